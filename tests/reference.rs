//! Tests that the page docs/reference/scene.md has exactly the keys that the reader of scene files accepts, and the
//! page docs/reference/flags.md exactly the flags (of a step) and events (of the haptic loop) that the code defines:
//! both pages are made from the code. `PALPATE_WRITE_DOCS=1 cargo test --test reference` writes the two pages anew.

use std::fmt::Write;
use std::path::Path;

use palpate::internal::haptics::event::Event;
use palpate::scene::profile::PROFILES;
use palpate::scene::reference::{ONE_OF, REQUIRED, TABLES};
use palpate::{Explanation, Flags};

const HEAD: &str = "# Scene files

For whoever writes a scene. A scene is a TOML file; paths in it are relative to its folder. Units are SI, y is up,
quaternions are x, y, z, w. An unknown key, a value out of range or a name that does not resolve is an error that names
the file, the line, the key and the remedy.

This page is written from the lists by which the reader accepts keys (`src/scene/reference.rs`). A default in brackets
is a description, not a value. How to choose a material or a mesh stands in the how-to pages.
";

/// The page of scene files, made from the lists of keys that the reader accepts.
fn page() -> String {
    let mut page = HEAD.to_owned();
    let cell = |text: &str| text.replace('|', "\\|");
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
             | profile | force, N | torque, N m | stiffness, N/m | damping, N s/m | radius of the workspace, m | senses rotation | resolution, um |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- |\n";
    for p in PROFILES {
        let torque = if p.max_torque > 0.0 { p.max_torque.to_string() } else { "none".into() };
        let resolution = p.resolution.map_or("not known".into(), |step| format!("{:.1}", 1e6 * step));
        let rotation = if p.senses_rotation { "yes" } else { "no" };
        writeln!(
            page,
            "| `{}` | {} | {torque} | {} | {} | {} | {rotation} | {resolution} |",
            p.name, p.max_force, p.stiffness, p.damping, p.workspace
        )
        .unwrap();
    }
    page
}

const FLAGS_HEAD: &str = "# Flags and events

For whoever sees a flag or an event in a report, and wants to know what it means and what to do.

A *flag* belongs to a step of the simulation. The column `flags` of `trace.csv`, `flags` of a wrench in C and
`StepReport::flags` in Rust are sums of the bits below; `summary.json` counts the steps of each name. A step without a
flag has the value 0. This page is written from the code (`src/stages/flags.rs`, `src/haptics/event.rs`).

## Flags of a step

| bit | name | title | meaning | remedy |
| --- | --- | --- | --- | --- |
";
const EVENTS_HEAD: &str = "
## Events of the haptic loop

An *event* belongs to a tick, one cycle of the haptic loop. `summary.json` counts the ticks of each name, and a recording
written as CSV has a column `events`.

| bit | name | title | meaning | remedy |
| --- | --- | --- | --- | --- |
";

/// The page of flags and events, made from the code.
fn flags() -> String {
    let mut page = FLAGS_HEAD.to_owned();
    let row = |page: &mut String, bit: u32, name: &str, words: &Explanation| {
        let remedy = words.remedy.unwrap_or("none is needed");
        writeln!(page, "| {bit} | `{name}` | {} | {} | {remedy} |", words.title, words.meaning).unwrap();
    };
    for (flag, name) in Flags::ALL {
        for (_, words) in flag.explained() {
            row(&mut page, flag.0, name, words);
        }
    }
    page += EVENTS_HEAD;
    for (event, name) in Event::ALL {
        row(&mut page, 1 << event as u32, name, event.explained());
    }
    page
}

/// Compares a page of the book with `page`, which the code makes; if PALPATE_WRITE_DOCS is set, `page` is written into
/// the book first.
fn compare(name: &str, page: &str) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference").join(name);
    if std::env::var_os("PALPATE_WRITE_DOCS").is_some() {
        std::fs::write(&file, page).unwrap();
    }
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written == page, "{} is out of date; see the start of tests/reference.rs", file.display());
}

#[test]
fn the_page_of_scene_keys_is_that_of_the_reader() {
    compare("scene.md", &page());
}

#[test]
fn the_page_of_flags_has_every_flag_and_every_event() {
    compare("flags.md", &flags());
}
