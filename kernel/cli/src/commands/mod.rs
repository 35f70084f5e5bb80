//! One file a command.

mod check;
mod doctor;
mod evaluate;
mod gap;
mod models;
mod perceive;
mod replay;
mod run;
mod simulate;
mod skills;

use crate::arguments::{Arguments, Command};
use crate::error::CliError;

/// Carries out a command. `Ok(false)` is a task that failed.
pub fn execute(arguments: Arguments) -> Result<bool, CliError> {
    match arguments.command {
        Command::Run(run) => run::run(&run),
        Command::Check { script, places } => check::check(&script, &places),
        Command::Gap(gap) => gap::gap(&gap),
        Command::Simulate(simulate) => simulate::simulate(&simulate),
        Command::Perceive(perceive) => perceive::perceive(&perceive),
        Command::Evaluate(command) => evaluate::evaluate(&command),
        Command::Models(command) => models::models(&command),
        Command::Skills(command) => skills::skills(&command),
        Command::Replay { recording, .. } => replay::replay(&recording),
        Command::Doctor { places } => doctor::doctor(&places),
    }
}

/// Prints to stdout. A reader that went away is no error.
pub fn print(text: &str) {
    use std::io::Write;
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}
