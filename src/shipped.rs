//! Files embedded in the program: the sweeps from the documentation, the flights that they replay, and the detector. So `dtd` works
//! wherever it is installed.

use std::fs;
use std::path::{Path, PathBuf};

use dataset::Error;
use dataset::files::own_path::own_path;
use tempfile::TempDir;

const DEMO_SWEEP: &str = "demo.toml";
const PAPER_SWEEP: &str = "paper.toml";
const DETECTOR: &str = "models/aircraft.onnx";

/// A file of the repository: its name and its content.
macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_bytes!(concat!("../", $name)).as_slice())),*]
    };
}

const FILES: [(&str, &[u8]); 30] = shipped![
    "demo.toml",
    "scenarios.toml",
    "detector.toml",
    "paper.toml",
    "schema/sweep.schema.json",
    "models/aircraft.onnx",
    "models/aircraft.json",
    "tests/data/flights/01_calm_ils.csv",
    "tests/data/flights/04_storm_gusts.csv",
    "tests/data/flights/07_loc_offset_intercept.csv",
    "tests/data/paper-flights/01.csv",
    "tests/data/paper-flights/02.csv",
    "tests/data/paper-flights/03.csv",
    "tests/data/paper-flights/04.csv",
    "tests/data/paper-flights/05.csv",
    "tests/data/paper-flights/06.csv",
    "tests/data/paper-flights/07.csv",
    "tests/data/paper-flights/08.csv",
    "tests/data/paper-flights/09.csv",
    "tests/data/paper-flights/10.csv",
    "tests/data/paper-flights/11.csv",
    "tests/data/paper-flights/12.csv",
    "tests/data/paper-flights/13.csv",
    "tests/data/paper-flights/14.csv",
    "tests/data/paper-flights/15.csv",
    "tests/data/paper-flights/16.csv",
    "tests/data/paper-flights/17.csv",
    "tests/data/paper-flights/18.csv",
    "tests/data/paper-flights/19.csv",
    "tests/data/paper-flights/20.csv",
];

/// The files in a temporary folder that is deleted with this value.
pub(crate) struct Shipped {
    folder: TempDir,
}

impl Shipped {
    /// Writes them into a new temporary folder.
    pub(crate) fn unpack() -> dataset::Result<Self> {
        let temporary = std::env::temp_dir();
        let folder = TempDir::with_prefix("dtd-").map_err(Error::io("create", &temporary))?;
        write(folder.path())?;
        Ok(Self { folder })
    }

    /// The sweep of `dtd demo`.
    pub(crate) fn demo_sweep(&self) -> PathBuf {
        self.folder.path().join(DEMO_SWEEP)
    }

    /// The sweep of `dtd paper`.
    pub(crate) fn paper_sweep(&self) -> PathBuf {
        self.folder.path().join(PAPER_SWEEP)
    }

    /// The detector for images of the stand-in.
    pub(crate) fn detector(&self) -> PathBuf {
        self.folder.path().join(DETECTOR)
    }
}

/// A detector: the one that was asked for, or the one that ships.
pub(crate) struct Detector {
    path: PathBuf,
    /// Holds its folder.
    _shipped: Option<Shipped>,
}

impl Detector {
    /// The detector at this path; `None`: the one that ships.
    pub(crate) fn chosen(asked: Option<&Path>) -> dataset::Result<Self> {
        if let Some(path) = asked {
            return Ok(Self {
                path: path.to_owned(),
                _shipped: None,
            });
        }
        let shipped = Shipped::unpack()?;
        Ok(Self {
            path: shipped.detector(),
            _shipped: Some(shipped),
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

/// Writes all files into a folder. Existing ones stay as they are.
pub(crate) fn write(folder: &Path) -> dataset::Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    let paths = FILES.iter().map(|(name, _)| own_path(folder, name));
    // All are looked at before any is written.
    let paths = paths.collect::<dataset::Result<Vec<_>>>()?;
    for ((_, content), path) in FILES.iter().zip(paths) {
        if path.exists() {
            continue;
        }
        let parent = path.parent().unwrap_or(folder);
        fs::create_dir_all(parent).map_err(Error::io("create", parent))?;
        dataset::files::json_file::write_atomically(&path, content)?;
        written.push(path);
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use generator::sweep::Sweep;

    use super::*;

    #[test]
    fn every_shipped_sweep_finds_all_that_it_names() {
        let shipped = Shipped::unpack().unwrap();
        assert!(shipped.detector().is_file());
        for (name, _) in FILES {
            if name.ends_with(".toml") {
                Sweep::read(&shipped.folder.path().join(name)).unwrap();
            }
        }
    }

    #[test]
    fn a_file_that_is_there_stays() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(DEMO_SWEEP), "mine").unwrap();
        let written = write(folder.path()).unwrap();
        assert_eq!(written.len(), FILES.len() - 1);
        assert_eq!(
            fs::read_to_string(folder.path().join(DEMO_SWEEP)).unwrap(),
            "mine"
        );
    }
}
