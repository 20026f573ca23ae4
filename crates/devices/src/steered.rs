//! Haptic devices that play no force: a SpaceMouse, a game pad, a controller of a virtual-reality system. Their user
//! steers a goal, which the device follows as [`Mouse`] follows one. A thread of each device reads the hardware, so
//! that the haptic loop never waits for it, and opens the hardware again where it was lost.

#[cfg(target_os = "linux")]
mod game_pad;
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
mod openxr;
#[cfg(target_os = "linux")]
mod space_mouse;
#[cfg(test)]
mod tests;

use std::sync::atomic::Ordering::Relaxed;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};
use palpate::Wrench;
use palpate::internal::haptics::{Device, Fault, Reading};
use palpate::scene::profile::MOUSE;
use palpate::scene::{DeviceKind, Profile};

use crate::mouse::{CATCH_UP, Goal, Mouse};

/// Speed (m/s) and angular speed (rad/s) of the goal along and about an axis, where a control is pushed as far as it
/// goes. They grow as the square of the push, so that small pushes move finely.
const SPEEDS: [f64; 2] = [0.1, 1.5];
/// How long hardware waits for news at most.
const WAIT: Duration = Duration::from_millis(100);
/// Time since the hardware last answered after which it counts as lost.
const SILENCE: Duration = Duration::from_millis(500);
/// Time between two attempts to open hardware that was lost.
const RETRY: Duration = Duration::from_millis(500);
/// How long closing waits for the thread, which is left to itself then.
const CLOSING: Duration = Duration::from_millis(500);

/// What a user asks for by the controls, and what is felt: shared by the thread that reads the hardware and the device.
struct Steering {
    goal: Goal,
    /// Velocity (m/s), then angular velocity (rad/s) of the goal, along the axes of the world, as the bits of f64.
    velocities: [AtomicU64; 6],
    /// Pressed buttons, one bit each.
    buttons: AtomicU32,
    /// Magnitude of the force that the user would feel, N, as the bits of an f64.
    force: AtomicU64,
    is_lost: AtomicBool,
    /// Why the hardware is lost.
    why: Mutex<String>,
    begin: Instant,
    /// When the hardware last answered, ms since `begin`.
    answered: AtomicU64,
    ends: AtomicBool,
}

impl Steering {
    fn new(goal: Goal) -> Steering {
        Steering {
            goal,
            velocities: Default::default(),
            buttons: AtomicU32::new(0),
            force: AtomicU64::new(0),
            is_lost: AtomicBool::new(false),
            why: Mutex::default(),
            begin: Instant::now(),
            answered: AtomicU64::new(0),
            ends: AtomicBool::new(false),
        }
    }

    /// Asks for a velocity (m/s) and an angular velocity (rad/s), along the axes of the world: right, up, towards the
    /// user.
    fn ask(&self, [velocity, angular_velocity]: [DVec3; 2]) {
        let numbers = velocity.to_array().into_iter().chain(angular_velocity.to_array());
        self.velocities.iter().zip(numbers).for_each(|(cell, x)| cell.store(x.to_bits(), Relaxed));
    }

    fn velocities(&self) -> [DVec3; 2] {
        let x = self.velocities.each_ref().map(|cell| f64::from_bits(cell.load(Relaxed)));
        [DVec3::new(x[0], x[1], x[2]), DVec3::new(x[3], x[4], x[5])]
    }

    /// Strength of a vibration that shows the force, from 0 to 1 at the greatest force of the profile. It grows as the
    /// root, since motors do not turn where they are asked for little.
    fn strength(&self) -> f64 {
        (f64::from_bits(self.force.load(Relaxed)) / MOUSE.max_force).min(1.0).sqrt()
    }

    /// Notes that the hardware is lost, and why. Then nobody pushes its controls.
    fn lose(&self, why: String) {
        self.ask([DVec3::ZERO; 2]);
        self.buttons.store(0, Relaxed);
        *self.why.lock().unwrap_or_else(PoisonError::into_inner) = why;
        self.is_lost.store(true, Relaxed);
    }

    fn find_again(&self) {
        self.is_lost.store(false, Relaxed);
    }

    fn note_answer(&self) {
        self.answered.store(self.begin.elapsed().as_millis() as u64, Relaxed);
    }

