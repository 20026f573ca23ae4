//! Reads the table `[haptics]` of a scene file, for `load.rs`: the haptic device, the haptic loop, and limits below
//! those of the device. The device moves the tool, a rigid body of the simulation. The haptic loop reads the device's
//! pose and *plays* a force, that is, commands it to the device, at a fixed rate. In this file "device" is always the
//! haptic device, a *wrench* is the force and torque on the tool that a step of the simulation reports, and a *profile*
//! is the limits and abilities of one model of device. The table `[drive]` of a scene file is the reference trajectory:
//! poses at given times, which the device follows where no user moves it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::check;
use super::hand::HandParameters;
use super::keys::{Table, Value};
use super::profile::{HAPLY, PROFILES, Profile};
use super::reference;
use crate::Result;

/// Least and greatest rate of the haptic loop, Hz.
pub const RATES: [f64; 2] = [50.0, 4000.0];
/// Default of [`Haptics::trust`], m.
const TRUST: f64 = 8e-3;
/// Default of [`Haptics::longest_step`], s.
const LONGEST_STEP: f64 = 0.02;

/// The settings of `[haptics]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Haptics {
    /// Whether a device moves the tool and the simulation runs in real time; otherwise the poses of `[drive]` move the
    /// tool, step by step in simulated time. So it is in the settings of the first tool where any tool has a device.
    pub has_device: bool,
    /// The kind of device.
    pub device: DeviceKind,
    /// The profile of a simulated device; for a real device, a profile that lowers the device's own limits.
    /// `None`: the device's own profile.
    pub profile: Option<&'static Profile>,
    /// Resolution of the device's positions (the step of its encoders), m. `None`: the profile's.
    pub resolution: Option<f64>,
    /// Rate of the haptic loop, Hz.
    pub rate: f64,
    /// Limits that the scene sets below those of the profile.
    pub limits: Lowered,
    /// Whether the loop, until the next wrench arrives, computes the contact force of the moving tool by a local model
    /// (a linear force law about the newest wrench); otherwise the contact force stays that of the newest wrench.
    pub local_model: bool,
    /// The local model is trusted while the tool is at most this far, m, from its pose at the newest wrench.
    pub trust: f64,
    /// Whether the passivity controller acts, a damper that keeps the loop from giving energy to the user's hand;
    /// otherwise that energy is only computed.
    pub passivity: bool,
    /// The longest time step of the simulation, s. With a device, a step is as long as its computation takes, up to
    /// this limit; if the computation takes longer, bodies move slower than in real time.
    pub longest_step: f64,
    /// The simulated person who holds the device, for device = "hand".
    pub hand: HandParameters,
    /// How to reach the service (a program made by Haply) that connects to a Haply device. The device's home position
    /// and rate are not among these settings; the haptic loop sets them.
    pub haply: HaplyService,
    /// Which of several devices of a kind that [has units](DeviceKind::has_units): its name in the maker's
    /// configuration, its serial number, its name or path in the system, or the hand, `left` or `right`. `None`: the
    /// first that is found, the right hand.
    pub unit: Option<String>,
    /// File with the recording of an earlier run of the haptic loop, which is replayed, for device = "replay".
    pub recording: Option<PathBuf>,
}

/// How to reach the service (a program made by Haply) that connects to a Haply device: `haply = { .. }`.
#[derive(Debug, Clone, PartialEq)]
pub struct HaplyService {
    /// Address `ws://HOST:PORT` of the service; HOST must be `localhost` or a loopback address, unless `trust_remote`.
    pub url: String,
    /// Whether the service may run on another machine.
    pub trust_remote: bool,
    /// Id of the device; `None`: the first device of the service.
    pub device_id: Option<String>,
    /// Id of the grip (the handle) whose orientation and buttons count, or [`HaplyService::NO_GRIP`]; `None`: the first
    /// grip of the service that is awake.
    pub grip: Option<String>,
    /// Format of the forces sent; `None`: the format that the service's version requires, and [`Dialect::Vector`] if
    /// the service reports no version.
    pub dialect: Option<Dialect>,
}

impl Default for HaplyService {
    fn default() -> HaplyService {
        let url = "ws://localhost:10001".into();
        HaplyService { url, trust_remote: false, device_id: None, grip: None, dialect: None }
    }
}

impl HaplyService {
    /// Stands for the id of a grip where none counts.
    pub const NO_GRIP: &'static str = "none";
}

/// The JSON key under which the service of a Haply device expects forces in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// The key `vector`, for service version 3.5 and later.
    Vector,
    /// The key `values`, for older service versions 3.x.
    Values,
}

/// Limits that a scene sets; each can only lower the limit of the device's profile.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Lowered {
    /// Greatest force, N.
    pub force: Option<f64>,
    /// Greatest torque, N m.
    pub torque: Option<f64>,
    /// Greatest rate at which the force may change, N/s.
    pub slew: Option<f64>,
    /// Radius of the workspace, m.
    pub workspace: Option<f64>,
    /// Age, s, of the newest wrench above which the force fades to zero.
    pub watchdog: Option<f64>,
}

