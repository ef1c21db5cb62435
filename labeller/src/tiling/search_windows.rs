//! Windows for a detector.
//!
//! Input: the sizes of the image and of the model's windows. Output: [`Window`]s. A model that takes any size sees the whole image at once,
//! and each aircraft in a crop just large enough; a fixed-size model sees tiles (six of 640 pixels for 1920x1280, as in the paper), and
//! each aircraft in the middle of a tile-sized window.

use std::ops::Range;

use dataset::tables::pixel_box::PixelBox;

use crate::detector::{Window, WindowSize};
use crate::tiling::row_band::RowBand;

/// Sides of crops around an aircraft for models that take any size, px: a few pixels need surroundings, and larger crops cost too much.
const CROP_PX: Range<f64> = 160.0..256.0;
/// Maximum part of a window's side that an aircraft fills; larger ones are shrunk.
const MAX_SHARE: f64 = 0.65;

/// First-pass windows over a band, row by row: tiles, or a single window if the model takes any size and no tile size is
/// requested. They may extend past the image at the right and at the bottom.
pub(crate) fn first_windows(
    [width_px, height_px]: [u32; 2],
    size: WindowSize,
    tile_px: Option<u32>,
    band: Option<RowBand>,
    shrink: u32,
) -> Vec<Window> {
    let rows = RowBand::within(band, height_px);
    let tile = match (size, tile_px) {
        (
            WindowSize::Fixed {
                width_px,
                height_px,
            },
            _,
        ) => [width_px, height_px],
        (WindowSize::Any { multiple_px }, None) => [width_px, rows.end - rows.start]
            .map(|side_px| side_px.div_ceil(shrink).next_multiple_of(multiple_px)),
        (WindowSize::Any { multiple_px }, Some(tile_px)) => {
            [tile_px.next_multiple_of(multiple_px); 2]
        }
    };
    let [shown_wide_px, shown_high_px] = tile.map(|side_px| side_px * shrink);
    let lefts = starts(0..width_px, shown_wide_px, width_px);
    let tops = starts(rows, shown_high_px, height_px);
    let window = |left_px, top_px| Window {
        left_px,
        top_px,
        width_px: tile[0],
        height_px: tile[1],
        shrink,
    };
    tops.into_iter()
        .flat_map(|top_px| lefts.iter().map(move |&left_px| window(left_px, top_px)))
        .collect()
}

/// Starts of the tiles that cover a range. A single tile is moved inside the image if it fits.
fn starts(covered: Range<u32>, tile_px: u32, picture_px: u32) -> Vec<u32> {
    let length_px = covered.end - covered.start;
    if length_px == 0 {
        return Vec::new();
    }
    if length_px <= tile_px {
        return vec![covered.start.min(picture_px.saturating_sub(tile_px))];
    }
    let tiles = length_px.div_ceil(tile_px);
    (0..tiles)
        .map(|tile| covered.start + tile * tile_px)
        .collect()
}

/// The whole image in one window of the usual size, as a detector without tiles sees it.
pub(crate) fn shrunk_picture([width_px, height_px]: [u32; 2], size: WindowSize) -> Window {
    let [most_wide, most_high] = size.usual_px();
    let shrink = width_px
        .div_ceil(most_wide)
        .max(height_px.div_ceil(most_high))
        .max(1);
    let [width_px, height_px] = match size {
        WindowSize::Fixed { .. } => [most_wide, most_high],
        WindowSize::Any { multiple_px } => [width_px, height_px]
            .map(|side_px| side_px.div_ceil(shrink).next_multiple_of(multiple_px)),
    };
    Window {
        left_px: 0,
        top_px: 0,
        width_px,
        height_px,
        shrink,
    }
}

