//! One box in one image: what stands out from the background around it, and where.
//!
//! The background is a plane through the brightness of the pixels around the box: over so few pixels the brightness of the sky changes
//! linearly. The residual of the pixels around the box is noise, that of those inside is the aircraft.

use glam::{DVec2, DVec3};

use super::outline::Outline;
use dataset::numbers::least_squares::NormalEquations;
use dataset::numbers::spread::quantile;
use dataset::tables::pixel_box::PixelBox;
use dataset::video::BYTES_PER_PIXEL;

/// Minimum box size with enough pixels.
const MIN_WIDTH_PX: f64 = 4.0;
const MIN_HEIGHT_PX: f64 = 2.0;
/// Width of the border around the box: this part of the longer side, within these bounds.
pub(super) const BORDER_OF_SIDE: f64 = 0.5;
const MIN_BORDER_PX: f64 = 6.0;
const MAX_BORDER_PX: f64 = 48.0;
/// Pixels next to the box that belong to neither: encoding and lamps smear the aircraft over them.
const SMEAR_PX: f64 = 2.0;
/// Minimum number of background pixels for a plane.
const MIN_BACKGROUND: usize = 40;
/// Contrast of something that is clearly there, grey levels: far above the effect of encoding the same image twice.
pub(super) const MIN_CONTRAST: f64 = 10.0;
/// A background with a larger residual is not smooth, grey levels.
const MAX_NOISE: f64 = 5.0;

/// A decoded image.
pub(super) struct DecodedPicture<'a> {
    rgb: &'a [u8],
    width: i64,
    height: i64,
}

/// What stands out in a box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BoxContent {
    /// Mean of the tenth of the pixels in the box that stand out most, grey levels.
    pub(super) contrast: f64,
    /// Level that nine tenths of the surrounding pixels stay below, grey levels.
    pub(super) noise: f64,
    /// Centre of the object, relative to the centre of the box, pixels.
    pub(super) offset_px: DVec2,
    /// Outline of the object.
    pub(super) outline: Option<Outline>,
}

impl BoxContent {
    /// True if something is in the box.
    pub(super) fn is_filled(&self) -> bool {
        self.contrast >= self.least_to_be_filled()
    }

    /// True if it is clearly empty: between the two, the answer is open.
    pub(super) fn is_empty(&self) -> bool {
        self.contrast < 1.6 * self.noise + 1.5
    }

    /// Minimum contrast in filled boxes, grey levels.
    pub(super) fn least_to_be_filled(&self) -> f64 {
        3.0 * self.noise + 2.0
    }

    /// True if the background is smooth enough to decide.
    pub(super) fn is_before_smooth(&self) -> bool {
        self.noise <= MAX_NOISE
    }
}

impl<'a> DecodedPicture<'a> {
    pub(super) fn new(rgb: &'a [u8], width_px: u32, height_px: u32) -> Self {
        Self {
            rgb,
            width: i64::from(width_px),
            height: i64::from(height_px),
        }
    }

    /// A second image of this size.
    pub(super) fn of_same_size<'b>(&self, rgb: &'b [u8]) -> DecodedPicture<'b> {
        DecodedPicture {
            rgb,
            width: self.width,
            height: self.height,
        }
    }

    /// All bytes.
    pub(super) fn bytes(&self) -> &[u8] {
        self.rgb
    }

    /// Brightness by BT.709, grey levels.
    fn grey(&self, x: i64, y: i64) -> f64 {
        let at = (y * self.width + x) as usize * BYTES_PER_PIXEL;
        let [red, green, blue] = [0, 1, 2].map(|channel| f64::from(self.rgb[at + channel]));
        0.2126 * red + 0.7152 * green + 0.0722 * blue
    }

    /// Width and height, pixels.
    pub(super) fn size_px(&self) -> [i64; 2] {
        [self.width, self.height]
    }

    /// Brightness of neighbouring pixels in a row, every `step`th pixel in every `step`th row, with the place of the left one.
    pub(super) fn neighbours(&self, step: usize) -> impl Iterator<Item = ([usize; 2], [f64; 2])> {
        let columns = move || (0..self.width - 1).step_by(step);
        let rows = (0..self.height).step_by(step);
        rows.flat_map(move |y| {
            columns().map(move |x| {
                let place = [x as usize, y as usize];
                (place, [self.grey(x, y), self.grey(x + 1, y)])
            })
        })
    }

    /// The box's whole pixels that are in the image.
    fn pixels(&self, within: &PixelBox, margin_px: f64) -> impl Iterator<Item = (i64, i64)> {
        let [left, top, right, bottom] = within.edges();
        let first = |edge: f64| ((edge - margin_px).ceil() as i64).max(0);
        let last = |edge: f64, size: i64| ((edge + margin_px).floor() as i64).min(size - 1);
        let columns = first(left)..=last(right, self.width);
        (first(top)..=last(bottom, self.height))
            .flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }
}

