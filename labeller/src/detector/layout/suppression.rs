//! Non-maximum suppression: one box per object.
//!
//! Each box is compared only with the few that are kept, so clutter costs a sort.

use crate::detector::ScoredBox;

/// Non-maximum suppression: the best items, at most `most`, that overlap no better item by more than `iou`. Best first; equal scores keep
/// their order.
///
/// Takes time proportional to `items.len() * most`, since each item is compared only with those that are kept.
pub fn keep_best<T>(
    mut items: Vec<T>,
    iou: f64,
    most: usize,
    scored: impl Fn(&T) -> ScoredBox,
) -> Vec<T> {
    items.sort_by(|a, b| scored(b).score.total_cmp(&scored(a).score));
    let mut kept: Vec<T> = Vec::new();
    for item in items {
        if kept.len() >= most {
            break;
        }
        let candidate = scored(&item).pixel_box;
        if kept
            .iter()
            .all(|better| scored(better).pixel_box.iou(&candidate) <= iou)
        {
            kept.push(item);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use dataset::tables::pixel_box::PixelBox;

    fn scored(cx_px: f64, score: f64) -> ScoredBox {
        ScoredBox {
            pixel_box: PixelBox {
                cx_px,
                cy_px: 0.0,
                width_px: 10.0,
                height_px: 4.0,
            },
            score,
        }
    }

    #[test]
    fn the_best_of_overlapping_boxes_is_kept_and_a_distant_one_too() {
        let found = keep_best(
            vec![scored(1.0, 0.6), scored(90.0, 0.5), scored(0.0, 0.9)],
            0.5,
            9,
            |item| *item,
        );
        assert_eq!(found, [scored(0.0, 0.9), scored(90.0, 0.5)]);
    }

    #[test]
    fn a_hundred_thousand_boxes_are_compared_with_the_few_that_are_kept_and_not_with_each_other() {
        const BOXES: usize = 100_000;
        const MAX_COUNT: usize = 6;
        let apart = (0..BOXES).map(|k| scored(20.0 * k as f64, 0.5)).collect();
        let on_each_other = (0..BOXES).map(|k| scored(1e-6 * k as f64, 0.5)).collect();
        for (items, kept) in [(apart, MAX_COUNT), (on_each_other, 1)] {
            let looks = Cell::new(0_usize);
            let found = keep_best(items, 0.3, MAX_COUNT, |item: &ScoredBox| {
                looks.set(looks.get() + 1);
                *item
            });
            assert_eq!(found.len(), kept);
            // Sorting makes about two comparisons for each of n log n pairs.
            let sorting = 2 * BOXES * BOXES.ilog2() as usize;
            let bound = sorting + BOXES * (MAX_COUNT + 1);
            assert!(
                looks.get() <= bound,
                "{} looks, {bound} expected",
                looks.get()
            );
        }
    }
}
