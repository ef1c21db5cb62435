//! Arguments and options of the verbs.

use clap::{Arg, Command};

use super::markdown::{paragraph, table};
use crate::args::Args;

pub(super) fn sections() -> String {
    let mut command = Args::grouped_command();
    command.build();
    let globals = command.get_arguments().filter(|arg| arg.is_global_set());
    let mut text = String::from("## Every verb\n\n") + &arguments(globals);
    for verb in command.get_subcommands_mut() {
        if verb.is_hide_set() || verb.get_name() == "help" {
            continue;
        }
        text += &section(verb);
    }
    text
}

fn section(verb: &mut Command) -> String {
    let name = verb.get_name().to_owned();
    let usage = verb.render_usage().to_string();
    let usage = usage.trim_start_matches("Usage: ").trim();
    let about = verb.get_long_about().or(verb.get_about());
    let about = about.map(ToString::to_string).unwrap_or_default();
    let own = verb.get_arguments().filter(|arg| !arg.is_global_set());
    format!("## {name}\n\n")
        + &about
            .split("\n\n")
            .map(with_full_stop)
            .map(|part| paragraph(&part))
            .collect::<String>()
        + &format!("```text\n{usage}\n```\n\n")
        + &arguments(own)
}

fn arguments<'a>(arguments: impl Iterator<Item = &'a Arg>) -> String {
    let rows: Vec<_> = arguments
        .filter(|arg| !arg.is_hide_set() && arg.get_id() != "help" && arg.get_id() != "version")
        .map(row)
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    table(["argument", "default", "meaning"], &rows)
}

fn row(arg: &Arg) -> [String; 3] {
    let long = arg.get_long().map(|long| format!("--{long}"));
    let short = arg.get_short().map(|short| format!("-{short}"));
    let names: Vec<_> = short.into_iter().chain(long).collect();
    let values = arg.get_value_names().unwrap_or_default();
    let takes_values = arg.get_action().takes_values();
    let values = values
        .iter()
        .filter(|_| takes_values)
        .map(ToString::to_string);
    let shown: Vec<String> = [names.join(", ")].into_iter().chain(values).collect();
    let default = arg.get_default_values().iter().filter(|_| takes_values);
    let default: Vec<_> = default
        .map(|value| format!("`{}`", value.display()))
        .collect();
    let help = arg.get_long_help().or(arg.get_help());
    let help = help.map(ToString::to_string).unwrap_or_default();
    let mut meaning: Vec<String> = help.split("\n\n").map(with_full_stop).collect();
    let possible = arg.get_possible_values();
    let possible = possible
        .iter()
        .filter(|value| takes_values && !value.is_hide_set());
    let possible: Vec<_> = possible
        .map(|value| format!("`{}`", value.get_name()))
        .collect();
    if !possible.is_empty() {
        meaning.push(format!("One of: {}.", possible.join(", ")));
    }
    [
        format!("`{}`", shown.join(" ").trim()),
        if arg.is_required_set() {
            "required".into()
        } else {
            default.join(" ")
        },
        meaning.join(" "),
    ]
}

/// Help texts are written without a full stop at the end of their first paragraph.
fn with_full_stop(text: &str) -> String {
    let text = text.trim();
    if text.is_empty() || text.ends_with(['.', ':']) {
        text.to_owned()
    } else {
        format!("{text}.")
    }
}
