//! Predicts a tracked aircraft's box: a Kalman filter with constant rates for its centre and size.
//!
//! The four box numbers are filtered independently. Motion between two images grows with the aircraft's size in the image: at 10 NM it
//! drifts by fractions of a pixel per second, before touchdown by several lengths. So all noise is stated in box lengths, and its effect
//! follows from the time between the images: 30 FPS and 0.3 FPS need no different settings.

use dataset::tables::pixel_box::PixelBox;

/// Error of the centre: pixels, and box lengths.
const CENTRE_ERROR: (f64, f64) = (0.5, 0.03);
/// Error of width and height.
const SIZE_ERROR: (f64, f64) = (1.0, 0.10);
/// Initial standard deviation of velocity, pixels and lengths per second: a crossing flight at 10 NM moves by half its length.
const NEW_VELOCITY: (f64, f64) = (3.0, 0.6);
/// Initial standard deviation of growth.
const NEW_GROWTH: (f64, f64) = (0.5, 0.15);
/// Standard deviation of the change of velocity within a second.
const ACCELERATION: (f64, f64) = (0.2, 0.10);
/// Standard deviation of the change of growth within a second.
const GROWTH_CHANGE: (f64, f64) = (0.1, 0.03);

/// Centre, width and height with their rates.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Motion {
    /// Centre right and down, width, height.
    numbers: [Filtered; 4],
}

/// A number and its rate, with their covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Filtered {
    value: f64,
    rate: f64,
    value_variance: f64,
    covariance: f64,
    rate_variance: f64,
}

/// Squared standard deviation with a part in pixels and one in box lengths.
fn variance((px, lengths): (f64, f64), length_px: f64) -> f64 {
    (px + lengths * length_px).powi(2)
}

fn length_px(pixel_box: &PixelBox) -> f64 {
    pixel_box.width_px.max(pixel_box.height_px).max(1.0)
}

fn numbers_of(pixel_box: &PixelBox) -> [f64; 4] {
    let PixelBox {
        cx_px,
        cy_px,
        width_px,
        height_px,
    } = *pixel_box;
    [cx_px, cy_px, width_px, height_px]
}

/// For centre right and down, width, height.
fn variances(centre: (f64, f64), size: (f64, f64), length_px: f64) -> [f64; 4] {
    let (centre, size) = (variance(centre, length_px), variance(size, length_px));
    [centre, centre, size, size]
}

impl Motion {
    /// A new aircraft.
    pub(super) fn starting_at(seen: &PixelBox) -> Self {
        let length_px = length_px(seen);
        let errors = variances(CENTRE_ERROR, SIZE_ERROR, length_px);
        let rates = variances(NEW_VELOCITY, NEW_GROWTH, length_px);
        let values = numbers_of(seen);
        Self {
            numbers: std::array::from_fn(|k| Filtered {
                value: values[k],
                rate: 0.0,
                value_variance: errors[k],
                covariance: 0.0,
                rate_variance: rates[k],
            }),
        }
    }

    pub(super) fn advance(&mut self, seconds: f64) {
        let changes = variances(ACCELERATION, GROWTH_CHANGE, length_px(&self.expected()));
        for (number, change) in self.numbers.iter_mut().zip(changes) {
            number.advance(seconds, change);
        }
    }

    /// Takes a box that belongs to it.
    pub(super) fn correct(&mut self, seen: &PixelBox) {
        let errors = variances(CENTRE_ERROR, SIZE_ERROR, length_px(seen));
        let measured = numbers_of(seen).into_iter().zip(errors);
        for (number, (value, error)) in self.numbers.iter_mut().zip(measured) {
            number.correct(value, error);
        }
    }

    pub(super) fn expected(&self) -> PixelBox {
        let [cx_px, cy_px, width_px, height_px] = self.numbers.map(|number| number.value);
        PixelBox {
            cx_px,
            cy_px,
            width_px: width_px.max(1.0),
            height_px: height_px.max(1.0),
        }
    }

    /// Distance that the centre may move in `seconds`, in lengths of the box: two standard deviations more than expected.
    pub(super) fn lengths_moved(&self, seconds: f64) -> f64 {
        let [right, down, ..] = &self.numbers;
        let expected = right.rate.hypot(down.rate);
        let error = right.rate_variance.max(down.rate_variance).sqrt();
        (expected + 2.0 * error) * seconds / length_px(&self.expected())
    }

    /// Squared Mahalanobis distance from the expected box: about 4 for the same aircraft.
    pub(super) fn distance(&self, seen: &PixelBox) -> f64 {
        let errors = variances(CENTRE_ERROR, SIZE_ERROR, length_px(seen));
        let measured = numbers_of(seen).into_iter().zip(errors);
        self.numbers
            .iter()
            .zip(measured)
            .map(|(number, (value, error))| {
                (value - number.value).powi(2) / (number.value_variance + error)
            })
            .sum()
    }
}

impl Filtered {
    fn advance(&mut self, seconds: f64, change: f64) {
        let (dt, dt2, dt3) = (seconds, seconds.powi(2), seconds.powi(3));
        self.value += dt * self.rate;
        self.value_variance +=
            2.0 * dt * self.covariance + dt2 * self.rate_variance + change * dt3 / 3.0;
        self.covariance += dt * self.rate_variance + change * dt2 / 2.0;
        self.rate_variance += change * dt;
    }

    fn correct(&mut self, measured: f64, error: f64) {
        let total = self.value_variance + error;
        let (gain, rate_gain) = (self.value_variance / total, self.covariance / total);
        let misfit = measured - self.value;
        self.value += gain * misfit;
        self.rate += rate_gain * misfit;
        self.rate_variance -= rate_gain * self.covariance;
        self.covariance *= 1.0 - gain;
        self.value_variance *= 1.0 - gain;
    }
}
