//! Plausibility check for boxes. Numbers that are read in the wrong unit or order give boxes below a pixel, or outside the window,
//! and nothing else would show it.

use std::sync::Once;

use super::ScoredBox;

/// The boxes that a model found in its windows.
#[derive(Debug, Default)]
pub(super) struct Plausibility {
    plausible: u64,
    implausible: u64,
}

impl Plausibility {
    pub(super) fn add(&mut self, boxes: &[ScoredBox], [width_px, height_px]: [u32; 2]) {
        for ScoredBox { pixel_box, .. } in boxes {
            let is_inside = (-0.5..f64::from(width_px)).contains(&pixel_box.cx_px)
                && (-0.5..f64::from(height_px)).contains(&pixel_box.cy_px);
            if is_inside && pixel_box.width_px.max(pixel_box.height_px) >= 1.0 {
                self.plausible += 1;
            } else {
                self.implausible += 1;
            }
        }
    }

    fn is_doubtful(&self) -> bool {
        self.implausible > 0 && self.plausible == 0
    }
}

impl Drop for Plausibility {
    fn drop(&mut self) {
        // Once, not by every worker.
        static WARNED: Once = Once::new();
        if self.is_doubtful() {
            WARNED.call_once(|| {
                tracing::warn!(
                    "all {} boxes of the model are smaller than a pixel or outside its window: its output is probably read in another form \
                     or unit than it has; say layout, box_form or box_unit in the model's settings (docs/detectors.md)",
                    self.implausible
                );
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use dataset::tables::pixel_box::PixelBox;

    use super::*;

    #[test]
    fn only_a_model_without_any_box_of_a_pixel_in_its_window_is_doubtful() {
        let found = |cx_px: f64, width_px: f64| ScoredBox {
            pixel_box: PixelBox {
                cx_px,
                cy_px: 10.0,
                width_px,
                height_px: 0.2,
            },
            score: 0.9,
        };
        let mut seen = Plausibility::default();
        assert!(!seen.is_doubtful());
        seen.add(&[found(0.1, 0.06), found(900.0, 20.0)], [640, 640]);
        assert!(seen.is_doubtful());
        seen.add(&[found(100.0, 1.5)], [640, 640]);
        assert!(!seen.is_doubtful());
    }
}