/// Examines a box; `None` if it is too small, or if there is too little background around it.
pub(super) fn look(picture: &DecodedPicture, within: &PixelBox) -> Option<BoxContent> {
    if within.width_px < MIN_WIDTH_PX || within.height_px < MIN_HEIGHT_PX {
        return None;
    }
    let longer_px = within.width_px.max(within.height_px);
    let margin_px = (BORDER_OF_SIDE * longer_px).clamp(MIN_BORDER_PX, MAX_BORDER_PX);
    let centre = DVec2::new(within.cx_px, within.cy_px);
    let beyond = |x: i64, y: i64| {
        let away = (DVec2::new(x as f64, y as f64) - centre).abs();
        (away.x - within.width_px / 2.0).max(away.y - within.height_px / 2.0)
    };
    let mut around = Vec::new();
    let mut inside = Vec::new();
    for (x, y) in picture.pixels(within, margin_px) {
        let from_centre = DVec2::new(x as f64, y as f64) - centre;
        let pixel = (from_centre, picture.grey(x, y));
        let beyond_px = beyond(x, y);
        if beyond_px > SMEAR_PX {
            around.push(pixel);
        }
        inside.push((pixel, beyond_px));
    }
    if around.len() < MIN_BACKGROUND {
        return None;
    }
    let plane = Plane::through(&around)?;
    let mut left: Vec<f64> = around.iter().map(|pixel| plane.left_of(pixel)).collect();
    // A lamp's glow or a distant cloud's edge must not tilt the plane.
    let noise = quantile(&mut left, 0.9);
    let calm: Vec<_> = around
        .into_iter()
        .filter(|pixel| plane.left_of(pixel) <= noise)
        .collect();
    let plane = Plane::through(&calm)?;

    let mut stands_out: Vec<f64> = inside
        .iter()
        .filter(|(_, beyond_px)| *beyond_px <= 0.5)
        .map(|(pixel, _)| plane.left_of(pixel))
        .collect();
    let contrast = mean_of_top_tenth(&mut stands_out)?;
    let threshold = above_noise(noise).max(contrast / 4.0);
    let reach_px = margin_px * 0.7;
    let (mut sum, mut moment) = (0.0, DVec2::ZERO);
    let residuals = inside.iter().map(|(pixel, beyond_px)| {
        let is_near = *beyond_px <= reach_px;
        (pixel.0, if is_near { plane.left_of(pixel) } else { 0.0 })
    });
    let outline = Outline::of(residuals, &stands_out, contrast, noise);
    for (pixel, beyond_px) in &inside {
        let weight = plane.left_of(pixel);
        if *beyond_px <= reach_px && weight > threshold {
            sum += weight;
            moment += pixel.0 * weight;
        }
    }
    Some(BoxContent {
        contrast,
        noise,
        offset_px: if sum > 0.0 { moment / sum } else { DVec2::ZERO },
        outline,
    })
}

/// Change between two images where the aircraft was and is, grey levels: the mean of the tenth of the pixels that changed most.
pub(super) fn change_between(
    before: &DecodedPicture,
    after: &DecodedPicture,
    was: &PixelBox,
    is: &PixelBox,
) -> Option<f64> {
    if before.rgb.len() != after.rgb.len() {
        return None;
    }
    let [a, b] = [was.edges(), is.edges()];
    let both = PixelBox::from_edges(
        a[0].min(b[0]),
        a[1].min(b[1]),
        a[2].max(b[2]),
        a[3].max(b[3]),
    );
    let mut changes: Vec<f64> = after
        .pixels(&both, 1.0)
        .map(|(x, y)| (after.grey(x, y) - before.grey(x, y)).abs())
        .collect();
    mean_of_top_tenth(&mut changes)
}

/// Residual brightness that noise hardly reaches, grey levels.
pub(super) fn above_noise(noise: f64) -> f64 {
    2.0 * noise + 1.0
}

