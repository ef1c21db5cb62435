//! The rule for two copies of a scenario with the same parameters, wherever they meet.
//!
//! 1. A whole copy goes before a damaged one. Files that the damaged copy lost and the other one has are sent first, so that the rest of
//!    the damaged copy is kept.
//! 2. Of the same recording (the same videos and poses), a labelled copy goes before an unlabelled one, whatever the clocks say.
//! 3. Of two copies that are both labelled, or both not, the one that was sealed later goes first: the time of `DONE.json` in the
//!    folder where it was made, which the store notes. At the same millisecond, the greater hash of the manifest goes first. So every
//!    order of uploads ends with the same copy.
//! 4. Another recording is a conflict: the store keeps its copy until a person decides.

use std::path::Path;
use std::time::SystemTime;

use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::SealedFile;
use dataset::tables::frames::Frames;

use super::stored_seal::unix_ms;

/// A copy as far as the rule looks at it.
pub(crate) struct SealedCopy<'a> {
    pub(crate) files: &'a [SealedFile],
    pub(crate) sealed: SystemTime,
    pub(crate) manifest_blake3: &'a str,
}

/// The copy that goes first: ours to send, or the store's, with the reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum First {
    Ours,
    TheirsIsLabelled,
    TheirsIsLater,
}

impl SealedCopy<'_> {
    fn is_labelled(&self) -> bool {
        self.hash_of(ScenarioFolder::TRUTH_BOXES).is_some()
    }

    fn hash_of(&self, name: &str) -> Option<&str> {
        let file = self.files.iter().find(|file| file.name == name)?;
        Some(&file.blake3)
    }

    /// True if both have the same videos.
    pub(crate) fn has_videos_of(&self, other: &Self) -> bool {
        let videos = |copy: &Self| {
            let videos = copy.files.iter().filter(|file| is_video(&file.name));
            let mut videos: Vec<_> = videos
                .map(|file| (file.name.clone(), file.blake3.clone()))
                .collect();
            videos.sort();
            videos
        };
        videos(self) == videos(other)
    }

    /// True if both have the same table of ticks, byte for byte.
    pub(crate) fn has_frames_of(&self, other: &Self) -> bool {
        self.hash_of(ScenarioFolder::FRAMES) == other.hash_of(ScenarioFolder::FRAMES)
    }
}

fn is_video(name: &str) -> bool {
    name.starts_with("views/")
}

/// Decides which of two whole copies of the same recording goes first.
pub(crate) fn first(ours: &SealedCopy<'_>, theirs: &SealedCopy<'_>) -> First {
    let order = |copy: &SealedCopy<'_>| (unix_ms(copy.sealed), copy.manifest_blake3.to_owned());
    match (ours.is_labelled(), theirs.is_labelled()) {
        (true, false) => First::Ours,
        (false, true) => First::TheirsIsLabelled,
        _ if order(ours) > order(theirs) => First::Ours,
        _ => First::TheirsIsLater,
    }
}

/// True if two tables of ticks are equal except for the labels. False if one cannot be read.
pub(crate) fn are_same_poses(ours: Vec<u8>, theirs: Vec<u8>) -> bool {
    let unlabelled = |table: Vec<u8>| {
        let mut frames = Frames::parse(table, Path::new(ScenarioFolder::FRAMES)).ok()?;
        for row in &mut frames.rows {
            row.labels = None;
        }
        Some(frames)
    };
    let (ours, theirs) = (unlabelled(ours), unlabelled(theirs));
    ours.is_some() && ours == theirs
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn file(name: &str, content: &str) -> SealedFile {
        SealedFile {
            name: name.into(),
            blake3: blake3::hash(content.as_bytes()).to_string(),
        }
    }

    #[test]
    fn every_order_of_two_copies_ends_with_the_same_one() {
        let plain = [
            file("views/left.mp4", "video"),
            file("frames.parquet", "poses"),
        ];
        let labelled = [
            file("views/left.mp4", "video"),
            file("frames.parquet", "poses and labels"),
            file("boxes_truth.parquet", "boxes"),
        ];
        let copy = |files, seconds, manifest_blake3| SealedCopy {
            files,
            sealed: SystemTime::UNIX_EPOCH + Duration::from_secs(seconds),
            manifest_blake3,
        };
        let copies: [SealedCopy<'_>; 5] = [
            copy(&plain[..], 50, "c"),
            copy(&plain[..], 60, "a"),
            copy(&labelled[..], 10, "b"),
            copy(&labelled[..], 20, "a"),
            copy(&labelled[..], 20, "b"),
        ];
        for (i, one) in copies.iter().enumerate() {
            for (j, other) in copies.iter().enumerate() {
                assert!(one.has_videos_of(other));
                if i != j {
                    assert_eq!(first(one, other) == First::Ours, i > j, "{i} {j}");
                }
            }
        }
    }

    #[test]
    fn tables_that_cannot_be_read_are_no_same_poses() {
        assert!(!are_same_poses(b"table".to_vec(), b"table".to_vec()));
    }
}
