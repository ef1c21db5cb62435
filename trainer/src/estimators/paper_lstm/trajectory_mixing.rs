//! Additional training samples: geometrically exact mixtures of the training trajectories.
//!
//! A handful of approaches covers the corridor with a handful of lines, and a network may invent what is between them. So two
//! training trajectories are mixed: at the same distance along the course, the new one is `part` of the way from the first to the
//! second, sideways and in height, plus a few random metres ([`Corridor`]). The detected boxes of the first are moved by exactly as
//! many pixels as the projection of the aircraft's position moves, and scaled by the change in range; the detector's errors at that
//! tick stay in them.
//!
//! This needs the calibration of the cameras, and networks that learn from mixed samples learn it with them. Mixed samples never come
//! from, and never enter, the validation or the test side.

use dataset::geometry::camera::Camera;
use dataset::geometry::geodesy::Geodetic;
use dataset::geometry::runway::RunwayCoordinates;
use dataset::tables::pixel_box::PixelBox;
use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use crate::samples::trusted_boxes::is_whole;
use crate::samples::{Observation, Sample, ScenarioSummary};

/// Position of a trajectory across the course, as a function of the distance along it.
struct Track {
    /// Along-track, cross-track, altitude above mean sea level; metres, sorted by the first.
    points: Vec<[f64; 3]>,
}

impl Track {
    fn of(samples: &[&Sample], scenario: usize) -> Self {
        let mut points: Vec<_> = samples
            .iter()
            .filter(|s| s.scenario == scenario)
            .map(|s| [s.along_track_m, s.cross_track_m, s.position.altitude_msl_m])
            .collect();
        points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Self { points }
    }

    /// Cross-track offset and altitude, interpolated; `None` outside the flown distances.
    fn at(&self, along_track_m: f64) -> Option<[f64; 2]> {
        let after = self
            .points
            .partition_point(|point| point[0] < along_track_m);
        let (a, b) = (
            self.points.get(after.checked_sub(1)?)?,
            self.points.get(after)?,
        );
        let part = (along_track_m - a[0]) / (b[0] - a[0]);
        Some([a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2])])
    }
}

/// Largest deviation of mixed samples from the flown paths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corridor {
    /// Beyond the two trajectories that are mixed, in parts of their separation.
    pub extrapolation: f64,
    /// Sideways and vertically, metres, whatever their separation. Flights that an autopilot holds on the axis are separated by
    /// less than a metre, and a corridor of some multiple of that contains no gust.
    pub deviation_m: f64,
}

impl Corridor {
    /// Draws a deviation sideways and in height. A wide one is drawn as often as a narrow one, so that most samples are near the
    /// middle, where most flights are.
    fn deviation_m(&self, random: &mut ChaCha12Rng) -> [f64; 2] {
        let widest = self.deviation_m * random.random_range(0.0..=1.0);
        [(); 2].map(|()| widest * random.random_range(-1.0..=1.0))
    }
}

/// Makes `count` mixed samples. Fewer if the trajectories hardly overlap.
pub(crate) fn mix(
    training: &[&Sample],
    scenarios: &[ScenarioSummary],
    corridor: Corridor,
    count: usize,
    random: &mut ChaCha12Rng,
) -> Vec<Sample> {
    let mut tracks: Vec<(usize, Track)> = Vec::new();
    for sample in training {
        if tracks
            .iter()
            .all(|(scenario, _)| *scenario != sample.scenario)
        {
            tracks.push((sample.scenario, Track::of(training, sample.scenario)));
        }
    }
    let mut mixed = Vec::with_capacity(count);
    // Near the ends of the flown distances some draws have no partner: these are redrawn, up to a limit.
    for _ in 0..count.saturating_mul(4) {
        if mixed.len() == count || training.is_empty() {
            break;
        }
        let sample = training[random.random_range(0..training.len())];
        let (_, own) = tracks
            .iter()
            .find(|(scenario, _)| *scenario == sample.scenario)
            .expect("every scenario has a track");
        let (_, other) = &tracks[random.random_range(0..tracks.len())];
        let part = random.random_range(-corridor.extrapolation..=1.0 + corridor.extrapolation);
        let [sideways_m, upwards_m] = corridor.deviation_m(random);
        // Half the flown spacing to either side fills the space between ticks.
        let along_track_m = sample.along_track_m + random.random_range(-0.5..0.5) * SPACING_M;
        let (Some(from), Some(to)) = (own.at(along_track_m), other.at(along_track_m)) else {
            continue;
        };
        let cross_track_m = from[0] + part * (to[0] - from[0]) + sideways_m;
        let altitude_msl_m = from[1] + part * (to[1] - from[1]) + upwards_m;
        mixed.extend(moved(
            sample,
            &scenarios[sample.scenario],
            along_track_m,
            cross_track_m,
            altitude_msl_m,
        ));
    }
    mixed
}

/// Distance flown in one second, approximately, metres: the spacing of ticks at the lowest usual frame rate.
const SPACING_M: f64 = 75.0;

