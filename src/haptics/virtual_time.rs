//! The loop and what it meets in one thread and in time that nobody waits for: for measurements and tests, which give the
//! same bits every time.

use super::device::Device;
use super::environment::Environment;
use super::servo::{Servo, Tick};
use crate::Result;
use crate::step::ContactWrench;

/// When steps begin, and when what they found is there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Schedule {
    /// Ticks from one step to the next; a step is so long.
    pub ticks_a_step: u32,
    /// Ticks from a step's beginning until the loop has its wrench, 1 at least; at most `ticks_a_step`.
    pub delay: u32,
}

impl Schedule {
    /// Steps that take as long as they simulate, and so begin one after another; `rate`: Hz, of the steps.
    pub fn at(rate: f64, period: f64) -> Schedule {
        let ticks = (1.0 / (rate * period)).round().max(1.0) as u32;
        Schedule { ticks_a_step: ticks, delay: ticks }
    }
}

/// Ticks a servo so many times; `each` sees every tick.
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

/// Ticks a servo as [`run`] does, but that `control` may change what a tick plays before the device is told.
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
            let wrench = environment.feel(&servo.held(), f64::from(schedule.ticks_a_step) * period)?;
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
