//! Recordings that match a glob.

use std::path::{Path, PathBuf};

use glob::Pattern;

use super::RecordingError;

/// The files that a glob matches, sorted; it is relative to `folder`. `*` and `?` match within a name, `**` across folders, `[..]`
/// one of several characters.
pub(crate) fn matching_files(folder: &Path, pattern: &str) -> Result<Vec<PathBuf>, RecordingError> {
    // The folder is not the author's choice: glob characters in it are literal.
    let whole = match folder.to_str() {
        Some("") => pattern.to_owned(),
        _ if Path::new(pattern).is_absolute() => pattern.to_owned(),
        Some(folder) => format!("{}/{pattern}", Pattern::escape(folder)),
        None => {
            let folder = folder.display();
            return Err(RecordingError::Unusable(format!(
                "the folder {folder} is not UTF-8"
            )));
        }
    };
    let paths = glob::glob(&whole).map_err(|error| {
        RecordingError::Unusable(format!("{pattern:?} is not a valid glob: {error}"))
    })?;
    let mut found = Vec::new();
    for path in paths {
        let path = path.map_err(|error| {
            let folder = error.path().to_owned();
            dataset::Error::io("list", &folder)(error.into())
        })?;
        if path.is_file() {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        Err(RecordingError::Unusable(format!(
            "no file matches {}; expected at least one recording",
            folder.join(pattern).display()
        )))
    } else {
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn globs_find_files_in_order_and_through_folders() {
        let outer = tempfile::tempdir().unwrap();
        // A folder whose own name looks like a glob.
        let folder = outer.path().join("flights [old]");
        fs::create_dir_all(folder.join("more")).unwrap();
        for name in ["b.csv", "a.csv", "a.txt", "more/c.csv"] {
            fs::write(folder.join(name), "").unwrap();
        }
        let names = |pattern: &str| {
            let found = matching_files(&folder, pattern).map_err(|error| error.to_string());
            found.map(|files| {
                let names = files.iter().map(|file| file.strip_prefix(&folder).unwrap());
                names.map(|n| n.display().to_string()).collect::<Vec<_>>()
            })
        };
        assert_eq!(names("*.csv").unwrap(), ["a.csv", "b.csv"]);
        assert_eq!(names("[b-z].csv").unwrap(), ["b.csv"]);
        assert_eq!(names("**/*.csv").unwrap(), ["a.csv", "b.csv", "more/c.csv"]);
        assert_eq!(names("a.csv").unwrap(), ["a.csv"]);
        assert!(names("x*.csv").unwrap_err().contains("no file matches"));
        assert!(names("more").unwrap_err().contains("no file matches"));
        assert!(
            names("a**.csv")
                .unwrap_err()
                .contains("is not a valid glob")
        );
    }
}
