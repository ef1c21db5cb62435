//! Shards in which the samples of all scenarios of a side are mixed, so that reading them in order gives a fair mix.
//!
//! ```text
//! unmixed/<scenario>     the samples of a scenario in the order of its ticks, one after the other
//! <split>-000000.tar     samples in a shuffled order
//! ```
//!
//! Scenarios are decoded side by side, each into a separate file; when all are complete, their samples are copied into shards in an order
//! that only the scenarios and their ticks determine. A shard appears under its name when it is whole, and the files of the
//! scenarios stay until all shards are there, so a mix that was interrupted goes on with the next shard.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use dataset::files::new_file::{NewFile, sync};
use dataset::work::watch::Watch;
use serde::{Deserialize, Serialize};

use super::{archive, shard_name};
use crate::error::Result;

/// Maximum shard size: about a thousand samples with two crops.
const MAX_BYTES: u64 = 100_000_000;
/// Samples of scenarios, before they are mixed.
const UNMIXED: &str = "unmixed";

/// A sample's place in its scenario's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(in crate::formats) struct Stored {
    tick: u32,
    bytes: u64,
}

/// A scenario's file while it is written.
pub(super) struct Unmixed {
    path: PathBuf,
    file: BufWriter<File>,
    stored: Vec<Stored>,
}

impl Unmixed {
    pub(super) fn create(folder: &Path, scenario: &str) -> Result<Self> {
        let parent = folder.join(UNMIXED);
        fs::create_dir_all(&parent).map_err(dataset::Error::io("create", &parent))?;
        let path = parent.join(scenario);
        let file = File::create(&path).map_err(dataset::Error::io("create", &path))?;
        Ok(Self {
            path,
            file: BufWriter::new(file),
            stored: Vec::new(),
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a sample.
    pub(super) fn append(&mut self, tick: u32, entries: &[u8]) -> Result<()> {
        let written = self.file.write_all(entries);
        written.map_err(dataset::Error::io("write", &self.path))?;
        self.stored.push(Stored {
            tick,
            bytes: entries.len() as u64,
        });
        Ok(())
    }

    /// Returns the samples once they are on disk.
    pub(super) fn finish(mut self) -> Result<Vec<Stored>> {
        let flushed = self.file.flush();
        flushed.map_err(dataset::Error::io("write", &self.path))?;
        sync(&self.path)?;
        Ok(self.stored)
    }
}

/// A sample on its way into a shard. Ordered by its key.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    /// Pseudo-random, from scenario and tick.
    key: u64,
    /// Number of the scenario.
    scenario: usize,
    /// Offset in the scenario's file.
    offset: u64,
    bytes: u64,
}

/// Copies the samples of all scenarios, which are given with their split and their stored samples, into shards: at least `least_shards` for
/// each split that has as many samples.
pub(super) fn mix(
    folder: &Path,
    least_shards: u32,
    scenarios: impl Iterator<Item = Result<(String, &'static str, Vec<Stored>)>>,
    watch: &dyn Watch,
) -> Result<()> {
    let unmixed = folder.join(UNMIXED);
    let mut files = Vec::new();
    let mut splits: BTreeMap<&str, Vec<Entry>> = BTreeMap::new();
    for scenario in scenarios {
        let (id, split, stored) = scenario?;
        let mut offset = 0;
        for Stored { tick, bytes } in stored {
            splits.entry(split).or_default().push(Entry {
                key: key(&id, tick),
                scenario: files.len(),
                offset,
                bytes,
            });
            offset += bytes;
        }
        files.push(unmixed.join(id));
    }
    for (split, mut entries) in splits {
        entries.sort();
        let bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
        let share = bytes / u64::from(least_shards) + archive::END.len() as u64;
        for (number, range) in (0..).zip(shards(&entries, share.min(MAX_BYTES))) {
            watch.check()?;
            let path = folder.join(shard_name(split, number));
            if !path.exists() {
                write_shard(&path, &entries[range], &files)?;
            }
        }
    }
    if unmixed.exists() {
        fs::remove_dir_all(&unmixed).map_err(dataset::Error::io("remove", &unmixed))?;
    }
    Ok(())
}

/// The samples of each shard.
fn shards(entries: &[Entry], most_bytes: u64) -> Vec<Range<usize>> {
    let mut ranges = Vec::new();
    let (mut start, mut written) = (0, 0);
    for (at, entry) in entries.iter().enumerate() {
        if at > start && !archive::fits(written, entry.bytes, most_bytes) {
            ranges.push(start..at);
            (start, written) = (at, 0);
        }
        written += entry.bytes;
    }
    if start < entries.len() {
        ranges.push(start..entries.len());
    }
    ranges
}

fn write_shard(path: &Path, entries: &[Entry], files: &[PathBuf]) -> Result<()> {
    let mut shard = NewFile::create(path)?;
    {
        let mut to = BufWriter::new(&mut shard);
        for entry in entries {
            let from = &files[entry.scenario];
            copy(from, entry, &mut to)?.map_err(dataset::Error::io("write", path))?;
        }
        let ended = to.write_all(&archive::END).and_then(|()| to.flush());
        ended.map_err(dataset::Error::io("write", path))?;
    }
    Ok(shard.commit()?)
}

/// Copies a sample. The inner result is the write's.
fn copy(from: &Path, entry: &Entry, to: &mut impl Write) -> Result<io::Result<()>> {
    let mut sample = vec![0; entry.bytes as usize];
    let read = File::open(from).and_then(|mut file| {
        file.seek(SeekFrom::Start(entry.offset))?;
        file.read_exact(&mut sample)
    });
    read.map_err(dataset::Error::io("read", from))?;
    Ok(to.write_all(&sample))
}

/// A number that orders samples pseudo-randomly, and always in the same way.
fn key(scenario: &str, tick: u32) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("dtd mixed shards v1");
    // Earlier versions had a seed here, 0 by default.
    hasher.update(&0_u64.to_le_bytes());
    hasher.update(&tick.to_le_bytes());
    hasher.update(scenario.as_bytes());
    let mut key = [0; 8];
    hasher.finalize_xof().fill(&mut key);
    u64::from_le_bytes(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::work::watch::Silent;
    use testkit::files::contents;

    /// Scenarios, and the ticks of each.
    const COUNTS: [u32; 2] = [12, 60];

    /// Writes the files of all scenarios, whose samples are their own keys.
    fn write(folder: &Path) -> Vec<(String, &'static str, Vec<Stored>)> {
        let of_scenario = |number| {
            let id = format!("{number:04}-a");
            let split = if number % 4 == 0 { "test" } else { "train" };
            let mut unmixed = Unmixed::create(folder, &id).unwrap();
            for tick in 0..COUNTS[1] {
                let files = [("json".to_owned(), vec![b' '; 100 + tick as usize])];
                let entries = archive::entries(&format!("{id}_{tick:06}"), &files).unwrap();
                unmixed.append(tick, &entries).unwrap();
            }
            (id, split, unmixed.finish().unwrap())
        };
        (0..COUNTS[0]).map(of_scenario).collect()
    }

    fn names_in(path: &Path) -> Vec<String> {
        let mut archive = tar::Archive::new(File::open(path).unwrap());
        let name = |entry: io::Result<tar::Entry<'_, File>>| {
            entry.unwrap().path().unwrap().display().to_string()
        };
        archive.entries().unwrap().map(name).collect()
    }

    #[test]
    fn each_sample_is_once_in_a_shard_of_its_side_among_those_of_other_scenarios() {
        let folder = tempfile::tempdir().unwrap();
        let stored = write(folder.path());
        mix(folder.path(), 1, stored.into_iter().map(Ok), &Silent).unwrap();
        let shards = ["test-000000.tar", "train-000000.tar"];
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), shards.len());
        let mut all = Vec::new();
        for shard in shards {
            let names = names_in(&folder.path().join(shard));
            for name in &names {
                let number: u32 = name[..4].parse().unwrap();
                assert_eq!(
                    number.is_multiple_of(4),
                    shard.starts_with("test"),
                    "{name}"
                );
            }
            let batches = names.chunks_exact(16);
            let scenarios = |batch: &[String]| {
                let mut ids: Vec<_> = batch.iter().map(|name| name[..4].to_owned()).collect();
                ids.sort();
                ids.dedup();
                ids.len()
            };
            let count = batches.len();
            let mean = batches.map(scenarios).sum::<usize>() as f64 / count as f64;
            let expected = if shard.starts_with("test") { 2.5 } else { 6.5 };
            assert!(mean > expected, "{shard}: {mean} scenarios in 16 samples");
            all.extend(names);
        }
        all.sort();
        all.dedup();
        assert_eq!(all.len() as u32, COUNTS[0] * COUNTS[1]);
        assert!(!folder.path().join(UNMIXED).exists());
    }

