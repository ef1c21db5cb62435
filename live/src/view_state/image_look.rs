//! Image properties that need no search: darkness, and the change since the previous image.

use dataset::video::Luma;

/// Sampling steps of rows and columns.
const ROW_STEP: usize = 32;
const COLUMN_STEP: usize = 3;
/// Maximum level and maximum spread of a dark image, without one pixel in a thousand.
const DARK_LEVEL: usize = 40;
const DARK_SPREAD: usize = 6;
const IGNORED_PART: f64 = 0.001;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ImageLook {
    /// Black, or evenly grey like it.
    pub(crate) is_dark: bool,
    /// Mean difference to the image before, grey levels; `None` for the first one.
    pub(crate) change_levels: Option<f64>,
}

/// Measures a view's images one after the other.
#[derive(Debug, Default)]
pub(crate) struct Looks {
    before: Vec<u8>,
    now: Vec<u8>,
}

impl Looks {
    /// Looks at the next image; `None` for pixels that it cannot read.
    pub(crate) fn next(&mut self, image: Option<Luma<'_>>) -> Option<ImageLook> {
        let image = image?;
        std::mem::swap(&mut self.before, &mut self.now);
        self.now.clear();
        for row in (ROW_STEP / 2..image.height_px).step_by(ROW_STEP) {
            self.now.extend(image.row(row).iter().step_by(COLUMN_STEP));
        }
        let is_same_size = self.before.len() == self.now.len() && !self.now.is_empty();
        let change = || {
            let pairs = self.before.iter().zip(&self.now);
            let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
            sum as f64 / self.now.len() as f64
        };
        Some(ImageLook {
            is_dark: self.is_dark(),
            change_levels: is_same_size.then(change),
        })
    }

    fn is_dark(&self) -> bool {
        let mut counts = [0_usize; 256];
        for level in &self.now {
            counts[usize::from(*level)] += 1;
        }
        let ignored = (self.now.len() as f64 * IGNORED_PART) as usize;
        let first_of = |levels: &mut dyn Iterator<Item = usize>| {
            let mut seen = 0;
            for level in levels {
                seen += counts[level];
                if seen > ignored {
                    return Some(level);
                }
            }
            None
        };
        match (first_of(&mut (0..256)), first_of(&mut (0..256).rev())) {
            (Some(darkest), Some(brightest)) => {
                brightest <= DARK_LEVEL && brightest - darkest <= DARK_SPREAD
            }
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 640;

    fn look(looks: &mut Looks, level: impl Fn(usize) -> u8) -> ImageLook {
        let levels: Vec<u8> = (0..WIDTH * 480).map(level).collect();
        looks.next(Some(Luma::of(&levels, WIDTH))).unwrap()
    }

    #[test]
    fn a_black_image_is_dark_and_a_night_with_lamps_is_not() {
        let looks = &mut Looks::default();
        assert!(look(looks, |_| 16).is_dark);
        assert!(look(looks, |at| 14 + (at % 5) as u8).is_dark);
        let lamp = |at: usize| if at % WIDTH < 20 { 200 } else { 12 };
        assert!(!look(looks, lamp).is_dark);
        assert!(!look(looks, |_| 90).is_dark);
    }

    #[test]
    fn a_change_is_the_mean_difference_to_the_image_before() {
        let looks = &mut Looks::default();
        assert_eq!(look(looks, |_| 50).change_levels, None);
        assert_eq!(look(looks, |_| 53).change_levels, Some(3.0));
        assert_eq!(look(looks, |_| 53).change_levels, Some(0.0));
    }
}
