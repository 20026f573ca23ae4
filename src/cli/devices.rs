//! `palpate devices`: one line a device, its index first, as `--device` takes it.

use palpate::Result;

use crate::{engine, print};

/// Lists the devices that can be used.
pub fn devices() -> Result<()> {
    let lines: Vec<String> =
        engine::devices()?.iter().enumerate().map(|(index, name)| format!("{index}  {name}\n")).collect();
    print(&lines.concat())
}
