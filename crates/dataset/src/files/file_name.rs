//! Names from outside that become file names: of weathers, profiles, rigs, cameras, scenarios, views.
//!
//! Portable POSIX file names, slightly restricted, because a corpus is copied to other systems and into object stores.

/// Longest name. Scenario names contain several names, and file systems allow 255 bytes.
pub(crate) const MAX_NAME_BYTES: usize = 64;

/// Longest scenario identifier, which contains several names; suffixes such as `.partial` are added to it.
pub(crate) const MAX_ID_BYTES: usize = 200;

/// Names that Windows reserves for devices, whatever their extension.
const RESERVED: [&str; 4] = ["con", "prn", "aux", "nul"];

/// A string that is not a valid file name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name:?} names files; expected {expected}")]
pub struct BadFileName {
    name: String,
    expected: String,
}

/// Rejects names that some file system does not accept.
pub fn check(name: &str) -> Result<(), BadFileName> {
    check_up_to(MAX_NAME_BYTES, name)
}

/// Rejects strings that cannot be a scenario's identifier.
pub fn check_id(id: &str) -> Result<(), BadFileName> {
    check_up_to(MAX_ID_BYTES, id)
}

fn check_up_to(most_bytes: usize, name: &str) -> Result<(), BadFileName> {
    let legal = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let expected = if name.is_empty() || !name.chars().all(legal) {
        "letters, digits, - and _ only".to_owned()
    } else if name.starts_with('-') {
        "a name that does not begin with -, as options do".to_owned()
    } else if name.len() > most_bytes {
        format!("at most {most_bytes} characters")
    } else if is_reserved(name) {
        "another name: Windows keeps it for a device".to_owned()
    } else {
        return Ok(());
    };
    // A message must not contain a megabyte-long name.
    let name = name.chars().take(most_bytes + 8).collect();
    Err(BadFileName { name, expected })
}

fn is_reserved(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let numbered = |device: &str| {
        let number = name.strip_prefix(device);
        number.is_some_and(|n| n.len() == 1 && n.chars().all(|c| c.is_ascii_digit()))
    };
    RESERVED.contains(&name.as_str()) || numbered("com") || numbered("lpt")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_taken_and_everything_else_is_refused_with_a_reason() {
        for name in ["foggy", "1700-foggy-r3", "left_2", "A", "console", "com10"] {
            assert_eq!(check(name), Ok(()), "{name}");
        }
        let long = "x".repeat(MAX_NAME_BYTES + 1);
        for (name, words) in [
            ("", "letters, digits"),
            ("..", "letters, digits"),
            ("a/b", "letters, digits"),
            ("a\u{7}", "letters, digits"),
            ("n\u{e9}", "letters, digits"),
            ("-rf", "does not begin with -"),
            (long.as_str(), "at most 64 characters"),
            ("Aux", "Windows"),
            ("lpt1", "Windows"),
        ] {
            let message = check(name).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
        assert_eq!(check_id(&long), Ok(()));
    }
}
