//! The program `palpate`.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(palpate_cli::program(std::env::args_os()))
}
