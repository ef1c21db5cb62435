//! Lens distortion: the Brown-Conrady model (D. C. Brown, "Close-Range Camera Calibration", Photogrammetric Engineering 37, 1971) with
//! OpenCV's formulation and coefficients.
//!
//! Input and output are image coordinates: right and down of the optical axis, divided by depth. A real lens does not fold a image over;
//! [`Distortion::fault`] rejects coefficients that do.

use glam::{DMat2, DVec2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Lens coefficients, each 0 by default; all 0 is a pinhole.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Distortion {
    /// Radial, of the squared radius; negative is a barrel.
    pub k1: f64,
    /// Radial, of the fourth power of the radius.
    pub k2: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
    /// Radial, of the sixth power of the radius.
    pub k3: f64,
}

/// The lens must map without folding up to this multiple of the image's half diagonal from the principal point.
pub(crate) const FIELD_OVER_HALF_DIAGONAL: f64 = 1.5;
/// A lens that shrinks areas below this share is close to folding.
const MIN_AREA: f64 = 0.05;
/// Directions and radii where lenses are checked.
const CHECKED: (u32, u32) = (72, 60);
/// Steps of Newton's method; four suffice for any lens that passes the check well inside its field.
const MAX_STEPS: u32 = 40;
/// Image coordinates closer than this are equal: 1e-9 px.
const EQUAL_COORDINATES: f64 = 1e-14;

impl Distortion {
    /// The coefficients in OpenCV's order: k1, k2, p1, p2, k3.
    pub fn coefficients(&self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }

    /// A lens from coefficients in OpenCV's order; `None` unless there are five coefficients.
    pub(crate) fn from_coefficients(coefficients: &[f64]) -> Option<Self> {
        let &[k1, k2, p1, p2, k3] = coefficients else {
            return None;
        };
        Some(Self { k1, k2, p1, p2, k3 })
    }

    /// The point to which the lens maps the ideal (pinhole) point `ideal`.
    pub(crate) fn distort(&self, ideal: DVec2) -> DVec2 {
        let Self { k1, k2, p1, p2, k3 } = *self;
        let DVec2 { x, y } = ideal;
        let r2 = ideal.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let tangential = DVec2::new(
            2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        ideal * radial + tangential
    }

    /// Derivative of [`Self::distort`].
    fn derivative(&self, ideal: DVec2) -> DMat2 {
        let Self { k1, k2, p1, p2, k3 } = *self;
        let DVec2 { x, y } = ideal;
        let r2 = ideal.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        // Derivative of `radial` with respect to the squared radius.
        let growth = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
        let mixed = 2.0 * x * y * growth + 2.0 * p1 * x + 2.0 * p2 * y;
        DMat2::from_cols(
            DVec2::new(
                radial + 2.0 * x * x * growth + 2.0 * p1 * y + 6.0 * p2 * x,
                mixed,
            ),
            DVec2::new(
                mixed,
                radial + 2.0 * y * y * growth + 6.0 * p1 * y + 2.0 * p2 * x,
            ),
        )
    }

    /// [`Self::distort`] inside a field of this radius; beyond it the mapping continues linearly, so that points far outside the image stay
    /// outside, which polynomials do not guarantee.
    pub(crate) fn distort_within(&self, ideal: DVec2, field: f64) -> DVec2 {
        let rim = ideal.clamp_length_max(field);
        self.distort(rim) + (ideal - rim)
    }

    /// Derivative of [`Self::distort_within`].
    fn derivative_within(&self, ideal: DVec2, field: f64) -> DMat2 {
        let rim = ideal.clamp_length_max(field);
        let slope = self.derivative(rim);
        if rim == ideal {
            return slope;
        }
        // Radially the mapping continues with unit slope; tangentially it follows the rim.
        let along = ideal.normalize().perp();
        let rim_moves =
            DMat2::from_cols(along * along.x, along * along.y) * (field / ideal.length());
        DMat2::IDENTITY + (slope - DMat2::IDENTITY) * rim_moves
    }

    /// The ideal point that [`Self::distort_within`] maps to `seen` (Newton's method).
    pub(crate) fn undistort_within(&self, seen: DVec2, field: f64) -> DVec2 {
        let mut ideal = seen;
        for _ in 0..MAX_STEPS {
            let off = self.distort_within(ideal, field) - seen;
            ideal -= self.derivative_within(ideal, field).inverse() * off;
            if off.abs().max_element() < EQUAL_COORDINATES {
                break;
            }
        }
        ideal
    }

    /// The reason why the coefficients do not describe a lens, if they do not: one is infinite or NaN, or the image would be folded over or
    /// leave its corners empty. `corner` is the distance from the middle of the image to its corners, in image coordinates.
    pub fn fault(&self, corner: f64) -> Option<String> {
        if self.coefficients().iter().any(|c| !c.is_finite()) {
            return Some(format!("{self:?} has a coefficient that is not a number"));
        }
        let (directions, radii) = CHECKED;
        for direction in 0..directions {
            let towards = DVec2::from_angle(
                std::f64::consts::TAU * f64::from(direction) / f64::from(directions),
            );
            for step in 1..=radii {
                let radius = FIELD_OVER_HALF_DIAGONAL * f64::from(step) / f64::from(radii);
                let slope = self.derivative(towards * (radius * corner));
                let grows = towards.dot(slope * towards);
                if !(slope.determinant() > MIN_AREA && grows > 0.0) {
                    return Some(format!(
                        "the lens folds the image over at {radius:.2} of the way from its middle to its corners; expected coefficients \
                         under which it grows steadily up to {FIELD_OVER_HALF_DIAGONAL}"
                    ));
                }
            }
            let rim = self
                .distort(towards * (FIELD_OVER_HALF_DIAGONAL * corner))
                .length()
                / corner;
            if rim < 1.0 {
                return Some(format!(
                    "the lens draws {FIELD_OVER_HALF_DIAGONAL} of the image into {rim:.2} of it and leaves its corners empty; expected \
                     weaker coefficients"
                ));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Typical for cheap wide-angle lenses.
    const BARREL: Distortion = Distortion {
        k1: -0.28,
        k2: 0.08,
        p1: 0.0012,
        p2: -0.0007,
        k3: -0.008,
    };
    const CORNER: f64 = 0.7;

    #[test]
    fn distortion_is_undone_to_a_billionth_of_a_pixel_up_to_the_corners() {
        assert_eq!(BARREL.fault(CORNER), None);
        let field = CORNER * FIELD_OVER_HALF_DIAGONAL;
        for i in 0..200 {
            let ideal = DVec2::from_angle(f64::from(i)) * (field * f64::from(i) / 200.0);
            let back = BARREL.undistort_within(BARREL.distort_within(ideal, field), field);
            assert!(back.distance(ideal) < 1e-12, "{ideal} came back as {back}");
        }
    }

    #[test]
    fn the_derivative_is_the_slope_of_the_distortion() {
        for i in 0..50 {
            let at = DVec2::from_angle(f64::from(i)) * (0.015 * f64::from(i));
            let slope = BARREL.derivative(at);
            for (axis, column) in [(DVec2::X, slope.x_axis), (DVec2::Y, slope.y_axis)] {
                let step = axis * 1e-6;
                let measured = (BARREL.distort(at + step) - BARREL.distort(at - step)) / 2e-6;
                assert!(measured.distance(column) < 1e-8, "{measured} {column}");
            }
        }
    }

    #[test]
    fn what_is_far_outside_the_picture_stays_outside() {
        let field = CORNER * FIELD_OVER_HALF_DIAGONAL;
        let far = DVec2::new(9.0, 0.5);
        assert!(BARREL.distort(far).length() > 1e3, "the polynomial itself");
        let drawn = BARREL.distort_within(far, field);
        assert!(drawn.length() > CORNER && drawn.x > 1.0, "{drawn}");
        let back = BARREL.undistort_within(drawn, field);
        assert!(back.distance(far) < 1e-6, "{back}");
    }

    #[test]
    fn a_lens_that_folds_the_picture_is_refused_and_a_strong_one_is_not() {
        let folding = Distortion {
            k1: -3.0,
            ..Distortion::default()
        };
        assert!(folding.fault(CORNER).unwrap().contains("folds the image"));
        let nothing = Distortion {
            p1: f64::NAN,
            ..Distortion::default()
        };
        assert!(nothing.fault(CORNER).unwrap().contains("not a number"));
        // At ten degrees of view the same coefficient is a weak distortion.
        assert_eq!(folding.fault(0.105), None);
    }
}
