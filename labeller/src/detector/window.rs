//! Pictures and the square windows that are cut out of them.

use super::profile::ChannelOrder;

/// Grey level of a window outside the picture; YOLO models are trained with this border.
const PADDING: u8 = 114;

/// An 8-bit RGB picture, rows from top to bottom without gaps.
#[derive(Debug, Clone, Copy)]
pub struct PictureView<'a> {
    /// `width_px * height_px * 3` bytes.
    pub rgb: &'a [u8],
    /// Width, pixels.
    pub width_px: u32,
    /// Height, pixels.
    pub height_px: u32,
}

/// The pixel of the picture in a window's top-left corner. A window may extend past the right and bottom edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Column of the left-most pixels.
    pub left_px: u32,
    /// Row of the top-most pixels.
    pub top_px: u32,
}

impl Window {
    /// Copies the window into a tensor of three planes (channel, row, column) of `size_px` squared, multiplied by `scale`.
    pub(super) fn write_planes(
        self,
        picture: &PictureView<'_>,
        size_px: u32,
        order: ChannelOrder,
        scale: f32,
        planes: &mut [f32],
    ) {
        let size = size_px as usize;
        let (first, rest) = planes.split_at_mut(size * size);
        let (second, third) = rest.split_at_mut(size * size);
        let [red, green, blue] = match order {
            ChannelOrder::Rgb => [first, second, third],
            ChannelOrder::Bgr => [third, second, first],
        };
        let columns = size.min(picture.width_px.saturating_sub(self.left_px) as usize);
        let rows = size.min(picture.height_px.saturating_sub(self.top_px) as usize);
        if columns < size || rows < size {
            for plane in [&mut *red, &mut *green, &mut *blue] {
                plane.fill(f32::from(PADDING) * scale);
            }
        }
        for row in 0..rows {
            let start = ((self.top_px as usize + row) * picture.width_px as usize
                + self.left_px as usize)
                * 3;
            let line = &picture.rgb[start..start + columns * 3];
            let span = row * size..row * size + columns;
            let channels = red[span.clone()]
                .iter_mut()
                .zip(&mut green[span.clone()])
                .zip(&mut blue[span]);
            for (pixel, ((red, green), blue)) in line.chunks_exact(3).zip(channels) {
                *red = f32::from(pixel[0]) * scale;
                *green = f32::from(pixel[1]) * scale;
                *blue = f32::from(pixel[2]) * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_becomes_planes_in_the_asked_order_and_is_padded_outside_the_picture() {
        // 3 x 2 pixels; the red of pixel k is k, green 100 + k, blue 200 + k.
        let rgb: Vec<u8> = (0..6).flat_map(|k| [k, 100 + k, 200 + k]).collect();
        let picture = PictureView {
            rgb: &rgb,
            width_px: 3,
            height_px: 2,
        };
        let mut planes = [0.0; 12];
        Window {
            left_px: 1,
            top_px: 0,
        }
        .write_planes(&picture, 2, ChannelOrder::Rgb, 1.0, &mut planes);
        assert_eq!(
            planes,
            [
                1.0, 2.0, 4.0, 5.0, 101.0, 102.0, 104.0, 105.0, 201.0, 202.0, 204.0, 205.0
            ]
        );
        Window {
            left_px: 2,
            top_px: 1,
        }
        .write_planes(&picture, 2, ChannelOrder::Bgr, 0.5, &mut planes);
        let pad = 57.0;
        assert_eq!(
            planes,
            [
                102.5, pad, pad, pad, 52.5, pad, pad, pad, 2.5, pad, pad, pad
            ]
        );
    }
}
