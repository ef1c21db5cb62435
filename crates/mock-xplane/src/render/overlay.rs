//! Overlays between the scene and the eye: a cockpit's panel, a pop-up window. Drawn so that they cannot be mistaken for anything
//! else.

/// An image to draw on.
#[derive(Debug)]
pub(crate) struct Canvas<'a> {
    /// Rows from the top, red, green, blue.
    pub rgb: &'a mut [u8],
    /// Pixels across.
    pub width_px: usize,
    /// Pixels down.
    pub height_px: usize,
}

/// A rectangle: left, top, right, bottom.
type Area = [f64; 4];

const PANEL: [u8; 3] = [38, 36, 34];
const FRAME: [u8; 3] = [24, 23, 22];
const RIM: [u8; 3] = [150, 150, 146];
const DIAL: [u8; 3] = [8, 8, 8];
const NEEDLE: [u8; 3] = [240, 240, 236];
const WINDOW: [u8; 3] = [230, 232, 235];
const TITLE: [u8; 3] = [22, 92, 190];
const TEXT: [u8; 3] = [60, 62, 66];
const ALERT: [u8; 3] = [150, 24, 24];
const MESSAGE: [u8; 3] = [18, 18, 22];
const TERMINAL: [u8; 3] = [120, 230, 120];

