//! The page of scene keys, docs/reference/scene.md, holds exactly the keys that the reader accepts: it is written from
//! the same lists. `PALPATE_WRITE_DOCS=1 cargo test --test reference` writes it anew.

use std::fmt::Write;
use std::path::Path;

use palpate::scene::profile::PROFILES;
use palpate::scene::reference::{ONE_OF, REQUIRED, TABLES};

const HEAD: &str = "# Scene files

For whoever writes a scene. A scene is a TOML file; paths in it are relative to its folder. Units are SI, y is up,
quaternions are x, y, z, w. An unknown key, a value out of range or a name that does not resolve is an error that names
the file, the line, the key and the remedy.

This page is written from the lists by which the reader accepts keys (`src/scene/reference.rs`). A default in brackets
is described, not a value. How to choose a material or a mesh stands in the how-to pages.
";

/// The page, from the lists of the reader.
fn page() -> String {
    let mut page = HEAD.to_owned();
    let cell = |text: &str| text.replace('|', "\\\\|");
    for table in TABLES {
        let heading =
            if table.heading.starts_with("The ") { table.heading.into() } else { format!("`{}`", table.heading) };
        write!(
            page,
            "\n## {heading}\n\n{}\n\n| key | value | default | meaning |\n| --- | --- | --- | --- |\n",
            table.meaning
        )
        .unwrap();
        for key in table.keys {
            let default = match key.default {
                REQUIRED => "required".into(),
                ONE_OF => "one of these is required".into(),
                text if text.starts_with('(') => text.to_owned(),
                text => format!("`{text}`"),
            };
            writeln!(page, "| `{}` | {} | {} | {} |", key.name, cell(key.value), cell(&default), cell(key.meaning))
                .unwrap();
        }
    }
    page += "\n## Profiles of devices\n\nThe names that `[haptics] profile` and the option `--profile` accept. Stiffness and damping are the \
             greatest that the device renders stably at 1 kHz.\n\n\
             | profile | force, N | torque, N m | stiffness, N/m | damping, N s/m | radius of the workspace, m | senses rotation |\n\
             | --- | --- | --- | --- | --- | --- | --- |\n";
    for p in PROFILES {
        let torque = if p.max_torque > 0.0 { p.max_torque.to_string() } else { "none".into() };
        let rotation = if p.senses_rotation { "yes" } else { "no" };
        writeln!(
            page,
            "| `{}` | {} | {torque} | {} | {} | {} | {rotation} |",
            p.name, p.max_force, p.stiffness, p.damping, p.workspace
        )
        .unwrap();
    }
    page
}

#[test]
fn the_page_of_scene_keys_is_that_of_the_reader() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference/scene.md");
    if std::env::var_os("PALPATE_WRITE_DOCS").is_some() {
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(&file, page()).unwrap();
    }
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written == page(), "{} is out of date: PALPATE_WRITE_DOCS=1 cargo test --test reference", file.display());
}
