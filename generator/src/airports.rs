//! Runways that need no definition in a sweep: a small table, `airports.toml`, in the format of a sweep. And [`import()`], which makes such
//! tables from published ones.

mod import;
mod sources;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::{Check, FieldOutOfLimits};
use serde::Deserialize;

pub use import::{Conflict, ImportError, Imported, UNCONFIRMED, import};
pub use sources::SourceError;

use crate::sweep::AirportTable;

#[derive(Deserialize)]
struct Bundled {
    airport: BTreeMap<String, AirportTable>,
}

static BUNDLED: LazyLock<BTreeMap<String, AirportTable>> = LazyLock::new(|| {
    let parsed: Bundled = toml::from_str(include_str!("airports.toml"))
        .expect("the bundled airports are a part of the program, and a test reads them");
    parsed.airport
});

/// The built-in runway of these names.
pub fn bundled(airport: &str, runway: &str) -> Option<Runway> {
    let table = BUNDLED.get(airport)?.runway.get(runway)?;
    table.complete(airport, runway, None).ok()
}

/// The time zone of a built-in airport.
pub(crate) fn time_zone(airport: &str) -> Option<&'static str> {
    BUNDLED.get(airport)?.time_zone.as_deref()
}

/// Reasons why a file does not define a runway.
#[derive(Debug, thiserror::Error)]
pub enum RunwayFileError {
    /// It cannot be read.
    #[error(transparent)]
    Unreadable(#[from] dataset::Error),
    /// It is not TOML, or its tables are not those of airports.
    #[error("{}: {cause}", path.display())]
    NotATable {
        /// The file.
        path: PathBuf,
        /// Place and reason.
        cause: toml::de::Error,
    },
    /// The runway is not defined, or not completely.
    #[error("{}: no {missing} in [airport.{airport}.runway.{runway}]", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// The airport.
        airport: String,
        /// The runway.
        runway: String,
        /// The missing value, or `table`.
        missing: &'static str,
    },
    /// A number that no runway has.
    #[error("{}: {fault}", path.display())]
    OutOfLimits {
        /// The file.
        path: PathBuf,
        /// Key, value and range.
        fault: FieldOutOfLimits,
    },
}

/// A runway of a file with `[airport]` tables, such as a sweep or what [`import()`] makes; completed from the built-in one.
///
/// # Errors
/// The file cannot be read, or does not define the runway completely.
pub fn in_file(path: &Path, airport: &str, runway: &str) -> Result<Runway, RunwayFileError> {
    let not_a_table = |cause| RunwayFileError::NotATable {
        path: path.to_owned(),
        cause,
    };
    let missing = |missing| RunwayFileError::Missing {
        path: path.to_owned(),
        airport: airport.to_owned(),
        runway: runway.to_owned(),
        missing,
    };
    let text = outside_file::read_text(path, FileKind::SWEEP)?;
    let all: toml::Table = toml::from_str(&text).map_err(not_a_table)?;
    let tables = all
        .get("airport")
        .cloned()
        .ok_or_else(|| missing("table"))?;
    let tables: BTreeMap<String, AirportTable> = tables.try_into().map_err(not_a_table)?;
    let table = tables
        .get(airport)
        .and_then(|airport| airport.runway.get(runway))
        .ok_or_else(|| missing("table"))?;
    let known = bundled(airport, runway);
    let runway = table
        .complete(airport, runway, known.as_ref())
        .map_err(missing)?;
    let mut check = Check::default();
    runway.check(&mut check);
    match check.first() {
        Some(fault) => Err(RunwayFileError::OutOfLimits {
            path: path.to_owned(),
            fault,
        }),
        None => Ok(runway),
    }
}

/// All of them: airport and runway.
pub fn all() -> impl Iterator<Item = (&'static str, &'static str)> {
    BUNDLED.iter().flat_map(|(airport, table)| {
        let runways = table.runway.keys();
        runways.map(move |runway| (airport.as_str(), runway.as_str()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_listed_runway_is_whole_and_changi_is_among_them() {
        for (airport, name) in all() {
            let runway = bundled(airport, name).unwrap();
            assert_eq!(
                (runway.airport.as_str(), runway.name.as_str()),
                (airport, name)
            );
        }
        let changi = bundled("WSSS", "02L").unwrap();
        assert_eq!(changi.course_true_deg, 23.02);
        assert_eq!(bundled("WSSS", "99Z"), None);
    }
}
