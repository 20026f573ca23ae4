//! The haptic loop in a thread of its own. In each iteration (*tick*), which begins at an absolute deadline, the loop
//! reads the haptic device and commands a wrench (force and torque) to it. The loop gets the newest contact wrench from
//! the simulation, and gives the simulation the newest state of the device and of the tool (the rigid body that the
//! device leads), through lock-free triple buffers: neither thread ever waits for the other.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use thread_priority::ThreadPriority;

use super::clock::{Lateness, Metronome};
use super::device::{Device, Fault};
use super::event::Event;
use super::servo::{Servo, Tick};
use crate::step::{ContactWrench, DeviceInput};

/// Greatest number of recorded ticks in the queue to the simulation's thread. The records of further ticks are
/// lost, which the event [`Event::RecordLost`] of the next recorded tick reports.
const ROOM: usize = 1 << 14;
/// Real-time priority of the loop's thread, on a scale from 0 to 99.
#[cfg(unix)]
const MIDDLE: u8 = 50;

/// A running haptic loop. Dropping it stops it.
pub struct ServoThread {
    thread: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
    begun: Instant,
    wrenches: triple_buffer::Input<ContactWrench>,
    states: triple_buffer::Output<DeviceInput>,
    ticks: rtrb::Consumer<Tick>,
    /// Whether the thread got its raised priority; if not, the error gives the reason.
    pub priority: Result<(), String>,
}

impl ServoThread {
    /// Starts the loop, whose clock began at `begun`. Setting `stop` ends the loop from outside, for example from a signal
    /// handler; the device exerts no force after that.
    pub fn start(device: Opened, servo: Servo, stop: Arc<AtomicBool>, begun: Instant) -> Result<ServoThread, Fault> {
        let (wrenches, newest) = triple_buffer::triple_buffer(&servo.newest());
        let (out, states) = triple_buffer::triple_buffer(&servo.input());
        let (record, ticks) = rtrb::RingBuffer::new(ROOM);
        let metronome = Metronome::since(begun, servo.period());
        let links = Links { newest, out, record, stop: stop.clone() };
        let (tell, told) = std::sync::mpsc::channel();
        let work = move || {
            // `start` waits for this message, and for nothing else that this thread does.
            let _ = tell.send(raise_priority());
            tick_until_stopped(device, servo, links, metronome);
        };
        let thread = std::thread::Builder::new().name("palpate-servo".into()).spawn(work);
        let thread =
            thread.map_err(|error| Fault::Lost(format!("the haptic loop's thread could not be started: {error}")))?;
        let priority = told.recv().unwrap_or_else(|_| Err("the thread ended".into()));
        Ok(ServoThread { thread: Some(thread), stop, begun, wrenches, states, ticks, priority })
    }

    /// The present time, s on the loop's clock.
    pub fn now(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// The newest state of device and tool, from which the next simulation step starts.
    pub fn newest(&mut self) -> DeviceInput {
        *self.states.read()
    }

    /// Passes a contact wrench to the loop, which takes it at its next tick.
    pub fn give(&mut self, wrench: ContactWrench) {
        self.wrenches.write(wrench);
    }

    /// Takes the recorded ticks that were not taken yet, the oldest first.
    pub fn ticks(&mut self) -> impl Iterator<Item = Tick> + '_ {
        std::iter::from_fn(|| self.ticks.pop().ok())
    }

    /// Whether the loop's thread is still running.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Stops the loop. When this returns, the device exerts no force and is closed; recorded ticks can still be taken.
    /// Returns false if the loop's thread panicked.
    pub fn stop(&mut self) -> bool {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().is_none_or(|thread| thread.join().is_ok())
    }
}

