//! A SpaceMouse of 3Dconnexion, or another device that the USB HID standard calls a multi-axis controller: the tool
//! moves as long as its cap is pushed. Written by descriptions of its protocol; never tried with a real one.
//!
//! A report is one byte that tells its kind, then little-endian numbers: 1, translation, three of 16 bits, to which
//! newer models add the rotation; 2, rotation, likewise; 3, buttons, one bit each. The cap's axes are right, towards
//! the user and down.

use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use glam::DVec3;
use hidapi::{DeviceInfo, HidApi};

use super::{Hardware, Loss, Steering, WAIT, speeds};

/// Usage page (generic desktop) and usage (multi-axis controller) of such a device in the HID standard.
const USAGE: (u16, u16) = (1, 8);
/// What a cap that is pushed as far as it goes reports.
const FULL: f64 = 350.0;
/// Share of `FULL` below which the cap counts as released.
pub(super) const DEAD: f64 = 0.04;

/// Waits for a report for at most the given time, and returns its bytes, none if there was no report.
pub(super) type Reports = Box<dyn FnMut(Duration) -> Result<Vec<u8>, String> + Send>;

/// A SpaceMouse that is open.
pub(super) struct SpaceMouse {
    name: String,
    unit: String,
    reports: Reports,
    /// Translation, then rotation, along the cap's axes.
    axes: [i16; 6],
}

impl SpaceMouse {
    pub(super) fn new(name: String, unit: String, reports: Reports) -> SpaceMouse {
        SpaceMouse { name, unit, reports, axes: [0; 6] }
    }

    /// Takes over what a report says; one of another kind says nothing.
    fn take(&mut self, report: &[u8], steering: &Steering) {
        let Some((kind, numbers)) = report.split_first() else { return };
        let mut axes = |from: usize| {
            for (axis, pair) in self.axes[from..].iter_mut().zip(numbers.chunks_exact(2)) {
                *axis = i16::from_le_bytes([pair[0], pair[1]]);
            }
        };
        match kind {
            1 => axes(0),
            2 => axes(3),
            3 => {
                let bits = numbers.iter().take(4).rev().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
                steering.buttons.store(bits, Relaxed);
            }
            _ => {}
        }
        let [x, y, z, about_x, about_y, about_z] = self.axes.map(|axis| f64::from(axis) / FULL);
        steering.ask(speeds([DVec3::new(x, -z, y), DVec3::new(about_x, -about_z, about_y)], DEAD));
    }
}

impl Hardware for SpaceMouse {
    fn unit(&self) -> String {
        self.unit.clone()
    }

    fn note(&self) -> String {
        format!("{}: plays no force; the tool moves as long as the cap is pushed", self.name)
    }

    fn follow(&mut self, steering: &Steering) -> Result<(), Loss> {
        let report = (self.reports)(WAIT)?;
        self.take(&report, steering);
        Ok(())
    }
}

/// Whether a device is a multi-axis controller, and the one that `unit` names.
fn is_wanted(info: &DeviceInfo, unit: Option<&str>) -> bool {
    let is_it = |unit: &str| info.product_string() == Some(unit) || info.path().to_str() == Ok(unit);
    (info.usage_page(), info.usage()) == USAGE && unit.is_none_or(is_it)
}

/// Opens the multi-axis controller that `unit` names, or the first one.
pub(super) fn open(unit: Option<&str>) -> Result<Box<dyn Hardware>, String> {
    let hid = HidApi::new().map_err(|e| format!("the system's input devices cannot be listed: {e}"))?;
    let Some(info) = hid.device_list().find(|info| is_wanted(info, unit)) else {
        let named = unit.map(|unit| format!(" called {unit}")).unwrap_or_default();
        return Err(format!("no SpaceMouse or other multi-axis controller{named} is plugged in; plug it in"));
    };
    let path = info.path().to_string_lossy().into_owned();
    let device = info.open_device(&hid).map_err(|e| {
        format!("{path} cannot be opened: {e}; allow this user to read it (on Linux by a rule of udev for `hidraw`)")
    })?;
    let name = info.product_string().unwrap_or("multi-axis controller").to_string();
    // Where it has no name, it is known by its path.
    let unit = unit.or(info.product_string()).unwrap_or(&path).into();
    let reports = move |wait: Duration| {
        let mut bytes = [0; 64];
        let count = device.read_timeout(&mut bytes, wait.as_millis() as i32).map_err(|e| e.to_string())?;
        Ok(bytes[..count].to_vec())
    };
    Ok(Box::new(SpaceMouse::new(name, unit, Box::new(reports))))
}
