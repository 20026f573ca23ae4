//! The thread that talks to the Inverse service: a message a period, a frame an answer. It shares with the haptic loop only
//! the newest frame and the newest force, by wait-free exchange, and plays nothing where the loop or the service is silent.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::thread;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::internal::haptics::Fault;
use palpate::internal::haptics::servo_thread::raise_priority;
use palpate::scene::Dialect;
use palpate::scene::profile::Profile;
use triple_buffer::{Input, Output};

use super::kind::Identity;
use super::link::{Address, Link};
use super::protocol::{self, State};

/// Oldest state that is still true of the device, and the longest wait for an answer before the next message.
pub const STATE_LIFE: Duration = Duration::from_millis(50);
/// As many garbled frames in a row and the device counts as garbled.
pub const MANY_GARBLED: u32 = 5;
/// Oldest force of the loop that is still played.
pub const FORCE_LIFE: Duration = Duration::from_millis(20);
/// A connection without a usable state for so long is made anew.
const PATIENCE: Duration = Duration::from_secs(1);
/// Wait for the inventory of a new connection.
const INVENTORY_WAIT: Duration = Duration::from_millis(500);
/// Waits before a new connection: the first, doubled up to the last.
const FIRST_WAIT: Duration = Duration::from_millis(100);
const LAST_WAIT: Duration = Duration::from_secs(2);
/// Most answers that the service may owe, or may send unasked within a period.
const MOST_OWED: u32 = 16;

/// What the thread knows of the device.
#[derive(Debug, Clone, Default)]
pub struct Shot {
    /// The newest usable state, and when it came.
    pub state: Option<(Instant, State)>,
    /// Garbled frames since.
    pub garbled: u32,
    /// What went wrong since.
    pub trouble: Option<Fault>,
    /// Which device it is, once the service has said so; from then on it is this one and no other, which would be somewhere
    /// else and might bear less.
    pub identity: Option<Arc<Identity>>,
}

/// What the loop wants played.
#[derive(Debug, Clone, Default)]
pub struct Order {
    /// N, palpate's axes.
    pub force: DVec3,
    /// When it was written; `None`: never.
    pub written: Option<Instant>,
}

/// What has happened since the device was made.
#[derive(Debug, Default)]
pub struct Tally {
    pub frames: AtomicU64,
    pub garbled: AtomicU64,
    pub connections: AtomicU64,
    pub limited: AtomicU64,
    pub withheld: AtomicU64,
}

fn count(counter: &AtomicU64) {
    counter.fetch_add(1, Relaxed);
}

/// The thread's side.
pub struct Exchange {
    pub address: Address,
    /// Device to talk to where none was found before; `None`: the first.
    pub device_id: Option<String>,
    /// Dialect to speak; `None`: what the service's version asks for.
    pub dialect: Option<Dialect>,
    /// Of a message.
    pub period: Duration,
    /// A profile that lowers the device's own.
    pub asked: Option<&'static Profile>,
    /// Greatest force, N: that of the connected device's profile.
    pub max_force: f64,
    pub shots: Input<Shot>,
    pub orders: Output<Order>,
    pub stop: Arc<AtomicBool>,
    pub tally: Arc<Tally>,
    /// The newest that was published.
    pub shot: Shot,
}

/// One connection, to one device.
struct Partner {
    link: Link,
    device_id: String,
    dialect: Dialect,
}

impl Exchange {
    /// Connects, and connects again, until told to stop.
    pub fn run(mut self) {
        // The loop says where this is not permitted: it asks for the same.
        let _ = raise_priority();
        let mut wait = FIRST_WAIT;
        while !self.stopping() {
            let before = self.shot.state.map(|(at, _)| at);
            let Err(fault) = self.connection() else { return };
            let has_served = self.shot.state.map(|(at, _)| at) != before;
            self.report(fault);
            wait = if has_served { FIRST_WAIT } else { wait };
            // Cut short where the device is closed.
            thread::park_timeout(wait);
            wait = (2 * wait).min(LAST_WAIT);
        }
    }

