//! One file a command.

use std::io::{self, Write};
use std::sync::{Mutex, PoisonError};

mod check;
mod doctor;
mod evaluate;
mod gap;
mod models;
mod output;
mod perceive;
mod replay;
mod run;
mod simulate;
mod skills;

use crate::arguments::{Arguments, Command};
use crate::error::CliError;

/// Carries out a command. `Ok(false)` is a task that failed.
pub fn execute(arguments: Arguments) -> Result<bool, CliError> {
    let done = match arguments.command {
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
    }?;
    // An answer that nobody got is none.
    match UNTOLD.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(e) => Err(CliError::Other(format!("the answer could not be written to stdout: {e}"))),
        None => Ok(done),
    }
}

/// Why something could not be printed.
static UNTOLD: Mutex<Option<io::Error>> = Mutex::new(None);

/// Prints to stdout. A reader that went away is no error; what else goes wrong is one of the command, once it is done.
pub fn print(text: &str) {
    let mut out = io::stdout().lock();
    if let Err(e) = out.write_all(text.as_bytes()).and_then(|()| out.flush())
        && e.kind() != io::ErrorKind::BrokenPipe
    {
        UNTOLD.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
    }
}
