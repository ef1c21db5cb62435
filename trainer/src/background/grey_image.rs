//! Stationary background: the mean of the first images in a flight, from just above the horizon down.
//!
//! Clouds are left out with the sky. The mean removes noise and rain; the aircraft covers few patches, and moves.

use dataset::corpus::open_scenario::OpenScenario;
use dataset::video::PicturePart;

use crate::error::Result;

/// Number of averaged images: their mean has a fifth of the noise.
const PICTURES: usize = 24;

/// Grey levels in some image rows.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GreyImage {
    pub(crate) width: usize,
    /// First row in the camera's image.
    pub(crate) top: usize,
    /// Grey levels, row by row.
    pub(crate) light: Vec<f32>,
}

impl GreyImage {
    /// Mean over the first images from a view, from the row `top` down. Images that are not `is_usual`, in the order of the video, are
    /// skipped if others are usual; images past the end of the list are used.
    pub(crate) fn of_view(
        scenario: &OpenScenario,
        view: &str,
        top: usize,
        [width, height]: [u32; 2],
        is_usual: &[bool],
    ) -> Result<Self> {
        let mut reader = scenario.open_video(view)?;
        let fault = |fault: String| {
            let path = scenario.folder().root().join(format!("views/{view}"));
            dataset::Error::corpus(&path, fault)
        };
        if (reader.width(), reader.height()) != (width, height) {
            let (found_wide, found_high) = (reader.width(), reader.height());
            return Err(fault(format!(
                "has images of {found_wide}x{found_high}, expected {width}x{height} as planned"
            ))
            .into());
        }
        let part = PicturePart {
            left_px: 0,
            top_px: top as u32,
            width_px: width,
            height_px: height - top as u32,
        };
        let mut light = vec![0.0; part.width_px as usize * part.height_px as usize];
        let mut rgb = Vec::new();
        let mut count = 0;
        let any = is_usual.iter().any(|usual| *usual);
        let mut used = is_usual.iter().map(|usual| *usual || !any);
        while count < PICTURES && reader.skip_frame()?.is_some() {
            if !used.next().unwrap_or(true) {
                continue;
            }
            reader.convert_part(part, &mut rgb)?;
            for (sum, pixel) in light.iter_mut().zip(rgb.chunks_exact(3)) {
                *sum +=
                    (f32::from(pixel[0]) + 2.0 * f32::from(pixel[1]) + f32::from(pixel[2])) / 4.0;
            }
            count += 1;
        }
        if count == 0 {
            return Err(fault("has no image".into()).into());
        }
        light.iter_mut().for_each(|sum| *sum /= count as f32);
        Ok(Self {
            width: width as usize,
            top,
            light,
        })
    }

    pub(crate) fn rows(&self) -> usize {
        self.light.len() / self.width
    }

    /// Image with each pixel computed from row and column.
    fn map(&self, light: impl Fn(usize, usize) -> f32) -> Self {
        let places =
            (0..self.rows()).flat_map(|row| (0..self.width).map(move |column| (row, column)));
        Self {
            light: places.map(|(row, column)| light(row, column)).collect(),
            ..*self
        }
    }

    fn at(&self, row: usize, column: usize) -> f32 {
        self.light[row * self.width + column]
    }

    /// Gaussian blur with this standard deviation, pixels.
    pub(crate) fn blurred(&self, sigma_px: f64) -> Self {
        let reach = (3.0 * sigma_px).ceil() as isize;
        let weights: Vec<f32> = (-reach..=reach)
            .map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp() as f32)
            .collect();
        let sum: f32 = weights.iter().sum();
        let clamped = |place: usize, i: usize, end: usize| {
            (place as isize + i as isize - reach).clamp(0, end as isize - 1) as usize
        };
        let along = |at: &dyn Fn(usize) -> f32| {
            let weighted = weights.iter().enumerate().map(|(i, weight)| weight * at(i));
            weighted.sum::<f32>() / sum
        };
        let across =
            self.map(|row, column| along(&|i| self.at(row, clamped(column, i, self.width))));
        across.map(|row, column| along(&|i| across.at(clamped(row, i, self.rows()), column)))
    }

    /// Gradients per pixel, right and down.
    pub(crate) fn gradients(&self) -> [Self; 2] {
        let (rows, columns) = (self.rows(), self.width);
        let half = |after: f32, before: f32| (after - before) / 2.0;
        [
            self.map(|y, x| {
                half(
                    self.at(y, (x + 1).min(columns - 1)),
                    self.at(y, x.saturating_sub(1)),
                )
            }),
            self.map(|y, x| {
                half(
                    self.at((y + 1).min(rows - 1), x),
                    self.at(y.saturating_sub(1), x),
                )
            }),
        ]
    }

    /// Interpolated grey level; the position, in the camera's image, must be at least one pixel inside.
    #[inline]
    pub(crate) fn between(&self, x_px: f64, y_px: f64) -> f64 {
        let y = y_px - self.top as f64;
        let (column, row) = (x_px as usize, y as usize);
        let (u, v) = (x_px - column as f64, y - row as f64);
        let pair = |place: usize| {
            let [left, right] = [self.light[place], self.light[place + 1]].map(f64::from);
            left + u * (right - left)
        };
        let above = pair(row * self.width + column);
        above + v * (pair((row + 1) * self.width + column) - above)
    }

    /// True if a rectangle in the camera's image is at least two pixels inside.
    pub(crate) fn contains(&self, [left, top, right, bottom]: [f64; 4]) -> bool {
        let last_row = (self.top + self.rows()) as f64 - 3.0;
        left >= 2.0
            && right <= self.width as f64 - 3.0
            && top >= self.top as f64 + 2.0
            && bottom <= last_row
    }
}
