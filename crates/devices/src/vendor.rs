//! Haptic devices that are driven through a library of their maker: [`Touch`] and [`ForceDimension`]. The library is
//! opened when the device is, so that palpate needs neither headers nor libraries of a maker to be built, and runs where
//! there are none. Known by the makers' documentation only: nobody has met a real device with this code.
//!
//! The library is called by a thread of its own (ours, or the scheduler of the library), so that the haptic loop never
//! waits for the device. Both share only the newest sample and the newest order, through wait-free triple buffers.

mod force_dimension;
mod library;
#[cfg(test)]
mod tests;
mod touch;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::{Duration, Instant};

use glam::DVec3;
use palpate::internal::haptics::device::{Device, Fault, Reading};
use palpate::scene::profile::Profile;
use palpate::{RigidState, Wrench};
use triple_buffer::{Input, Output, triple_buffer};

use force_dimension::Dhd;
use touch::OpenHaptics;

/// A Touch, Touch X or Phantom of 3D Systems, through OpenHaptics (`libHD`). Its torque is not driven. All devices of a
/// program share the library's scheduler, which stops for a moment whenever one of them is opened or closed; the others
/// command no force then.
pub type Touch = Vendor<OpenHaptics>;
/// An omega, delta, sigma or lambda of Force Dimension, or a Novint Falcon, through Force Dimension's SDK (`libdrd`).
/// Its gripper is not driven. The SDK's gravity compensation stays on: besides the commanded wrench it carries the
/// device's own weight, from the first commanded wrench on.
pub type ForceDimension = Vendor<Dhd>;

/// Longest time that opening waits for the device's first sample.
const OPEN_WAIT: Duration = Duration::from_secs(2);
/// Longest time that closing waits until the library's thread has commanded no force.
const CLOSE_WAIT: Duration = Duration::from_millis(200);
/// Greatest age of a sample that still counts as the device's present state.
const SAMPLE_LIFE: Duration = Duration::from_millis(50);
/// How long a device counts as lost after a fault: long enough for the haptic loop to see it, which then lets the force
/// return slowly.
const FAULT_LIFE: Duration = Duration::from_millis(50);
/// Rates at which the device may be sampled, Hz.
const RATES: std::ops::RangeInclusive<f64> = 50.0..=4000.0;
/// Greatest age of a wrench of the haptic loop that is still played, at least three periods of the loop; instead of an
/// older one, none is.
const ORDER_LIFE: Duration = Duration::from_millis(20);
const ORDER_PERIODS: u32 = 3;

/// How a device is found and used.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Which device: its name in the maker's configuration (Touch) or its serial number (Force Dimension); `None`: the
    /// first that the library finds.
    pub unit: Option<String>,
    /// File of the library; `None`: where the system's loader finds it. A scene cannot name it, since opening a library
    /// runs its code.
    pub library: Option<PathBuf>,
    /// World position given to the first reading, m; a later reading is this position plus the displacement of the
    /// device since the first reading.
    pub home: DVec3,
    /// Samples of the device a second, Hz: the rate of the haptic loop. The scheduler of OpenHaptics keeps its own.
    pub rate: f64,
    /// A profile whose limits count where they are lower than those of the device's own profile.
    pub profile: Option<&'static Profile>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { unit: None, library: None, home: DVec3::ZERO, rate: 1000.0, profile: None }
    }
}

/// A device that a library has opened.
#[derive(Debug, Clone, PartialEq)]
struct Found {
    /// What the library calls it, with its serial number if it has one.
    name: String,
    /// Limits and abilities of the device, and whether its type is known.
    profile: Profile,
    is_known: bool,
}

/// The newest measurement, in palpate's axes and SI units.
#[derive(Debug, Clone, Default)]
struct Sample {
    state: Option<(Instant, RigidState, u32)>,
    /// The last fault, until the device is well again.
    trouble: Option<Fault>,
}

/// The wrench that the haptic loop commands.
#[derive(Debug, Clone, Default)]
struct Order {
    wrench: Wrench,
    /// When it was written; `None`: never.
    written: Option<Instant>,
}

/// The library's end of the exchange with the haptic loop.
struct Desk {
    samples: Input<Sample>,
    orders: Output<Order>,
    /// Set when the device is to be closed: from then on no force is commanded.
    stop: Arc<AtomicBool>,
    /// Greatest force, N, and torque, N m, that may be commanded.
    most: [f64; 2],
    /// Time between two readings of the haptic loop, and the greatest age of a wrench that is played.
    period: Duration,
    order_life: Duration,
    sample: Sample,
    /// Until when the device is not well, after the last fault.
    ill_until: Option<Instant>,
}