impl Drop for ServoThread {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The loop's ends of the buffers that connect the loop with the simulation's thread, and the flag that stops the loop.
struct Links {
    newest: triple_buffer::Output<ContactWrench>,
    out: triple_buffer::Input<DeviceInput>,
    record: rtrb::Producer<Tick>,
    stop: Arc<AtomicBool>,
}

/// An open device. Dropping it, even because of a panic, closes the device, which then exerts no force.
pub struct Opened(Box<dyn Device>);

impl Opened {
    /// Opens the device.
    pub fn new(mut device: Box<dyn Device>) -> Result<Opened, Fault> {
        device.open()?;
        Ok(Opened(device))
    }
}

impl Drop for Opened {
    fn drop(&mut self) {
        self.0.close();
    }
}

fn tick_until_stopped(mut device: Opened, mut servo: Servo, mut links: Links, mut metronome: Metronome) {
    let mut is_lost = false;
    while !links.stop.load(Ordering::Relaxed) {
        let beat = metronome.wait();
        let reading = device.0.read(beat.time);
        let mut tick = servo.tick(beat.time, beat.late, reading, links.newest.read());
        if device.0.write(&tick.played).is_err() {
            servo.unplayed(&mut tick);
        }
        if is_lost {
            tick.events.raise(Event::RecordLost);
        }
        links.out.write(servo.input());
        is_lost = links.record.push(tick).is_err();
    }
}

/// Gives the calling thread real-time priority over all normal threads, if the system permits it.
#[cfg(unix)]
pub fn raise_priority() -> Result<(), String> {
    use thread_priority::{RealtimeThreadSchedulePolicy, ThreadSchedulePolicy};
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let middle = ThreadPriority::Crossplatform(MIDDLE.try_into().map_err(|_| "no such priority".to_string())?);
    let this = thread_priority::thread_native_id();
    thread_priority::set_thread_priority_and_policy(this, middle, policy).map_err(|error| format!("{error:?}"))
}

/// Gives the calling thread the greatest priority, if the system permits it.
#[cfg(not(unix))]
pub fn raise_priority() -> Result<(), String> {
    ThreadPriority::Max.set_for_current().map_err(|error| format!("{error:?}"))
}

/// A thread that does nothing but wake with the period of the haptic loop: a baseline for the lateness of ticks.
pub struct BareTimer {
    thread: Option<JoinHandle<Lateness>>,
    stop: Arc<AtomicBool>,
}

impl BareTimer {
    /// Starts the thread; `period` is the time between deadlines, s.
    pub fn start(period: f64) -> BareTimer {
        let stop = Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        let work = move || {
            // This thread asks for the priority that the loop's thread has, and runs without it if the system refuses.
            let _ = raise_priority();
            let (mut metronome, mut lateness) = (Metronome::new(period), Lateness::new());
            while !flag.load(Ordering::Relaxed) {
                lateness.add(metronome.wait().late, period);
            }
            lateness
        };
        BareTimer { thread: std::thread::Builder::new().name("palpate-bare-timer".into()).spawn(work).ok(), stop }
    }

    /// Stops the thread and returns how late it woke. `None`: the thread could not be started, or panicked.
    pub fn stop(mut self) -> Option<Lateness> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().and_then(|thread| thread.join().ok())
    }
}

