//! Runs the haptic loop, which commands wrenches (forces and torques) to a haptic device, and its environment (the
//! source of contact wrenches, for example the simulation) in one thread and in virtual time: nothing waits for a
//! clock. Measurements and tests run the loop in this way, because every run then gives the same bits.

use super::device::Device;
use super::environment::Environment;
use super::servo::{Servo, Tick};
use crate::Result;
use crate::step::ContactWrench;

/// When simulation steps begin and when their wrenches arrive, in ticks. A tick is one iteration of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Number of ticks from the beginning of one step to the beginning of the next; each step simulates the duration of
    /// this number of ticks.
    pub ticks_a_step: u32,
    /// Number of ticks from the beginning of a step until the loop has the step's wrench: at least 1, at most
    /// `ticks_a_step`.
    pub delay: u32,
}

impl Schedule {
    /// A schedule in which computing a step takes as long as the time that the step simulates, and the next step begins
    /// as soon as the step ends. `rate` is the number of steps a second, Hz, and `period` is the period of a tick, s.
    pub fn at(rate: f64, period: f64) -> Schedule {
        let ticks = (1.0 / (rate * period)).round().max(1.0) as u32;
        Schedule { ticks_a_step: ticks, delay: ticks }
    }
}

/// Runs the loop for `ticks` ticks; `each` is called with the record of every tick.
pub fn run(
    device: &mut dyn Device,
    servo: &mut Servo,
    environment: &mut dyn Environment,
    schedule: Schedule,
    ticks: u64,
    each: impl FnMut(&Tick),
) -> Result<()> {
    run_controlled(device, servo, environment, schedule, ticks, |_| (), each)
}

/// Like [`run`], but `control` may change the wrench in the record of a tick before that wrench is commanded to the
/// device.
pub fn run_controlled(
    device: &mut dyn Device,
    servo: &mut Servo,
    environment: &mut dyn Environment,
    schedule: Schedule,
    ticks: u64,
    mut control: impl FnMut(&mut Tick),
    mut each: impl FnMut(&Tick),
) -> Result<()> {
    let period = servo.period();
    let (mut newest, mut next) = (servo.newest(), None::<(u64, ContactWrench)>);
    for k in 0..ticks {
        if k % u64::from(schedule.ticks_a_step) == 0 {
            let wrench = environment.feel(&servo.input(), f64::from(schedule.ticks_a_step) * period)?;
            if let Some((_, waiting)) = next.replace((k + u64::from(schedule.delay), wrench)) {
                newest = waiting;
            }
        }
        if let Some((_, wrench)) = next.take_if(|(due, _)| *due <= k) {
            newest = wrench;
        }
        let time = k as f64 * period;
        let reading = device.read(time);
        let mut tick = servo.tick(time, 0.0, reading, &newest);
        control(&mut tick);
        if device.write(&tick.played).is_err() {
            servo.unplayed(&mut tick);
        }
        each(&tick);
    }
    Ok(())
}
