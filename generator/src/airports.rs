//! Built-in runways, which need no definition in a sweep (`airports.toml`, in the sweep format), and [`import()`], which makes such tables
//! from published ones.

mod import;
mod sources;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use dataset::files::outside_file::{self, FileKind};
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::Check;
use serde::Deserialize;

pub use import::{Conflict, ImportError, Imported, UNCONFIRMED, import};

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

/// Built-in runway by airport and designator.
pub fn bundled(airport: &str, runway: &str) -> Option<Runway> {
    let table = BUNDLED.get(airport)?.runway.get(runway)?;
    table.complete(airport, runway, None).ok()
}

pub(crate) fn time_zone(airport: &str) -> Option<&'static str> {
    BUNDLED.get(airport)?.time_zone.as_deref()
}

/// Reads a runway from a file with `[airport]` tables, such as a sweep or the result of [`import()`]; completed from the built-in one.
///
/// # Errors
/// The file cannot be read, or does not define the runway completely.
pub fn in_file(path: &Path, airport: &str, runway: &str) -> dataset::Result<Runway> {
    let missing = |what: &str| {
        dataset::Error::corpus(
            path,
            format!("no {what} in [airport.{airport}.runway.{runway}]"),
        )
    };
    let not_a_table = |error: toml::de::Error| dataset::Error::corpus(path, error);
    let text = outside_file::read_text(path, FileKind::SWEEP)?;
    let mut all: toml::Table = toml::from_str(&text).map_err(not_a_table)?;
    let tables = all.remove("airport").ok_or_else(|| missing("table"))?;
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
        Some(fault) => Err(dataset::Error::corpus(path, fault)),
        None => Ok(runway),
    }
}

/// Airport and designator per built-in runway.
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
