//! The loop: a thread of its own that ticks at absolute deadlines and waits for nothing else. The newest wrench comes in, and
//! the newest state goes out, through buffers that neither side ever waits for.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use thread_priority::{ThreadPriority, set_current_thread_priority};

use super::clock::{Lateness, Metronome};
use super::device::{Device, Fault, RigidState};
use super::event::Event;
use super::local_model::ContactWrench;
use super::servo::{Servo, Tick};

/// Ticks that wait to be taken at most: what comes after is lost, and said so.
const ROOM: usize = 1 << 14;

/// What a step of the simulation starts from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Held {
    /// Ticks done.
    pub ticks: u64,
    /// When the last of them began, s on the loop's clock.
    pub time: f64,
    /// The device.
    pub device: RigidState,
    /// The tool.
    pub tool: RigidState,
}

/// A loop that runs. Dropping it stops it.
pub struct ServoThread {
    thread: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
    begun: Instant,
    wrenches: triple_buffer::Input<ContactWrench>,
    states: triple_buffer::Output<Held>,
    ticks: rtrb::Consumer<Tick>,
    /// Whether the thread runs before all others; else why not.
    pub priority: Result<(), String>,
}

impl ServoThread {
    /// Opens the device and begins to tick. `stop` ends the loop from outside, as a signal does; it plays nothing then.
    pub fn start(mut device: Box<dyn Device>, servo: Servo, stop: Arc<AtomicBool>) -> Result<ServoThread, Fault> {
        device.open()?;
        let (wrenches, newest) = triple_buffer::triple_buffer(&servo.newest());
        let (out, states) = triple_buffer::triple_buffer(&servo.held());
        let (record, ticks) = rtrb::RingBuffer::new(ROOM);
        let metronome = Metronome::new(servo.period());
        let begun = metronome.begun();
        let links = Links { newest, out, record, stop: stop.clone() };
        let (tell, told) = std::sync::mpsc::channel();
        let device = Opened(device);
        let work = move || {
            // The other side waits for this alone.
            let _ = tell.send(raise_priority());
            tick_until_stopped(device, servo, links, metronome);
        };
        let thread = std::thread::Builder::new().name("palpate-servo".into()).spawn(work);
        let thread = thread.map_err(|error| Fault::Lost(format!("no thread for the loop: {error}")))?;
        let priority = told.recv().unwrap_or_else(|_| Err("the thread ended".into()));
        Ok(ServoThread { thread: Some(thread), stop, begun, wrenches, states, ticks, priority })
    }

    /// Now, s on the loop's clock.
    pub fn now(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// What a step starts from now.
    pub fn newest(&mut self) -> Held {
        *self.states.read()
    }

    /// Gives the loop a wrench, to be taken at its next tick.
    pub fn give(&mut self, wrench: ContactWrench) {
        self.wrenches.write(wrench);
    }

    /// Ticks that were not taken yet, the oldest first.
    pub fn ticks(&mut self) -> impl Iterator<Item = Tick> + '_ {
        std::iter::from_fn(|| self.ticks.pop().ok())
    }

    /// Whether it still ticks.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Stops: the device plays nothing and is closed when this returns. Ticks can still be taken. Says whether the loop ended
    /// in order.
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

/// The loop's ends of what joins it with the rest.
struct Links {
    newest: triple_buffer::Output<ContactWrench>,
    out: triple_buffer::Input<Held>,
    record: rtrb::Producer<Tick>,
    stop: Arc<AtomicBool>,
}

/// A device that is closed, and so plays nothing, however its owner ends.
struct Opened(Box<dyn Device>);

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
        links.out.write(servo.held());
        is_lost = links.record.push(tick).is_err();
    }
}

/// Before all threads that are not pressed for time, where that is permitted.
pub fn raise_priority() -> Result<(), String> {
    #[cfg(unix)]
    {
        use thread_priority::{RealtimeThreadSchedulePolicy, ThreadSchedulePolicy, thread_native_id};
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let middle = ThreadPriority::Crossplatform(50u8.try_into().map_err(|_| "no such priority".to_string())?);
        let _ = set_current_thread_priority;
        thread_priority::set_thread_priority_and_policy(thread_native_id(), middle, policy)
            .map_err(|error| format!("{error:?}"))
    }
    #[cfg(not(unix))]
    set_current_thread_priority(ThreadPriority::Max).map_err(|error| format!("{error:?}"))
}

/// A thread that does nothing but wake at the same deadlines, to compare the loop with.
pub struct BareTimer {
    thread: Option<JoinHandle<Lateness>>,
    stop: Arc<AtomicBool>,
}

impl BareTimer {
    /// Begins; `period`: s.
    pub fn start(period: f64) -> BareTimer {
        let stop = Arc::new(AtomicBool::new(false));
        let flag = stop.clone();
        let work = move || {
            // As the loop's: with it where it is permitted, without it where not.
            let _ = raise_priority();
            let (mut metronome, mut lateness) = (Metronome::new(period), Lateness::new());
            while !flag.load(Ordering::Relaxed) {
                lateness.add(metronome.wait().late, period);
            }
            lateness
        };
        BareTimer { thread: std::thread::Builder::new().name("palpate-bare-timer".into()).spawn(work).ok(), stop }
    }

    /// Ends it; how late it was. `None`: there was no thread to be had.
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
