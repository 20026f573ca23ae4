//! The Haply Inverse3 and Minverse, through the Inverse service's WebSocket. Spoken over `tungstenite` and not over the crate `haply`
//! (1.3): that holds 1 kHz too, but takes messages of up to 64 MiB and what it can save of malformed ones, speaks to
//! service 3.5 only, and spins without end once a connection has ended.

mod exchange;
#[cfg(test)]
mod fake;
#[cfg(test)]
mod faults;
mod kind;
mod link;
mod protocol;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use palpate::internal::haptics::device::{Device, Fault, Reading};
use palpate::scene::HaplyService;
use palpate::scene::profile::{HAPLY_SMALLEST, Profile};
use palpate::{RigidState, Wrench};
use triple_buffer::{Input, Output, triple_buffer};

use exchange::{Exchange, MANY_GARBLED, Order, STATE_LIFE, Shot, Tally};
use kind::Identity;
use link::Address;

/// Longest wait for the first state.
const OPEN_WAIT: Duration = Duration::from_secs(2);
/// Longest wait for the thread's end; it ends by itself where it takes longer.
const CLOSE_WAIT: Duration = Duration::from_millis(200);
/// Rates at which the service can be asked, Hz.
const RATES: std::ops::RangeInclusive<f64> = 50.0..=4000.0;

/// Where the service is, and how it is used.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The service.
    pub service: HaplyService,
    /// World position of the first reading, m; the others lie about it as they do in the hand.
    pub home: DVec3,
    /// Messages a second, that of the loop: 50 to 4000 Hz.
    pub rate: f64,
    /// A profile of Haply's to stay within; one that is above the device's own has no effect.
    pub profile: Option<&'static Profile>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { service: HaplyService::default(), home: DVec3::ZERO, rate: 1000.0, profile: None }
    }
}

/// What has happened since the device was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames that came.
    pub frames: u64,
    /// Of them, and of connections, those that were refused as implausible.
    pub garbled: u64,
    /// Connections made.
    pub connections: u64,
    /// Forces that were beyond the profile's greatest or not finite, and were sent as it or as nothing.
    pub limited: u64,
    /// Forces that were not sent, the loop or the service having been silent.
    pub withheld: u64,
}

/// A device of Haply's. Its type, which the service reports, decides its profile: until it is known, and where this version
/// does not know it, that is the smallest of all. Orientation and buttons are those of a Verse grip that the service lists; without one the orientation
/// is the identity. A grip's angular velocity is not known, and read as zero.
pub struct Haply {
    settings: Settings,
    profile: Profile,
    /// The device that was found when it was identified or opened first; from then on it is this one and no other.
    identity: Option<Arc<Identity>>,
    tally: Arc<Tally>,
    line: Option<Line>,
}

/// The loop's side of the exchange.
struct Line {
    shots: Output<Shot>,
    orders: Input<Order>,
    stop: Arc<AtomicBool>,
    handle: JoinHandle<()>,
    url: String,
    /// From the device's origin to the world's, m.
    offset: DVec3,
    /// The grip's newest, held where it falls asleep.
    orientation: DQuat,
}

impl Haply {
    /// A device that is not open yet; nothing is asked of the service.
    pub fn new(settings: Settings) -> Haply {
        Haply { settings, profile: HAPLY_SMALLEST, identity: None, tally: Arc::default(), line: None }
    }

    /// Finds out which device the service has, so that its profile holds before it is opened; plays nothing, and closes it
    /// again. Who takes limits from [`Device::profile`] before [`Device::open`] calls this first: the smallest are taken
    /// otherwise.
    ///
    /// # Errors
    /// As [`Device::open`].
    pub fn identify(&mut self) -> Result<(), Fault> {
        self.open()?;
        self.close();
        Ok(())
    }

    /// What has happened so far.
    pub fn counts(&self) -> Counts {
        let tally = &*self.tally;
        Counts {
            frames: tally.frames.load(Relaxed),
            garbled: tally.garbled.load(Relaxed),
            connections: tally.connections.load(Relaxed),
            limited: tally.limited.load(Relaxed),
            withheld: tally.withheld.load(Relaxed),
        }
    }

