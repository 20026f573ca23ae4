//! `[haptics]`: the device, the loop, and limits lower than the device's. Called by `load.rs`.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::check;
use super::hand::HandParameters;
use super::keys::{Table, Value};
use super::profile::{HAPLY, PROFILES, Profile};
use crate::Result;

/// Rates that the loop can keep, Hz.
pub const RATES: [f64; 2] = [50.0, 4000.0];
/// How far the local model is trusted unless a scene says otherwise, m.
const TRUST: f64 = 2e-3;
/// The longest step of the simulation that the loop asks for, s.
const LONGEST_STEP: f64 = 0.02;

/// `[haptics]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Haptics {
    /// Whether a device holds the tool in the world's time; else the scene's keys lead it, a step after another.
    pub is_held: bool,
    /// Which device.
    pub device: DeviceKind,
    /// The profile that a simulated device has, and that a Haply stays within; `None`: the device's own.
    pub profile: Option<&'static Profile>,
    /// Rate of the loop, Hz.
    pub rate: f64,
    /// Limits lower than the profile's.
    pub limits: Lowered,
    /// Whether contact is followed between wrenches.
    pub local_model: bool,
    /// How far, m.
    pub trust: f64,
    /// Whether the passivity controller acts.
    pub passivity: bool,
    /// The longest step of the simulation, s: where it takes longer than this, bodies move slower than in the world.
    pub longest_step: f64,
    /// The simulated human, of device = "hand".
    pub hand: HandParameters,
    /// How a Haply is reached: all but home and rate, which the session knows.
    pub haply: HaplyService,
    /// The session that is played again.
    pub recording: Option<PathBuf>,
}

/// The service that a Haply is reached by, `haply = { .. }`.
#[derive(Debug, Clone, PartialEq)]
pub struct HaplyService {
    /// `ws://HOST:PORT`; its host must be `localhost` or a loopback address.
    pub url: String,
    /// Whether the service may be on another machine.
    pub trust_remote: bool,
    /// Which device; `None`: the first.
    pub device_id: Option<String>,
    /// How forces are sent; `None`: as the service's version asks, [`Dialect::Vector`] where it does not tell one.
    pub dialect: Option<Dialect>,
}

impl Default for HaplyService {
    fn default() -> HaplyService {
        HaplyService { url: "ws://localhost:10001".into(), trust_remote: false, device_id: None, dialect: None }
    }
}

/// How a service wants its forces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dialect {
    /// Under `vector`: version 3.5 and later.
    Vector,
    /// Under `values`: older 3.x.
    Values,
}

/// What a scene asks of the limits; it can lower them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Lowered {
    /// N.
    pub force: Option<f64>,
    /// N m.
    pub torque: Option<f64>,
    /// N/s.
    pub slew: Option<f64>,
    /// m.
    pub workspace: Option<f64>,
    /// s.
    pub watchdog: Option<f64>,
}

/// Which device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// Follows `[drive]`.
    Scripted,
    /// A simulated human who means to follow `[drive]`.
    Hand,
    /// Plays the readings of a recorded session again.
    Replay,
    /// A device of Haply's: an Inverse3 or a Minverse.
    Haply,
}

