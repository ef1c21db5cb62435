//! `splits.json`: the scenarios for training, validation and test, and the check that no trajectory is on two sides.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::json_file::{parse_json, read_json, write_json};

/// Sides of the split.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Networks learn from these.
    Train,
    /// For decisions during training (schedules, when to stop).
    Validation,
    /// For evaluation only.
    Test,
}

impl fmt::Display for Side {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Train => "training",
            Self::Validation => "validation",
            Self::Test => "test",
        })
    }
}

/// Its name in messages.
const WHAT: &str = "split";
/// The unit that a split keeps together.
const BY_TRAJECTORY: &str = "trajectory";

/// A scenario for the purpose of splitting.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Assignment {
    /// Trajectory of the scenario.
    pub trajectory: String,
    /// Its side.
    pub side: Side,
}

/// A trajectory on two sides: training on it would leak into the test.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("trajectory {trajectory} is on two sides: {} is on the {} side, {} on the {} side", one.0, one.1, other.0, other.1)]
pub struct Leak {
    /// The trajectory.
    pub trajectory: String,
    /// A scenario that flies it, and its side.
    pub one: (String, Side),
    /// The second one, on a different side.
    pub other: (String, Side),
}

/// A corpus's split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Splits {
    /// The unit that is kept together: always `trajectory`.
    pub by: String,
    /// Side of each scenario, by its identifier.
    pub scenarios: BTreeMap<String, Assignment>,
}

impl Splits {
    /// A split by trajectory; rejects one that leaks.
    pub fn new(scenarios: BTreeMap<String, Assignment>) -> std::result::Result<Self, Leak> {
        let splits = Self {
            by: BY_TRAJECTORY.into(),
            scenarios,
        };
        match splits.leak() {
            None => Ok(splits),
            Some(leak) => Err(leak),
        }
    }

    /// The side's scenarios, sorted.
    pub fn side(&self, side: Side) -> impl Iterator<Item = &str> {
        self.scenarios
            .iter()
            .filter(move |(_, a)| a.side == side)
            .map(|(id, _)| id.as_str())
    }

    /// The first trajectory that is on two sides.
    pub fn leak(&self) -> Option<Leak> {
        let mut seen: BTreeMap<&str, (&str, Side)> = BTreeMap::new();
        for (id, assignment) in &self.scenarios {
            let (first, side) = *seen
                .entry(&assignment.trajectory)
                .or_insert((id, assignment.side));
            if side != assignment.side {
                return Some(Leak {
                    trajectory: assignment.trajectory.clone(),
                    one: (first.to_owned(), side),
                    other: (id.clone(), assignment.side),
                });
            }
        }
        None
    }

    /// Reads `splits.json`; rejects a split that leaks or is not by trajectory.
    pub fn read(path: &Path) -> Result<Self> {
        match read_json(path, WHAT) {
            Ok(splits) => Self::sound(splits, path),
            Err(error) if error.is_not_found() => Err(Error::corpus(
                path,
                "is missing: `dtd generate SWEEP --out CORPUS` writes it again, or import the recording again with `dtd import`",
            )),
            Err(error) => Err(error),
        }
    }

    /// Reads the content of `splits.json`; messages name it as `path`.
    pub fn parse(content: &[u8], path: &Path) -> Result<Self> {
        Self::sound(parse_json(content, path, WHAT)?, path)
    }

    fn sound(self, path: &Path) -> Result<Self> {
        if self.by != BY_TRAJECTORY {
            let found = &self.by;
            return Err(Error::corpus(
                path,
                format!("is a split by {found:?}, expected {BY_TRAJECTORY:?}"),
            ));
        }
        match self.leak() {
            None => Ok(self),
            Some(leak) => Err(Error::corpus(
                path,
                format!("{leak}; a trajectory must be on one side only"),
            )),
        }
    }

    /// Writes `splits.json`.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_json(path, self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assignment(trajectory: &str, side: Side) -> Assignment {
        Assignment {
            trajectory: trajectory.into(),
            side,
        }
    }

    #[test]
    fn a_lost_split_is_bad_input_and_says_what_writes_it_again() {
        let folder = tempfile::tempdir().unwrap();
        let error = Splits::read(&folder.path().join("splits.json")).unwrap_err();
        assert!(error.is_bad_content(), "{error}");
        assert!(
            error.to_string().ends_with(
                "splits.json: is missing: `dtd generate SWEEP --out CORPUS` writes it again, or import the recording again with `dtd import`"
            ),
            "{error}"
        );
    }

    #[test]
    fn a_trajectory_on_two_sides_is_refused_by_name() {
        let scenarios = BTreeMap::from([
            ("0001".to_owned(), assignment("flight-a", Side::Train)),
            ("0002".to_owned(), assignment("flight-a", Side::Test)),
        ]);
        let message = Splits::new(scenarios).unwrap_err().to_string();
        assert!(
            message.contains("flight-a") && message.contains("0001") && message.contains("0002"),
            "{message}"
        );
    }

    #[test]
    fn a_split_by_something_else_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("splits.json");
        let mut splits = Splits::new(BTreeMap::new()).unwrap();
        splits.write(&path).unwrap();
        assert_eq!(Splits::read(&path).unwrap(), splits);
        splits.by = "\u{1b}[31mred".into();
        splits.write(&path).unwrap();
        let message = Splits::read(&path).unwrap_err().to_string();
        assert!(message.contains("expected \"trajectory\""), "{message}");
    }

    #[test]
    fn scenarios_that_share_a_trajectory_may_share_a_side() {
        let scenarios = BTreeMap::from([
            ("0001".to_owned(), assignment("flight-a", Side::Test)),
            ("0002".to_owned(), assignment("flight-a", Side::Test)),
        ]);
        let splits = Splits::new(scenarios).unwrap();
        assert_eq!(
            splits.side(Side::Test).collect::<Vec<_>>(),
            ["0001", "0002"]
        );
    }
}
