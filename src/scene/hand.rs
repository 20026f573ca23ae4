//! What the simulated hand is made of.

/// The person and the device, by what matters to stability. People: 0.05 to 0.3 kg, 100 to 500 N/m, 2 to 10 N s/m. Devices
/// render a wall passively up to the lesser of 2 `device_damping` / T and 2 `friction` / `quantum` N/m at a period T (Abbott
/// and Okamura 2005, "Effects of position quantization and sampling rate on virtual-wall passivity"); by default that is
/// 1000 N/m at 1 kHz.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandParameters {
    /// Hand and device, kg; 0.001 to 10.
    pub mass: f64,
    /// Of the arm, N/m; 0 to 100,000.
    pub stiffness: f64,
    /// Of the arm, N s/m; 0 to 1000.
    pub damping: f64,
    /// Viscous, of the device, N s/m; 0 to 1000.
    pub device_damping: f64,
    /// Coulomb, of the device, N, the same in all directions; 0 to 100.
    pub friction: f64,
    /// About any axis, kg m^2; 1e-6 to 1.
    pub inertia: f64,
    /// Of the wrist, N m/rad; 0 to 1000.
    pub angular_stiffness: f64,
    /// Of the wrist and the device, towards the intended angular velocity, N m s/rad; 0 to 10.
    pub angular_damping: f64,
    /// Step of the encoders, each axis by itself, m; 0: none; up to 0.01. Orientation is read as it is.
    pub quantum: f64,
    /// From being told a wrench to playing it, s; a whole number of substeps, up to 1 s.
    pub delay: f64,
    /// Integration step, s; 1e-5 to 0.001.
    pub substep: f64,
}

impl Default for HandParameters {
    /// In the middle of what people are. The wrist swings as fast as the arm, about 7 Hz.
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
            quantum: 2e-5,
            delay: 0.0,
            substep: 1e-4,
        }
    }
}

impl HandParameters {
    /// Part of a substep that a time may lie before its end and still count as there: times are sums of rounded ticks.
    pub const EARLY: f64 = 1e-6;

    /// Whether all are in range.
    ///
    /// # Errors
    /// The first that is not, and its range, one line.
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
            ("quantum", self.quantum, 0.0, 0.01, "m"),
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
            return Err(format!("the hand's delay is {substeps} substeps of {} s; give a whole number", self.substep));
        }
        Ok(())
    }

    /// The delay as a number of substeps.
    pub fn delay_substeps(&self) -> u64 {
        (self.delay / self.substep).round() as u64
    }
}
