//! Copies of one scenario as several people have them: recorded once, labelled by some, recorded again by another.

use std::fs::{self, File};
use std::time::{Duration, SystemTime};

use dataset::corpus::seal::{DONE, Seal, seal_folder};
use dataset::corpus::{Corpus, ScenarioFolder};
use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::{Controls, Pose};
use dataset::tables::frames::{Frames, TickLabels, TickRow, ViewStamp};
use tempfile::TempDir;

use super::ID;

/// A copy in a separate folder.
pub(super) struct LocalCopy {
    _folder: TempDir,
    pub(super) corpus: Corpus,
    pub(super) seal: Seal,
    /// Number of the recording.
    pub(super) recording: u32,
    /// Place in the rule for copies of one recording: the greater goes first.
    pub(super) rank: u32,
}

impl LocalCopy {
    /// A copy of a recording, labelled with an offset or not, and sealed at the given time.
    pub(super) fn new(recording: u32, label: Option<f64>, sealed_s: u64, rank: u32) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let root = corpus.scenario(ID).root().to_owned();
        fs::create_dir_all(root.join("views")).unwrap();
        fs::write(root.join("views/left.mp4"), format!("video {recording}")).unwrap();
        let frames = root.join(ScenarioFolder::FRAMES);
        frames_of(recording, label).write(&frames).unwrap();
        if let Some(label) = label {
            let boxes = root.join(ScenarioFolder::TRUTH_BOXES);
            fs::write(boxes, format!("boxes {label}")).unwrap();
        }
        let seal = seal_folder(&root, "config").unwrap();
        let done = File::options().write(true).open(root.join(DONE)).unwrap();
        done.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(sealed_s))
            .unwrap();
        Self {
            _folder: folder,
            corpus,
            seal,
            recording,
            rank,
        }
    }

    /// Copies of two recordings; the unlabelled one is the newest by its clock.
    pub(super) fn some() -> [Self; 4] {
        [
            Self::new(1, None, 9_000, 0),
            Self::new(1, Some(1.0), 1_000, 1),
            Self::new(1, Some(2.0), 2_000, 2),
            Self::new(2, None, 3_000, 0),
        ]
    }

    pub(super) fn folder(&self) -> ScenarioFolder {
        self.corpus.scenario(ID)
    }
}

/// A table of one tick.
fn frames_of(recording: u32, label: Option<f64>) -> Frames {
    let pose = Pose {
        latitude_deg: 1.0 + f64::from(recording),
        longitude_deg: 103.9,
        altitude_msl_m: 700.0,
        heading_true_deg: 23.0,
        pitch_deg: 2.5,
        roll_deg: -0.5,
    };
    let stamp = ViewStamp {
        sim_frame: 0,
        pts: 0,
        echoed_pose: pose,
        echoed_camera: CameraPose {
            pose,
            hfov_deg: 10.0,
        },
    };
    let row = TickRow {
        tick: 0,
        time_ns: 0,
        pose,
        velocity_ned_mps: [60.0, 25.0, 3.5],
        true_airspeed_mps: 70.0,
        controls: Controls {
            flap_ratio: 0.75,
            gear_ratio: 1.0,
        },
        on_ground: false,
        views: vec![stamp],
        labels: label.map(|dtd_m| TickLabels {
            dtd_m,
            along_track_m: dtd_m,
            cross_track_m: 0.0,
            height_over_target_m: 700.0,
            time_to_touchdown_s: None,
        }),
    };
    Frames {
        views: vec!["left".into()],
        rows: vec![row],
    }
}
