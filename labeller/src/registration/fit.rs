//! The shift that fits best, and how certain it is.

use dataset::registrations::NoShift;
use glam::{DMat2, DVec2};

use super::linear::{Normal, inverse, robust_sd};
use super::patch::Cleaned;
use super::{MARGIN_PX, SEARCH_PX};

/// What is fitted: shift right and down, contrast, brightness.
const UNKNOWNS: usize = 4;
/// Iterations until the shift stands still, or does not at all.
const ITERATIONS: usize = 30;
/// A shift that moves by less than this stands still.
const STILL_PX: f64 = 1e-3;
/// Weights of aircraft seen from two sides may swing between two states; a small swing is within the error.
const SWING_PX: f64 = 0.05;
/// A step is never longer.
const LONGEST_STEP_PX: f64 = 1.0;
/// A pixel whose residual has this many standard deviations gets half the weight.
const CAUCHY: f64 = 6.0;
/// Least standard deviation of what fits, grey levels.
const LEAST_SD: f64 = 0.3;
/// Pixels that are compared for each whole-pixel shift.
const COARSE_PIXELS: f64 = 1_000.0;
/// The correlation of neighbouring residuals: blur and compression reach this far.
const REACH: usize = 3;

/// The best fit; all lengths in pixels of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Where the centre of the reference's box is in the view, minus where it is in the reference.
    pub(super) shift_px: DVec2,
    /// Scatter of the shift by the residuals.
    pub(super) sd_px: DVec2,
    /// Size in the view over that in the reference.
    pub(super) scale: f64,
    /// Contrast in the view over that in the reference.
    pub(super) gain: f64,
    /// Correlation of both.
    pub(super) correlation: f64,
}

/// The pixels of the reference that are compared.
struct Template<'a> {
    reference: &'a Cleaned,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
}

impl<'a> Template<'a> {
    fn new(
        reference: &'a Cleaned,
        view: &Cleaned,
        view_from_reference: DMat2,
    ) -> Result<Self, NoShift> {
        let larger = view_from_reference.determinant().abs().sqrt();
        let half = reference.size.max(view.size / larger) / 2.0 + MARGIN_PX;
        let range = |centre: f64, half: f64, length: usize| {
            let start = (centre - half).ceil().max(0.0) as usize;
            start..((centre + half).floor() as usize + 1).min(length)
        };
        let columns = range(reference.centre.x, half.x, reference.width);
        let rows = range(reference.centre.y, half.y, reference.height);
        if columns.len() < 7 || rows.len() < 5 {
            return Err(NoShift::Edge);
        }
        Ok(Self {
            reference,
            columns,
            rows,
        })
    }

    /// Position and value of each pixel, row by row.
    fn pixels(&self) -> impl Iterator<Item = (DVec2, f64)> {
        self.rows.clone().flat_map(move |row| {
            self.columns.clone().map(move |column| {
                let at = DVec2::new(column as f64, row as f64);
                (at, self.reference.at(column, row))
            })
        })
    }

    fn len(&self) -> usize {
        self.columns.len() * self.rows.len()
    }
}

/// A pixel of the template and where it falls in the view.
struct Pair {
    /// From the centre of the reference's box, mapped to the view.
    offset: DVec2,
    template: f64,
    view: f64,
    slope: DVec2,
}

impl Fit {
    /// Of the reference to the view, if `self` is that of the view to the reference. The centres are those of their boxes.
    pub(super) fn reversed(
        self,
        reference_px: DVec2,
        view_px: DVec2,
        view_from_reference: DMat2,
    ) -> Self {
        let view_in_reference_px = view_px + self.shift_px;
        let reference_in_view_px =
            view_px + view_from_reference * (reference_px - view_in_reference_px);
        let DMat2 { x_axis, y_axis } = view_from_reference;
        let sd_px = self.sd_px;
        Self {
            shift_px: reference_in_view_px - reference_px,
            sd_px: ((x_axis * sd_px.x).powf(2.0) + (y_axis * sd_px.y).powf(2.0)).map(f64::sqrt),
            scale: self.scale.recip(),
            gain: self.gain.recip(),
            correlation: self.correlation,
        }
    }
}

