//! Runways that need no definition in a sweep: a small table, `airports.toml`, in the format of a sweep. And [`import()`], which makes such
//! tables from published ones.

mod import;
mod sources;

use std::collections::BTreeMap;
use std::sync::LazyLock;

use dataset::geometry::runway::Runway;
use serde::Deserialize;

pub use import::{Conflict, ImportError, Imported, import};
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