impl DeviceKind {
    /// Every kind by its name.
    pub const CHOICES: [(&'static str, DeviceKind); 4] = [
        ("scripted", DeviceKind::Scripted),
        ("hand", DeviceKind::Hand),
        ("replay", DeviceKind::Replay),
        ("haply", DeviceKind::Haply),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        DeviceKind::CHOICES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

impl Default for Haptics {
    fn default() -> Haptics {
        Haptics {
            is_held: false,
            device: DeviceKind::Scripted,
            profile: None,
            rate: 1000.0,
            limits: Lowered::default(),
            local_model: true,
            trust: TRUST,
            passivity: true,
            longest_step: LONGEST_STEP,
            hand: HandParameters::default(),
            haply: HaplyService::default(),
            recording: None,
        }
    }
}

const KEYS: [&str; 15] = [
    "device",
    "profile",
    "rate",
    "max_force",
    "max_torque",
    "max_slew",
    "workspace",
    "watchdog",
    "local_model",
    "trust",
    "passivity",
    "longest_step",
    "hand",
    "haply",
    "recording",
];

/// The table, if there is one.
pub(super) fn read(root: &Table) -> Result<Haptics> {
    let default = Haptics::default();
    let Some(table) = root.get("haptics").map(|value| value.table(&KEYS)).transpose()? else { return Ok(default) };
    let limit = |key: &str| table.option(key, Value::positive);
    let device = table.or("device", default.device, |value| value.one_of("a device", &DeviceKind::CHOICES))?;
    let haptics = Haptics {
        is_held: device != DeviceKind::Scripted,
        device,
        profile: table.option("profile", profile)?,
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
        recording: table.option("recording", Value::file)?,
    };
    let needs = |key: &str, is_there: bool, kind: DeviceKind| match is_there && haptics.device != kind {
        true => Err(table.error(key, format!("belongs to device = \"{}\"", kind.name()), "remove it, or the device")),
        false => Ok(()),
    };
    needs("hand", table.has("hand"), DeviceKind::Hand)?;
    needs("haply", table.has("haply"), DeviceKind::Haply)?;
    needs("recording", haptics.recording.is_some(), DeviceKind::Replay)?;
    if let (DeviceKind::Haply, Some(profile)) = (haptics.device, haptics.profile) {
        of_haply(profile).map_err(|remedy| table.error("profile", NOT_HAPLYS, remedy))?;
    }
    Ok(haptics)
}

/// What is wrong with a profile that [`of_haply`] refuses.
pub const NOT_HAPLYS: &str = "is not that of a Haply";

/// Whether a profile may be named for a Haply, whose own it can only lower: one of Haply's devices.
///
/// # Errors
/// What to do where it may not.
pub fn of_haply(profile: &Profile) -> std::result::Result<(), String> {
    let names = || HAPLY.each_ref().map(|profile| profile.name).join(" or ");
    if profile.is_haplys() { Ok(()) } else { Err(format!("remove it, or give {}", names())) }
}

/// `hand = { mass = 0.15, .. }`.
fn hand(value: &Value) -> Result<HandParameters> {
    const KEYS: [&str; 10] = [
        "mass",
        "stiffness",
        "damping",
        "device_damping",
        "friction",
        "inertia",
        "angular_stiffness",
        "angular_damping",
        "quantum",
        "delay",
    ];
    let (table, mut hand) = (value.table(&KEYS)?, HandParameters::default());
    let places = [
        &mut hand.mass,
        &mut hand.stiffness,
        &mut hand.damping,
        &mut hand.device_damping,
        &mut hand.friction,
        &mut hand.inertia,
        &mut hand.angular_stiffness,
        &mut hand.angular_damping,
        &mut hand.quantum,
        &mut hand.delay,
    ];
    for (key, place) in KEYS.into_iter().zip(places) {
        *place = table.or(key, *place, Value::not_negative)?;
    }
    hand.check().map_err(|problem| value.error(problem, "give a number in that range"))?;
    Ok(hand)
}

/// `haply = { address = "ws://localhost:10001", .. }`.
fn haply(value: &Value) -> Result<HaplyService> {
    let (table, default) =
        (value.table(&["address", "trust_remote", "device_id", "force_key"])?, HaplyService::default());
    let text = |value: &Value| value.text().map(String::from);
    let dialects = [("vector", Dialect::Vector), ("values", Dialect::Values)];
    Ok(HaplyService {
        url: table.or("address", default.url.clone(), text)?,
        trust_remote: table.or("trust_remote", default.trust_remote, Value::truth)?,
        device_id: table.option("device_id", text)?,
        dialect: table.option("force_key", |value| value.one_of("a key of forces", &dialects))?,
    })
}

fn profile(value: &Value) -> Result<&'static Profile> {
    let choices: Vec<(&str, &Profile)> = PROFILES.iter().map(|profile| (profile.name, profile)).collect();
    value.one_of("a profile", &choices)
}

fn rate(value: &Value) -> Result<f64> {
    value.ruled(check::rate)
}
