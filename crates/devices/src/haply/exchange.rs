//! The thread that talks to Haply's Inverse service, a program on the same machine that passes forces to Haply's haptic
//! devices: each period it sends a message with a force and reads a *frame*, the service's JSON text with the state of
//! the device. It shares with the haptic loop only the newest state and the newest force, through wait-free triple
//! buffers, and sends zero force where the loop or the service is silent.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::thread;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::internal::haptics::Fault;
use palpate::internal::haptics::servo_thread::raise_priority;
use palpate::scene::profile::Profile;
use palpate::scene::{Dialect, HaplyService};
use triple_buffer::{Input, Output};

use super::kind::Identity;
use super::link::{Address, Link};
use super::protocol::{self, State};

/// Greatest age of a state that still counts as the device's present one, and the longest wait for an answer before the
/// next message is sent.
pub const STATE_LIFE: Duration = Duration::from_millis(50);
/// Number of garbled (malformed or implausible) frames in a row after which reading the device is a fault.
pub const MANY_GARBLED: u32 = 5;
/// Greatest age of a force from the haptic loop that is still sent, at least three periods of the loop; instead of an
/// older force, zero is sent.
pub const FORCE_LIFE: Duration = Duration::from_millis(20);
const FORCE_PERIODS: u32 = 3;
/// A connection that gives no usable state for this long is replaced by a new one.
const PATIENCE: Duration = Duration::from_secs(1);
/// Longest wait for a new connection's inventory, the first frame, which lists the devices.
const INVENTORY_WAIT: Duration = Duration::from_millis(500);
/// Pause before another connection is tried; it doubles after each failure, up to `LAST_WAIT`.
const FIRST_WAIT: Duration = Duration::from_millis(100);
const LAST_WAIT: Duration = Duration::from_secs(2);
/// Number of unanswered messages at which a connection is given up; also the greatest number of frames that may arrive
/// within a period besides the awaited one.
const MOST_OWED: u32 = 16;

/// What the thread knows of the device at a moment; the haptic loop reads the newest such record.
#[derive(Debug, Clone, Default)]
pub struct Shot {
    /// The newest usable state, and when it arrived.
    pub state: Option<(Instant, State)>,
    /// Number of garbled frames since that state arrived.
    pub garbled: u32,
    /// The last fault since that state arrived.
    pub trouble: Option<Fault>,
    /// Identity of the device, once the service has reported it. From then on any other device is refused, because it
    /// would be at another position and might bear less force.
    pub identity: Option<Arc<Identity>>,
}

/// The force that the haptic loop commands.
#[derive(Debug, Clone, Default)]
pub struct Order {
    /// Force, N, in palpate's axes (y up).
    pub force: DVec3,
    /// When the force was written; `None`: never.
    pub written: Option<Instant>,
}

/// Numbers of events since the `Haply` (the device in `mod.rs`) was made; its `Counts` explains each of them.
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

/// The thread's side of the exchange of states and forces with the haptic loop.
pub struct Exchange {
    pub address: Address,
    /// Id of the device to look for, used until a device has been found; `None`: the first device that the service
    /// lists.
    pub device_id: Option<String>,
    /// Id of the grip that counts; `None`: the first that is awake.
    pub grip: Option<String>,
    /// Dialect (key under which a force is written) to use; `None`: the one that the service's version asks for.
    pub dialect: Option<Dialect>,
    /// Time from one message to the next.
    pub period: Duration,
    /// Profile (limits of force, workspace and so on) that the user asks for; it can only lower the limits of the
    /// device's own profile.
    pub asked: Option<&'static Profile>,
    /// Greatest force that may be sent, N: that of the connected device's profile.
    pub max_force: f64,
    pub shots: Input<Shot>,
    pub orders: Output<Order>,
    pub stop: Arc<AtomicBool>,
    pub tally: Arc<Tally>,
    /// The record that was published last through `shots`.
    pub shot: Shot,
}

/// One connection, to one device.
struct Partner {
    link: Link,
    device_id: String,
    dialect: Dialect,
}

impl Exchange {
    /// Connects, and reconnects whenever a connection ends, until `stop` is set.
    pub fn run(mut self) {
        // A failure is ignored here: the haptic loop asks for the same priority and tells the user if it is not
        // permitted.
        let _ = raise_priority();
        let mut wait = FIRST_WAIT;
        while !self.stopping() {
            let before = self.shot.state.map(|(at, _)| at);
            let Err(fault) = self.connection() else { return };
            let has_served = self.shot.state.map(|(at, _)| at) != before;
            self.report(fault);
            wait = if has_served { FIRST_WAIT } else { wait };
            // `Haply::close` ends this pause early.
            thread::park_timeout(wait);
            wait = (2 * wait).min(LAST_WAIT);
        }
    }

