//! Runs a script to its end.

use std::path::{Path, PathBuf};

use rhai::{EvalAltResult, Position, Scope};

use super::check::folder_of;
use super::engine::{Surroundings, Termination, engine};
use crate::Diagnostic;

/// How a script ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// It ran to its end.
    Done,
    /// A failure was thrown and not caught: by a skill, or by the script itself.
    Failed {
        /// Code of the failure; `thrown` if the script threw something of its own.
        code: String,
        /// Where in the skill, if a skill failed.
        stage: String,
        /// What was thrown, and from where.
        diagnostic: Diagnostic,
    },
    /// Someone asked for it to stop.
    Interrupted,
    /// The script asks for what cannot be.
    Wrong(Diagnostic),
    /// The world or the program broke down.
    Broken(String),
}

/// Runs a script that [`check`](super::check::check) found nothing wrong in.
pub fn execute(script: &Path, surroundings: Surroundings) -> End {
    let engine = engine(&folder_of(script), surroundings);
    let mut ast = match engine.compile_file(script.to_owned()) {
        Ok(ast) => ast,
        Err(e) => return end_of(script, &e),
    };
    ast.set_source(script.to_string_lossy().as_ref());
    match engine.run_ast_with_scope(&mut Scope::new(), &ast) {
        Ok(()) => End::Done,
        Err(e) => end_of(script, &e),
    }
}

fn end_of(script: &Path, error: &EvalAltResult) -> End {
    // Down to what happened first, and the file in which it did.
    let (mut file, mut inner) = (script.to_owned(), error);
    let mut position = inner.position();
    loop {
        inner = match inner {
            EvalAltResult::ErrorInFunctionCall(_, source, next, _) => {
                if !source.is_empty() {
                    file = PathBuf::from(source);
                }
                next
            }
            EvalAltResult::ErrorInModule(path, next, _) => {
                // The text that a missing or wrong module leaves behind has no place of its own.
                if !next.position().is_none() {
                    file = super::modules::locate(&folder_of(script), path).unwrap_or(file);
                }
                next
            }
            _ => break,
        };
        if !inner.position().is_none() {
            position = inner.position();
        }
    }
    match inner {
        EvalAltResult::ErrorTerminated(token, _) => match token.clone().try_cast::<Termination>() {
            Some(Termination::Refused(refusal)) => End::Wrong(Diagnostic::at(&file, position, refusal.message, refusal.hint)),
            Some(Termination::Broken(message)) => End::Broken(message),
            Some(Termination::Interrupted) | None => End::Interrupted,
        },
        EvalAltResult::ErrorRuntime(thrown, _) => thrown_end(&file, position, thrown),
        EvalAltResult::ErrorTooManyOperations(_) => {
            let hint = "is there a loop that never ends? a script may take ten million steps".to_owned();
            End::Wrong(Diagnostic::at(&file, position, "the script takes too many steps", Some(hint)))
        }
        other => End::Wrong(Diagnostic::at(&file, position, without_position(other), None)),
    }
}

fn thrown_end(file: &Path, position: Position, thrown: &rhai::Dynamic) -> End {
    let field = |name: &str| {
        let map = thrown.read_lock::<rhai::Map>()?;
        map.get(name)?.clone().into_string().ok()
    };
    let (code, stage) = (field("code").unwrap_or_else(|| "thrown".to_owned()), field("stage").unwrap_or_default());
    let message = match (field("skill"), field("message")) {
        (Some(skill), Some(message)) => format!("{skill} failed at {stage} ({code}): {message}"),
        (None, Some(message)) => message,
        _ => thrown.to_string(),
    };
    End::Failed { code, stage, diagnostic: Diagnostic::at(file, position, message, None) }
}

/// Rhai writes the position behind its messages, and a diagnostic has it in front.
fn without_position(error: &EvalAltResult) -> String {
    let text = error.to_string();
    match text.rfind(" (line ") {
        Some(end) if text.ends_with(')') => text[..end].to_owned(),
        _ => text,
    }
}