    /// Whether the hardware is there.
    ///
    /// # Errors
    /// Why it is lost.
    fn check(&self) -> Result<(), Fault> {
        if self.is_lost.load(Relaxed) {
            // Where the thread is just writing the words, this reading goes without them.
            return Err(Fault::Lost(self.why.try_lock().map(|why| why.clone()).unwrap_or_default()));
        }
        let silent = self.begin.elapsed().saturating_sub(Duration::from_millis(self.answered.load(Relaxed)));
        match silent > SILENCE {
            true => Err(Fault::Lost(format!("its driver has not answered for {} ms", silent.as_millis()))),
            false => Ok(()),
        }
    }
}

/// Velocity and angular velocity that controls ask for which are pushed by shares of their ways, from -1 to 1. Below
/// the share `dead` a control counts as released.
fn speeds(pushes: [DVec3; 2], dead: f64) -> [DVec3; 2] {
    let speed = |push: f64| {
        let above = (push.abs().min(1.0) - dead).max(0.0) / (1.0 - dead);
        above * above * push.signum()
    };
    [0, 1].map(|k| SPEEDS[k] * DVec3::from_array(pushes[k].to_array().map(speed)))
}

/// Why hardware is lost.
enum Loss {
    /// It may be opened again.
    ForNow(String),
    /// It may not.
    ForGood(String),
}

impl From<String> for Loss {
    fn from(why: String) -> Loss {
        Loss::ForNow(why)
    }
}

/// Hardware that is open.
trait Hardware: Send {
    /// The unit by which the same hardware is opened again.
    fn unit(&self) -> String;
    /// What the user should know of it: its name, whether it vibrates, and what moves the tool.
    fn note(&self) -> String;
    /// Waits for news of the hardware for at most [`WAIT`] and passes them on.
    ///
    /// # Errors
    /// Why the hardware is lost.
    fn follow(&mut self, steering: &Steering) -> Result<(), Loss>;
}

/// When a vibration is sent to the hardware: where its strength has changed, and again before it ends by itself, as it
/// does where nobody renews it.
struct Vibration {
    strength: f64,
    sent: Option<Instant>,
}

impl Vibration {
    /// Change of strength that is sent.
    const CHANGE: f64 = 1.0 / 64.0;
    /// Time after which a vibration is sent again.
    const RENEWS: Duration = Duration::from_millis(100);
    /// How long a vibration lasts that nobody renews.
    const LASTS: Duration = Duration::from_millis(300);
    /// Time between two looks of hardware that vibrates.
    const TICK: Duration = Duration::from_millis(4);

    fn none() -> Vibration {
        Vibration { strength: 0.0, sent: None }
    }

    /// The strength to send now, if any.
    fn due(&mut self, strength: f64, now: Instant) -> Option<f64> {
        let strength = if strength < Vibration::CHANGE { 0.0 } else { strength };
        let is_old = self.sent.is_none_or(|sent| now.saturating_duration_since(sent) >= Vibration::RENEWS);
        let has_changed = (strength - self.strength).abs() >= Vibration::CHANGE;
        let is_due = has_changed || (strength > 0.0 && is_old);
        is_due.then(|| {
            (self.strength, self.sent) = (strength, Some(now));
            strength
        })
    }
}

/// Opens the hardware that a unit names, or the first one.
type Opens = Arc<dyn Fn(Option<&str>) -> Result<Box<dyn Hardware>, String> + Send + Sync>;

/// Opens hardware of a kind.
fn open(kind: DeviceKind, unit: Option<&str>) -> Result<Box<dyn Hardware>, String> {
    match (kind, unit) {
        #[cfg(target_os = "linux")]
        (DeviceKind::SpaceMouse, unit) => space_mouse::open(unit),
        #[cfg(target_os = "linux")]
        (DeviceKind::GamePad, unit) => game_pad::open(unit),
        #[cfg(target_os = "linux")]
        (DeviceKind::OpenXr, unit) => openxr::open(unit),
        (kind, _) => {
            let known = "a SpaceMouse, a game pad and an OpenXR controller, on Linux alone so far";
            Err(format!(
                "{} is none of the devices without force that palpate reads ({known}); use the mouse",
                kind.name()
            ))
        }
    }
}

/// A haptic device without force.
pub struct Steered {
    opens: Opens,
    unit: Option<String>,
    goal: Goal,
    follower: Mouse,
    steering: Arc<Steering>,
    /// Hardware that [`Steered::identify`] has opened.
    identified: Option<Box<dyn Hardware>>,
    /// Once the hardware has been open.
    note: Option<String>,
    thread: Option<JoinHandle<()>>,
    time: f64,
}

