//! Lines and boxes on an image, and its JPEG.

use std::path::Path;

use dataset::video;
use image::{Rgb, RgbImage};

use crate::error::Result;

/// Ground-truth colour.
pub(super) const TRUE: Rgb<u8> = Rgb([0, 200, 90]);
/// Detection colour.
pub(super) const FOUND: Rgb<u8> = Rgb([230, 60, 0]);
/// Tile colour.
pub(super) const TILE: Rgb<u8> = Rgb([250, 230, 60]);

/// Colours a square `width` pixels wide around a point, as far as it is inside the image.
fn dot(picture: &mut RgbImage, [x, y]: [f64; 2], width: u32, colour: Rgb<u8>) {
    let first = |centre: f64| (centre - f64::from(width) / 2.0).ceil() as i64;
    for (dx, dy) in
        (0..i64::from(width)).flat_map(|dx| (0..i64::from(width)).map(move |dy| (dx, dy)))
    {
        let place = [first(x) + dx, first(y) + dy].map(u32::try_from);
        if let [Ok(x), Ok(y)] = place
            && let Some(pixel) = picture.get_pixel_mut_checked(x, y)
        {
            *pixel = colour;
        }
    }
}

/// A line of `width` pixels through some points.
pub(super) fn line(picture: &mut RgbImage, points: &[[f64; 2]], width: u32, colour: Rgb<u8>) {
    for ends in points.windows(2) {
        let [from, to] = [ends[0], ends[1]];
        let length = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
        let steps = length.ceil().max(1.0) as u32;
        for step in 0..=steps {
            let part = f64::from(step) / f64::from(steps);
            let at = |axis: usize| from[axis] + part * (to[axis] - from[axis]);
            dot(picture, [at(0), at(1)], width, colour);
        }
    }
}

/// A box outline, by its left, top, right and bottom edges.
pub(super) fn outline(
    picture: &mut RgbImage,
    [left, top, right, bottom]: [f64; 4],
    width: u32,
    colour: Rgb<u8>,
) {
    let corners = [
        [left, top],
        [right, top],
        [right, bottom],
        [left, bottom],
        [left, top],
    ];
    line(picture, &corners, width, colour);
}

/// The image as JPEG. `what` names it in errors.
pub(super) fn jpeg(picture: &RgbImage, what: &str) -> Result<Vec<u8>> {
    let (width, height) = picture.dimensions();
    Ok(video::jpeg(Path::new(what), picture, [width, height])?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_leaves_the_picture_is_drawn_as_far_as_it_is_inside() {
        let mut picture = RgbImage::new(20, 10);
        line(&mut picture, &[[-5.0, 5.0], [30.0, 5.0]], 1, TRUE);
        assert!((0..20).all(|x| *picture.get_pixel(x, 5) == TRUE));
        assert_eq!(*picture.get_pixel(3, 4), Rgb([0, 0, 0]));
        outline(&mut picture, [2.0, 2.0, 8.0, 8.0], 1, FOUND);
        assert_eq!(*picture.get_pixel(2, 7), FOUND);
        assert_eq!(*picture.get_pixel(5, 4), Rgb([0, 0, 0]), "the inside stays");
    }
}
