//! Independent programs that judge what the command made.

use std::ffi::OsStr;
use std::process::Command;

use serde_json::Value;

use crate::command::{Ending, json};
use crate::{program_of_venv, repository};

/// Verdict of a program in `tests/judges`, which must succeed, as JSON.
pub fn judged(judge: &str, arguments: &[impl AsRef<OsStr>]) -> Value {
    let judge = repository().join("tests/judges").join(judge);
    let mut python = Command::new(program_of_venv("python"));
    json(&python.arg(judge).args(arguments).succeeds())
}
