//! Haply's haptic devices Inverse3 and Minverse, through the WebSocket of Haply's Inverse service, a program on the
//! same machine that sends *frames* (JSON texts with the devices' state) and takes forces. A thread of its own, the
//! *exchange thread* (`exchange.rs`), talks to the service, so that the haptic loop never waits for it. The protocol is
//! implemented here on the crate `tungstenite`. Haply's own crate `haply` (1.3) reaches 1 kHz too, but it accepts
//! messages of up to 64 MiB and parts of malformed ones, supports version 3.5 of the service only, and loops for ever
//! once a connection has ended.

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

/// Position, m, and velocity, m/s, that a message of the service gives; `None` where it is refused. For fuzzing.
#[doc(hidden)]
pub fn read_message(text: &str) -> Option<[DVec3; 2]> {
    protocol::find(text, None, None).ok().map(|(_, state)| [state.position, state.velocity])
}

/// Longest time that [`Haply::open`](Device::open) waits for the device's first state.
const OPEN_WAIT: Duration = Duration::from_secs(2);
/// Longest time that closing waits for the end of the exchange thread; a slower thread ends by itself later.
const CLOSE_WAIT: Duration = Duration::from_millis(200);
/// Rates at which messages may be exchanged with the service, Hz.
const RATES: std::ops::RangeInclusive<f64> = 50.0..=4000.0;

/// Settings of the connection: where the service is, and how it is used.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Address of the service, id of the device there, and JSON key under which the service expects forces.
    pub service: HaplyService,
    /// World position given to the first reading, m; a later reading is this position plus the displacement of the
    /// device since the first reading.
    pub home: DVec3,
    /// Messages exchanged with the service per second, Hz, from 50 to 4000: the rate of the haptic loop.
    pub rate: f64,
    /// A Haply profile (limits of a device) to be used, provided that it exceeds no limit of the device's own profile;
    /// otherwise the device's own profile is used.
    pub profile: Option<&'static Profile>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { service: HaplyService::default(), home: DVec3::ZERO, rate: 1000.0, profile: None }
    }
}

/// Numbers of events since this [`Haply`] was made.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames received.
    pub frames: u64,
    /// Frames that were refused as malformed or implausible, and connections that were ended because of bad messages.
    pub garbled: u64,
    /// Connections made.
    pub connections: u64,
    /// Forces greater than the profile allows, which were shortened to the greatest force allowed, and forces that were
    /// not finite, which were replaced with zero.
    pub limited: u64,
    /// Forces that were replaced with zero because the haptic loop or the service had been silent for too long.
    pub withheld: u64,
}

/// A haptic device of Haply. Its profile follows from the device type that the service reports; it is the Haply profile
/// with the lowest limits as long as the service has reported no type, or if this version of palpate does not know the
/// type. Orientation and buttons come from a Verse grip (a handle that senses orientation) that the service lists;
/// without a grip the orientation is the identity. The angular velocity of a grip is not known, and is reported as
/// zero.
pub struct Haply {
    settings: Settings,
    profile: Profile,
    /// Identity of the device that was found first, by [`Haply::identify`] or on opening; from then on any other device
    /// is refused.
    identity: Option<Arc<Identity>>,
    tally: Arc<Tally>,
    line: Option<Line>,
}

/// The haptic loop's end of the connection to the exchange thread.
struct Line {
    shots: Output<Shot>,
    orders: Input<Order>,
    stop: Arc<AtomicBool>,
    handle: JoinHandle<()>,
    url: String,
    /// World position of the device's origin, m.
    offset: DVec3,
    /// The newest orientation of the grip; it stays in use while the grip sleeps.
    orientation: DQuat,
}

impl Haply {
    /// A device that is not open yet; the service is not contacted here.
    pub fn new(settings: Settings) -> Haply {
        Haply { settings, profile: HAPLY_SMALLEST, identity: None, tally: Arc::default(), line: None }
    }

    /// Opens and closes the device without exerting a force, to learn its type and thereby its profile. A caller that
    /// takes limits from [`Device::profile`] before [`Device::open`] must call this first; otherwise it gets the
    /// smallest limits.
    ///
    /// # Errors
    /// The errors of [`Device::open`].
    pub fn identify(&mut self) -> Result<(), Fault> {
        self.open()?;
        self.close();
        Ok(())
    }

    /// The counts so far.
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
            return Err(Fault::Lost(format!(
                "{rate} messages per second are not possible: use a rate of 50 to 4000 Hz"
            )));
        }
        let (shot_input, shots) = triple_buffer(&Shot::default());
        let (orders, order_output) = triple_buffer(&Order::default());
        let stop = Arc::new(AtomicBool::new(false));
        let url = address.url().to_string();
        let exchange = Exchange {
            address,
            device_id: self.settings.service.device_id.clone(),
            grip: self.settings.service.grip.clone(),
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
        let handle = spawned.map_err(|e| Fault::Lost(format!("the thread for the service cannot be started: {e}")))?;
        Ok(Line { shots, orders, stop, handle, url, offset: DVec3::ZERO, orientation: DQuat::IDENTITY })
    }
}

impl Device for Haply {
    /// Connects to the service and waits for the device's first state, 2 s at most. If a device was found before, any
    /// other device is refused.
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
        Err(Fault::Lost(format!("no device state within {} s ({trouble}): {remedy}", OPEN_WAIT.as_secs())))
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn notes(&self) -> Vec<String> {
        let mut notes =
            self.identity.as_ref().map_or_else(Vec::new, |identity| identity.kind.notes(self.settings.profile));
        if let Some(grip) = self.settings.service.grip.as_deref().filter(|grip| *grip != HaplyService::NO_GRIP)
            && self.identity.is_some()
            && !self.profile.senses_rotation
        {
            let remedy = "if it sleeps, press one of its buttons";
            notes.push(format!("the grip {grip} gives no orientation yet, and turns nothing until it does: {remedy}"));
        }
        notes
    }

    /// Returns the newest state without waiting.
    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let line = self.line.as_mut().ok_or_else(closed)?;
        let shot = line.shots.read();
        let age = shot.state.map(|(at, _)| at.elapsed());
        let (Some((_, state)), Some(age)) = (shot.state, age.filter(|age| *age <= STATE_LIFE)) else {
            let silent = || Fault::Lost(format!("no device state from {} for {} ms", line.url, STATE_LIFE.as_millis()));
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

    /// Hands the force to the exchange thread, which sends it with its next message; the torque is ignored. Does not
    /// wait. If no other force follows within 20 ms, the exchange thread sends zero.
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
    Fault::Lost("the device is not open".into())
}
