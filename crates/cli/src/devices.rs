//! `palpate devices`: one line per Vulkan device, beginning with the index that `--device` takes.

use palpate::{Error, Result};

use crate::{engine, print};

/// Lists all Vulkan devices; the line of a device that cannot be used says why.
pub fn devices() -> Result<()> {
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
    }
    print(&lines)?;
    match devices.iter().any(|device| device.usable.is_ok()) {
        true => Ok(()),
        false => Err(Error::NoDevice("none of these devices can be used; the list above says why".into())),
    }
}