impl Desk {
    fn is_stopping(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// Publishes a measurement.
    fn publish(&mut self, state: RigidState, buttons: u32) {
        self.sample.state = Some((Instant::now(), state, buttons));
        if self.ill_until.is_none_or(|until| Instant::now() > until) {
            self.sample.trouble = None;
        }
        self.samples.write(self.sample.clone());
    }

    /// Publishes a fault; the last measurement stays until it is too old.
    fn report(&mut self, fault: Fault) {
        self.report_for(FAULT_LIFE, fault);
    }

    /// Publishes a fault, after which the device is not well for `life`.
    fn report_for(&mut self, life: Duration, fault: Fault) {
        let until = Instant::now() + life;
        if self.ill_until.is_none_or(|before| before <= until) {
            (self.sample.trouble, self.ill_until) = (Some(fault), Some(until));
        }
        self.samples.write(self.sample.clone());
    }

    /// Whether the haptic loop commands the device now.
    fn is_commanded(&mut self) -> bool {
        self.orders.read().written.is_some_and(|at| at.elapsed() <= self.order_life)
    }

    /// The wrench to command now: the newest of the haptic loop within the limits, or none where it is too old, is not
    /// finite, or the device is not well.
    fn wrench(&mut self) -> Wrench {
        let order = self.orders.read().clone();
        let is_meant = order.written.is_some_and(|at| at.elapsed() <= self.order_life);
        let Wrench { force, torque } = order.wrench;
        if !is_meant || self.is_stopping() || self.sample.trouble.is_some() || !(force + torque).is_finite() {
            return Wrench::ZERO;
        }
        Wrench { force: force.clamp_length_max(self.most[0]), torque: torque.clamp_length_max(self.most[1]) }
    }
}

/// A maker's library with a device that it has opened.
trait Library: Sized + Send {
    /// What calls the library until it is dropped; then the device has no force, and is released.
    type Running: Send;
    /// What to do where no device is found.
    const REMEDY: &'static str;
    /// The profile with the lowest limits of the devices that the library knows.
    const SMALLEST: &'static Profile;

    /// Opens the library and a device, which exerts no force yet.
    fn open(settings: &Settings) -> Result<Self, Fault>;
    fn found(&self) -> Found;
    /// Begins to exchange samples and orders.
    fn begin(self, desk: Desk) -> Result<Self::Running, Fault>;
}

/// A device that is driven through the library `L`. Its profile follows from the type that the library reports; a type
/// that is not known gets the lowest limits of the maker's devices, and so has the device before it is found.
#[allow(private_bounds)]
pub struct Vendor<L: Library> {
    settings: Settings,
    profile: Profile,
    /// The device that was found first; from then on any other is refused.
    found: Option<Found>,
    line: Option<Line<L::Running>>,
    /// Whether [`Vendor::identify`] has opened the device.
    is_identified: bool,
}

/// The haptic loop's end of the exchange.
struct Line<R> {
    samples: Output<Sample>,
    orders: Input<Order>,
    stop: Arc<AtomicBool>,
    /// World position of the device's origin, m.
    offset: DVec3,
    /// When the last wrench was written, and after what time the next one is too late.
    written: Option<Instant>,
    order_life: Duration,
    /// Kept for its end, which releases the device.
    _running: R,
}

#[allow(private_bounds)]
impl<L: Library> Vendor<L> {
    /// A device that is not open yet; the library is not opened here.
    pub fn new(settings: Settings) -> Vendor<L> {
        Vendor { settings, profile: L::SMALLEST.clone(), found: None, line: None, is_identified: false }
    }

    /// Opens the device without exerting a force, to learn its type and thereby its profile; [`Device::open`] then goes
    /// on with it, since libraries may need long to release a device. A caller that takes limits from
    /// [`Device::profile`] before [`Device::open`] must call this first; otherwise it gets the smallest limits.
    ///
    /// # Errors
    /// The errors of [`Device::open`].
    pub fn identify(&mut self) -> Result<(), Fault> {
        self.open()?;
        self.is_identified = true;
        Ok(())
    }

    /// Whether the device that [`Vendor::identify`] has opened is well; its present place becomes home.
    fn goes_on(&mut self) -> bool {
        let (home, is_identified) = (self.settings.home, std::mem::take(&mut self.is_identified));
        let Some(line) = self.line.as_mut().filter(|_| is_identified) else { return false };
        let sample = line.samples.read();
        let Some((at, state, _)) = sample.state.filter(|_| sample.trouble.is_none()) else { return false };
        line.offset = home - state.position;
        at.elapsed() <= SAMPLE_LIFE
    }

    fn line(&mut self) -> Result<&mut Line<L::Running>, Fault> {
        self.line.as_mut().ok_or_else(|| Fault::Lost("the device is not open".into()))
    }

