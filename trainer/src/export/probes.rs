//! Ticks that verify a runtime: boxes all over the training range, missing views, false boxes, and registrations.

use dataset::tables::pixel_box::PixelBox;
use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;

use crate::networks::normalisation::Normalisation;
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::view_shift::ViewShift;
use crate::samples::{Candidate, Look, Observation};

const TICKS: usize = 500;
/// Share of empty views, of false boxes, and of missing shifts.
const SPOILT: f64 = 0.2;
/// Maximum deviation of the shifts from the difference between the boxes, pixels.
const APART_PX: f64 = 2.0;

/// Model inputs.
#[derive(Debug, Clone, PartialEq)]
pub struct Probes {
    /// Number of ticks.
    pub ticks: usize,
    /// Number of views.
    pub views: usize,
    /// `[ticks, views, 4]`.
    pub boxes: Vec<f64>,
    /// `[ticks, views, 2]`.
    pub registrations: Vec<f64>,
}

/// Draws probes; also returns the ticks as estimators see them.
pub(super) fn draw(normalisation: &Normalisation) -> (Probes, Vec<Observation>) {
    let random = &mut ChaCha12Rng::seed_from_u64(0);
    let views = normalisation.views.len();
    let mut probes = Probes {
        ticks: TICKS,
        views,
        boxes: Vec::new(),
        registrations: Vec::new(),
    };
    let mut believed = Vec::new();
    for tick in 0..TICKS {
        let boxes: Vec<Option<PixelBox>> = (0..views)
            .map(|view| box_in(normalisation, view, random))
            .collect();
        let registered = !random.random_bool(SPOILT);
        let shifts: Vec<Option<ViewShift>> = (0..views)
            .map(|view| {
                let centre = |seen| centre_and_size(seen).0;
                let from_px = centre(boxes[0].as_ref()?);
                let there_px = centre(boxes[view].as_ref()?);
                let apart = DVec2::new(
                    random.random_range(-APART_PX..APART_PX),
                    random.random_range(-APART_PX..APART_PX),
                );
                (registered && view > 0).then(|| ViewShift {
                    reference: 0,
                    from_px,
                    shift_px: there_px - from_px + apart,
                    sd_px: DVec2::splat(0.1),
                })
            })
            .collect();
        let found = boxes.into_iter().map(|seen| {
            Some(vec![Candidate {
                pixel_box: seen?,
                score: 1.0,
                track: None,
            }])
        });
        let looks = vec![Look::Placed; views];
        let observed = Observation::of((0, tick as u32, 0), found.collect(), shifts, looks);
        for view in 0..views {
            let seen = observed.best(view);
            probes.boxes.extend(seen.map_or([f64::NAN; 4], |b| {
                [b.cx_px, b.cy_px, b.width_px, b.height_px]
            }));
            let shift_px = match observed.shift(view) {
                None if view == 0 => DVec2::ZERO,
                None => DVec2::NAN,
                Some(shift) => shift.shift_px,
            };
            probes.registrations.extend(shift_px.to_array());
        }
        believed.push(normalisation.without_outliers(&observed, false));
    }
    (probes, believed)
}

/// Random box, mostly within the training range.
fn box_in(
    normalisation: &Normalisation,
    view: usize,
    random: &mut ChaCha12Rng,
) -> Option<PixelBox> {
    let range = normalisation.range_px[view]?;
    let [cx_px, cy_px, width_px, height_px] =
        range.map(|[least, most]| least + (most - least) * random.random_range(0.0..=1.0));
    let is_false = random.random_bool(SPOILT);
    (!random.random_bool(SPOILT)).then_some(PixelBox {
        cx_px,
        cy_px,
        width_px,
        height_px: if is_false { 9.0 * height_px } else { height_px },
    })
}
