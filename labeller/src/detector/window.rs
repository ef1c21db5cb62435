//! Images and their windows.

use dataset::tables::pixel_box::PixelBox;

use super::ScoredBox;
use super::profile::ChannelOrder;

/// Grey level outside the image; YOLO models are trained with this border.
const PADDING: u8 = 114;

/// An 8-bit RGB image, rows from top to bottom without gaps.
#[derive(Debug, Clone, Copy)]
pub struct PictureView<'a> {
    /// `width_px * height_px * 3` bytes.
    pub rgb: &'a [u8],
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
}

/// Image part as the model sees it. It may extend past the right and bottom edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Column of the image's left-most pixels in it.
    pub left_px: u32,
    /// Row of the image's top-most pixels in it.
    pub top_px: u32,
    /// Width of the model's input, pixels.
    pub width_px: u32,
    /// Height of the model's input, pixels.
    pub height_px: u32,
    /// Pixels of the image, across and down, that are averaged to one of the input; 1 shows every pixel.
    pub shrink: u32,
}

impl Window {
    /// Copies the window into a tensor of three planes (channel, row, column), multiplied by `scale`.
    pub(super) fn write_planes(
        self,
        picture: &PictureView<'_>,
        order: ChannelOrder,
        scale: f32,
        planes: &mut [f32],
    ) {
        let size = self.width_px as usize * self.height_px as usize;
        let (first, rest) = planes.split_at_mut(size);
        let (second, third) = rest.split_at_mut(size);
        let [red, green, blue] = match order {
            ChannelOrder::Rgb => [first, second, third],
            ChannelOrder::Bgr => [third, second, first],
        };
        let inside = |length_px: u32, start_px: u32, most: u32| {
            let shown_px = length_px.saturating_sub(start_px);
            shown_px.div_ceil(self.shrink).min(most) as usize
        };
        let columns = inside(picture.width_px, self.left_px, self.width_px);
        let rows = inside(picture.height_px, self.top_px, self.height_px);
        let width = self.width_px as usize;
        if columns < width || rows < self.height_px as usize {
            for plane in [&mut *red, &mut *green, &mut *blue] {
                plane.fill(f32::from(PADDING) * scale);
            }
        }
        let mut means = Vec::new();
        for row in 0..rows {
            let span = row * width..row * width + columns;
            let channels = red[span.clone()]
                .iter_mut()
                .zip(&mut green[span.clone()])
                .zip(&mut blue[span]);
            if self.shrink == 1 {
                let start = ((self.top_px as usize + row) * picture.width_px as usize
                    + self.left_px as usize)
                    * 3;
                let line = &picture.rgb[start..start + columns * 3];
                for (pixel, ((red, green), blue)) in line.chunks_exact(3).zip(channels) {
                    *red = f32::from(pixel[0]) * scale;
                    *green = f32::from(pixel[1]) * scale;
                    *blue = f32::from(pixel[2]) * scale;
                }
            } else {
                self.mean_line(picture, row, columns, &mut means);
                for (mean, ((red, green), blue)) in means.iter().zip(channels) {
                    *red = mean[0] * scale;
                    *green = mean[1] * scale;
                    *blue = mean[2] * scale;
                }
            }
        }
    }

    /// Means over squares with side `shrink` in one row, clipped to the image.
    fn mean_line(
        self,
        picture: &PictureView<'_>,
        row: usize,
        columns: usize,
        means: &mut Vec<[f32; 3]>,
    ) {
        let shrink = self.shrink as usize;
        let [width, height] = [picture.width_px, picture.height_px].map(|side| side as usize);
        let left = self.left_px as usize;
        let top = self.top_px as usize + row * shrink;
        let lines = top..(top + shrink).min(height);
        let end = (left + columns * shrink).min(width);
        // Of the lines first: neighbours in memory, which the compiler adds many at a time.
        let mut sums = vec![0_u32; (end - left) * 3];
        for line in lines.clone() {
            let pixels = &picture.rgb[(line * width + left) * 3..(line * width + end) * 3];
            for (sum, &value) in sums.iter_mut().zip(pixels) {
                *sum += u32::from(value);
            }
        }
        means.clear();
        means.extend(sums.chunks(shrink * 3).map(|square| {
            let mut sum = [0; 3];
            for pixel in square.chunks_exact(3) {
                sum = std::array::from_fn(|channel| sum[channel] + pixel[channel]);
            }
            let pixels = square.len() / 3 * lines.len();
            sum.map(|sum| sum as f32 / pixels as f32)
        }));
    }

