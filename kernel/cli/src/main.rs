//! The program `sagci`: runs task scripts, and shows the models, skills and recordings that they are made of.
//!
//! It exits with 0 if what was asked for is done, 1 if a task failed, 2 if the tool or its input was wrong. Results go to
//! stdout; progress and errors go to stderr.
#![forbid(unsafe_code)]

mod arguments;
mod commands;
mod error;
mod place;
mod table;
mod watch;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    match commands::execute(arguments::Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(e) => {
            eprintln!("error: {e}");
            ExitCode::from(2)
        }
    }
}
