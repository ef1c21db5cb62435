//! Corpora whose `calibration.json` is wrong.

use dataset::corpus::Corpus;
use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::seal::seal_folder;
use dataset::error::Result;
use dataset::geometry::pose::Pose;

/// One degree of latitude, metres.
const DEGREE_M: f64 = 111_200.0;

/// Differences of all stated cameras from the true ones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Miscalibration {
    /// Turn to the right, degrees.
    pub yaw_deg: f64,
    /// Turn upwards, degrees.
    pub pitch_deg: f64,
    /// Turn about the optical axis, degrees.
    pub roll_deg: f64,
    /// Increase of the focal length, percent.
    pub focal_pct: f64,
    /// Move to the north, metres.
    pub north_m: f64,
}

impl Miscalibration {
    /// Makes the calibration of every scenario wrong by this, and seals the scenarios again. Videos, boxes and labels stay.
    pub fn apply(&self, corpus: &Corpus) -> Result<()> {
        self.apply_to(corpus, |_| true)
    }

    /// Applies the errors to some of the views.
    pub fn apply_to(&self, corpus: &Corpus, is_wrong: impl Fn(&str) -> bool) -> Result<()> {
        for folder in corpus.scenarios()? {
            let scenario = folder.open()?;
            let mut calibration = scenario.calibration()?;
            for (view, entry) in &mut calibration.cameras {
                if is_wrong(view) {
                    *entry = self.of(entry);
                }
            }
            let config_hash = scenario.seal().config_hash.clone();
            calibration.write(&folder.calibration_path())?;
            seal_folder(folder.root(), &config_hash)?;
        }
        Ok(())
    }

    fn of(&self, entry: &CameraEntry) -> CameraEntry {
        let mut placed = entry.placed;
        let Pose {
            latitude_deg,
            heading_true_deg,
            pitch_deg,
            roll_deg,
            ..
        } = &mut placed.pose;
        *latitude_deg += self.north_m / DEGREE_M;
        *heading_true_deg = (*heading_true_deg + self.yaw_deg).rem_euclid(360.0);
        *pitch_deg += self.pitch_deg;
        *roll_deg += self.roll_deg;
        let half = (placed.hfov_deg.to_radians() / 2.0).tan() / (1.0 + self.focal_pct / 100.0);
        placed.hfov_deg = 2.0 * half.atan().to_degrees();
        CameraEntry::from_pose(placed, entry.width_px, entry.height_px)
            .with_imaging(&entry.imaging())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::SyntheticCorpus;

    #[test]
    fn every_camera_is_wrong_by_as_much_and_the_corpus_is_still_whole() {
        let folder = tempfile::tempdir().unwrap();
        let corpus = SyntheticCorpus::tiny().write(folder.path()).unwrap();
        let cameras = || {
            let scenarios = corpus.scenarios().unwrap();
            let of = scenarios
                .iter()
                .map(|s| s.open().unwrap().calibration().unwrap().cameras);
            of.flat_map(|cameras| cameras.into_values().map(|entry| entry.camera()))
                .collect::<Vec<_>>()
        };
        let before = cameras();
        let wrong = Miscalibration {
            yaw_deg: 0.5,
            focal_pct: 3.0,
            north_m: 5.0,
            ..Miscalibration::default()
        };
        wrong.apply(&corpus).unwrap();
        for (before, after) in before.iter().zip(cameras()) {
            assert!((after.focal_px / before.focal_px - 1.03).abs() < 1e-9);
            let moved_m = after.center_ecef_m.distance(before.center_ecef_m);
            assert!((moved_m - 5.0).abs() < 0.05, "{moved_m}");
            let [old, new] = [before, &after].map(|camera| camera.ecef_from_camera.z_axis);
            let turned_deg = old.angle_between(new).to_degrees();
            assert!((turned_deg - 0.5).abs() < 0.001, "{turned_deg}");
        }
    }
}