    fn stopping(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// One connection from its first message to its last, which plays nothing, whatever happened between.
    fn connection(&mut self) -> Result<(), Fault> {
        let mut link = self.address.connect()?;
        count(&self.tally.connections);
        let inventory = link.receive(Instant::now() + INVENTORY_WAIT)?;
        let inventory = inventory.ok_or_else(|| Fault::Lost("the service sends no inventory".into()))?;
        let (identity, _) = protocol::find(&inventory, self.wanted())?;
        let device_id = identity.device_id.clone();
        self.max_force = identity.kind.profile(self.asked).max_force;
        match &self.shot.identity {
            Some(known) if **known != identity => {
                // Limits were chosen for what was there before.
                let (before, now) = (&known.kind, &identity.kind);
                let what = format!("the service reported {before} of {device_id:?} and now reports {now}");
                return Err(Fault::Lost(format!("{what}: end the session and begin another")));
            }
            Some(_) => {}
            None => self.shot.identity = Some(Arc::new(identity)),
        }
        let told = || link.version().and_then(|version| protocol::dialect_of(&version));
        let dialect = self.dialect.or_else(told).unwrap_or(Dialect::Vector);
        link.send(protocol::greeting(&device_id, dialect))?;
        let mut partner = Partner { link, device_id, dialect };
        let ended = self.ticks(&mut partner);
        // The first thing after a fault, and all that can be done where it fails too.
        let _ = self.play(&mut partner, DVec3::ZERO);
        partner.link.close();
        ended
    }

    /// The device that is asked for: the one that was found, or the user's.
    fn wanted(&self) -> Option<&str> {
        let found = self.shot.identity.as_ref().map(|identity| identity.device_id.as_str());
        found.or(self.device_id.as_deref())
    }

    /// A frame and a message a period, the greeting being sent.
    fn ticks(&mut self, partner: &mut Partner) -> Result<(), Fault> {
        let (mut due, mut sent) = (Instant::now(), Instant::now());
        let mut patience = sent;
        let mut owed = 1;
        while !self.stopping() {
            if let Some(text) = partner.link.receive(sent + STATE_LIFE)? {
                self.take(&text, &mut owed);
            } else {
                self.report(Fault::Lost(format!("the service is silent for {} ms", STATE_LIFE.as_millis())));
            }
            due = (due + self.period).max(Instant::now());
            thread::sleep(due.saturating_duration_since(Instant::now()));
            // Answers that came late: the newest counts.
            let mut late = 0;
            while let Some(text) = partner.link.receive(sent)? {
                self.take(&text, &mut owed);
                late += 1;
                if late > MOST_OWED {
                    return Err(Fault::Garbled("frames that nobody asked for".into()));
                }
            }
            patience = self.shot.state.map_or(patience, |(at, _)| at.max(patience));
            if owed >= MOST_OWED || patience.elapsed() > PATIENCE {
                return Err(Fault::Lost("the service does not keep up, or says nothing of use".into()));
            }
            sent = Instant::now();
            let force = self.force();
            self.play(partner, force)?;
            owed += 1;
        }
        Ok(())
    }

    /// Reads a frame.
    fn take(&mut self, text: &str, owed: &mut u32) {
        *owed = owed.saturating_sub(1);
        count(&self.tally.frames);
        match protocol::find(text, self.wanted()) {
            Ok((_, state)) => {
                self.shot.state = Some((Instant::now(), state));
                (self.shot.garbled, self.shot.trouble) = (0, None);
                self.shots.write(self.shot.clone());
            }
            Err(fault) => self.report(fault),
        }
    }

    fn report(&mut self, fault: Fault) {
        let url = self.address.url();
        self.shot.trouble = Some(match fault {
            Fault::Lost(why) => Fault::Lost(format!("{url}: {why}")),
            Fault::Garbled(why) => {
                count(&self.tally.garbled);
                self.shot.garbled += 1;
                Fault::Garbled(format!("{url}: {why}"))
            }
        });
        self.shots.write(self.shot.clone());
    }

    /// What the loop wants played, or nothing where it or the service is silent.
    fn force(&mut self) -> DVec3 {
        let order = self.orders.read();
        let is_seen = self.shot.state.is_some_and(|(at, _)| at.elapsed() <= STATE_LIFE);
        let is_meant = order.written.is_some_and(|at| at.elapsed() <= FORCE_LIFE);
        if is_seen && is_meant && self.shot.garbled < MANY_GARBLED {
            return order.force;
        }
        if order.force != DVec3::ZERO {
            count(&self.tally.withheld);
        }
        DVec3::ZERO
    }

    /// Sends a force, and never more than the device's greatest.
    fn play(&mut self, partner: &mut Partner, force: DVec3) -> Result<(), Fault> {
        let limited = if force.is_finite() { force.clamp_length_max(self.max_force) } else { DVec3::ZERO };
        if limited != force {
            count(&self.tally.limited);
        }
        partner.link.send(protocol::command(&partner.device_id, partner.dialect, limited))
    }
}
