//! Invalid values, and the checks that several tables share.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Display;

use dataset::files::file_name;

/// An invalid value.
#[derive(Debug)]
pub(crate) struct Fault {
    /// Dotted key of the value, for [`dataset::files::toml_file::TomlFile::rejected`].
    pub(crate) key: String,
    /// The value that was found, and the expected one.
    pub(crate) message: String,
}

pub(crate) type Checked<T> = Result<T, Fault>;

/// Pattern of the names of weathers, rigs, profiles and cameras: they become file names. Also part of the schema.
pub(crate) const NAME_PATTERN: &str = "^[A-Za-z0-9_-]+$";

pub(crate) fn fault<T>(key: impl Into<String>, message: impl Into<String>) -> Checked<T> {
    Err(Fault {
        key: key.into(),
        message: message.into(),
    })
}

/// Rejects names that do not match [`NAME_PATTERN`], and those that some system cannot use as file names.
pub(crate) fn legal_name(key: impl Into<String>, name: &str) -> Checked<()> {
    file_name::check(name).or_else(|bad| fault(key, bad.to_string()))
}

/// Rejects names that a file system without case, as on macOS and Windows, takes for one.
pub(crate) fn distinct_names<'a>(
    kind: &str,
    names: impl IntoIterator<Item = &'a String>,
) -> Checked<()> {
    let mut seen = BTreeMap::new();
    for name in names {
        if let Some(other) = seen.insert(name.to_ascii_lowercase(), name) {
            return fault(
                format!("{kind}.{name}"),
                format!(
                    "{name:?} and {other:?} name the same files where case does not count, as on macOS and Windows; expected names that \
                     differ in more than case"
                ),
            );
        }
    }
    Ok(())
}

/// Rejects a name for which the sweep has no table `[KIND.NAME]`.
pub(crate) fn defined(
    key: impl Into<String>,
    kind: &str,
    name: &String,
    tables: &BTreeSet<&String>,
) -> Checked<()> {
    if tables.contains(name) {
        return Ok(());
    }
    let known = list(tables);
    fault(
        key,
        format!("{kind} {name:?} is not defined; defined are {known}; add a table [{kind}.{name}]"),
    )
}

/// Names in a sentence.
pub(crate) fn list(names: impl IntoIterator<Item = impl Display>) -> String {
    let names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    if names.is_empty() {
        "none".into()
    } else {
        names.join(", ")
    }
}