/// Fits the aircraft of the reference to the view. `view_from_reference`: small displacements in the view, from those in the reference.
pub(super) fn fit(
    reference: &Cleaned,
    view: &Cleaned,
    view_from_reference: DMat2,
) -> Result<Fit, NoShift> {
    let template = Template::new(reference, view, view_from_reference)?;
    // The centre of the reference's box in the view.
    let start = coarse(&template, view).ok_or(NoShift::Edge)?;
    let mut at = start;
    let (mut gain, mut offset) = (1.0, 0.0);
    let mut last_step = f64::INFINITY;
    let mut pairs = Vec::with_capacity(template.len());
    let mut weights = Vec::with_capacity(template.len());
    for iteration in 0..ITERATIONS {
        collect(&template, view, view_from_reference, at, &mut pairs);
        if pairs.len() < template.len() * 9 / 10 {
            return Err(NoShift::Lost);
        }
        if iteration == 0 {
            (gain, offset) = level(&pairs).ok_or(NoShift::Different)?;
        }
        weigh(&pairs, gain, offset, &mut weights);
        let mut normal = Normal::<UNKNOWNS>::new();
        for (pair, weight) in pairs.iter().zip(&weights) {
            normal.add(&derivatives(pair), pair.residual(gain, offset), *weight);
        }
        let step = normal.solve().ok_or(NoShift::Different)?;
        let moved = DVec2::new(-step[0], -step[1]);
        if !moved.is_finite() {
            return Err(NoShift::Lost);
        }
        let moved = moved.clamp_length_max(LONGEST_STEP_PX);
        at += moved;
        gain -= step[2];
        offset -= step[3];
        last_step = moved.length();
        if last_step < STILL_PX {
            break;
        }
    }
    let strayed = (at - start).abs().max_element();
    if last_step > SWING_PX || strayed > SEARCH_PX {
        return Err(NoShift::Lost);
    }
    collect(&template, view, view_from_reference, at, &mut pairs);
    if pairs.len() < template.len() {
        // A part of the template is outside the patch.
        return Err(NoShift::Edge);
    }
    weigh(&pairs, gain, offset, &mut weights);
    let scatter = scatter(&template, &pairs, &weights, gain, offset).ok_or(NoShift::Vague)?;
    let step_px = reference.step_px();
    let shape = view_from_reference.determinant().abs().sqrt();
    Ok(Fit {
        shift_px: view.centre_px() + (at - view.centre) * step_px - reference.centre_px(),
        sd_px: scatter * step_px,
        scale: shape * (1.0 + growth(&pairs, &weights, gain, offset)),
        gain,
        correlation: correlation(&pairs),
    })
}

/// The whole-pixel position of the reference's centre with the highest correlation, near the centre of the view's box.
fn coarse(template: &Template<'_>, view: &Cleaned) -> Option<DVec2> {
    let centre = template.reference.centre;
    let fraction = centre - centre.round();
    let middle = (view.centre - fraction).round();
    let reach = view.search(SEARCH_PX).ceil() as i64;
    let first = DVec2::new(template.columns.start as f64, template.rows.start as f64);
    let size = DVec2::new(template.columns.len() as f64, template.rows.len() as f64);
    // Every pixel of a small aircraft, and about as many of a large one.
    let stride = (template.len() as f64 / COARSE_PIXELS).sqrt().ceil() as usize;
    let some_rows = || template.rows.clone().step_by(stride);
    let some: Vec<f64> = some_rows()
        .flat_map(|row| {
            let columns = template.columns.clone().step_by(stride);
            columns.map(move |column| template.reference.at(column, row))
        })
        .collect();
    let likeness = Likeness::with(&some);
    let mut best = None;
    for j in -reach..=reach {
        for i in -reach..=reach {
            let to = middle + DVec2::new(i as f64, j as f64);
            let corner = first - centre.round() + to;
            let inside = corner.cmpge(DVec2::ZERO).all()
                && (corner + size).x <= view.width as f64
                && (corner + size).y <= view.height as f64;
            if !inside {
                continue;
            }
            let (left, top) = (corner.x as usize, corner.y as usize);
            let lines = (0..template.rows.len()).step_by(stride).map(|row| {
                let line = &view.line(top + row)[left..left + template.columns.len()];
                line.iter().step_by(stride)
            });
            let likeness = likeness.of(lines);
            if best.is_none_or(|(most, _)| likeness > most) {
                best = Some((likeness, to + fraction));
            }
        }
    }
    best.map(|(_, at)| at)
}

/// Compares each pixel of the template with its place in the view.
fn collect(
    template: &Template<'_>,
    view: &Cleaned,
    view_from_reference: DMat2,
    at: DVec2,
    pairs: &mut Vec<Pair>,
) {
    let centre = template.reference.centre;
    pairs.clear();
    pairs.extend(template.pixels().filter_map(|(pixel, value)| {
        let offset = view_from_reference * (pixel - centre);
        let (there, slope) = view.sample(at + offset)?;
        Some(Pair {
            offset,
            template: value,
            view: there,
            slope,
        })
    }));
}

impl Pair {
    fn residual(&self, gain: f64, offset: f64) -> f64 {
        self.view - gain * self.template - offset
    }
}

/// By the unknowns.
fn derivatives(pair: &Pair) -> [f64; UNKNOWNS] {
    [pair.slope.x, pair.slope.y, -pair.template, -1.0]
}

/// Contrast and brightness that fit best without a shift.
fn level(pairs: &[Pair]) -> Option<(f64, f64)> {
    let mut normal = Normal::<2>::new();
    for pair in pairs {
        normal.add(&[pair.template, 1.0], pair.view, 1.0);
    }
    let [gain, offset] = normal.solve()?;
    Some((gain, offset))
}

