//! Scenery: the area loaded around the aircraft, and its ground height while it settles.

pub(crate) mod local_frame;

use dataset::geometry::geodesy::LatLon;

use crate::quirks::{Quirk, Quirks};

/// Radius of scenery around its centre, metres.
const REACH_M: f64 = 45_000.0;
/// Loading time of scenery at a new place, seconds.
const LOADING_S: f64 = 20.0;
/// Settling time of the terrain after that.
const SETTLING_S: f64 = 3.0;
/// Steps of the settling, seconds and metres.
const STEP_S: f64 = 0.5;
const STEP_M: f64 = 4.0;

/// The scenery around the aircraft.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scenery {
    quirks: Quirks,
    middle: LatLon,
    /// Time at which the loading flag falls, by the simulator's running time.
    loaded_at_s: f64,
    now_s: f64,
}

impl Scenery {
    /// Scenery around a place, loaded long ago.
    pub(super) fn around(middle: LatLon, quirks: Quirks) -> Self {
        Self {
            quirks,
            middle,
            loaded_at_s: f64::NEG_INFINITY,
            now_s: 0.0,
        }
    }

    /// Lets time pass with the aircraft at a place; returns whether scenery began to load.
    pub(super) fn advance(&mut self, elapsed_s: f64, aircraft: LatLon) -> bool {
        self.now_s += elapsed_s;
        let left = self.middle.distance_m(aircraft) > REACH_M;
        if left {
            self.load(aircraft);
        }
        left
    }

    /// Begins to load scenery around a place.
    pub(super) fn load(&mut self, middle: LatLon) {
        self.middle = middle;
        self.loaded_at_s = if self.quirks.has(Quirk::SlowScenery) {
            self.now_s + LOADING_S
        } else {
            self.now_s
        };
    }

    /// True if the flag reports that it is loading.
    pub(super) fn is_loading(&self) -> bool {
        self.now_s < self.loaded_at_s
    }

    /// Height of the ground above its final height, metres; `None` where none is loaded.
    pub(super) fn ground_off_m(&self, at: LatLon) -> Option<f64> {
        let quirks = self.quirks;
        let knows_places = quirks.has(Quirk::SlowScenery) || quirks.has(Quirk::FarAway);
        if knows_places && (self.is_loading() || self.middle.distance_m(at) > REACH_M) {
            return None;
        }
        let settled_s = self.now_s - self.loaded_at_s;
        if !quirks.has(Quirk::SettlingTerrain) || settled_s >= SETTLING_S {
            return Some(0.0);
        }
        let steps_to_go = ((SETTLING_S - settled_s) / STEP_S).ceil();
        Some(STEP_M * steps_to_go)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: LatLon = LatLon {
        latitude_deg: 1.35,
        longitude_deg: 103.98,
    };
    const ELSEWHERE: LatLon = LatLon {
        latitude_deg: 9.7,
        longitude_deg: 104.0,
    };

    fn travelled(quirks: &[Quirk]) -> Scenery {
        let quirks = quirks.iter().fold(Quirks::NONE, |set, &one| set.with(one));
        let mut scenery = Scenery::around(ELSEWHERE, quirks);
        assert!(scenery.advance(0.1, HERE));
        scenery
    }

    #[test]
    fn without_quirks_the_ground_is_there_at_once_and_everywhere() {
        let scenery = travelled(&[]);
        assert!(!scenery.is_loading());
        assert_eq!(scenery.ground_off_m(ELSEWHERE), Some(0.0));
    }

    #[test]
    fn terrain_settles_for_3_s_after_the_flag_has_fallen() {
        let mut scenery = travelled(&[Quirk::SlowScenery, Quirk::SettlingTerrain]);
        scenery.advance(20.1, HERE);
        assert!(!scenery.is_loading());
        let mut heights = Vec::new();
        for _ in 0..8 {
            heights.push(scenery.ground_off_m(HERE).unwrap());
            scenery.advance(0.5, HERE);
        }
        assert!(heights[0] >= 20.0, "{heights:?}");
        assert!(heights.windows(2).all(|pair| pair[0] >= pair[1]));
        assert!(
            heights[4] > 1.0 && heights[6..] == [0.0, 0.0],
            "{heights:?}"
        );
    }
}