impl Canvas<'_> {
    /// The pilot's panel over the lower half, with instruments, and the frame of the windows.
    pub(crate) fn draw_panel(&mut self) {
        self.fill([0.0, 0.52, 1.0, 1.0], PANEL);
        self.fill([0.0, 0.0, 0.06, 1.0], FRAME);
        self.fill([0.94, 0.0, 1.0, 1.0], FRAME);
        self.fill([0.485, 0.0, 0.515, 0.52], FRAME);
        self.fill([0.0, 0.0, 1.0, 0.08], FRAME);
        for row in [0.64, 0.86] {
            for column in [0.16, 0.33, 0.50, 0.67, 0.84] {
                self.disc(column, row, 0.095, RIM);
                self.disc(column, row, 0.085, DIAL);
                self.fill(
                    [column - 0.004, row - 0.07, column + 0.004, row + 0.01],
                    NEEDLE,
                );
            }
        }
    }

    /// Makes an area brighter, its edges in proportion to the part of each pixel that it covers. Left, top, right, bottom in pixels.
    pub(crate) fn brighten_px(&mut self, [left, top, right, bottom]: Area, levels: f64) {
        let share = |pixel: usize, from: f64, to: f64| {
            let pixel = pixel as f64;
            (to.min(pixel + 1.0) - from.max(pixel)).clamp(0.0, 1.0)
        };
        for row in top.max(0.0) as usize..(bottom.ceil().max(0.0) as usize).min(self.height_px) {
            for column in
                left.max(0.0) as usize..(right.ceil().max(0.0) as usize).min(self.width_px)
            {
                let more = levels * share(row, top, bottom) * share(column, left, right);
                let first = (row * self.width_px + column) * 3;
                for value in &mut self.rgb[first..first + 3] {
                    *value = (f64::from(*value) + more).round().min(255.0) as u8;
                }
            }
        }
    }

    /// A window with a title and lines of text over the middle.
    pub(crate) fn draw_pop_up(&mut self) {
        self.fill([0.30, 0.22, 0.70, 0.70], WINDOW);
        self.fill([0.30, 0.22, 0.70, 0.28], TITLE);
        for line in 0..6 {
            let top = 0.34 + 0.055 * f64::from(line);
            self.fill([0.34, top, 0.62, top + 0.018], TEXT);
        }
    }

    /// X-Plane's error about a plugin, at the top: a red box with lines of text.
    pub(crate) fn draw_alert(&mut self) {
        self.fill([0.30, 0.03, 0.70, 0.15], ALERT);
        for line in 0..3 {
            let top = 0.05 + 0.03 * f64::from(line);
            self.fill([0.32, top, 0.64, top + 0.012], NEEDLE);
        }
    }

    /// X-Plane's message: an opaque box with lines of text. The area is left, top, right, bottom in pixels.
    pub(crate) fn draw_message(&mut self, area_px: [u32; 4]) {
        let area = area_px.map(f64::from);
        self.fill_px(area, MESSAGE);
        self.write_lines(area, NEEDLE);
    }

    /// A plugin's window: half transparent, with a frame and lines of text.
    pub(crate) fn draw_plugin_window(&mut self, area_px: [u32; 4]) {
        let [left, top, right, bottom] = area_px.map(|edge| edge as usize);
        for row in top..bottom.min(self.height_px) {
            for column in left..right.min(self.width_px) {
                let is_frame =
                    row < top + 2 || row + 2 >= bottom || column < left + 2 || column + 2 >= right;
                self.blend(column, row, if is_frame { RIM } else { PANEL });
            }
        }
        self.write_lines(area_px.map(f64::from), TERMINAL);
    }

    fn write_lines(&mut self, [left, top, right, bottom]: Area, colour: [u8; 3]) {
        let mut line = top + 5.0;
        while line + 3.0 < bottom {
            let mut letter = left + 6.0;
            while letter + 6.0 < right {
                self.fill_px([letter, line, letter + 3.0, line + 1.0], colour);
                letter += 5.0;
            }
            line += 6.0;
        }
    }

    /// Draws a pixel that is somewhat transparent.
    fn blend(&mut self, column: usize, row: usize, colour: [u8; 3]) {
        let at = 3 * (row * self.width_px + column);
        if let Some(pixel) = self.rgb.get_mut(at..at + 3) {
            for (value, wanted) in pixel.iter_mut().zip(colour) {
                *value = ((u16::from(*value) * 2 + u16::from(wanted) * 3) / 5) as u8;
            }
        }
    }

    /// Fills a rectangle given in shares of the image.
    fn fill(&mut self, [left, top, right, bottom]: Area, colour: [u8; 3]) {
        let (width, height) = (self.width_px as f64, self.height_px as f64);
        let area = [left * width, top * height, right * width, bottom * height];
        self.fill_px(area, colour);
    }

    /// Fills a rectangle: left, top, right, bottom in pixels.
    pub(crate) fn fill_px(&mut self, area: Area, colour: [u8; 3]) {
        let [left, top, right, bottom] = area.map(|edge| edge.round().max(0.0) as usize);
        let (from, to) = (left, right.min(self.width_px));
        for row in top..bottom.min(self.height_px) {
            for column in from..to {
                self.set(column, row, colour);
            }
        }
    }

    /// Round in pixels; the radius is a share of the height.
    fn disc(&mut self, x: f64, y: f64, radius: f64, colour: [u8; 3]) {
        let (x, y) = (x * self.width_px as f64, y * self.height_px as f64);
        let radius = radius * self.height_px as f64;
        for row in 0..self.height_px {
            for column in 0..self.width_px {
                let away = (column as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y);
                if away < radius {
                    self.set(column, row, colour);
                }
            }
        }
    }

    fn set(&mut self, column: usize, row: usize, colour: [u8; 3]) {
        let at = 3 * (row * self.width_px + column);
        if let Some(pixel) = self.rgb.get_mut(at..at + 3) {
            pixel.copy_from_slice(&colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (96, 64);

    fn covered(draw: impl Fn(&mut Canvas<'_>)) -> f64 {
        let sky = [120, 160, 220];
        let mut rgb = sky.repeat(SIZE.0 * SIZE.1);
        draw(&mut Canvas {
            rgb: &mut rgb,
            width_px: SIZE.0,
            height_px: SIZE.1,
        });
        let changed = rgb.chunks_exact(3).filter(|pixel| *pixel != sky);
        changed.count() as f64 / (SIZE.0 * SIZE.1) as f64
    }

    #[test]
    fn panels_pop_ups_alerts_and_windows_cover_their_areas() {
        let panel = covered(|canvas| canvas.draw_panel());
        let pop_up = covered(|canvas| canvas.draw_pop_up());
        let alert = covered(|canvas| canvas.draw_alert());
        assert!((0.5..0.75).contains(&panel), "{panel}");
        assert!((0.15..0.25).contains(&pop_up), "{pop_up}");
        assert!((0.04..0.06).contains(&alert), "{alert}");
        let (message, window) = (
            covered(|canvas| canvas.draw_message([10, 10, 42, 30])),
            covered(|canvas| canvas.draw_plugin_window([10, 10, 42, 30])),
        );
        let wanted = 32.0 * 20.0 / (SIZE.0 * SIZE.1) as f64;
        assert_eq!((message, window), (wanted, wanted));
    }
}