/// The kinds of haptic device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// No hardware: the pose of the device follows `[drive]`.
    Scripted,
    /// A simulated person, who holds a simulated device and intends to follow `[drive]`.
    Hand,
    /// A recording of an earlier run of the haptic loop: the recorded readings (poses) of a device are read again.
    Replay,
    /// A device made by Haply: an Inverse3 or a Minverse.
    Haply,
    /// A device made by 3D Systems, through OpenHaptics: a Touch, Touch X or Phantom.
    Touch,
    /// A device made by Force Dimension, through its SDK: an omega, delta, sigma or lambda, or a Novint Falcon.
    ForceDimension,
    /// A SpaceMouse of 3Dconnexion, or another multi-axis controller: it plays no force.
    SpaceMouse,
    /// A game pad, which vibrates at most.
    GamePad,
    /// A controller of an OpenXR runtime, which vibrates at most.
    OpenXr,
}

impl DeviceKind {
    /// Every kind, with its name in a scene file.
    pub const CHOICES: [(&'static str, DeviceKind); 9] = [
        ("scripted", DeviceKind::Scripted),
        ("hand", DeviceKind::Hand),
        ("replay", DeviceKind::Replay),
        ("haply", DeviceKind::Haply),
        ("touch", DeviceKind::Touch),
        ("force-dimension", DeviceKind::ForceDimension),
        ("space-mouse", DeviceKind::SpaceMouse),
        ("game-pad", DeviceKind::GamePad),
        ("openxr", DeviceKind::OpenXr),
    ];

    /// Name of the kind in a scene file.
    pub fn name(self) -> &'static str {
        DeviceKind::CHOICES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// Checks that a scene may name a profile for this kind of device. That of a Haply must be a Haply's, and can only
    /// lower the device's own limits; what plays no force has none.
    ///
    /// # Errors
    /// Problem and remedy, if the profile does not go with the kind.
    pub fn check_profile(self, profile: &Profile) -> std::result::Result<(), (&'static str, String)> {
        match self {
            DeviceKind::Haply if !profile.is_haplys() => {
                let names = HAPLY.each_ref().map(|profile| profile.name).join(" or ");
                Err(("is not that of a Haply", format!("remove it, or give {names}")))
            }
            _ if !self.plays_force() => Err(("does not apply to a device that plays no force", "remove it".into())),
            _ => Ok(()),
        }
    }

    /// Whether the device is real, so that a person holds it.
    pub fn is_real(self) -> bool {
        match self {
            DeviceKind::Scripted | DeviceKind::Hand | DeviceKind::Replay => false,
            DeviceKind::Haply | DeviceKind::Touch | DeviceKind::ForceDimension => true,
            DeviceKind::SpaceMouse | DeviceKind::GamePad | DeviceKind::OpenXr => true,
        }
    }

    /// Whether the device pushes the hand that holds it; otherwise the force is seen, and may be shown by vibration.
    pub fn plays_force(self) -> bool {
        !matches!(self, DeviceKind::SpaceMouse | DeviceKind::GamePad | DeviceKind::OpenXr)
    }

    /// Whether the key `unit` tells several devices of this kind apart.
    pub fn has_units(self) -> bool {
        self.is_real() && self != DeviceKind::Haply
    }
}

impl Default for Haptics {
    fn default() -> Haptics {
        Haptics {
            has_device: false,
            device: DeviceKind::Scripted,
            profile: None,
            resolution: None,
            rate: 1000.0,
            limits: Lowered::default(),
            local_model: true,
            trust: TRUST,
            passivity: true,
            longest_step: LONGEST_STEP,
            hand: HandParameters::default(),
            haply: HaplyService::default(),
            unit: None,
            recording: None,
        }
    }
}

/// Reads the table `haptics` of the scene's root table, or of that of a tool; if it is absent, returns the defaults.
pub(super) fn read(root: &Table) -> Result<Haptics> {
    let default = Haptics::default();
    let Some(table) = root.get("haptics").map(|value| value.table(&reference::HAPTICS)).transpose()? else {
        return Ok(default);
    };
    let limit = |key: &str| table.option(key, Value::positive);
    let device = table.or("device", default.device, |value| value.one_of("device", &DeviceKind::CHOICES))?;
    let haptics = Haptics {
        has_device: device != DeviceKind::Scripted,
        device,
        profile: table.option("profile", profile)?,
        resolution: table.option("resolution", |value| value.ruled(check::resolution))?,
        rate: table.or("rate", default.rate, rate)?,
        limits: Lowered {
            force: limit("max_force")?,
            torque: limit("max_torque")?,
            slew: limit("max_slew")?,
            workspace: limit("workspace")?,
            watchdog: limit("watchdog")?,
        },
        local_model: table.or("local_model", true, Value::truth)?,
        trust: table.or("trust", default.trust, Value::positive)?,
        passivity: table.or("passivity", true, Value::truth)?,
        longest_step: table.or("longest_step", default.longest_step, Value::positive)?,
        hand: table.or("hand", default.hand, hand)?,
        haply: table.or("haply", default.haply.clone(), haply)?,
        unit: table.option("unit", |value| value.text().map(String::from))?,
        recording: table.option("recording", Value::file)?,
    };
    let needs = |key: &str, is_there: bool, kind: DeviceKind| match is_there && haptics.device != kind {
        true => Err(table.error(key, format!("belongs to device = \"{}\"", kind.name()), "remove it or set `device`")),
        false => Ok(()),
    };
    needs("hand", table.has("hand"), DeviceKind::Hand)?;
    needs("haply", table.has("haply"), DeviceKind::Haply)?;
    if haptics.unit.is_some() && !haptics.device.has_units() {
        let kinds = DeviceKind::CHOICES.iter().filter(|(_, kind)| kind.has_units());
        let names: Vec<_> = kinds.map(|(name, _)| format!("\"{name}\"")).collect();
        let problem = format!("belongs to device = {}", names.join(" or "));
        return Err(table.error("unit", problem, "remove it or set `device`"));
    }
    haptics.check_unit().map_err(|(problem, remedy)| table.error("unit", problem, remedy))?;
    needs("recording", haptics.recording.is_some(), DeviceKind::Replay)?;
    haptics.check_profile().map_err(|(problem, remedy)| table.error("profile", problem, remedy))?;
    Ok(haptics)
}

impl Haptics {
    /// These settings, with `has_device` as the kind of device asks for.
    pub(super) fn for_device(self) -> Haptics {
        Haptics { has_device: self.device != DeviceKind::Scripted, ..self }
    }