    fn stopping(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// Runs one connection from its first message to its last, which always commands zero force.
    fn connection(&mut self) -> Result<(), Fault> {
        let mut link = self.address.connect()?;
        count(&self.tally.connections);
        let inventory = link.receive(Instant::now() + INVENTORY_WAIT)?;
        let inventory = inventory.ok_or_else(|| Fault::Lost("the service sent no list of its devices".into()))?;
        let (identity, _) = protocol::find(&inventory, self.wanted(), self.grip.as_deref())?;
        // After a fault of the service the device goes on without its grip, until that is back.
        let is_first = self.shot.identity.is_none();
        if let Some(grip) = self.grip.as_deref().filter(|grip| is_first && *grip != HaplyService::NO_GRIP) {
            protocol::find_grip(&inventory, grip)?;
        }
        let device_id = identity.device_id.clone();
        self.max_force = identity.kind.profile(self.asked).max_force;
        match &self.shot.identity {
            Some(known) if **known != identity => {
                // The limits in use were chosen for the device that was found before.
                let (before, now) = (&known.kind, &identity.kind);
                let what = format!("the service reported {before} for {device_id:?}, and now reports {now}");
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
        // After a fault zero force is sent at once; where this fails too, nothing more can be done.
        let _ = self.play(&mut partner, DVec3::ZERO);
        partner.link.close();
        ended
    }

    /// Id of the device to look for: the one that was found before, or else the one that the user names.
    fn wanted(&self) -> Option<&str> {
        let found = self.shot.identity.as_ref().map(|identity| identity.device_id.as_str());
        found.or(self.device_id.as_deref())
    }

    /// Reads a frame and sends a message each period until `stop` is set. The greeting, which is the first message,
    /// must have been sent before.
    fn ticks(&mut self, partner: &mut Partner) -> Result<(), Fault> {
        let (mut due, mut sent) = (Instant::now(), Instant::now());
        let mut patience = sent;
        let mut owed = 1;
        while !self.stopping() {
            if let Some(text) = partner.link.receive(sent + STATE_LIFE)? {
                self.take(&text, &mut owed);
            } else {
                self.report(Fault::Lost(format!("the service has been silent for {} ms", STATE_LIFE.as_millis())));
            }
            due = (due + self.period).max(Instant::now());
            thread::sleep(due.saturating_duration_since(Instant::now()));
            // Answers that came late are read here; the newest one counts.
            let mut late = 0;
            while let Some(text) = partner.link.receive(sent)? {
                self.take(&text, &mut owed);
                late += 1;
                if late > MOST_OWED {
                    return Err(Fault::Garbled("the service sends unrequested frames".into()));
                }
            }
            patience = self.shot.state.map_or(patience, |(at, _)| at.max(patience));
            if owed >= MOST_OWED || patience.elapsed() > PATIENCE {
                return Err(Fault::Lost("the service falls behind, or sends no usable state".into()));
            }
            sent = Instant::now();
            let force = self.force();
            self.play(partner, force)?;
            owed += 1;
        }
        Ok(())
    }

    /// Publishes the state that a frame contains, or a fault if the frame contains no usable state.
    fn take(&mut self, text: &str, owed: &mut u32) {
        *owed = owed.saturating_sub(1);
        count(&self.tally.frames);
        match protocol::find(text, self.wanted(), self.grip.as_deref()) {
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

    /// The force to send: the haptic loop's newest force, or zero where the loop or the service is silent.
    fn force(&mut self) -> DVec3 {
        let order = self.orders.read();
        let is_seen = self.shot.state.is_some_and(|(at, _)| at.elapsed() <= STATE_LIFE);
        let is_meant = order.written.is_some_and(|at| at.elapsed() <= FORCE_LIFE.max(FORCE_PERIODS * self.period));
        if is_seen && is_meant && self.shot.garbled < MANY_GARBLED {
            return order.force;
        }
        if order.force != DVec3::ZERO {
            count(&self.tally.withheld);
        }
        DVec3::ZERO
    }

    /// Sends a force, shortened to the greatest force that the device's profile allows.
    fn play(&mut self, partner: &mut Partner, force: DVec3) -> Result<(), Fault> {
        let limited = if force.is_finite() { force.clamp_length_max(self.max_force) } else { DVec3::ZERO };
        if limited != force {
            count(&self.tally.limited);
        }
        partner.link.send(protocol::command(&partner.device_id, partner.dialect, limited))
    }
}
