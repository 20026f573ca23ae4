//! Profiles of haptic devices: limits (force, torque, stiffness, damping, workspace), whether a device senses rotation,
//! and the resolution of its positions. The limits of real devices are those of CHAI3D (`cHapticDeviceInfo` of its
//! drivers, version 3.2), except for [`MINVERSE`], which names its sources. Greatest stiffness and damping are what a
//! device renders stably at 1 kHz, not what its mechanism has. Resolutions are the nominal ones that makers state for
//! the middle of the workspace (860 dots per inch for a Premium, 450 for a Touch, 400 for a Falcon), from general
//! knowledge: the data sheets were not at hand. `palpate devices --calibrate` measures the resolution of one device.

/// Limits and abilities of one haptic device.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Name of the profile in a scene file.
    pub name: &'static str,
    /// Greatest force, N.
    pub max_force: f64,
    /// Greatest torque, N m; 0: the device cannot play torque.
    pub max_torque: f64,
    /// Greatest linear stiffness at 1 kHz, N/m.
    pub stiffness: f64,
    /// Greatest linear damping at 1 kHz, N s/m.
    pub damping: f64,
    /// Greatest angular stiffness at 1 kHz, N m/rad.
    pub angular_stiffness: f64,
    /// Greatest angular damping at 1 kHz, N m s/rad.
    pub angular_damping: f64,
    /// Radius of the workspace, m: how far the device can move from the position at which it is opened.
    pub workspace: f64,
    /// Whether the device senses rotation.
    pub senses_rotation: bool,
    /// Resolution of the positions that the device reads, which is the step of its encoders, m. `None`: it is not
    /// known.
    pub resolution: Option<f64>,
}

/// All built-in profiles. Two of them are not those of a haptic device: `scripted` is for poses that follow a script
/// while nobody holds a device, and `mouse` is for a mouse.
pub const PROFILES: [Profile; 10] = [
    profile("scripted", [20.0, 1.0], [5000.0, 30.0], [5.0, 0.05], 10.0, true),
    PREMIUM,
    TOUCH,
    OMEGA,
    DELTA,
    SIGMA,
    FALCON,
    INVERSE3,
    MINVERSE,
    MOUSE,
];

/// Resolution that is assumed of a device whose resolution is not known, m.
pub const ASSUMED_RESOLUTION: f64 = 2e-5;

/// Profile of the Phantom Premium 1.5 of 3D Systems.
pub const PREMIUM: Profile =
    profile("premium", [8.5, 0.188], [800.0, 5.0], [0.3, 0.004], 0.12, true).of_resolution(3e-5);

/// Profile of the Touch of 3D Systems, formerly Phantom Omni.
pub const TOUCH: Profile = profile("touch", [3.3, 0.0], [400.0, 4.0], [0.0, 0.0], 0.075, true).of_resolution(5.5e-5);

/// Profile of Force Dimension's omega.3, omega.6 and omega.7. Only the latter two sense rotation.
pub const OMEGA: Profile =
    profile("omega.x", [12.0, 0.0], [5000.0, 30.0], [0.0, 0.0], 0.075, false).of_resolution(1e-5);

/// Profile of Force Dimension's delta.6.
pub const DELTA: Profile = profile("delta.6", [20.0, 0.2], [5000.0, 30.0], [1.0, 0.0], 0.15, true).of_resolution(3e-5);

/// Profile of Force Dimension's sigma.7.
pub const SIGMA: Profile =
    profile("sigma.7", [12.0, 0.2], [4000.0, 30.0], [1.0, 0.07], 0.075, true).of_resolution(1.5e-6);

/// Profile of the Novint Falcon.
pub const FALCON: Profile =
    profile("falcon", [8.0, 0.0], [3000.0, 20.0], [0.0, 0.0], 0.04, false).of_resolution(6.3e-5);

/// Profile of the Haply Inverse3.
pub const INVERSE3: Profile = profile("inverse3", [10.0, 0.0], [1000.0, 6.0], [0.0, 0.0], 0.15, false);

