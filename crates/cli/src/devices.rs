//! `palpate devices`: one line per Vulkan device, beginning with the index that `--device` takes, and what each offers;
//! or the measured resolution of a haptic device.

use glam::{DQuat, DVec3};
use palpate::internal::haptics::Device;
use palpate::internal::step::trajectory::Trajectory;
use palpate::scene::profile::PROFILES;
use palpate::scene::{HandParameters, HaplyService, Key, Profile};
use palpate::{Error, Result};
use palpate_devices::resolution::Resolution;
use palpate_devices::{Hand, Haply, haply};

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
    /// Measure the resolution of the haptic device that lies at rest, for the key `resolution` of a scene, and list no
    /// Vulkan device
    #[arg(long, value_name = "HAPTIC-DEVICE", conflicts_with = "verbose")]
    calibrate: Option<Kind>,
    /// Address of the service of a Haply
    #[arg(long, value_name = "ws://HOST:PORT", requires = "calibrate")]
    address: Option<String>,
}

/// The haptic devices whose resolution can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Kind {
    /// An Inverse3 or a Minverse of Haply
    Haply,
    /// The simulated hand, which drifts slowly, as a rehearsal
    Hand,
}

/// Measures the resolution of a haptic device, and prints it as the line of a scene file.
fn calibrate(kind: Kind, address: Option<&str>) -> Result<()> {
    let mut device: Box<dyn Device> = match kind {
        Kind::Haply => {
            let mut service = HaplyService::default();
            service.url = address.map_or(service.url, String::from);
            Box::new(Haply::new(haply::Settings { service, ..haply::Settings::default() }))
        }
        Kind::Hand if address.is_some() => {
            return Err(Error::Usage("--address is that of a Haply's service: leave it out for `hand`".into()));
        }
        Kind::Hand => {
            let key = |time: f64| Key { time, position: DRIFT * time * DVec3::X, orientation: DQuat::IDENTITY };
            let intended = Trajectory::new(&[key(0.0), key(2.0 * SECONDS)], key(0.0));
            let profile = Profile::named("premium").unwrap_or(&PROFILES[0]).clone();
            Box::new(Hand::new(HandParameters::default(), intended, profile).map_err(Error::Usage)?)
        }
    };
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

/// Lists all Vulkan devices, the line of a device that cannot be used saying why; or measures a haptic device.
///
/// # Errors
/// No Vulkan device can be used; the haptic device is lost, moves or stands still.
pub fn devices(arguments: &Arguments) -> Result<()> {
    if let Some(kind) = arguments.calibrate {
        return calibrate(kind, arguments.address.as_deref());
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