    /// A box of the window in the image.
    pub(super) fn to_picture(self, found: ScoredBox) -> ScoredBox {
        let shrink = f64::from(self.shrink);
        let along = |start_px: u32, at_px: f64| {
            // The first pixel of the input shows the first `shrink` of the image.
            f64::from(start_px) + at_px * shrink + (shrink - 1.0) / 2.0
        };
        ScoredBox {
            pixel_box: PixelBox {
                cx_px: along(self.left_px, found.pixel_box.cx_px),
                cy_px: along(self.top_px, found.pixel_box.cy_px),
                width_px: found.pixel_box.width_px * shrink,
                height_px: found.pixel_box.height_px * shrink,
            },
            ..found
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(window: Window, order: ChannelOrder, scale: f32) -> Vec<f32> {
        // 3 x 2 pixels; the red of pixel k is k, green 100 + k, blue 200 + k.
        let rgb: Vec<u8> = (0..6).flat_map(|k| [k, 100 + k, 200 + k]).collect();
        let picture = PictureView {
            rgb: &rgb,
            width_px: 3,
            height_px: 2,
        };
        let mut planes = vec![0.0; (window.width_px * window.height_px * 3) as usize];
        window.write_planes(&picture, order, scale, &mut planes);
        planes
    }

    fn window(left_px: u32, top_px: u32, [width_px, height_px]: [u32; 2], shrink: u32) -> Window {
        Window {
            left_px,
            top_px,
            width_px,
            height_px,
            shrink,
        }
    }

    #[test]
    fn a_window_becomes_planes_in_the_asked_order_and_is_padded_outside_the_picture() {
        assert_eq!(
            planes(window(1, 0, [2, 2], 1), ChannelOrder::Rgb, 1.0),
            [
                1.0, 2.0, 4.0, 5.0, 101.0, 102.0, 104.0, 105.0, 201.0, 202.0, 204.0, 205.0
            ]
        );
        let pad = 57.0;
        assert_eq!(
            planes(window(2, 1, [2, 2], 1), ChannelOrder::Bgr, 0.5),
            [
                102.5, pad, pad, pad, 52.5, pad, pad, pad, 2.5, pad, pad, pad
            ]
        );
        // Wider than high.
        assert_eq!(
            planes(window(0, 1, [2, 1], 1), ChannelOrder::Rgb, 1.0),
            [3.0, 4.0, 103.0, 104.0, 203.0, 204.0]
        );
    }

    #[test]
    fn a_shrunk_window_holds_means_of_what_is_inside_the_picture() {
        // The square at the right shows one column of the image.
        assert_eq!(
            planes(window(0, 0, [3, 1], 2), ChannelOrder::Rgb, 1.0),
            [2.0, 3.5, 114.0, 102.0, 103.5, 114.0, 202.0, 203.5, 114.0]
        );
    }

    #[test]
    fn a_box_in_a_shrunk_window_covers_the_same_pixels_of_the_picture() {
        let found = ScoredBox {
            pixel_box: PixelBox::from_edges(9.5, 4.5, 14.5, 6.5),
            score: 0.5,
        };
        let in_picture = window(100, 40, [32, 32], 3).to_picture(found).pixel_box;
        // Pixels 10 to 14 of the window begin with column 100 + 30 and end with 100 + 44.
        assert_eq!(in_picture.edges(), [129.5, 54.5, 144.5, 60.5]);
    }
}