/// Profile of the Haply Minverse. The workspace is the radius within which Haply's tutorial keeps the cursor of a
/// Minverse (docs.haply.co, Inverse service 3.5, tutorial 06: 0.04 m; for an Inverse3 it is 0.10 m). The force is the
/// lower end of the range (2 to 4 N) that a comparison of haptic controllers quotes from haply.co/minverse; the maker's
/// data sheet was not available. The Minverse's stiffness and damping are not published: the values here are the
/// default stiffness and the greatest damping in Haply's tutorials for the larger Inverse3.
pub const MINVERSE: Profile = profile("minverse", [2.0, 0.0], [300.0, 3.0], [0.0, 0.0], 0.04, false);

/// The profiles of Haply's devices.
pub const HAPLY: [Profile; 2] = [INVERSE3, MINVERSE];

/// The Haply profile that is lowest in every limit; it is used for a Haply device as long as the type of the device is
/// not known.
pub const HAPLY_SMALLEST: Profile = MINVERSE;

/// Profile of a mouse that is used as a haptic device. The force may be large, because nobody feels it: it is only
/// shown on the screen.
pub const MOUSE: Profile = profile("mouse", [20.0, 1.0], [5000.0, 30.0], [5.0, 0.05], 10.0, true);

const fn profile(
    name: &'static str,
    [max_force, max_torque]: [f64; 2],
    [stiffness, damping]: [f64; 2],
    [angular_stiffness, angular_damping]: [f64; 2],
    workspace: f64,
    senses_rotation: bool,
) -> Profile {
    Profile {
        name,
        max_force,
        max_torque,
        stiffness,
        damping,
        angular_stiffness,
        angular_damping,
        workspace,
        senses_rotation,
        resolution: None,
    }
}

impl Profile {
    const fn of_resolution(mut self, resolution: f64) -> Profile {
        self.resolution = Some(resolution);
        self
    }

    /// Resolution of the device's positions, m; where it is not known, [`ASSUMED_RESOLUTION`].
    pub fn step(&self) -> f64 {
        self.resolution.unwrap_or(ASSUMED_RESOLUTION)
    }