    fn start(&self) -> Result<Line, Fault> {
        let address = Address::new(&self.settings.service.url, self.settings.service.trust_remote)?;
        let rate = self.settings.rate;
        if !RATES.contains(&rate) {
            return Err(Fault::Lost(format!("a rate of {rate} Hz: use 50 to 4000")));
        }
        let (shot_input, shots) = triple_buffer(&Shot::default());
        let (orders, order_output) = triple_buffer(&Order::default());
        let stop = Arc::new(AtomicBool::new(false));
        let url = address.url().to_string();
        let exchange = Exchange {
            address,
            device_id: self.settings.service.device_id.clone(),
            dialect: self.settings.service.dialect,
            period: Duration::from_secs_f64(1.0 / rate),
            asked: self.settings.profile,
            max_force: HAPLY_SMALLEST.max_force,
            shots: shot_input,
            orders: order_output,
            stop: stop.clone(),
            tally: self.tally.clone(),
            shot: Shot { identity: self.identity.clone(), ..Shot::default() },
        };
        let spawned = thread::Builder::new().name("haply".into()).spawn(move || exchange.run());
        let handle = spawned.map_err(|e| Fault::Lost(format!("no thread for it: {e}")))?;
        Ok(Line { shots, orders, stop, handle, url, offset: DVec3::ZERO, orientation: DQuat::IDENTITY })
    }
}

impl Device for Haply {
    /// Connects and waits for the first state, 2 s at most. Another device than the one found before is refused.
    fn open(&mut self) -> Result<(), Fault> {
        self.close();
        let line = self.line.insert(self.start()?);
        let started = Instant::now();
        while started.elapsed() < OPEN_WAIT {
            if let Shot { state: Some((_, first)), identity: Some(identity), .. } = line.shots.read() {
                line.offset = self.settings.home - first.position;
                self.profile = identity.kind.profile(self.settings.profile).clone();
                self.profile.senses_rotation = first.orientation.is_some();
                self.identity = Some(identity.clone());
                return Ok(());
            }
            thread::sleep(Duration::from_millis(1));
        }
        let trouble = match &line.shots.read().trouble {
            Some(Fault::Lost(why) | Fault::Garbled(why)) => why.clone(),
            None => format!("{}: no answer", line.url),
        };
        self.close();
        let remedy = "start the Inverse service with an Inverse3 or a Minverse plugged in, or check the address";
        Err(Fault::Lost(format!("no state in {} s ({trouble}): {remedy}", OPEN_WAIT.as_secs())))
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn notes(&self) -> Vec<String> {
        self.identity.as_ref().map_or_else(Vec::new, |identity| identity.kind.notes(self.settings.profile))
    }

    /// The newest state. Never waits.
    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let line = self.line.as_mut().ok_or_else(closed)?;
        let shot = line.shots.read();
        let age = shot.state.map(|(at, _)| at.elapsed());
        let (Some((_, state)), Some(age)) = (shot.state, age.filter(|age| *age <= STATE_LIFE)) else {
            let silent = || Fault::Lost(format!("no state from {} for {} ms", line.url, STATE_LIFE.as_millis()));
            return Err(shot.trouble.clone().unwrap_or_else(silent));
        };
        match &shot.trouble {
            Some(trouble) if shot.garbled >= MANY_GARBLED => return Err(trouble.clone()),
            _ => {}
        }
        line.orientation = state.orientation.unwrap_or(line.orientation);
        let mut rigid = RigidState::at_rest(line.offset + state.position, line.orientation);
        rigid.velocity = state.velocity;
        Ok(Reading { time: time - age.as_secs_f64(), state: rigid, buttons: state.buttons })
    }

    /// The force goes out with the thread's next message; the torque is not played. Never waits. A force that is not
    /// followed by another within 20 ms is followed by nothing.
    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        let line = self.line.as_mut().ok_or_else(closed)?;
        line.orders.write(Order { force: wrench.force, written: Some(Instant::now()) });
        Ok(())
    }

    fn close(&mut self) {
        let Some(line) = self.line.take() else { return };
        line.stop.store(true, Relaxed);
        line.handle.thread().unpark();
        let asked = Instant::now();
        while !line.handle.is_finished() && asked.elapsed() < CLOSE_WAIT {
            thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Drop for Haply {
    fn drop(&mut self) {
        self.close();
    }
}

fn closed() -> Fault {
    Fault::Lost("it is not open".into())
}