impl Steered {
    /// A device of a kind [without force](DeviceKind::plays_force) that begins at a pose. `unit`: its name or a path
    /// that leads to it, or the hand (`left`, `right`) of an OpenXR controller; `None`: the first device, the right hand.
    pub fn new(kind: DeviceKind, unit: Option<String>, position: DVec3, orientation: DQuat) -> Steered {
        Steered::with(Arc::new(move |unit| open(kind, unit)), unit, position, orientation)
    }

    fn with(opens: Opens, unit: Option<String>, position: DVec3, orientation: DQuat) -> Steered {
        let goal = Goal::new(position, orientation);
        let (follower, steering) = (Mouse::new(goal.clone()), Arc::new(Steering::new(goal.clone())));
        Steered { opens, unit, goal, follower, steering, identified: None, note: None, thread: None, time: 0.0 }
    }

    /// Opens the hardware without reading it, to learn whether it is there and what [`Device::notes`] says of it. A
    /// caller that tells the notes before [`Device::open`] must call this first; otherwise there are none.
    ///
    /// # Errors
    /// It cannot be opened.
    pub fn identify(&mut self) -> Result<(), Fault> {
        self.close();
        let hardware = (self.opens)(self.unit.as_deref()).map_err(Fault::Lost)?;
        // From now on it is this one and no other.
        (self.note, self.unit) = (Some(hardware.note()), Some(hardware.unit()));
        self.identified = Some(hardware);
        Ok(())
    }
}

/// Follows the hardware until the device is closed; opens it again when it was lost.
fn follow(steering: &Steering, opens: &Opens, unit: Option<&str>, first: Box<dyn Hardware>) {
    let mut hardware = Some(first);
    while !steering.ends.load(Relaxed) {
        let followed = match &mut hardware {
            Some(hardware) => hardware.follow(steering),
            None => opens(unit).map_err(Loss::from).map(|again| {
                hardware = Some(again);
                steering.find_again();
            }),
        };
        steering.note_answer();
        match followed {
            Ok(()) => {}
            Err(Loss::ForNow(why)) => {
                steering.lose(why);
                hardware = None;
                thread::park_timeout(RETRY);
            }
            Err(Loss::ForGood(why)) => return steering.lose(why),
        }
    }
}

impl Device for Steered {
    fn open(&mut self) -> Result<(), Fault> {
        if self.identified.is_none() {
            self.identify()?;
        }
        let Some(hardware) = self.identified.take() else { return Ok(()) };
        (self.steering, self.time) = (Arc::new(Steering::new(self.goal.clone())), 0.0);
        self.follower.open()?;
        let (steering, opens, unit) = (self.steering.clone(), self.opens.clone(), self.unit.clone());
        let thread = thread::Builder::new()
            .name("steered".into())
            .spawn(move || follow(&steering, &opens, unit.as_deref(), hardware));
        self.thread = Some(thread.map_err(|e| Fault::Lost(format!("its thread cannot be started: {e}")))?);
        Ok(())
    }

    fn profile(&self) -> &Profile {
        self.follower.profile()
    }

    fn notes(&self) -> Vec<String> {
        self.note.iter().cloned().collect()
    }

    fn read(&mut self, time: f64) -> Result<Reading, Fault> {
        let is_there = self.steering.check();
        let span = (time - self.time).clamp(0.0, CATCH_UP);
        let [velocity, angular_velocity] = self.steering.velocities();
        // Hardware that asks for no velocity may place the goal itself; then the goal's lock is not taken here.
        if is_there.is_ok() && span > 0.0 && [velocity, angular_velocity] != [DVec3::ZERO; 2] {
            self.goal.shift(span * velocity);
            self.goal.turn(span * angular_velocity);
        }
        self.time = if time.is_finite() { time } else { self.time };
        let reading = self.follower.read(time)?;
        is_there?;
        Ok(Reading { buttons: self.steering.buttons.load(Relaxed), ..reading })
    }

    fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
        self.steering.force.store(wrench.force.length().to_bits(), Relaxed);
        Ok(())
    }

    fn close(&mut self) {
        self.identified = None;
        self.steering.ends.store(true, Relaxed);
        let Some(thread) = self.thread.take() else { return };
        thread.thread().unpark();
        let begun = Instant::now();
        while !thread.is_finished() && begun.elapsed() < CLOSING {
            thread::sleep(Duration::from_millis(1));
        }
        if thread.is_finished() {
            // What it panicked of has been printed.
            let _ = thread.join();
        }
    }
}

impl Drop for Steered {
    fn drop(&mut self) {
        self.close();
    }
}