    /// The profile for a device: its own, with the lower of each limit of the one that was asked for.
    fn granted(&self, found: &Found) -> Profile {
        self.settings.profile.map_or_else(|| found.profile.clone(), |asked| found.profile.lowered_by(asked))
    }
}

impl<L: Library> Device for Vendor<L> {
    /// Opens the library and the device, and waits for its first sample, 2 s at most. If a device was found before, any
    /// other is refused.
    fn open(&mut self) -> Result<(), Fault> {
        if self.goes_on() {
            return Ok(());
        }
        self.close();
        let rate = self.settings.rate;
        if !RATES.contains(&rate) {
            return Err(Fault::Lost(format!("{rate} samples a second are not possible: use a rate of 50 to 4000 Hz")));
        }
        let library = L::open(&self.settings)?;
        let found = library.found();
        if let Some(before) = self.found.as_ref().filter(|before| **before != found) {
            let what = format!("the library found {} before, and now {}", before.name, found.name);
            return Err(Fault::Lost(format!("{what}: end the session and begin another")));
        }
        self.profile = self.granted(&found);
        self.found = Some(found);
        let (input, samples) = triple_buffer(&Sample::default());
        let (orders, output) = triple_buffer(&Order::default());
        let stop = Arc::new(AtomicBool::new(false));
        let period = Duration::from_secs_f64(1.0 / rate);
        let order_life = ORDER_LIFE.max(ORDER_PERIODS * period);
        let desk = Desk {
            samples: input,
            orders: output,
            stop: stop.clone(),
            most: [self.profile.max_force, self.profile.max_torque],
            period,
            order_life,
            sample: Sample::default(),
            ill_until: None,
        };
        let running = library.begin(desk)?;
        let line = Line { samples, orders, stop, offset: DVec3::ZERO, written: None, order_life, _running: running };
        let line = self.line.insert(line);
        let started = Instant::now();
        while started.elapsed() < OPEN_WAIT {
            if let Some((_, first, _)) = line.samples.read().state {
                line.offset = self.settings.home - first.position;
                return Ok(());
            }
            thread::sleep(Duration::from_millis(1));
        }
        let trouble = match &line.samples.read().trouble {
            Some(Fault::Lost(why) | Fault::Garbled(why)) => why.clone(),
            None => "the library called nothing".into(),
        };
        self.close();
        Err(Fault::Lost(format!("no sample within {} s ({trouble}): {}", OPEN_WAIT.as_secs(), L::REMEDY)))
    }

    fn profile(&self) -> &Profile {
        &self.profile
    }

    fn notes(&self) -> Vec<String> {
        let Some(found) = &self.found else { return Vec::new() };
        let mut notes = vec![format!("the device is {}; this driver has never met a real one", found.name)];
        if !found.is_known {
            notes.push(format!(
                "its type is not known, so that it gets the lowest limits, those of the profile {} (greatest force {} N)",
                self.profile.name, self.profile.max_force
            ));
        }
        if let Some(asked) = self.settings.profile.filter(|asked| !asked.is_within(&found.profile)) {
            let (asked, own) = (asked.name, self.profile.name);
            notes.push(format!("of the profile {asked} those limits are used that lie below the device's own ({own})"));
        }
        notes
    }

    /// Returns the newest sample without waiting.
    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let line = self.line()?;
        let sample = line.samples.read();
        let age = sample.state.map(|(at, ..)| at.elapsed());
        let (Some((_, mut state, buttons)), Some(age)) = (sample.state, age.filter(|age| *age <= SAMPLE_LIFE)) else {
            let silent = || Fault::Lost(format!("no sample of the device for {} ms", SAMPLE_LIFE.as_millis()));
            return Err(sample.trouble.clone().unwrap_or_else(silent));
        };
        if let Some(trouble) = &sample.trouble {
            return Err(trouble.clone());
        }
        state.position += line.offset;
        Ok(Reading { time: time - age.as_secs_f64(), state, buttons })
    }

    /// Hands the wrench to the library's thread. Does not wait. If no other follows within 20 ms (three periods, if that is
    /// more), none is played. The wrench after such a pause is not played either, and is a fault, so that the haptic
    /// loop lets the force return slowly.
    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        let line = self.line()?;
        let now = Instant::now();
        let is_late = line.written.is_some_and(|last| now - last > line.order_life);
        line.written = Some(now);
        let wrench = if is_late { Wrench::ZERO } else { *wrench };
        line.orders.write(Order { wrench, written: Some(now) });
        let late = || Fault::Lost("no wrench was commanded for so long that the device plays none".into());
        if is_late { Err(late()) } else { Ok(()) }
    }

    fn close(&mut self) {
        if let Some(line) = self.line.take() {
            line.stop.store(true, Relaxed);
        }
    }
}

impl<L: Library> Drop for Vendor<L> {
    fn drop(&mut self) {
        self.close();
    }
}
