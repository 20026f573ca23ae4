//! The haptic loop from Python: the loop and the simulation run on threads of their own, and Python is only shown the
//! newest tick (iteration of the loop) at intervals, so that the interpreter never delays a force.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use palpate::internal::haptics::servo::Tick;
use palpate::internal::haptics::session::{self, Moment, Options, Report};
use palpate::scene::DeviceKind;
use palpate::{Error, RigidState, Simulation};
use pyo3::prelude::*;

use crate::arrays::PlainPose;
use crate::failure::raise;

/// A tick as Python unpacks it: time, poses of device and tool, force and torque played, contact force on the tool, and
/// age of the newest wrench.
type PlainTick = (f64, PlainPose, PlainPose, [f64; 3], [f64; 3], [f64; 3], f64);

/// Shortest and longest wait between two looks at the loop, s: the longest lets an interrupt be noticed.
const NAP: [f64; 2] = [1e-3, 5e-3];

/// Ends the loop when it is dropped, so that nothing waits for a session that nobody watches.
struct Ended<'a>(&'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Runs the loop for `seconds` with the device of this name, or the scene's; so it does for each further tool to which the
/// scene gives a device. `watch` is called every `every` seconds with the newest tick of the first tool, on the calling
/// thread; if it returns `False` or raises, or at an interrupt, the loops end. Returns a report for each device.
pub fn hold(
    simulation: &mut Simulation,
    device: Option<&str>,
    seconds: f64,
    every: f64,
    watch: Option<&Py<PyAny>>,
) -> PyResult<Vec<Report>> {
    let mut scene = simulation.scene().clone();
    if let Some(name) = device {
        let known = DeviceKind::CHOICES.iter().find(|(known, _)| *known == name);
        let names = DeviceKind::CHOICES.map(|(name, _)| name).join(", ");
        let unknown = || raise(Error::Usage(format!("there is no haptic device {name}; give one of {names}")));
        scene.haptics.device = known.ok_or_else(unknown)?.1;
    }
    scene.haptics.has_device = true;
    let missing = || raise(Error::Usage("the scene has no tool for a haptic device to hold; add a [tool]".into()));
    let tool = simulation.tool().ok_or_else(missing)?.clone();
    let leaders = palpate_cli::leaders(simulation, &scene).map_err(raise)?;
    let stop = Arc::new(AtomicBool::new(false));
    let options = Options { seconds, shortest_step: scene.step.dt, stop: stop.clone(), bare_timer: false };
    let newest: Mutex<Option<Tick>> = Mutex::new(None);
    let hear = |moment: Moment| {
        if let Moment::Tick(0, tick) = moment {
            *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(*tick);
        }
        Ok(())
    };
    let (came, watched) = thread::scope(|scope| {
        let _ended = Ended(&stop);
        let work = || session::hold_each(leaders, simulation, &options, hear);
        let session = scope.spawn(work);
        let mut watched: PyResult<()> = Ok(());
        let mut shown = Instant::now();
        while !session.is_finished() {
            thread::sleep(Duration::from_secs_f64(every.clamp(NAP[0], NAP[1])));
            let is_due = shown.elapsed().as_secs_f64() >= every && watched.is_ok();
            let tick = newest.lock().unwrap_or_else(PoisonError::into_inner).take_if(|_| is_due);
            let shows = Python::attach(|py| {
                py.check_signals()?;
                let (Some(watch), Some(tick)) = (watch, tick) else { return Ok(true) };
                shown = Instant::now();
                let answer = watch.call1(py, (plain(&tick),))?;
                Ok(!answer.bind(py).is(pyo3::types::PyBool::new(py, false)))
            });
            match shows {
                Ok(true) => {}
                Ok(false) => stop.store(true, Ordering::Relaxed),
                Err(error) => {
                    stop.store(true, Ordering::Relaxed);
                    watched = watched.and(Err(error));
                }
            }
        }
        (session.join(), watched)
    });
    simulation.couple(tool.coupling);
    watched?;
    let panicked = || raise(Error::Simulation("internal error: the session panicked; the device was released".into()));
    came.map_err(|_| panicked())?.map_err(raise)
}

fn plain(tick: &Tick) -> PlainTick {
    let pose = |state: &RigidState| (state.position.to_array(), state.orientation.to_array());
    (
        tick.time,
        pose(&tick.device),
        pose(&tick.tool),
        tick.played.force.to_array(),
        tick.played.torque.to_array(),
        tick.contact.force.to_array(),
        tick.staleness,
    )
}