impl Drop for BareTimer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Duration;

    use glam::{DMat3, DQuat, DVec3};

    use super::*;
    use crate::haptics::Reading;
    use crate::haptics::safety::Limits;
    use crate::haptics::servo::Settings;
    use crate::scene::{Coupling, Lowered, Profile};
    use crate::step::tool::Tool;
    use crate::step::{RigidState, Wrench};

    /// The wrenches that were commanded to a device, in order; `None` stands for closing the device.
    type Told = Arc<Mutex<Vec<Option<Wrench>>>>;

    /// A simulated device that swings about the origin; its driver panics at reading number `panics_at`, if such a
    /// number is given.
    struct Swinging {
        profile: Profile,
        told: Told,
        readings: u32,
        panics_at: Option<u32>,
    }

    impl Device for Swinging {
        fn open(&mut self) -> Result<(), Fault> {
            Ok(())
        }

        fn profile(&self) -> &Profile {
            &self.profile
        }

        fn read(&mut self, time: f64) -> Result<Reading, Fault> {
            self.readings += 1;
            assert!(Some(self.readings) != self.panics_at, "the simulated driver panics here");
            let position = DVec3::Y * 0.01 * (20.0 * time).sin();
            Ok(Reading { time, state: RigidState::at_rest(position, DQuat::IDENTITY), buttons: 0 })
        }

        fn write(&mut self, wrench: &Wrench) -> Result<(), Fault> {
            self.told.lock().unwrap().push(Some(*wrench));
            Ok(())
        }

        fn close(&mut self) {
            self.told.lock().unwrap().push(None);
        }
    }

    fn start(panics_at: Option<u32>) -> (ServoThread, Told) {
        let (settings, tool, device, told) = making(panics_at);
        let device = Opened::new(device).unwrap();
        let thread = ServoThread::start(device, Servo::new(settings, tool), Arc::default(), Instant::now());
        (thread.unwrap(), told)
    }

    fn making(panics_at: Option<u32>) -> (Settings, Tool, Box<dyn Device>, Told) {
        let profile = Profile::named("premium").unwrap().clone();
        let (limits, _) = Limits::new(&profile, &Lowered::default());
        let coupling = Coupling { stiffness: 500.0, damping: 2.0, angular_stiffness: 0.1, angular_damping: 1e-3 };
        let tool = Tool {
            mass: 0.05,
            inertia: DMat3::IDENTITY * 2e-6,
            coupling: Some(coupling),
            centre: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
        };
        let settings = Settings {
            period: 1e-3,
            limits,
            local_model: true,
            passivity: false,
            most_damping: [5.0, 0.0],
            trust: 2e-3,
            arm: 6e-3,
            resolution: 2e-5,
        };
        let told = Told::default();
        let device = Swinging { profile, told: told.clone(), readings: 0, panics_at };
        (settings, tool, Box::new(device), told)
    }

    /// Waits until `done` holds, for at most ten seconds.
    fn wait_for(mut done: impl FnMut() -> bool) {
        let begun = Instant::now();
        while !done() {
            assert!(begun.elapsed() < Duration::from_secs(10), "the condition was not met within ten seconds");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Passes to the loop a wrench without contact for the present time, so that the loop's newest wrench never gets
    /// out of date.
    fn feed(thread: &mut ServoThread) {
        let input = thread.newest();
        let step = input.ticks + 1;
        thread.give(ContactWrench { step, time: input.time, ..ContactWrench::none(input.tool) });
    }

    #[test]
    fn a_loop_that_is_stopped_or_dropped_closes_its_device() {
        for is_dropped in [true, false] {
            let (mut thread, told) = start(None);
            wait_for(|| {
                feed(&mut thread);
                told.lock().unwrap().iter().flatten().any(|wrench| wrench.force.length() > 0.0)
            });
            let input = thread.newest();
            assert!(input.ticks > 0 && input.coupling.is_some() && thread.is_running());
            let ticks: Vec<Tick> = thread.ticks().collect();
            assert!(ticks.iter().enumerate().all(|(k, tick)| tick.index == k as u64));
            match is_dropped {
                true => drop(thread),
                false => assert!(thread.stop() && !thread.is_running()),
            }
            let told = told.lock().unwrap();
            assert_eq!(told.last(), Some(&None), "closing must be the last call to the device");
            assert_eq!(told.iter().filter(|told| told.is_none()).count(), 1);
        }
    }

    #[test]
    fn a_flag_from_outside_stops_the_loop_as_a_signal_does() {
        let (thread, told) = start(None);
        thread.stop.store(true, Ordering::Relaxed);
        wait_for(|| !thread.is_running());
        assert_eq!(told.lock().unwrap().last(), Some(&None));
    }

    #[test]
    fn a_driver_that_panics_still_lets_go() {
        let (mut thread, told) = start(Some(100));
        wait_for(|| {
            feed(&mut thread);
            !thread.is_running()
        });
        assert!(!thread.stop(), "`stop` returned true although the thread panicked");
        assert_eq!(told.lock().unwrap().last(), Some(&None));
    }

    #[test]
    fn a_record_with_ticks_missing_says_where() {
        let (settings, tool, device, told) = making(None);
        let servo = Servo::new(settings, tool);
        let (record, mut ticks) = rtrb::RingBuffer::new(4);
        let (_wrenches, newest) = triple_buffer::triple_buffer(&servo.newest());
        let (out, _states) = triple_buffer::triple_buffer(&servo.input());
        let stop = Arc::<AtomicBool>::default();
        let links = Links { newest, out, record, stop: stop.clone() };
        let work = move || tick_until_stopped(Opened(device), servo, links, Metronome::new(1e-3));
        let thread = std::thread::spawn(work);
        wait_for(|| told.lock().unwrap().len() > 20);
        let mut taken = Vec::new();
        wait_for(|| {
            taken.extend(ticks.pop());
            taken.len() > 8
        });
        stop.store(true, Ordering::Relaxed);
        thread.join().unwrap();
        let indices: Vec<u64> = taken.iter().map(|tick| tick.index).collect();
        assert_eq!(indices[..4], [0, 1, 2, 3]);
        assert!(indices[4] > 4, "no tick was lost although the queue was full; recorded ticks: {indices:?}");
        for (last, tick) in taken.iter().zip(&taken[1..]) {
            assert_eq!(
                tick.events.has(Event::RecordLost),
                tick.index != last.index + 1,
                "`RecordLost` must mark exactly the ticks after a gap; recorded ticks: {indices:?}"
            );
        }
    }
}
