//! The shift that fits best, and how certain it is.

use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::deviation_from_zero;
use dataset::tables::registrations::NoShift;
use glam::{DMat2, DVec2};

use super::patch::Cleaned;
use super::{MARGIN_PX, SEARCH_PX};

/// Unknowns of the fit: shift right and down, contrast, brightness.
const UNKNOWNS: usize = 4;
/// Iterations until the shift stands still, or does not at all.
const ITERATIONS: usize = 30;
/// A shift that moves by less than this stands still.
const STILL_PX: f64 = 1e-3;
/// Weights of aircraft seen from two sides may swing between two states; a small swing is within the error.
const SWING_PX: f64 = 0.05;
/// A step is never longer.
const MAX_STEP_PX: f64 = 1.0;
/// A pixel whose residual has this many standard deviations gets half the weight.
const CAUCHY: f64 = 6.0;
/// Minimum standard deviation of the residuals, grey levels.
const MIN_RESIDUAL_SD: f64 = 0.3;
/// Pixels that are compared for each whole-pixel shift.
const COARSE_PIXELS: usize = 1_000;
/// The correlation of neighbouring residuals: blur and compression reach this far.
const REACH: usize = 3;

/// The best fit; all lengths in pixels of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Position of the reference's box centre in the view, minus its position in the reference.
    pub(super) shift_px: DVec2,
    /// Scatter of the shift by the residuals.
    pub(super) sd_px: DVec2,
    /// Contrast in the view over that in the reference.
    pub(super) gain: f64,
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
    template: f64,
    view: f64,
    slope: DVec2,
}

impl Fit {
    /// The fit of the reference to the view, if `self` is the fit of the view to the reference. `reference_px` and `view_px` are the
    /// centres of their boxes.
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
        let mut normal = NormalEquations::new(UNKNOWNS);
        for (pair, weight) in pairs.iter().zip(&weights) {
            normal.add(&derivatives(pair), pair.residual(gain, offset), *weight);
        }
        let step: [f64; UNKNOWNS] = normal.solve_for().ok_or(NoShift::Different)?;
        let moved = DVec2::new(-step[0], -step[1]);
        if !moved.is_finite() {
            return Err(NoShift::Lost);
        }
        let moved = moved.clamp_length_max(MAX_STEP_PX);
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
    Ok(Fit {
        shift_px: view.centre_px() + (at - view.centre) * step_px - reference.centre_px(),
        sd_px: scatter * step_px,
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
    // Every pixel for small aircraft, and about as many for large ones.
    let stride = (template.len() as f64 / COARSE_PIXELS as f64).sqrt().ceil() as usize;
    let some_columns = template.columns.len().div_ceil(stride);
    let some: Vec<f64> = template
        .rows
        .clone()
        .step_by(stride)
        .flat_map(|row| {
            let columns = template.columns.clone().step_by(stride);
            columns.map(move |column| template.reference.at(column, row))
        })
        .collect();
    let likeness = Likeness::with(&some);
    let view_lines = StridedLines::of(view.values(), view.width, stride);
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
            let rows = (top..top + template.rows.len()).step_by(stride);
            let likeness = likeness.of(rows.map(|row| view_lines.part(row, left, some_columns)));
            if best.is_none_or(|(most, _)| likeness > most) {
                best = Some((likeness, to + fraction));
            }
        }
    }
    best.map(|(_, at)| at)
}

/// Every n-th pixel of image lines as slices with any start.
struct StridedLines {
    /// Line by line, first the pixels 0, n, 2n .., then 1, n + 1, 2n + 1 ..
    values: Vec<f64>,
    width: usize,
    stride: usize,
    /// Index in a line of the first of the pixels that begin at 0, 1 ..
    starts: Vec<usize>,
}

impl StridedLines {
    fn of(picture: &[f64], width: usize, stride: usize) -> Self {
        let values = picture.chunks_exact(width).flat_map(|line| {
            (0..stride).flat_map(move |first| line.iter().skip(first).step_by(stride).copied())
        });
        let lengths = (0..stride).map(|first| width.saturating_sub(first).div_ceil(stride));
        let starts = lengths.scan(0, |end, length| {
            *end += length;
            Some(*end - length)
        });
        Self {
            values: values.collect(),
            width,
            stride,
            starts: starts.collect(),
        }
    }