fn weigh(pairs: &[Pair], gain: f64, offset: f64, weights: &mut Vec<f64>) {
    let residuals = || pairs.iter().map(|pair| pair.residual(gain, offset));
    let sd = robust_sd(residuals()).max(LEAST_SD);
    weights.clear();
    weights.extend(residuals().map(|residual| 1.0 / (1.0 + (residual / (CAUCHY * sd)).powi(2))));
}

/// Standard deviation of the shift. Neighbouring residuals are alike, so each counts with its neighbours, less with distance (Bartlett's
/// window; Conley, "GMM estimation with cross sectional dependence", 1999).
fn scatter(
    template: &Template<'_>,
    pairs: &[Pair],
    weights: &[f64],
    gain: f64,
    offset: f64,
) -> Option<DVec2> {
    let (width, height) = (template.columns.len(), template.rows.len());
    let mut normal = Normal::<UNKNOWNS>::new();
    let mut scores = Vec::with_capacity(pairs.len());
    for (pair, weight) in pairs.iter().zip(weights) {
        let row = derivatives(pair);
        let residual = pair.residual(gain, offset);
        normal.add(&row, residual, *weight);
        scores.push(row.map(|derivative| weight * residual * derivative));
    }
    let inverse = inverse(normal.matrix)?;
    // Only the first two rows are needed: the influence of each pixel on the shift.
    let influence: Vec<DVec2> = scores
        .iter()
        .map(|score| {
            let along = |k: usize| {
                inverse[k]
                    .iter()
                    .zip(score)
                    .map(|(a, b)| a * b)
                    .sum::<f64>()
            };
            DVec2::new(along(0), along(1))
        })
        .collect();
    let mut variance = DVec2::ZERO;
    for row in 0..height {
        for column in 0..width {
            let here = influence[row * width + column];
            for below in row.saturating_sub(REACH)..(row + REACH + 1).min(height) {
                for beside in column.saturating_sub(REACH)..(column + REACH + 1).min(width) {
                    let near = |away: usize| 1.0 - away as f64 / (REACH + 1) as f64;
                    let share = near(below.abs_diff(row)) * near(beside.abs_diff(column));
                    variance += share * here * influence[below * width + beside];
                }
            }
        }
    }
    Some(variance.max(DVec2::ZERO).map(f64::sqrt))
}

/// How much larger the aircraft is in the view than the cameras say, as a part: fitted after the shift, which stays.
fn growth(pairs: &[Pair], weights: &[f64], gain: f64, offset: f64) -> f64 {
    let mut normal = Normal::<5>::new();
    for (pair, weight) in pairs.iter().zip(weights) {
        let [dx, dy, contrast, brightness] = derivatives(pair);
        let row = [dx, dy, contrast, brightness, pair.slope.dot(pair.offset)];
        normal.add(&row, pair.residual(gain, offset), *weight);
    }
    let fitted = normal.solve().map_or(0.0, |step| -step[4]);
    fitted.clamp(-0.5, 0.5)
}

/// The correlation of many pictures with the same one, whose own sums are taken once.
struct Likeness<'a> {
    values: &'a [f64],
    sum: f64,
    spread: f64,
}

impl<'a> Likeness<'a> {
    fn with(values: &'a [f64]) -> Self {
        let (count, sum) = (values.len() as f64, values.iter().sum::<f64>());
        let squares: f64 = values.iter().map(|value| value * value).sum();
        Self {
            values,
            sum,
            spread: count * squares - sum * sum,
        }
    }

    /// Of a picture with as many pixels, line by line; 0 if one of the two is constant.
    fn of<'b>(&self, lines: impl Iterator<Item = impl Iterator<Item = &'b f64>>) -> f64 {
        let (mut b, mut bb, mut ab) = (0.0, 0.0, 0.0);
        let mut values = self.values.iter();
        for line in lines {
            for (y, x) in line.zip(&mut values) {
                b += y;
                bb += y * y;
                ab += x * y;
            }
        }
        let n = self.values.len() as f64;
        let spread = self.spread * (n * bb - b * b);
        if spread > 0.0 {
            (n * ab - self.sum * b) / spread.sqrt()
        } else {
            0.0
        }
    }
}

fn correlation(pairs: &[Pair]) -> f64 {
    pearson(pairs.iter().map(|pair| (pair.template, pair.view)))
}

/// Correlation of pairs of values; 0 if one of them is constant.
fn pearson(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let [mut n, mut a, mut b, mut aa, mut bb, mut ab] = [0.0; 6];
    for (x, y) in values {
        n += 1.0;
        a += x;
        b += y;
        aa += x * x;
        bb += y * y;
        ab += x * y;
    }
    let spread = (n * aa - a * a) * (n * bb - b * b);
    if spread > 0.0 {
        (n * ab - a * b) / spread.sqrt()
    } else {
        0.0
    }
}