/// The window around a box, moved inside the image if the image is large enough. An aircraft that would fill it is shrunk.
pub(crate) fn window_around(around: &PixelBox, picture_px: [u32; 2], size: WindowSize) -> Window {
    let longer_px = around.width_px.max(around.height_px);
    let [width_px, height_px] = match size {
        WindowSize::Fixed {
            width_px,
            height_px,
        } => [width_px, height_px],
        WindowSize::Any { multiple_px } => {
            let side_px = (longer_px / MAX_SHARE).clamp(CROP_PX.start, CROP_PX.end);
            [(side_px.ceil() as u32).next_multiple_of(multiple_px); 2]
        }
    };
    let largest_px = |side_px: u32| MAX_SHARE * f64::from(side_px);
    let shrink = (around.width_px / largest_px(width_px))
        .max(around.height_px / largest_px(height_px))
        .ceil()
        .max(1.0) as u32;
    let start = |centre_px: f64, side_px: u32, picture_px: u32| {
        let shown_px = side_px.saturating_mul(shrink);
        let start = (centre_px - f64::from(shown_px - 1) / 2.0).round();
        start.clamp(0.0, f64::from(picture_px.saturating_sub(shown_px))) as u32
    };
    Window {
        left_px: start(around.cx_px, width_px, picture_px[0]),
        top_px: start(around.cy_px, height_px, picture_px[1]),
        width_px,
        height_px,
        shrink,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANY: WindowSize = WindowSize::Any { multiple_px: 32 };
    const PICTURE: [u32; 2] = [1_920, 1_280];

    fn corners(windows: &[Window]) -> Vec<(u32, u32)> {
        windows
            .iter()
            .map(|window| (window.left_px, window.top_px))
            .collect()
    }

    fn tiles(picture_px: [u32; 2], tile_px: u32) -> Vec<Window> {
        first_windows(picture_px, WindowSize::square(tile_px), None, None, 1)
    }

    fn aircraft(cx_px: f64, cy_px: f64, width_px: f64) -> PixelBox {
        PixelBox {
            cx_px,
            cy_px,
            width_px,
            height_px: 0.3 * width_px,
        }
    }

    #[test]
    fn a_full_frame_is_six_tiles_row_by_row() {
        assert_eq!(
            corners(&tiles(PICTURE, 640)),
            [
                (0, 0),
                (640, 0),
                (1280, 0),
                (0, 640),
                (640, 640),
                (1280, 640)
            ]
        );
        assert_eq!(tiles([1_920, 1_080], 640).len(), 6);
        assert_eq!(tiles(PICTURE, 416).len(), 20);
    }

    #[test]
    fn a_model_of_any_size_sees_the_whole_picture_or_the_rows_that_are_asked_for_at_once() {
        let whole = |height_px, band| {
            let windows = first_windows([1_920, height_px], ANY, None, band, 1);
            let rows = windows.iter().map(|w| (w.top_px, w.height_px));
            rows.collect::<Vec<_>>()
        };
        assert_eq!(whole(1_280, None), [(0, 1_280)]);
        assert_eq!(whole(1_080, None), [(0, 1_088)]);
        let band = |top_px, bottom_px| Some(RowBand { top_px, bottom_px });
        assert_eq!(whole(1_280, band(300, 700)), [(300, 416)]);
        assert_eq!(whole(1_280, band(1_100, 5_000)), [(1_088, 192)]);
        assert_eq!(whole(1_280, band(2_000, 5_000)), []);
        let tiled = first_windows(PICTURE, ANY, Some(640), band(300, 700), 1);
        assert_eq!(corners(&tiled), [(0, 300), (640, 300), (1_280, 300)]);
    }

    #[test]
    fn at_half_the_scale_windows_show_twice_as_much() {
        let band = Some(RowBand {
            top_px: 370,
            bottom_px: 1_057,
        });
        let at_half = |size| first_windows(PICTURE, size, None, band, 2);
        let whole = at_half(ANY);
        let shown = (whole[0].top_px, whole[0].width_px, whole[0].height_px);
        assert_eq!(
            (whole.len(), shown, whole[0].shrink),
            (1, (370, 960, 352), 2)
        );
        let tiles = at_half(WindowSize::square(640));
        assert_eq!(corners(&tiles), [(0, 0), (1_280, 0)]);
    }

    #[test]
    fn a_crop_is_just_large_enough_and_shrinks_what_would_fill_it() {
        let crop = |width_px| window_around(&aircraft(960.0, 640.0, width_px), PICTURE, ANY);
        let sides = [8.0, 110.0, 160.0, 300.0].map(|width_px| {
            let window = crop(width_px);
            (window.width_px, window.shrink)
        });
        assert_eq!(sides, [(160, 1), (192, 1), (256, 1), (256, 2)]);
        let fixed = |width_px| {
            let around = aircraft(960.0, 640.0, width_px);
            window_around(&around, PICTURE, WindowSize::square(640)).shrink
        };
        assert_eq!([fixed(300.0), fixed(500.0)], [1, 2]);
    }

    #[test]
    fn a_crop_at_the_edge_is_moved_inside_the_picture() {
        let window = window_around(&aircraft(1_915.0, 3.0, 12.0), PICTURE, ANY);
        assert_eq!((window.left_px, window.top_px), (1_760, 0));
        let small = window_around(&aircraft(50.0, 50.0, 12.0), [100, 90], ANY);
        assert_eq!((small.left_px, small.top_px), (0, 0));
    }

    #[test]
    fn a_shrunk_picture_fits_into_one_window() {
        let sizes = |picture_px, size| {
            let window = shrunk_picture(picture_px, size);
            (window.width_px, window.height_px, window.shrink)
        };
        assert_eq!(sizes(PICTURE, ANY), (640, 448, 3));
        assert_eq!(sizes(PICTURE, WindowSize::square(640)), (640, 640, 3));
        assert_eq!(sizes([300, 200], WindowSize::square(640)), (640, 640, 1));
    }
}
