//! Images and boxes for the tests.

use dataset::corpus::detections::Detection;
use dataset::tables::pixel_box::{PixelBox, TruthBox};

use crate::outcome::picture::Picture;
use dataset::conditions::sight::Sight;

pub(crate) fn at(cx_px: f64) -> PixelBox {
    PixelBox {
        cx_px,
        cy_px: 100.0,
        width_px: 20.0,
        height_px: 8.0,
    }
}

/// An aircraft in plain sight, at (100, 100).
pub(crate) fn picture(tick: u32, view: usize, distance_nm: f64) -> Picture {
    Picture {
        tick,
        view,
        distance_nm,
        truth: Some(TruthBox {
            tick,
            view: ["left", "right"][view].into(),
            class: "aircraft".into(),
            pixel_box: at(100.0),
            visible_fraction: 1.0,
            truncation: 0.0,
            transmission: 0.5,
            aircraft_number: None,
            occluded_fraction: None,
        }),
        others: Vec::new(),
        sight: Sight::Open,
    }
}

pub(crate) fn seen(tick: u32, view: &str, cx_px: f64, score: f64) -> Detection {
    Detection::untracked(tick, view, at(cx_px), score, 0)
}
