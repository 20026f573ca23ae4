//! Options of a haptic loop, which replace values of the scene's table `[haptics]`. The loop runs at a fixed rate: at
//! each tick (one iteration) it reads the haptic device and plays a force, that is, commands the device to exert it.
//! Meanwhile the simulation does steps, each of which gives one wrench: contact force and torque on the tool, the rigid
//! body that the haptic device leads.

use palpate::scene::{HAPTIC_RATES, Haptics};

use super::sized::{Field, Sized32, fields};
use super::status::{Failure, Outcome, palpate_status};

/// Options of a haptic loop. Unless its description says otherwise, a field that is 0 leaves the option at its value in
/// the scene's table `[haptics]` (for a tool after the first in the table `haptics` of the tool) or, if the scene does not
/// set the option, at the default of that table.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct palpate_loop_options {
    /// Size of the struct in bytes: sizeof(palpate_loop_options).
    pub size: u32,
    /// 1: until the simulation's next step ends, the contact force follows the tool's motion by a local model, which
    /// consists of the contact force, stiffness and damping that the newest step gave. -1: the contact force stays that
    /// of the newest step.
    pub local_model: i32,
    /// 1: the passivity controller is on: it damps the force when the loop has given the user's hand more energy than
    /// it has absorbed from the hand. -1: the passivity controller is off.
    pub passivity: i32,
    /// Reserved: must be 0.
    pub reserved: u32,
    /// Rate of the loop in ticks (iterations) per second, from 50 to 4000.
    pub rate: f64,
    /// Duration of the loop, s, of several devices the shortest given; 0: the loop runs until it is stopped.
    pub seconds: f64,
    /// Greatest force that is played, N. This field and the next four can only lower the limits in the profile of the
    /// haptic device (the limits of its model); if a value is higher than the profile's limit, the profile's limit
    /// holds, and a note of the loop reports this.
    pub max_force: f64,
    /// Greatest torque that is played, N m.
    pub max_torque: f64,
    /// Greatest rate of change of the played force, N/s.
    pub max_slew: f64,
    /// Radius of the workspace, m: the sphere about the position at which the device was first read. Outside this
    /// sphere the force fades out.
    pub workspace: f64,
    /// Greatest latency of the newest wrench, s: if more time has passed since the inputs of the wrench's step were
    /// taken, the force fades out.
    pub watchdog: f64,
    /// Longest time step of the simulation, s. From the scene's `dt` up to this value, the loop chooses the shortest
    /// time step that takes no longer to compute than it lasts. If even a step of this length takes longer to compute,
    /// the loop uses this length, and bodies move slower than in real time. Of several devices the shortest holds.
    pub longest_step: f64,
}

// SAFETY: the struct is `repr(C)`, its first field is its size, and all fields are numbers, so any bytes are a value.
unsafe impl Sized32 for palpate_loop_options {
    const NAME: &str = "palpate_loop_options";
    const LEAST: usize = 72;
    const FIELDS: &'static [Field] = fields!(palpate_loop_options {
        size,
        local_model,
        passivity,
        reserved,
        rate,
        seconds,
        max_force,
        max_torque,
        max_slew,
        workspace,
        watchdog,
        longest_step
    });

    fn unset() -> Self {
        palpate_loop_options {
            size: size_of::<Self>() as u32,
            local_model: 0,
            passivity: 0,
            reserved: 0,
            rate: 0.0,
            seconds: 0.0,
            max_force: 0.0,
            max_torque: 0.0,
            max_slew: 0.0,
            workspace: 0.0,
            watchdog: 0.0,
            longest_step: 0.0,
        }
    }
}

