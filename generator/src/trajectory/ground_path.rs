//! Paths over the ground about a runway: straight legs, joined by quarter turns to the right.

use std::f64::consts::{FRAC_PI_2, PI};

/// A place on the ground, and the direction of the nose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GroundPlace {
    /// Distance past the touchdown target along the landing course, metres.
    pub(super) past_m: f64,
    /// Distance right of the centreline, metres.
    pub(super) right_m: f64,
    /// Direction right of the landing course, degrees.
    pub(super) turned_deg: f64,
}

/// A part of a path.
#[derive(Debug, Clone, Copy)]
pub(super) enum Leg {
    /// Straight ahead for this distance, metres.
    Straight(f64),
    /// A quarter turn to the right with this radius, metres.
    RightTurn(f64),
}

/// A path, straight before its first leg and after its last.
#[derive(Debug, Clone)]
pub(super) struct GroundPath {
    pub(super) start: GroundPlace,
    pub(super) legs: Vec<Leg>,
}

impl Leg {
    fn length_m(self) -> f64 {
        match self {
            Self::Straight(length_m) => length_m,
            Self::RightTurn(radius_m) => radius_m * FRAC_PI_2,
        }
    }
}

impl GroundPlace {
    /// The place after a part of a leg, metres.
    fn after(self, leg: Leg, way_m: f64) -> Self {
        let (sin, cos) = self.turned_deg.to_radians().sin_cos();
        let (ahead_m, right_m, turn_rad) = match leg {
            Leg::Straight(_) => (way_m, 0.0, 0.0),
            Leg::RightTurn(radius_m) => {
                let turn_rad = way_m / radius_m;
                let right_m = radius_m * (1.0 - turn_rad.cos());
                (radius_m * turn_rad.sin(), right_m, turn_rad)
            }
        };
        Self {
            past_m: self.past_m + ahead_m * cos - right_m * sin,
            right_m: self.right_m + ahead_m * sin + right_m * cos,
            turned_deg: self.turned_deg + turn_rad * 180.0 / PI,
        }
    }
}

impl GroundPath {
    /// Length of all legs, metres.
    pub(super) fn length_m(&self) -> f64 {
        self.legs.iter().map(|leg| leg.length_m()).sum()
    }

    /// The place at a distance from the start, metres; negative before it.
    pub(super) fn at(&self, way_m: f64) -> GroundPlace {
        let (mut place, mut left_m) = (self.start, way_m);
        for leg in &self.legs {
            if left_m <= 0.0 {
                break;
            }
            let part_m = left_m.min(leg.length_m());
            place = place.after(*leg, part_m);
            left_m -= part_m;
        }
        place.after(Leg::Straight(left_m), left_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_with_two_right_turns_leads_back_beside_itself_without_a_jump() {
        let start = GroundPlace {
            past_m: 900.0,
            right_m: 3.0,
            turned_deg: 0.0,
        };
        let legs = vec![
            Leg::Straight(50.0),
            Leg::RightTurn(60.0),
            Leg::Straight(67.0),
            Leg::RightTurn(60.0),
        ];
        let path = GroundPath { start, legs };
        let end = path.at(path.length_m());
        assert!((end.past_m - 950.0).abs() < 1e-9 && (end.right_m - 190.0).abs() < 1e-9);
        assert!((end.turned_deg - 180.0).abs() < 1e-9);
        let later = path.at(path.length_m() + 100.0);
        assert!((later.past_m - 850.0).abs() < 1e-9 && (later.right_m - 190.0).abs() < 1e-9);
        assert!((path.at(-20.0).past_m - 880.0).abs() < 1e-9);
        for way_m in 0..500 {
            let [a, b] = [way_m, way_m + 1].map(|way_m| path.at(f64::from(way_m)));
            let step_m = (b.past_m - a.past_m).hypot(b.right_m - a.right_m);
            assert!((step_m - 1.0).abs() < 0.01, "{way_m}: {step_m}");
        }
    }
}
