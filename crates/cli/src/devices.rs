//! `palpate devices`: one line per Vulkan device, beginning with the index that `--device` takes, and what each offers;
//! or a haptic device's measured resolution, or a check of it.

use std::time::{Duration, Instant};

use clap::ValueEnum;
use glam::{DQuat, DVec3};
use palpate::internal::haptics::Device;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::profile::{MOUSE, PREMIUM};
use palpate::scene::{DeviceKind, HandParameters, HaplyService, Key, Profile};
use palpate::{Error, Result};
use palpate_devices::resolution::Resolution;
use palpate_devices::safety_check::{self, Finding, Guide};
use palpate_devices::{ForceDimension, Hand, Haply, Steered, Touch, haply, vendor};

use crate::signals::Stop;
use crate::{engine, print, tell};

/// How long a haptic device is read, s.
const SECONDS: f64 = 3.0;
/// Speed at which the simulated hand drifts, m/s.
const DRIFT: f64 = 4e-4;

/// Options of `palpate devices`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Also list what each device offers (queue, memory, limits), and which sizes are chosen for it
    #[arg(long)]
    verbose: bool,
    /// List the haptic devices that can be opened instead, each with its profile, or the reason why there is none
    #[arg(long, conflicts_with_all = ["verbose", "calibrate", "test"])]
    haptic: bool,
    /// Measure the resolution of the haptic device that lies at rest, for the key `resolution` of a scene, and list no
    /// Vulkan device
    #[arg(long, value_name = "HAPTIC-DEVICE", conflicts_with = "verbose")]
    calibrate: Option<Kind>,
    /// Check the haptic device, held in a hand, with a tenth of its greatest force at most: free motion, pushes in six
    /// directions, release, watchdog
    #[arg(long, value_name = "HAPTIC-DEVICE", conflicts_with_all = ["verbose", "calibrate"])]
    test: Option<Kind>,
    /// Address of the service of a Haply
    #[arg(long, value_name = "ws://HOST:PORT")]
    address: Option<String>,
    /// Which of several devices: its name in the maker's configuration (touch) or its serial number (force-dimension)
    #[arg(long, value_name = "NAME")]
    unit: Option<String>,
}

/// The haptic devices whose resolution can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// An Inverse3 or a Minverse of Haply
    Haply,
    /// A Touch or Phantom of 3D Systems
    Touch,
    /// A device of Force Dimension, or a Novint Falcon
    ForceDimension,
    /// The simulated hand, as a rehearsal
    Hand,
}

/// The haptic device that the options name, which is not open yet.
fn haptic_device(kind: Kind, arguments: &Arguments) -> Result<Box<dyn Device>> {
    if arguments.address.is_some() && kind != Kind::Haply {
        return Err(Error::Usage("--address is that of a Haply's service: leave it out for other devices".into()));
    }
    if arguments.unit.is_some() && !matches!(kind, Kind::Touch | Kind::ForceDimension) {
        return Err(Error::Usage("--unit belongs to touch and force-dimension: leave it out for other devices".into()));
    }
    let settings = || vendor::Settings { unit: arguments.unit.clone(), ..vendor::Settings::default() };
    Ok(match kind {
        Kind::Haply => {
            let mut service = HaplyService::default();
            service.url = arguments.address.clone().unwrap_or(service.url);
            Box::new(Haply::new(haply::Settings { service, ..haply::Settings::default() }))
        }
        Kind::Touch => Box::new(Touch::new(settings())),
        Kind::ForceDimension => Box::new(ForceDimension::new(settings())),
        Kind::Hand if arguments.test.is_some() => Box::new(safety_check::rehearsal(PREMIUM).map_err(Error::Usage)?),
        Kind::Hand => {
            let key = |time: f64| Key { time, position: DRIFT * time * DVec3::X, orientation: DQuat::IDENTITY };
            let intended = Trajectory::new(&[key(0.0), key(2.0 * SECONDS)], key(0.0));
            Box::new(Hand::new(HandParameters::default(), intended, PREMIUM).map_err(Error::Usage)?)
        }
    })
}

/// Measures the resolution of a haptic device, and prints it as the line of a scene file.
fn calibrate(mut device: Box<dyn Device>) -> Result<()> {
    device.open().map_err(|fault| Error::NoDevice(fault.to_string()))?;
    device.notes().iter().for_each(|note| tell(note));
    let found = Resolution::measure(&mut *device, SECONDS);
    device.close();
    let found = found.map_err(Error::NoDevice)?;
    print(&format!(
        "[haptics]\nresolution = {:.1e}  # m; median of {} changes in {} readings within {:.3} mm\n",
        found.step,
        found.changes,
        found.readings,
        1e3 * found.range
    ))
}