    /// Problem and remedy, if `profile` does not go with the kind of device.
    pub(super) fn check_profile(&self) -> std::result::Result<(), (&'static str, String)> {
        self.profile.map_or(Ok(()), |profile| self.device.check_profile(profile))
    }

    /// Problem and remedy, if `unit` does not go with the kind of device.
    pub(super) fn check_unit(&self) -> std::result::Result<(), (&'static str, &'static str)> {
        let Some(unit) = &self.unit else { return Ok(()) };
        match self.device {
            DeviceKind::Touch if unit.is_empty() || unit.contains('\0') => {
                Err(("is no name of a device", "give the name that the maker's Touch Setup shows"))
            }
            DeviceKind::ForceDimension if unit.parse::<u16>().is_err() => {
                Err(("is no serial number of a device", "give one such as \"12345\""))
            }
            DeviceKind::OpenXr if unit != "left" && unit != "right" => {
                Err(("is no hand", "give \"left\" or \"right\""))
            }
            // A scene of such a device may be rehearsed with another one.
            _ => Ok(()),
        }
    }
}

/// Reads `hand = { mass = 0.15, .. }`.
fn hand(value: &Value) -> Result<HandParameters> {
    let (table, mut hand) = (value.table(&reference::HAND)?, HandParameters::default());
    let places = [
        ("mass", &mut hand.mass),
        ("stiffness", &mut hand.stiffness),
        ("damping", &mut hand.damping),
        ("device_damping", &mut hand.device_damping),
        ("friction", &mut hand.friction),
        ("inertia", &mut hand.inertia),
        ("angular_stiffness", &mut hand.angular_stiffness),
        ("angular_damping", &mut hand.angular_damping),
        ("delay", &mut hand.delay),
    ];
    for (key, place) in places {
        *place = table.or(key, *place, Value::not_negative)?;
    }
    hand.quantum = table.option("quantum", Value::not_negative)?;
    hand.check().map_err(|problem| value.error(problem, "give a number in that range"))?;
    Ok(hand)
}

/// Reads `haply = { address = "ws://localhost:10001", .. }`.
fn haply(value: &Value) -> Result<HaplyService> {
    let (table, default) = (value.table(&reference::HAPLY)?, HaplyService::default());
    let text = |value: &Value| value.text().map(String::from);
    let dialects = [("vector", Dialect::Vector), ("values", Dialect::Values)];
    Ok(HaplyService {
        url: table.or("address", default.url.clone(), text)?,
        trust_remote: table.or("trust_remote", default.trust_remote, Value::truth)?,
        device_id: table.option("device_id", text)?,
        grip: table.option("grip", text)?,
        dialect: table.option("force_key", |value| value.one_of("force key", &dialects))?,
    })
}

fn profile(value: &Value) -> Result<&'static Profile> {
    let choices: Vec<(&str, &Profile)> = PROFILES.iter().map(|profile| (profile.name, profile)).collect();
    value.one_of("profile", &choices)
}

fn rate(value: &Value) -> Result<f64> {
    value.ruled(check::rate)
}
