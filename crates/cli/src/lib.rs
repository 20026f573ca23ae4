//! The `palpate` program: reads the command line, runs one command, and turns an error into one line and an exit status
//! (0 success, 2 bad input, 3 no usable device, 4 the simulation failed). It is a library so that the Python package can
//! run it too.

mod bench;
mod devices;
mod diff;
mod ending;
mod engine;
mod export;
#[cfg(feature = "view")]
mod figures;
#[cfg(feature = "view")]
mod film;
mod fit;
mod hold;
mod prepare;
mod press;
mod query;
#[cfg(all(test, feature = "view"))]
mod reference;
mod replay;
mod report;
mod run;
mod selftest;
mod signals;
mod stability;
mod validate;
#[cfg(feature = "view")]
mod view;

use std::ffi::OsString;
use std::io::{IsTerminal, Write};

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};
use palpate::internal::{files, printable};
use palpate::{Error, Result};

#[cfg(feature = "view")]
pub use film::Look;
pub use hold::leaders;
pub use report::haptics::summary as session_summary;

/// Feel soft bodies: deformable contact and haptic forces on any Vulkan 1.3 device.
#[derive(Parser)]
#[command(name = "palpate", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate a scene, and report its steps and the state at the end
    Run(Box<run::Arguments>),
    /// Run a recorded haptic session again, and report the first difference from the recording
    Replay(replay::Arguments),
    /// Compare two runs: their traces, and their series of fields
    Diff(diff::Arguments),
    /// Make a soft body from a surface mesh, with a report, images and a scene in which the body is touched
    Prepare(prepare::Arguments),
    /// Find where two undeformed surfaces overlap
    Query(query::Arguments),
    /// Find the values of a scene with which its force agrees best with a measured curve
    Fit(fit::Arguments),
    /// Run benchmarks and write their report
    Bench(bench::Arguments),
    /// Check that a Vulkan device computes what it should, and measure what a pass and a submit cost
    Selftest(selftest::Arguments),
    /// Run stiff and extreme cases, and check that each keeps the invariants of a simulation
    Stability(stability::Arguments),
    /// Compute values that others published, and check that they are reproduced
    Validate(validate::Arguments),
    /// Render a scene as a film or as a folder of images, without a display
    #[cfg(feature = "view")]
    Film(film::Arguments),
    /// Render the figures of the README
    #[cfg(feature = "view")]
    Figures(figures::Arguments),
    /// Show a scene in a window, and move its tool with the mouse or a haptic device
    #[cfg(feature = "view")]
    View(view::Arguments),
    /// List the Vulkan devices; if a device cannot be used, its line says why
    Devices(devices::Arguments),
}

/// Runs the program with these arguments, its name first; returns the exit status. The process is the program's own: a
/// signal may end it.
pub fn program(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> u8 {
    signals::this_is_the_program();
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(error) => return usage(&error),
    };
    match run_command(arguments.command) {
        Ok(()) => 0,
        Err(error) => {
            let message = error.to_string().lines().collect::<Vec<_>>().join(" ");
            // A closed stderr is ignored; the exit status remains.
            let _ = writeln!(std::io::stderr(), "error: {message}");
            error.exit_status()
        }
    }
}

/// Runs the program with these arguments, its name first.
///
/// # Errors
/// The command line cannot be read, or the command failed.
pub fn command(arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<()> {
    run_command(Arguments::try_parse_from(arguments).map_err(|error| Error::Usage(one_line(&error)))?.command)
}

fn run_command(command: Command) -> Result<()> {
    files::forget_inputs();
    match command {
        Command::Run(arguments) => run::run(&arguments),
        Command::Replay(arguments) => replay::replay(&arguments),
        Command::Diff(arguments) => diff::diff(&arguments),
        Command::Prepare(arguments) => prepare::prepare(&arguments),
        Command::Query(arguments) => query::query(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Bench(arguments) => bench::bench(&arguments),
        Command::Selftest(arguments) => selftest::selftest(&arguments),
        Command::Stability(arguments) => stability::stability(&arguments),
        Command::Validate(arguments) => validate::validate(&arguments),
        #[cfg(feature = "view")]
        Command::Film(arguments) => film::film(&arguments),
        #[cfg(feature = "view")]
        Command::Figures(arguments) => figures::figures(&arguments),
        #[cfg(feature = "view")]
        Command::View(arguments) => view::view(&arguments),
        Command::Devices(arguments) => devices::devices(&arguments),
    }
}

/// Prints help and version unchanged, and a mistake on the command line as one line, like every other error; returns the
/// exit status.
fn usage(error: &clap::Error) -> u8 {
    if !error.use_stderr() || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = error.print();
    } else {
        // A closed stderr is ignored; the exit status remains.
        let _ = writeln!(std::io::stderr(), "{}", printable(&one_line(error)));
    }
    error.exit_code() as u8
}

/// A mistake on the command line as one line.
fn one_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join("; ")
}

/// Writes a note for the user to standard error; if standard error is closed, the note is dropped.
fn tell(note: &str) {
    drop(writeln!(std::io::stderr(), "note: {}", printable(note)));
}

/// Writes a line of progress to standard error, if standard error is a terminal.
fn watch(what: &str) {
    let mut stderr = std::io::stderr();
    if stderr.is_terminal() {
        // A closed stderr does not stop a measurement.
        drop(writeln!(stderr, "{}", printable(what)));
    }
}

/// Prints to standard output. A closed pipe is not an error: its reader has read enough.
fn print(text: &str) -> Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(printable(text).as_bytes()).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Output { file: "standard output".into(), source })
        }
        _ => Ok(()),
    }
}