/// Returns a copy of the scene's `[haptics]` in which the values that the options set replace those of the scene.
/// Messages call the options `name`.
pub(super) fn chosen(options: &palpate_loop_options, name: &str, scene: &Haptics) -> Outcome<Haptics> {
    let wrong = |what: String| Failure::new(palpate_status::Argument, format!("{name}.{what}"));
    if options.reserved != 0 {
        return Err(wrong(format!("reserved is {}; set it to 0", options.reserved)));
    }
    let number = |key: &str, given: f64| match given.is_finite() && given >= 0.0 {
        true => Ok((given > 0.0).then_some(given)),
        false => Err(wrong(format!("{key} is {given}; give more than 0, or 0 for the default"))),
    };
    let truth = |key: &str, given: i32, scene: bool| match given {
        0 => Ok(scene),
        1 => Ok(true),
        -1 => Ok(false),
        _ => Err(wrong(format!("{key} is {given}; give 1, -1, or 0 for the scene's value"))),
    };
    number("seconds", options.seconds)?;
    let mut haptics = scene.clone();
    if let Some(rate) = number("rate", options.rate)? {
        let [lowest, highest] = HAPTIC_RATES;
        if !(lowest..=highest).contains(&rate) {
            return Err(wrong(format!("rate is {rate}; give {lowest} to {highest} Hz")));
        }
        haptics.rate = rate;
    }
    haptics.longest_step = number("longest_step", options.longest_step)?.unwrap_or(scene.longest_step);
    haptics.local_model = truth("local_model", options.local_model, scene.local_model)?;
    haptics.passivity = truth("passivity", options.passivity, scene.passivity)?;
    let (asked, limits) = (options, &mut haptics.limits);
    limits.force = number("max_force", asked.max_force)?.or(limits.force);
    limits.torque = number("max_torque", asked.max_torque)?.or(limits.torque);
    limits.slew = number("max_slew", asked.max_slew)?.or(limits.slew);
    limits.workspace = number("workspace", asked.workspace)?.or(limits.workspace);
    limits.watchdog = number("watchdog", asked.watchdog)?.or(limits.watchdog);
    Ok(haptics)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_is_the_scenes_and_what_cannot_be_is_refused() {
        let unset = palpate_loop_options::unset();
        let mut scene = Haptics { passivity: false, rate: 500.0, ..Haptics::default() };
        scene.limits.force = Some(2.0);
        assert_eq!(chosen(&unset, "options", &scene).unwrap(), scene);
        let other = palpate_loop_options { passivity: 1, local_model: -1, rate: 2000.0, max_force: 1.0, ..unset };
        let told = chosen(&other, "options", &scene).unwrap();
        assert_eq!((told.passivity, told.local_model, told.rate), (true, false, 2000.0));
        assert_eq!((told.limits.force, told.limits.torque), (Some(1.0), None));
        let bad = [
            ("rate", palpate_loop_options { rate: 9000.0, ..unset }),
            ("seconds", palpate_loop_options { seconds: f64::NAN, ..unset }),
            ("max_slew", palpate_loop_options { max_slew: -1.0, ..unset }),
            ("watchdog", palpate_loop_options { watchdog: f64::INFINITY, ..unset }),
            ("passivity", palpate_loop_options { passivity: 2, ..unset }),
            ("reserved", palpate_loop_options { reserved: 1, ..unset }),
        ];
        for (name, options) in bad {
            let refused = chosen(&options, "options", &scene).unwrap_err();
            assert!(
                refused.message.starts_with(&format!("options.{name} is ")),
                "the error does not begin with `options.{name} is`: {}",
                refused.message
            );
        }
    }

    #[test]
    fn the_first_version_of_the_options_is_read_without_the_longest_step() {
        assert_eq!(std::mem::offset_of!(palpate_loop_options, longest_step), palpate_loop_options::LEAST);
        assert_eq!(size_of::<palpate_loop_options>(), palpate_loop_options::LEAST + size_of::<f64>());
        let set = palpate_loop_options { longest_step: 0.01, ..palpate_loop_options::unset() };
        let haptics = Haptics::default();
        assert_eq!(chosen(&set, "options", &haptics).unwrap().longest_step, 0.01);
        assert_eq!(
            chosen(&palpate_loop_options::unset(), "options", &haptics).unwrap().longest_step,
            haptics.longest_step
        );
        let wrong = palpate_loop_options { longest_step: f64::NAN, ..set };
        assert!(chosen(&wrong, "options", &haptics).err().unwrap().message.contains("options.longest_step is NaN"));
    }
}