    fn part(&self, row: usize, left: usize, count: usize) -> &[f64] {
        let start = self.starts[left % self.stride] + left / self.stride;
        &self.values[row * self.width + start..][..count]
    }
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

fn derivatives(pair: &Pair) -> [f64; UNKNOWNS] {
    [pair.slope.x, pair.slope.y, -pair.template, -1.0]
}

/// Contrast and brightness that fit best without a shift.
fn level(pairs: &[Pair]) -> Option<(f64, f64)> {
    let mut normal = NormalEquations::new(2);
    for pair in pairs {
        normal.add(&[pair.template, 1.0], pair.view, 1.0);
    }
    let [gain, offset] = normal.solve_for()?;
    Some((gain, offset))
}

fn weigh(pairs: &[Pair], gain: f64, offset: f64, weights: &mut Vec<f64>) {
    let residuals = || pairs.iter().map(|pair| pair.residual(gain, offset));
    let sd = deviation_from_zero(residuals()).max(MIN_RESIDUAL_SD);
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
    let width = template.columns.len();
    let mut normal = NormalEquations::new(UNKNOWNS);
    let mut scores = Vec::with_capacity(pairs.len());
    for (pair, weight) in pairs.iter().zip(weights) {
        let row = derivatives(pair);
        let residual = pair.residual(gain, offset);
        normal.add(&row, residual, *weight);
        scores.push(row.map(|derivative| weight * residual * derivative));
    }
    let inverse = normal.inverse()?;
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
    let with_neighbours = windowed(&influence, width);
    let variance: DVec2 = influence
        .iter()
        .zip(&with_neighbours)
        .map(|(here, near)| here * near)
        .sum();
    Some(variance.max(DVec2::ZERO).map(f64::sqrt))
}

/// Sum over each value's neighbours within [`REACH`], in Bartlett's window; values outside are 0.
fn windowed(values: &[DVec2], width: usize) -> Vec<DVec2> {
    let height = values.len() / width;
    let sums = |values: &[DVec2], step: usize, length: usize| {
        let sum = |index: usize| {
            let at = index / step % length;
            (at.saturating_sub(REACH)..(at + REACH + 1).min(length))
                .map(|near| {
                    let share = 1.0 - near.abs_diff(at) as f64 / (REACH + 1) as f64;
                    share * values[index + near * step - at * step]
                })
                .sum()
        };
        Vec::from_iter((0..values.len()).map(sum))
    };
    sums(&sums(values, 1, width), width, height)
}

/// The correlation of many images with the same one, whose own sums are taken once.
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

    /// Correlation with an equally large image, line by line; 0 if either is constant.
    fn of<'b>(&self, lines: impl Iterator<Item = &'b [f64]>) -> f64 {
        // Sums of every fourth pixel do not wait for each other.
        const LANES: usize = 4;
        let [mut b, mut bb, mut ab] = [[0.0; LANES]; 3];
        let mut values = self.values;
        for line in lines {
            let (own, others) = values.split_at(line.len());
            values = others;
            let mut add = |own: &[f64], line: &[f64]| {
                for (lane, (x, y)) in own.iter().zip(line).enumerate() {
                    b[lane] += y;
                    bb[lane] += y * y;
                    ab[lane] += x * y;
                }
            };
            let (own, line) = (own.as_chunks::<LANES>(), line.as_chunks::<LANES>());
            own.0
                .iter()
                .zip(line.0)
                .for_each(|(own, line)| add(own, line));
            add(own.1, line.1);
        }
        let [b, bb, ab] = [b, bb, ab].map(|lanes| lanes.iter().sum::<f64>());
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
    let (template, view): (Vec<f64>, Vec<f64>) =
        pairs.iter().map(|pair| (pair.template, pair.view)).unzip();
    Likeness::with(&template).of([view.as_slice()].into_iter())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pearson correlation; 0 if either variable is constant.
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

    #[test]
    fn the_window_weighs_each_neighbour_by_its_distance_in_rows_and_columns() {
        let (width, height) = (9, 6);
        let value = |row: usize, column: usize| DVec2::new((7 * row + column) as f64, 1.0);
        let values: Vec<DVec2> = (0..width * height)
            .map(|index| value(index / width, index % width))
            .collect();
        let windowed = windowed(&values, width);
        let share = |a: usize, b: usize| (1.0 - a.abs_diff(b) as f64 / 4.0).max(0.0);
        for (row, column) in [(0, 0), (2, 4), (5, 8), (4, 1)] {
            let mut expected = DVec2::ZERO;
            for below in 0..height {
                for beside in 0..width {
                    expected += share(row, below) * share(column, beside) * value(below, beside);
                }
            }
            let found = windowed[row * width + column];
            assert!((found - expected).length() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn likeness_is_the_correlation_with_every_second_pixel_too() {
        let values: Vec<f64> = (0..11 * 5).map(|i| f64::from(i * i % 17)).collect();
        let picked = |left: usize, stride: usize, count: usize| -> Vec<f64> {
            (0..5)
                .step_by(stride)
                .flat_map(|row| (0..count).map(move |k| (row, k)))
                .map(|(row, k)| values[row * 11 + left + k * stride])
                .collect()
        };
        for (stride, count) in [(1, 7), (2, 4), (3, 3)] {
            let lines = StridedLines::of(&values, 11, stride);
            let template = picked(0, stride, count);
            for left in 0..=11 - (count - 1) * stride - 1 {
                let rows = (0..5).step_by(stride);
                let found =
                    Likeness::with(&template).of(rows.map(|row| lines.part(row, left, count)));
                let there = picked(left, stride, count);
                let expected = pearson(template.iter().copied().zip(there));
                assert!(
                    (found - expected).abs() < 1e-9,
                    "{stride} {left}: {found} {expected}"
                );
            }
        }
    }
}
