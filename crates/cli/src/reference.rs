//! Makes the page docs/reference/command-line.md from the options that the program `palpate` accepts. A test checks
//! that the page in the repository is the one made here; `PALPATE_WRITE_DOCS=1 cargo test -p palpate-cli --bin palpate`
//! writes the page anew.

use std::fmt::Write;
use std::path::Path;

use clap::{Arg, Command, CommandFactory};

use crate::Arguments;

const HEAD: &str = "# Command line

For whoever runs the program. This page is written from the options that the program accepts; `palpate COMMAND --help`
says the same on a terminal.

An error is one line on standard error; notes there begin with `note:`. A directory that `--out` names appears complete
or not at all.

| environment variable | meaning |
| --- | --- |
| `PALPATE_CACHE` | folder for prepared bodies, compiled pipelines and measurements of devices; else `XDG_CACHE_HOME/palpate`, else `~/.cache/palpate` |
| `VK_DRIVER_FILES` | list of drivers for the Vulkan loader, instead of the system's list |
| `LP_NUM_THREADS` | worker threads of Mesa's lavapipe; wins over `--threads` |
";

fn line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

/// How an option is written on the command line.
fn usage(argument: &Arg) -> String {
    let names: Vec<String> =
        argument.get_value_names().unwrap_or_default().iter().map(|name| name.to_string()).collect();
    let takes_value =
        argument.get_num_args().is_none_or(|range| range.max_values() > 0) && argument.get_action().takes_values();
    match argument.get_long() {
        None => names.join(" "),
        Some(long) if !takes_value => format!("--{long}"),
        Some(long) if argument.is_require_equals_set() => format!("--{long}[={}]", names.join(" ")),
        Some(long) => format!("--{long} {}", names.join(" ")),
    }
}

fn described(argument: &Arg) -> String {
    let mut text = argument.get_help().map(|help| line(&help.to_string())).unwrap_or_default();
    let choices: Vec<String> =
        argument.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect();
    if argument.get_action().takes_values() && !choices.is_empty() {
        write!(text, ": {}", choices.join(", ")).unwrap();
    }
    let defaults: Vec<String> =
        argument.get_default_values().iter().map(|v| v.to_string_lossy().into_owned()).collect();
    if argument.get_action().takes_values() && !defaults.is_empty() {
        write!(text, " [default: {}]", defaults.join(",")).unwrap();
    }
    text
}

fn page() -> String {
    let mut page = HEAD.to_owned();
    page += "\n| exit status | meaning |\n| --- | --- |\n";
    for (status, meaning) in palpate::Error::EXIT_STATUSES {
        writeln!(page, "| {status} | {meaning} |").unwrap();
    }
    let mut program = Arguments::command();
    program.build();
    let commands: Vec<&Command> = program.get_subcommands().filter(|command| command.get_name() != "help").collect();
    for command in commands {
        let about = command.get_about().map(|text| line(&text.to_string())).unwrap_or_default();
        write!(page, "\n## palpate {}\n\n{about}.\n", command.get_name()).unwrap();
        let shown = |argument: &&Arg| argument.get_id() != "help" && !argument.is_hide_set();
        let mut rows = command.get_arguments().filter(shown).peekable();
        if rows.peek().is_some() {
            page += "\n| argument or option | meaning |\n| --- | --- |\n";
        }
        for argument in rows {
            writeln!(page, "| `{}` | {} |", usage(argument).replace('|', "\\|"), described(argument)).unwrap();
        }
    }
    page
}

#[test]
fn the_page_of_the_command_line_is_that_of_the_program() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/command-line.md");
    if std::env::var_os("PALPATE_WRITE_DOCS").is_some() {
        std::fs::write(&file, page()).unwrap();
    }
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written == page(), "{} is out of date: write the page with PALPATE_WRITE_DOCS=1", file.display());
}
