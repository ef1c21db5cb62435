//! Image sizes that fit a screen, for a sweep whose images do not.

use crate::link::PictureSize;

/// Sizes with the same shape that fit the screen: the largest, and about three quarters and half as large. Videos need even sides.
pub(super) fn sizes_that_fit(wanted: PictureSize, screen: PictureSize) -> Vec<PictureSize> {
    let (mut divisor, mut rest) = (wanted.width_px, wanted.height_px);
    while rest != 0 {
        (divisor, rest) = (rest, divisor % rest);
    }
    let (across, down) = (
        wanted.width_px / divisor.max(1),
        wanted.height_px / divisor.max(1),
    );
    if across == 0 || down == 0 {
        return Vec::new();
    }
    let most = (screen.width_px / across).min(screen.height_px / down);
    let even = |times: &u32| (across * times).is_multiple_of(2) && (down * times).is_multiple_of(2);
    let mut sizes: Vec<PictureSize> = [most, most * 3 / 4, most / 2]
        .into_iter()
        .filter_map(|most| (1..=most).rev().find(even))
        .map(|times| PictureSize {
            width_px: across * times,
            height_px: down * times,
        })
        .collect();
    sizes.dedup();
    sizes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(wanted: (u32, u32), screen: (u32, u32)) -> Vec<String> {
        let [wanted, screen] = [wanted, screen].map(|(width_px, height_px)| PictureSize {
            width_px,
            height_px,
        });
        let fitting = sizes_that_fit(wanted, screen);
        fitting.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn sizes_have_the_shape_of_the_pictures_and_even_sides() {
        assert_eq!(
            sizes((1_920, 1_280), (1_366, 768)),
            ["1152x768", "864x576", "576x384"]
        );
        assert_eq!(
            sizes((1_920, 1_080), (1_366, 768)),
            ["1344x756", "992x558", "672x378"]
        );
        // A shape that no smaller size has.
        assert_eq!(sizes((1_921, 1_279), (1_366, 768)), [""; 0]);
    }
}