fn mean_of_top_tenth(values: &mut [f64]) -> Option<f64> {
    let top = values.len().div_ceil(10);
    if top == 0 {
        return None;
    }
    let first = values.len() - top;
    values.select_nth_unstable_by(first, f64::total_cmp);
    Some(values[first..].iter().sum::<f64>() / top as f64)
}

/// Brightness that changes linearly: `at the centre + slope . place`.
struct Plane(DVec3);

impl Plane {
    fn through(pixels: &[(DVec2, f64)]) -> Option<Self> {
        let mut normal = NormalEquations::new(3);
        for (place, grey) in pixels {
            normal.add(&place.extend(1.0).to_array(), *grey, 1.0);
        }
        Some(Self(DVec3::from_array(normal.solve_for()?)))
    }

    /// A pixel's absolute residual.
    fn left_of(&self, (place, grey): &(DVec2, f64)) -> f64 {
        (grey - self.0.dot(place.extend(1.0))).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: u32 = 96;

    /// A sky with a gradient and a little grain, and a dark bar around a place.
    fn picture(bar: Option<(f64, f64)>) -> Vec<u8> {
        let mut rgb = Vec::new();
        for y in 0..SIZE {
            for x in 0..SIZE {
                let grain = f64::from((x * 7_919 + y * 104_729) % 3);
                let mut grey = 120.0 + 0.4 * f64::from(x) + 0.2 * f64::from(y) + grain;
                if let Some((cx, cy)) = bar {
                    let inside = |d: f64, half: f64| {
                        ((d + 0.5).min(half) - (d - 0.5).max(-half)).clamp(0.0, 1.0)
                    };
                    grey -= 30.0 * inside(f64::from(x) - cx, 5.0) * inside(f64::from(y) - cy, 1.5);
                }
                rgb.extend([grey as u8; 3]);
            }
        }
        rgb
    }

    fn around(cx_px: f64, cy_px: f64) -> PixelBox {
        PixelBox {
            cx_px,
            cy_px,
            width_px: 10.0,
            height_px: 3.0,
        }
    }

    #[test]
    fn a_bar_is_found_where_it_is_and_not_elsewhere() {
        let rgb = picture(Some((40.3, 50.6)));
        let picture = DecodedPicture::new(&rgb, SIZE, SIZE);
        let there = look(&picture, &around(40.3, 50.6)).unwrap();
        assert!(there.is_filled() && there.is_before_smooth(), "{there:?}");
        assert!(there.offset_px.length() < 0.2, "{there:?}");
        let beside = look(&picture, &around(41.3, 50.6)).unwrap();
        assert!((beside.offset_px - DVec2::new(-1.0, 0.0)).length() < 0.3);
        let elsewhere = look(&picture, &around(70.0, 20.0)).unwrap();
        assert!(elsewhere.is_empty(), "{elsewhere:?}");
    }

    #[test]
    fn what_moved_changed_and_what_did_not_did_not() {
        let [first, second] = [(40.0, 50.0), (42.0, 50.0)].map(|place| picture(Some(place)));
        let [a, b] = [&first, &second].map(|rgb| DecodedPicture::new(rgb, SIZE, SIZE));
        let [was, is] = [around(40.0, 50.0), around(42.0, 50.0)];
        assert!(change_between(&a, &b, &was, &is).unwrap() > 20.0);
        assert_eq!(change_between(&a, &a, &was, &is), Some(0.0));
    }

    #[test]
    fn a_bar_that_the_edge_of_the_picture_cuts_off_is_found_by_what_is_left_of_it() {
        let without = picture(None);
        for (x, y) in [(-4.0, -1.0), (99.0, 95.0), (0.0, 95.0)] {
            let with = picture(Some((x, y)));
            let [nothing, bar] = [&without, &with].map(|rgb| {
                let picture = DecodedPicture::new(rgb, SIZE, SIZE);
                look(&picture, &around(x, y)).unwrap()
            });
            assert!(nothing.is_empty(), "({x}, {y}): {nothing:?}");
            assert!(bar.is_filled(), "({x}, {y}): {bar:?}");
            // The visible part lies inwards of the centre.
            let inwards = DVec2::splat(47.5) - DVec2::new(x, y);
            assert!(bar.offset_px.dot(inwards) > 0.0, "({x}, {y}): {bar:?}");
        }
    }
}