    /// The profile called `name`; `None` if there is no such profile.
    pub fn named(name: &str) -> Option<&'static Profile> {
        PROFILES.iter().find(|profile| profile.name == name)
    }

    /// Whether this is the profile of one of Haply's devices.
    pub fn is_haplys(&self) -> bool {
        HAPLY.iter().any(|profile| profile.name == self.name)
    }

    /// Whether each limit of this profile is at most the corresponding limit of `other`.
    pub fn is_within(&self, other: &Profile) -> bool {
        self.limits().iter().zip(other.limits()).all(|((_, own), (_, others))| *own <= others)
    }

    /// This profile with the lower of each limit of both.
    pub fn lowered_by(&self, other: &Profile) -> Profile {
        Profile {
            max_force: self.max_force.min(other.max_force),
            max_torque: self.max_torque.min(other.max_torque),
            stiffness: self.stiffness.min(other.stiffness),
            damping: self.damping.min(other.damping),
            angular_stiffness: self.angular_stiffness.min(other.angular_stiffness),
            angular_damping: self.angular_damping.min(other.angular_damping),
            workspace: self.workspace.min(other.workspace),
            ..self.clone()
        }
    }

    /// This profile for a device, or a driver, that plays no torque.
    pub fn without_torque(&self) -> Profile {
        Profile { max_torque: 0.0, angular_stiffness: 0.0, angular_damping: 0.0, ..self.clone() }
    }

    /// All limits, each with the name of its field.
    fn limits(&self) -> [(&'static str, f64); 7] {
        [
            ("max_force", self.max_force),
            ("max_torque", self.max_torque),
            ("stiffness", self.stiffness),
            ("damping", self.damping),
            ("angular_stiffness", self.angular_stiffness),
            ("angular_damping", self.angular_damping),
            ("workspace", self.workspace),
        ]
    }

    /// Checks a profile that comes from outside the program: each limit must be finite and not negative, the workspace
    /// greater than zero, and the resolution, if it is known, greater than zero and at most 0.01 m.
    ///
    /// # Errors
    /// One line about the first value that is not valid.
    pub fn check(&self) -> Result<(), String> {
        if let Some(resolution) = self.resolution.filter(|x| !(*x > 0.0 && *x <= 0.01)) {
            return Err(format!(
                "profile {}: resolution is {resolution}; give more than 0 and at most 0.01 m",
                self.name
            ));
        }
        let fits =
            |name: &str, figure: f64| figure.is_finite() && figure >= 0.0 && (figure > 0.0 || name != "workspace");
        match self.limits().into_iter().find(|&(name, figure)| !fits(name, figure)) {
            Some(("workspace", figure)) => {
                Err(format!("profile {}: workspace is {figure}; give a radius greater than 0", self.name))
            }
            Some((name, figure)) => Err(format!("profile {}: {name} is {figure}; give 0 or more", self.name)),
            None => Ok(()),
        }
    }

    /// Whether the device can play torque.
    pub fn plays_torque(&self) -> bool {
        self.max_torque > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Greatest force (N), torque (N m), stiffness (N/m) and damping (N s/m) that the profile of each device must have.
    /// The values are CHAI3D's, except for those of the last device, whose sources [`MINVERSE`] names.
    const PUBLISHED: [(&str, [f64; 4]); 8] = [
        ("premium", [8.5, 0.188, 800.0, 5.0]),
        ("touch", [3.3, 0.0, 400.0, 4.0]),
        ("omega.x", [12.0, 0.0, 5000.0, 30.0]),
        ("delta.6", [20.0, 0.2, 5000.0, 30.0]),
        ("sigma.7", [12.0, 0.2, 4000.0, 30.0]),
        ("falcon", [8.0, 0.0, 3000.0, 20.0]),
        ("inverse3", [10.0, 0.0, 1000.0, 6.0]),
        ("minverse", [2.0, 0.0, 300.0, 3.0]),
    ];

    #[test]
    fn profiles_hold_the_published_figures() {
        for (name, figures) in PUBLISHED {
            let p = Profile::named(name).unwrap();
            assert_eq!(
                [p.max_force, p.max_torque, p.stiffness, p.damping],
                figures,
                "greatest force, torque, stiffness and damping of {name}"
            );
            assert_eq!(p.plays_torque(), figures[1] > 0.0, "whether {name} plays torque");
        }
        assert_eq!(Profile::named("omni"), None);
    }

    #[test]
    fn the_smallest_haply_is_within_every_other() {
        assert!(HAPLY.iter().all(|profile| Profile::named(profile.name) == Some(profile) && profile.is_haplys()));
        assert!(HAPLY.iter().all(|profile| HAPLY_SMALLEST.is_within(profile)));
        assert!(!INVERSE3.is_within(&MINVERSE) && PROFILES.iter().all(|profile| profile.is_within(profile)));
        assert!(!PROFILES[0].is_haplys());
        // A profile of which a single limit is above that of another profile is not within the other profile.
        let far = Profile { workspace: 0.2, ..MINVERSE };
        assert!(!far.is_within(&INVERSE3));
    }

    type Change = fn(&mut Profile, f64);

    #[test]
    fn only_figures_that_can_be_are_accepted() {
        let changes: [(&str, Change); 7] = [
            ("max_force", |p, x| p.max_force = x),
            ("max_torque", |p, x| p.max_torque = x),
            ("stiffness", |p, x| p.stiffness = x),
            ("damping", |p, x| p.damping = x),
            ("angular_stiffness", |p, x| p.angular_stiffness = x),
            ("angular_damping", |p, x| p.angular_damping = x),
            ("workspace", |p, x| p.workspace = x),
        ];
        for profile in PROFILES {
            assert_eq!(profile.check(), Ok(()), "limits of the profile {}", profile.name);
            for (name, change) in changes {
                for (figure, fits) in
                    [(0.0, name != "workspace"), (-1.0, false), (f64::NAN, false), (f64::INFINITY, false)]
                {
                    let mut changed = profile.clone();
                    change(&mut changed, figure);
                    let said = changed.check();
                    assert_eq!(said.is_ok(), fits, "whether `check` accepts {name} = {figure}");
                    assert!(said.err().is_none_or(|line| line.contains(name) && !line.contains('\n')));
                }
            }
            for resolution in [0.0, -1e-6, 0.011, f64::NAN, f64::INFINITY] {
                let changed = Profile { resolution: Some(resolution), ..profile.clone() };
                assert!(changed.check().is_err_and(|line| line.contains("resolution")), "{resolution} is accepted");
            }
        }
    }
}
