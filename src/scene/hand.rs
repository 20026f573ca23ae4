//! Parameters of the simulated hand, a haptic device of the crate `devices`: a person's arm and wrist, and the device
//! that the person holds.

/// Parameters of the person and of the device that matter to stability; the comment on each ends with the allowed
/// range. Arm and wrist are springs and dampers that pull the device to the pose that the person intends. In people the
/// mass is 0.05 to 0.3 kg, the stiffness 100 to 500 N/m, and the damping 2 to 10 N s/m.
///
/// A device renders a virtual wall passively (without giving energy to the hand) if the wall's stiffness is at most
/// min(2 b / T, 2 c / q) N/m, where b is `device_damping`, c is `friction`, q is `quantum`, and T is the sampling
/// period, s (Abbott and Okamura 2005, "Effects of position quantization and sampling rate on virtual-wall passivity").
/// With the default values and a sampling rate of 1 kHz, this limit is 1000 N/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandParameters {
    /// Mass of hand and device, kg; 0.001 to 10.
    pub mass: f64,
    /// Stiffness of the arm, N/m; 0 to 100,000.
    pub stiffness: f64,
    /// Damping of the arm, N s/m; 0 to 1000.
    pub damping: f64,
    /// Viscous damping of the device, N s/m; 0 to 1000.
    pub device_damping: f64,
    /// Coulomb friction of the device, the same in all directions, N; 0 to 100.
    pub friction: f64,
    /// Moment of inertia of hand and device about any axis, kg m^2; 1e-6 to 1.
    pub inertia: f64,
    /// Angular stiffness of the wrist, N m/rad; 0 to 1000.
    pub angular_stiffness: f64,
    /// Angular damping of wrist and device, relative to the angular velocity of the intended pose, N m s/rad; 0 to 10.
    pub angular_damping: f64,
    /// Resolution of the position that the device reads on each axis (orientation is exact), m; 0 (exact) to 0.01.
    /// `None`: that of the device's profile.
    pub quantum: Option<f64>,
    /// Time, s, between the command of a wrench (force and torque) to the device and the moment when it acts on the
    /// hand; a whole number of substeps from 0 to 1 s.
    pub delay: f64,
    /// Substep: the time step of the hand's equations of motion, s; 1e-5 to 0.001.
    pub substep: f64,
}

impl Default for HandParameters {
    /// Values in the middle of the range that people have. The wrist has the same natural frequency as the arm, about 7
    /// Hz.
    fn default() -> Self {
        HandParameters {
            mass: 0.15,
            stiffness: 300.0,
            damping: 5.0,
            device_damping: 0.5,
            friction: 0.05,
            inertia: 1e-3,
            angular_stiffness: 2.0,
            angular_damping: 0.04,
            quantum: None,
            delay: 0.0,
            substep: 1e-4,
        }
    }
}

impl HandParameters {
    /// Rounding tolerance of times, as a share of a substep. A time that is earlier than the end of a substep by no
    /// more than this counts as that end, because times are sums of rounded periods of the haptic loop.
    pub const EARLY: f64 = 1e-6;

    /// Checks that all values are in range.
    ///
    /// # Errors
    /// One line that names the first value out of range, and the allowed range.
    pub fn check(&self) -> Result<(), String> {
        let ranges = [
            ("mass", self.mass, 1e-3, 10.0, "kg"),
            ("stiffness", self.stiffness, 0.0, 1e5, "N/m"),
            ("damping", self.damping, 0.0, 1e3, "N s/m"),
            ("device_damping", self.device_damping, 0.0, 1e3, "N s/m"),
            ("friction", self.friction, 0.0, 100.0, "N"),
            ("inertia", self.inertia, 1e-6, 1.0, "kg m^2"),
            ("angular_stiffness", self.angular_stiffness, 0.0, 1e3, "N m/rad"),
            ("angular_damping", self.angular_damping, 0.0, 10.0, "N m s/rad"),
            ("quantum", self.quantum.unwrap_or(0.0), 0.0, 0.01, "m"),
            ("delay", self.delay, 0.0, 1.0, "s"),
            ("substep", self.substep, 1e-5, 1e-3, "s"),
        ];
        for (name, value, least, most, unit) in ranges {
            if !(least..=most).contains(&value) {
                return Err(format!("the hand's {name} is {value} {unit}; give {least} to {most}"));
            }
        }
        let substeps = self.delay / self.substep;
        if (substeps - substeps.round()).abs() > Self::EARLY {
            return Err(format!(
                "the hand's delay is {substeps} substeps of {} s; give a whole number of substeps",
                self.substep
            ));
        }
        Ok(())
    }

    /// The delay, as a number of substeps.
    pub fn delay_substeps(&self) -> u64 {
        (self.delay / self.substep).round() as u64
    }
}
