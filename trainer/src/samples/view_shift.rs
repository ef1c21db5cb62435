//! Aircraft positions relative to a second view.
//!
//! Box errors are independent between views, and distance follows from the difference between views. Registration
//! ([`dataset::tables::registrations`]) measures this difference several times more precisely than two boxes do.

use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::Shift;
use glam::DVec2;

use crate::samples::Observation;
use crate::samples::trusted_boxes::centre_and_size;

/// Shift error beyond its stated standard deviation, px: perspective, lights seen from two sides.
pub(crate) const MIN_SD_PX: f64 = 0.05;

/// Position in a view minus position in the reference view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ViewShift {
    pub reference: usize,
    /// The point in the reference view that is followed, pixels.
    pub from_px: DVec2,
    /// Right and down, pixels.
    pub shift_px: DVec2,
    /// Standard deviation, pixels.
    pub sd_px: DVec2,
}

impl ViewShift {
    /// Variance along one axis, averaged over both, square pixels.
    pub(crate) fn variance_px2(&self) -> f64 {
        self.sd_px.length_squared() / 2.0
    }

    /// A shift of a table, by the index of its reference view.
    pub(crate) fn of(reference: usize, shift: &Shift) -> Self {
        Self {
            reference,
            from_px: DVec2::new(shift.x_px, shift.y_px),
            shift_px: DVec2::new(shift.dx_px, shift.dy_px),
            sd_px: DVec2::new(shift.sd_x_px, shift.sd_y_px),
        }
    }

    /// True if the followed point is in a box of the reference view, and its match in a box of the other one.
    pub(crate) fn joins(&self, [in_reference, in_view]: [&PixelBox; 2]) -> bool {
        let holds = |seen: &PixelBox, point_px: DVec2| {
            let (centre, size) = centre_and_size(seen);
            (point_px - centre).abs().cmple(size / 2.0).all()
        };
        holds(in_reference, self.from_px) && holds(in_view, self.from_px + self.shift_px)
    }
}

/// Image positions of the aircraft at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Places {
    /// Per view, pixels.
    pub centres_px: Vec<DVec2>,
    /// Standard deviation of position differences, root mean square over views and axes, pixels; `None` if unknown.
    pub sd_px: Option<f64>,
}

impl Places {
    /// Box centres; `None` if a view has no box.
    pub(crate) fn of_boxes(observed: &Observation, views: &[usize]) -> Option<Self> {
        let centre = |&view: &usize| Some(centre_and_size(observed.best(view)?).0);
        Some(Self {
            centres_px: views.iter().map(centre).collect::<Option<_>>()?,
            sd_px: None,
        })
    }

    /// Positions with the registered shifts between them and the mean of the box centres; `None` unless all views are registered with one
    /// view in the set.
    pub(crate) fn registered(observed: &Observation, views: &[usize]) -> Option<Self> {
        let boxes = Self::of_boxes(observed, views)?;
        let reference = views
            .iter()
            .find_map(|&view| Some(observed.shift(view)?.reference))?;
        if !views.contains(&reference) {
            return None;
        }
        let shift = |&view: &usize| {
            if view == reference {
                Some((DVec2::ZERO, None))
            } else {
                observed
                    .shift(view)
                    .filter(|shift| shift.reference == reference)
                    .map(|shift| (shift.shift_px, Some(shift.variance_px2())))
            }
        };
        let shifts: Vec<_> = views.iter().map(shift).collect::<Option<_>>()?;
        let count = views.len() as f64;
        let from_box = boxes.centres_px.iter().zip(&shifts);
        let in_reference = from_box
            .map(|(centre, (shift, _))| *centre - *shift)
            .sum::<DVec2>()
            / count;
        let variances: Vec<f64> = shifts
            .iter()
            .filter_map(|(_, variance)| *variance)
            .collect();
        Some(Self {
            centres_px: shifts
                .iter()
                .map(|(shift, _)| in_reference + *shift)
                .collect(),
            sd_px: Some((variances.iter().sum::<f64>() / variances.len() as f64).sqrt()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::Sample;
    use crate::samples::tests::fixtures::{box_at, shift_of};

    fn shift(x_px: f64, dx_px: f64) -> Shift {
        shift_of([x_px, 600.0], [dx_px, 4.0])
    }

    fn sample(shifts: Vec<Option<ViewShift>>) -> Sample {
        let boxes = vec![Some(box_at(500.0, 600.0)), Some(box_at(401.0, 603.0)), None];
        let mut sample = Sample::of_boxes(1.0, boxes);
        sample.observed.shifts = shifts;
        sample
    }

    #[test]
    fn registered_places_differ_by_the_shift_and_have_the_mean_of_the_boxes() {
        let shift = ViewShift::of(0, &shift(500.0, -100.0));
        let sample = sample(vec![None, Some(shift), None]);
        let places = Places::registered(&sample, &[0, 1]).unwrap();
        assert_eq!(
            places.centres_px,
            [DVec2::new(500.5, 599.5), DVec2::new(400.5, 603.5)]
        );
        let sd_px = places.sd_px.unwrap();
        assert!((sd_px - 0.05 / 2.0_f64.sqrt()).abs() < 1e-12, "{sd_px}");
        for views in [&[0][..], &[1], &[0, 2], &[1, 2]] {
            assert_eq!(Places::registered(&sample, views), None, "{views:?}");
        }
        let boxes = Places::of_boxes(&sample, &[0, 1]).unwrap();
        assert_eq!(boxes.centres_px[1], DVec2::new(401.0, 603.0));
        assert_eq!(Places::of_boxes(&sample, &[0, 2]), None);
    }

    #[test]
    fn a_shift_of_something_else_than_the_two_boxes_is_none() {
        let (left, right) = (box_at(500.0, 600.0), box_at(401.0, 603.0));
        let joins = |x_px, dx_px| ViewShift::of(0, &shift(x_px, dx_px)).joins([&left, &right]);
        assert!(joins(510.0, -100.0));
        assert!(!joins(560.0, -100.0), "another box");
        assert!(!joins(500.0, -160.0), "led elsewhere");
    }
}