/// The sample as seen from the new position; `None` if no view would see it or it is not before the target.
fn moved(
    sample: &Sample,
    scenario: &ScenarioSummary,
    along_track_m: f64,
    cross_track_m: f64,
    altitude_msl_m: f64,
) -> Option<Sample> {
    if along_track_m <= 0.0 {
        return None;
    }
    let position: Geodetic = scenario
        .runway
        .point_on_approach(along_track_m, cross_track_m)
        .at_altitude_m(altitude_msl_m);
    let boxes: Vec<_> = sample
        .boxes
        .iter()
        .zip(&scenario.cameras)
        .map(|(seen, camera)| moved_box(seen.as_ref()?, camera, sample.position, position))
        .collect();
    boxes.iter().any(Option::is_some).then(|| Sample {
        observed: Observation {
            shifts: vec![None; boxes.len()],
            boxes,
            ..sample.observed
        },
        dtd_m: RunwayCoordinates::of(
            position,
            scenario.touchdown,
            scenario.runway.course_true_deg,
        )
        .dtd_m,
        along_track_m,
        cross_track_m,
        position,
        ..*sample
    })
}

fn moved_box(seen: &PixelBox, camera: &Camera, from: Geodetic, to: Geodetic) -> Option<PixelBox> {
    let (from, to) = (from.to_ecef(), to.to_ecef());
    let shift = camera.project(to)? - camera.project(from)?;
    let growth = camera.to_camera(from).z / camera.to_camera(to).z;
    let moved = PixelBox {
        cx_px: seen.cx_px + shift.x,
        cy_px: seen.cy_px + shift.y,
        width_px: seen.width_px * growth,
        height_px: seen.height_px * growth,
    };
    is_whole(&moved, camera).then_some(moved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::{DistanceRange, Samples};
    use dataset::corpus::splits::Side;
    use rand::SeedableRng;
    use testkit::synthetic::SyntheticCorpus;

    #[test]
    fn a_mixed_sample_of_perfect_boxes_has_perfect_boxes_at_its_new_place() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus {
            centre_noise_px: 0.0,
            size_noise_px: 0.0,
            ..SyntheticCorpus::tiny()
        }
        .write(folder.path())
        .unwrap();
        let samples = Samples::read(
            &corpus,
            None,
            DistanceRange {
                min_nm: 0.05,
                max_nm: None,
            },
        )
        .unwrap();
        let training = samples.of_side(Side::Train);
        let mut random = ChaCha12Rng::seed_from_u64(1);
        let corridor = Corridor {
            extrapolation: 0.3,
            deviation_m: 10.0,
        };
        let mixed = mix(&training, &samples.scenarios, corridor, 200, &mut random);
        assert_eq!(mixed.len(), 200);
        let mut moved_sideways = 0;
        for sample in &mixed {
            let origin = training
                .iter()
                .find(|t| t.scenario == sample.scenario && t.tick == sample.tick)
                .unwrap();
            moved_sideways +=
                usize::from((origin.cross_track_m - sample.cross_track_m).abs() > 1.0);
            let cameras = &samples.scenarios[sample.scenario].cameras;
            for (seen, camera) in sample.boxes.iter().zip(cameras) {
                let Some(seen) = seen else { continue };
                let expected = testkit::synthetic::perfect_box(camera, sample.position.to_ecef());
                // These synthetic boxes are centred on the projected position, except for a part of their height.
                assert!(
                    (seen.cx_px - expected.cx_px).abs() < 1e-6,
                    "{seen:?} {expected:?}"
                );
                assert!(
                    (seen.width_px - expected.width_px).abs() < 1e-6,
                    "{seen:?} {expected:?}"
                );
            }
        }
        assert!(moved_sideways > 50, "{moved_sideways}");
    }

    #[test]
    fn flights_that_are_all_on_the_axis_are_mixed_into_a_corridor_of_the_asked_width() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
        let range = DistanceRange {
            min_nm: 0.5,
            max_nm: None,
        };
        let samples = Samples::read(&corpus, None, range).unwrap();
        // A single flight, so the separation of two trajectories is 0.
        let alone: Vec<_> = samples.samples.iter().filter(|s| s.scenario == 0).collect();
        let track = Track::of(&alone, 0);
        let farthest_m = |deviation_m: f64| {
            let corridor = Corridor {
                extrapolation: 4.0,
                deviation_m,
            };
            let mut random = ChaCha12Rng::seed_from_u64(2);
            mix(&alone, &samples.scenarios, corridor, 400, &mut random)
                .iter()
                .map(|s| (s.cross_track_m - track.at(s.along_track_m).unwrap()[0]).abs())
                .fold(0.0, f64::max)
        };
        assert!(farthest_m(0.0) < 1e-9, "{}", farthest_m(0.0));
        let wide_m = farthest_m(30.0);
        assert!((20.0..=30.0).contains(&wide_m), "{wide_m}");
    }

    #[test]
    fn a_track_is_interpolated_inside_and_unknown_outside() {
        let track = Track {
            points: vec![[100.0, 0.0, 10.0], [200.0, 4.0, 20.0]],
        };
        assert_eq!(track.at(150.0), Some([2.0, 15.0]));
        assert_eq!(track.at(99.0), None);
        assert_eq!(track.at(201.0), None);
    }
}
