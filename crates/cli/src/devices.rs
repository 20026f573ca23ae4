//! `palpate devices`: one line per Vulkan device, beginning with the index that `--device` takes, and what each offers.

use palpate::{Error, Result};

use crate::{engine, print};

/// Options of `palpate devices`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Also list what each device offers (queue, memory, limits), and which sizes are chosen for it
    #[arg(long)]
    verbose: bool,
}

/// Lists all Vulkan devices; the line of a device that cannot be used says why.
pub fn devices(arguments: &Arguments) -> Result<()> {
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
