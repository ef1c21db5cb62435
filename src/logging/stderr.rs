//! Standard error: every line for people, in the form that suits its reader.
//!
//! On a terminal a line is as short as possible. Elsewhere it begins with its date and time, since a night's log is read in the morning.
//! With `--progress json` it is an object of `schema/progress.schema.json`, for programs. Lines may contain text from a simulator, a client
//! or a file, so control characters are shown by their numbers in all three.

use std::io::{self, IsTerminal, Write};
use std::sync::OnceLock;
use std::time::SystemTime;

use chrono::{DateTime, SecondsFormat, Utc};
use dataset::plain::{plain, plain_lines};
use serde::Serialize;

use crate::progress::beside_bars;

/// The readers of standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    /// A person at a terminal.
    Terminal,
    /// A person, later.
    Log,
    /// A program.
    Json,
}

/// Severity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Level {
    Error,
    Warning,
    Info,
    Detail,
}

/// A line as a program reads it.
#[derive(Serialize)]
struct Message<'a> {
    time: String,
    kind: &'static str,
    level: Level,
    text: &'a str,
}

static FORM: OnceLock<Form> = OnceLock::new();

/// Sets the form to JSON. Without it, the form depends on standard error being a terminal.
pub(crate) fn use_json() {
    let _ = FORM.set(Form::Json);
}

/// The form of this process.
pub(crate) fn form() -> Form {
    *FORM.get_or_init(|| {
        if io::stderr().is_terminal() {
            Form::Terminal
        } else {
            Form::Log
        }
    })
}

/// Writes a verb's message. `step`: its step of the work, as `generate: `, or empty.
pub(crate) fn say(level: Level, step: &str, text: &str) {
    write(level, &message(level, step, text));
}

/// A verb's message in this process's form, safe for a terminal.
pub(crate) fn message(level: Level, step: &str, text: &str) -> String {
    form().text_of(level, step, text, has_colours())
}

/// Writes an event of the log.
pub(crate) fn log(level: Level, text: &str) {
    let form = form();
    let text = match form {
        Form::Json => text.to_owned(),
        Form::Terminal => format!("{} {text}", coloured(level.tag(), level, has_colours())),
        Form::Log => format!("{} {text}", level.tag()),
    };
    write(level, &text);
}

/// Writes a text that is safe and in its form already, but for its time.
fn write(level: Level, text: &str) {
    let time = SystemTime::now();
    match form() {
        Form::Terminal => write_line(text),
        Form::Log => write_line(&format!("{} {text}", utc(time))),
        Form::Json => write_json(&Message {
            time: utc(time),
            kind: "message",
            level,
            text,
        }),
    }
}

/// Writes an object for a program.
pub(crate) fn write_json(line: &impl Serialize) {
    if let Ok(line) = serde_json::to_string(line) {
        write_line(&line);
    }
}

/// A reader that is gone is no failure.
fn write_line(line: &str) {
    let _ = beside_bars(|| writeln!(io::stderr().lock(), "{line}"));
}

/// Date and time of day, UTC: `2026-11-26T00:00:05Z`.
pub(crate) fn utc(time: SystemTime) -> String {
    DateTime::<Utc>::from(time).to_rfc3339_opts(SecondsFormat::Secs, true)
}

impl Form {
    /// A verb's message, safe for a terminal. Errors and warnings are named as such, and later lines are indented, so that no text of
    /// others begins a line.
    fn text_of(self, level: Level, step: &str, text: &str, has_colours: bool) -> String {
        let text = if self == Self::Json {
            plain(text)
        } else {
            plain_lines(text)
        };
        let word = match level {
            Level::Error => "error",
            Level::Warning => "warning",
            Level::Info | Level::Detail => return format!("{step}{text}"),
        };
        let has_colours = has_colours && self == Self::Terminal;
        format!("{step}{}: {text}", coloured(word, level, has_colours))
    }
}

impl Level {
    fn tag(self) -> &'static str {
        match self {
            Self::Error => "ERROR",
            Self::Warning => " WARN",
            Self::Info => " INFO",
            Self::Detail => "DEBUG",
        }
    }
}

/// True if the terminal shows colours and the user has not disabled them (<https://no-color.org>).
fn has_colours() -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_none_or(|term| term == "dumb");
    form() == Form::Terminal && !is_set("NO_COLOR") && !is_dumb
}

fn coloured(word: &str, level: Level, has_colours: bool) -> String {
    let colour = match level {
        Level::Error => "1;31",
        Level::Warning => "1;33",
        Level::Info => "32",
        Level::Detail => "2",
    };
    if has_colours {
        format!("\u{1b}[{colour}m{word}\u{1b}[0m")
    } else {
        word.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_time_has_its_date() {
        let at = SystemTime::UNIX_EPOCH + Duration::from_secs(1_795_651_205);
        assert_eq!(utc(at), "2026-11-26T00:00:05Z");
    }

    #[test]
    fn only_a_terminal_gets_colours_and_only_its_own() {
        let text = |form: Form, colours| form.text_of(Level::Error, "", "\u{1b}[2Jno", colours);
        assert_eq!(
            text(Form::Terminal, true),
            "\u{1b}[1;31merror\u{1b}[0m: \\u{1b}[2Jno"
        );
        assert_eq!(text(Form::Terminal, false), "error: \\u{1b}[2Jno");
        assert_eq!(text(Form::Log, true), "error: \\u{1b}[2Jno");
        assert_eq!(text(Form::Json, true), "error: \\u{1b}[2Jno");
    }

    #[test]
    fn a_message_has_the_level_of_its_caller_whatever_it_says() {
        let text = |level, text| Form::Log.text_of(level, "generate: ", text, false);
        assert_eq!(
            text(Level::Warning, "0037 is set aside"),
            "generate: warning: 0037 is set aside"
        );
        assert_eq!(text(Level::Info, "error: no"), "generate: error: no");
    }

    #[test]
    fn no_later_line_of_a_message_begins_like_a_line_of_ours() {
        let text =
            |form: Form| form.text_of(Level::Error, "", "cn/x\n2026-11-26T00:00:00Z done", false);
        assert_eq!(text(Form::Log), "error: cn/x\n  2026-11-26T00:00:00Z done");
        // In an object it is one string.
        assert_eq!(text(Form::Json), "error: cn/x\n2026-11-26T00:00:00Z done");
    }
}
