//! WebDataset: shards that are read from end to end, tar archives with a sample per tick: an image per view and what is known of them.
//!
//! ```text
//! <split>-000000.tar
//!   <scenario>_<tick>.<view>.png
//!   <scenario>_<tick>.json
//! ```
//!
//! With whole images, a shard holds ticks of one scenario, up to a number of bytes and samples, so that scenarios can be written side by
//! side. With crops ([`crops`]), it holds ticks of all scenarios of a side.

mod archive;
pub(super) mod crops;
mod mixed_shards;
mod samples;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use dataset::corpus::calibration::CameraEntry;
use serde::Serialize;
use serde_json::Value;

use self::samples::{LabelledCorners, each_sample};
use crate::about::split_of;
use crate::error::Result;
use crate::file_format::{FileFormat, Writing, Written};
use crate::request::Abilities;

/// A shard is closed before the sample that would make it larger than this; readers want some hundred megabytes at a time.
const MAX_BYTES: u64 = 1_000_000_000;
/// Shards of scenarios, before they are numbered.
const UNNUMBERED: &str = "unnumbered";

#[derive(Serialize)]
struct View<'a> {
    boxes: Vec<LabelledCorners>,
    calibration: &'a CameraEntry,
}

/// The format, with whole images.
pub(super) struct WebDataset;

impl FileFormat for WebDataset {
    fn abilities(&self) -> Abilities {
        Abilities {
            has_shards: true,
            ..Abilities::of_stills("webdataset")
        }
    }

    /// Writes the shards; the record is their number.
    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let parent = scenario.folder.join(UNNUMBERED);
        fs::create_dir_all(&parent).map_err(dataset::Error::io("create", &parent))?;
        let source = &scenario.source;
        let scenarios = scenario.export.scenarios.iter();
        let same_split = scenarios
            .filter(|other| split_of(other.selected.side) == split_of(source.selected.side));
        let least = scenario.export.request.shards();
        let of_scenario = least.div_ceil(same_split.count().max(1) as u32);
        let samples = source.rows().filter(|row| source.has_sample(row.tick));
        let samples = samples.count() as u32;
        let mut shards = Shards {
            most_samples: (samples / of_scenario).max(1),
            ..Shards::new(parent, &source.record.id, MAX_BYTES)
        };
        let path = shards.path();
        let show = |view: &str, tick, _: &mut _| {
            let boxes = source.boxes_of(view, tick).iter();
            let boxes = boxes.map(|labelled| LabelledCorners::within([0, 0], labelled));
            Ok(View {
                boxes: boxes.collect(),
                calibration: source.view(view)?.1,
            })
        };
        let append = |_, entries: Vec<u8>| shards.append(&entries);
        each_sample(scenario, &path, show, append)?;
        scenario.part(&shards.finish()?)
    }

    /// Numbers all shards. A kill may have left some of them numbered.
    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let folder = written.folder();
        let parent = folder.join(UNNUMBERED);
        let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
        for (scenario, shards) in written.export.scenarios.iter().zip(written.parts::<u32>()) {
            let split = split_of(scenario.selected.side);
            for shard in 0..shards? {
                let number = numbers.entry(split).or_default();
                let name = shard_name(split, *number);
                *number += 1;
                let from = shard_path(&parent, &scenario.selected.id(), shard);
                let to = folder.join(name);
                if !to.exists() {
                    fs::rename(&from, &to).map_err(dataset::Error::io("rename", &from))?;
                }
            }
        }
        if parent.exists() {
            fs::remove_dir(&parent).map_err(dataset::Error::io("remove", &parent))?;
        }
        Ok(())
    }
}

fn shard_name(split: &str, number: u32) -> String {
    format!("{split}-{number:06}.tar")
}

fn shard_path(folder: &Path, scenario: &str, number: u32) -> PathBuf {
    folder.join(format!("{scenario}-{number:06}.tar"))
}

/// A scenario's shards while they are written.
struct Shards<'a> {
    folder: PathBuf,
    scenario: &'a str,
    most_bytes: u64,
    most_samples: u32,
    begun: u32,
    /// The shard that is written, its bytes and samples.
    open: Option<(BufWriter<File>, u64, u32)>,
}

impl<'a> Shards<'a> {
    fn new(folder: PathBuf, scenario: &'a str, most_bytes: u64) -> Self {
        Self {
            folder,
            scenario,
            most_bytes,
            most_samples: u32::MAX,
            begun: 0,
            open: None,
        }
    }

    /// The shard that is written, or would be next.
    fn path(&self) -> PathBuf {
        let number = match self.open {
            Some(_) => self.begun - 1,
            None => self.begun,
        };
        shard_path(&self.folder, self.scenario, number)
    }

    /// Adds a sample's entries, which stay together.
    fn append(&mut self, entries: &[u8]) -> Result<()> {
        let added = entries.len() as u64;
        if let Some((_, written, samples)) = &self.open
            && (*samples >= self.most_samples || !archive::fits(*written, added, self.most_bytes))
        {
            self.close()?;
        }
        if self.open.is_none() {
            let path = self.path();
            let file = File::create(&path).map_err(dataset::Error::io("create", &path))?;
            self.open = Some((BufWriter::new(file), 0, 0));
            self.begun += 1;
        }
        let path = self.path();
        if let Some((file, written, samples)) = &mut self.open {
            let appended = file.write_all(entries);
            appended.map_err(dataset::Error::io("write", &path))?;
            *written += added;
            *samples += 1;
        }
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        let path = self.path();
        if let Some((mut file, ..)) = self.open.take() {
            let ended = file.write_all(&archive::END).and_then(|()| file.flush());
            ended.map_err(dataset::Error::io("write", &path))?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<u32> {
        self.close()?;
        Ok(self.begun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_stays_together_and_no_shard_is_larger_than_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let most_bytes = 8 * 512;
        let mut shards = Shards::new(folder.path().to_owned(), "a", most_bytes);
        for tick in 0..5 {
            let files = [
                ("left.png".to_owned(), vec![tick; 100]),
                ("json".to_owned(), vec![0; 513]),
            ];
            let entries = archive::entries(&format!("a_{tick}"), &files).unwrap();
            shards.append(&entries).unwrap();
        }
        assert_eq!(shards.finish().unwrap(), 5, "five blocks each: one fits");
        for number in 0..5 {
            let path = shard_path(folder.path(), "a", number);
            assert!(fs::metadata(&path).unwrap().len() <= most_bytes);
            let mut archive = tar::Archive::new(File::open(&path).unwrap());
            let names: Vec<_> = archive
                .entries()
                .unwrap()
                .map(|entry| entry.unwrap().path().unwrap().into_owned())
                .collect();
            let key = format!("a_{number}");
            let expected = [format!("{key}.left.png"), format!("{key}.json")];
            assert_eq!(names, expected.map(PathBuf::from));
        }
    }
}