/// Opens each kind of haptic device, and prints what was found. None plays a force.
fn list_haptic(arguments: &Arguments) -> Result<()> {
    let mut is_any_there = false;
    let mut devices: Vec<(String, Box<dyn Device>)> = Vec::new();
    for kind in [Kind::Haply, Kind::Touch, Kind::ForceDimension] {
        let name = kind.to_possible_value().map_or_else(String::new, |value| value.get_name().into());
        devices.push((name, haptic_device(kind, arguments)?));
    }
    for (name, kind) in DeviceKind::CHOICES.into_iter().filter(|(_, kind)| !kind.plays_force()) {
        devices.push((name.into(), Box::new(Steered::new(kind, None, DVec3::ZERO, DQuat::IDENTITY))));
    }
    for (name, mut device) in devices {
        let found = match device.open() {
            Ok(()) => {
                is_any_there = true;
                let Profile { name, max_force, workspace, .. } = device.profile();
                let limits = format!("profile {name}: at most {max_force} N, {:.0} mm from its place", 1e3 * workspace);
                // What plays no force has no limits either.
                let limits = (device.profile() != &MOUSE).then_some(limits);
                limits.into_iter().chain(device.notes()).collect::<Vec<_>>().join("; ")
            }
            Err(fault) => fault.to_string(),
        };
        device.close();
        print(&format!("{name:<16} {found}\n"))?;
    }
    let none = || Error::NoDevice("no haptic device can be opened; the list above says why".into());
    is_any_there.then_some(()).ok_or_else(none)
}

/// Checks a haptic device that a person holds, and prints what was found.
fn test(mut device: Box<dyn Device>, has_watchdog: bool) -> Result<()> {
    let stop = Stop::or_suspended()?;
    device.open().map_err(|fault| Error::NoDevice(fault.to_string()))?;
    device.notes().iter().for_each(|note| tell(note));
    let begun = Instant::now();
    let mut wait = |time: f64| {
        std::thread::sleep(Duration::from_secs_f64(time).saturating_sub(begun.elapsed()));
        begun.elapsed().as_secs_f64()
    };
    let mut say = |line: &str| tell(line);
    let flag = stop.flag();
    let mut guide = Guide { wait: &mut wait, say: &mut say, stop: &flag, has_watchdog };
    let found = safety_check::check(&mut *device, &mut guide);
    device.close();
    let found = found.map_err(Error::Simulation)?;
    let line = |finding: &Finding| format!("{:<5} {}\n", if finding.is_well { "well" } else { "FAULT" }, finding.text);
    print(&found.iter().map(line).collect::<String>())?;
    match found.iter().filter(|finding| !finding.is_well).count() {
        0 => Ok(()),
        count => Err(Error::Simulation(format!("{count} of {} parts of the check are not well", found.len()))),
    }
}

/// Lists all Vulkan devices, the line of a device that cannot be used saying why; or measures or checks a haptic device.
///
/// # Errors
/// No Vulkan device can be used; the haptic device is lost, moves or stands still, or does not pass the check.
pub fn devices(arguments: &Arguments) -> Result<()> {
    if arguments.calibrate.is_none()
        && arguments.test.is_none()
        && (arguments.address.is_some() || arguments.unit.is_some())
    {
        return Err(Error::Usage(
            "--address and --unit name a haptic device: give --calibrate or --test as well".into(),
        ));
    }
    if arguments.haptic {
        return list_haptic(arguments);
    }
    if let Some(kind) = arguments.test {
        return test(haptic_device(kind, arguments)?, kind != Kind::Hand);
    }
    if let Some(kind) = arguments.calibrate {
        return calibrate(haptic_device(kind, arguments)?);
    }
    let devices = engine::devices()?;
    let mut lines = String::new();
    for device in &devices {
        let kind = format!("{:?}", device.kind).to_lowercase();
        lines +=
            &format!("{}  {} ({kind}, {}, Vulkan {})", device.index, device.name, device.driver, device.api_version);
        if let Err(reason) = &device.usable {
            lines += &format!("  not usable: {reason}");
        }
        lines.push('\n');
        for (name, value) in device.details.iter().filter(|_| arguments.verbose) {
            lines += &format!("   {name:<12}{value}\n");
        }
    }
    print(&lines)?;
    match devices.iter().any(|device| device.usable.is_ok()) {
        true => Ok(()),
        false => Err(Error::NoDevice("none of these devices can be used; the list above says why".into())),
    }
}
