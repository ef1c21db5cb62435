//! Copies of one scenario as several people have them: recorded once, labelled by some, recorded again by another.

use std::fs;

use dataset::corpus::seal::{Seal, seal_folder};
use dataset::corpus::{Corpus, ScenarioFolder};
use tempfile::TempDir;

use super::ID;

/// A copy of the scenario in a corpus of its own.
pub(super) struct LocalCopy {
    _folder: TempDir,
    pub(super) corpus: Corpus,
    pub(super) seal: Seal,
    /// Number of the recording.
    pub(super) recording: u32,
    pub(super) is_labelled: bool,
}

impl LocalCopy {
    /// A copy of a recording, labelled with an offset or not.
    pub(super) fn new(recording: u32, label: Option<f64>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(folder.path()).unwrap();
        let root = corpus.scenario(ID).root().to_owned();
        fs::create_dir_all(root.join("views")).unwrap();
        fs::write(root.join("views/left.mp4"), format!("video {recording}")).unwrap();
        let frames = format!("poses {recording}, labels {label:?}");
        fs::write(root.join(ScenarioFolder::FRAMES), frames).unwrap();
        if let Some(label) = label {
            let boxes = root.join(ScenarioFolder::TRUTH_BOXES);
            fs::write(boxes, format!("boxes {label}")).unwrap();
        }
        let seal = seal_folder(&root, "config").unwrap();
        Self {
            _folder: folder,
            corpus,
            seal,
            recording,
            is_labelled: label.is_some(),
        }
    }

    /// Copies of two recordings.
    pub(super) fn some() -> [Self; 4] {
        [(1, None), (1, Some(1.0)), (1, Some(2.0)), (2, None)]
            .map(|(recording, label)| Self::new(recording, label))
    }

    pub(super) fn folder(&self) -> ScenarioFolder {
        self.corpus.scenario(ID)
    }
}
