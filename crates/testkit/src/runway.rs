//! The runway of all tests.

use dataset::geometry::runway::Runway;

/// Changi 02L, as in the reference sweep and in `tests/data/flights/README.md`.
pub fn changi_02l() -> Runway {
    serde_json::from_str(include_str!("changi_02l.json")).expect("the runway of the tests")
}