    #[test]
    fn a_side_has_as_many_shards_as_its_readers_need() {
        for (least, expected) in [(1, 1..=1), (16, 16..=20), (1_000, 180..=180)] {
            let folder = tempfile::tempdir().unwrap();
            let stored = write(folder.path());
            mix(folder.path(), least, stored.into_iter().map(Ok), &Silent).unwrap();
            let tests = contents(folder.path());
            let is_test = |path: &Path| path.to_string_lossy().contains("test-");
            let tests = tests.iter().filter(|(path, _)| is_test(path)).count();
            assert!(expected.contains(&tests), "{tests} for {least}");
        }
    }

    #[test]
    fn a_mix_that_was_killed_anywhere_goes_on_to_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let mixed = |name: &str, damage: &dyn Fn(&Path)| {
            let folder = folder.path().join(name);
            let stored = write(&folder);
            let again = stored.clone();
            mix(&folder, 1, stored.into_iter().map(Ok), &Silent).unwrap();
            damage(&folder);
            mix(&folder, 1, again.into_iter().map(Ok), &Silent).unwrap();
            contents(&folder)
        };
        let straight = mixed("straight", &|_| {});
        assert_eq!(straight.len(), 2);
        let before_the_last = mixed("before-the-last", &|folder| {
            write(folder);
            fs::remove_file(folder.join("train-000000.tar")).unwrap();
        });
        assert!(before_the_last == straight);
        let while_removing = mixed("while-removing", &|folder| {
            write(folder);
            fs::remove_file(folder.join(UNMIXED).join("0001-a")).unwrap();
        });
        assert!(while_removing == straight);
    }

    #[test]
    fn no_shard_is_larger_than_asked_for_unless_a_single_sample_is() {
        let entry = |bytes| Entry {
            key: 0,
            scenario: 0,
            offset: 0,
            bytes,
        };
        let entries = [1_024, 1_024, 512, 9_216, 512].map(entry);
        let most_bytes = 2 * 1_024 + archive::END.len() as u64;
        assert_eq!(shards(&entries, most_bytes), [0..2, 2..3, 3..4, 4..5]);
        assert!(shards(&[], most_bytes).is_empty());
    }

    #[test]
    fn the_order_is_that_of_the_first_export() {
        // Exports were made in this order: the same request must give the same bytes.
        assert_eq!(key("1200-clear-r1", 7), PINNED_KEY);
    }

    const PINNED_KEY: u64 = 8_288_235_010_843_405_898;
}
