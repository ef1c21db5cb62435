//! Non-maximum suppression: one box per object.

use super::ScoredBox;

/// Drops every item whose box overlaps that of a better one by more than `iou`. Returns the rest, best first; equal scores keep
/// their order.
pub fn keep_best<T>(mut items: Vec<T>, iou: f64, scored: impl Fn(&T) -> ScoredBox) -> Vec<T> {
    items.sort_by(|a, b| scored(b).score.total_cmp(&scored(a).score));
    let mut kept: Vec<T> = Vec::new();
    for item in items {
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
    use super::*;
    use dataset::pixel_box::PixelBox;

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
            |item| *item,
        );
        assert_eq!(found, [scored(0.0, 0.9), scored(90.0, 0.5)]);
    }
}
