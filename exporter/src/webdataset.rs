//! WebDataset: shards that are read from end to end, tar archives with a sample per tick: a picture per view and what is known of them.
//!
//! ```text
//! <split>-000000.tar
//!   <scenario>_<tick>.<view>.png
//!   <scenario>_<tick>.json
//! ```
//!
//! A shard holds ticks of one scenario, up to a number of bytes, so that scenarios can be written side by side.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use dataset::calibration::CameraEntry;
use dataset::frames::TickRow;
use dataset::pose::Pose;
use serde::Serialize;
use tar::{Builder, EntryType, Header};

use crate::about::split_of;
use crate::columns_text::Kind;
use crate::croissant::{
    Contents, Field, FileSet, JSON, ListedFile, NameList, RecordSet, content_of, part_of_path,
};
use crate::error::{Error, Result};
use crate::export::Watch;
use crate::part::TruthFigures;
use crate::pictures::ViewPictures;
use crate::request::ExportRequest;
use crate::source::Source;

/// A shard is closed before the sample that would make it larger than this; readers want some hundred megabytes at a time.
const MOST_BYTES: u64 = 1_000_000_000;
/// Shards of scenarios, before they are numbered.
const UNNUMBERED: &str = "unnumbered";

/// What Croissant calls the files that say what is known of ticks.
const SAMPLE_FILES: &str = "sample-files";

/// What is known of a tick.
#[derive(Serialize)]
struct Sample<'a> {
    scenario: &'a str,
    tick: u32,
    time_ns: i64,
    weather: &'a str,
    time_of_day: &'a str,
    split: &'static str,
    dtd_m: Option<f64>,
    pose: Pose,
    views: BTreeMap<&'a str, View<'a>>,
}

#[derive(Serialize)]
struct View<'a> {
    boxes: Vec<LabelledCorners>,
    calibration: &'a CameraEntry,
}

/// A box as left, top, width and height from the outer corner of the top-left pixel.
#[derive(Serialize)]
struct LabelledCorners {
    bbox: [f64; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    truth: Option<TruthFigures>,
}

/// Writes the shards of a scenario; returns their number.
pub(crate) fn write_scenario(
    source: &Source<'_>,
    request: &ExportRequest,
    folder: &Path,
    watch: Watch<'_>,
    picture_done: &dyn Fn(),
) -> Result<u32> {
    let parent = folder.join(UNNUMBERED);
    fs::create_dir_all(&parent).map_err(dataset::Error::io("create", &parent))?;
    let views = &source.selected.views;
    let mut decoded = Vec::with_capacity(views.len());
    for view in views {
        decoded.push(ViewPictures::open(source, view)?);
    }
    let mut shards = Shards::new(parent, &source.record.id, MOST_BYTES);
    let stills = request.stills();
    let mut rgb = Vec::new();
    for row in &source.frames.rows {
        let mut files = Vec::new();
        for (view, pictures) in views.iter().zip(&mut decoded) {
            if (watch.is_stopped)() {
                return Err(Error::Stopped);
            }
            pictures.decode(row)?;
            if !source.is_asked_for(row.tick) {
                continue;
            }
            pictures.convert(&mut rgb)?;
            let name = format!("{view}.{}", stills.extension());
            let mut bytes = Vec::new();
            stills.encode(&mut bytes, &shards.path(), &rgb, pictures.size_px())?;
            files.push((name, bytes));
            picture_done();
        }
        if source.is_asked_for(row.tick) {
            let sample = serde_json::to_vec(&sample(source, row)?);
            let sample =
                sample.map_err(|e| dataset::Error::io("write", &shards.path())(e.into()))?;
            files.push(("json".into(), sample));
            let key = format!("{}_{:06}", source.record.id, row.tick);
            shards.append(&key, &files)?;
        }
    }
    shards.finish()
}

fn sample<'a>(source: &'a Source<'_>, row: &TickRow) -> Result<Sample<'a>> {
    let mut views = BTreeMap::new();
    for view in &source.selected.views {
        let boxes = source.boxes_of(view, row.tick).iter();
        let boxes = boxes.map(|labelled| LabelledCorners {
            bbox: labelled.corner_and_size(),
            score: labelled.score,
            truth: labelled.truth,
        });
        let described = View {
            boxes: boxes.collect(),
            calibration: source.view(view)?.1,
        };
        views.insert(view.as_str(), described);
    }
    Ok(Sample {
        scenario: &source.record.id,
        tick: row.tick,
        time_ns: row.time_ns,
        weather: &source.record.conditions.weather_name,
        time_of_day: &source.record.conditions.time_of_day,
        split: split_of(source.selected.side),
        dtd_m: row.labels.map(|labels| labels.dtd_m),
        pose: row.pose,
        views,
    })
}

/// Numbers the shards of all scenarios, which come with their split and their number. A kill may have left some of them numbered.
pub(crate) fn finish(
    folder: &Path,
    scenarios: impl Iterator<Item = Result<(String, &'static str, u32)>>,
) -> Result<Contents> {
    let parent = folder.join(UNNUMBERED);
    let mut numbers: BTreeMap<&str, u32> = BTreeMap::new();
    let mut names = Vec::new();
    for scenario in scenarios {
        let (id, split, shards) = scenario?;
        for shard in 0..shards {
            let number = numbers.entry(split).or_default();
            let name = format!("{split}-{number:06}.tar");
            *number += 1;
            let (from, to) = (shard_path(&parent, &id, shard), folder.join(&name));
            if !to.exists() {
                fs::rename(&from, &to).map_err(dataset::Error::io("rename", &from))?;
            }
            names.push(name);
        }
    }
    if parent.exists() {
        fs::remove_dir(&parent).map_err(dataset::Error::io("remove", &parent))?;
    }
    Ok(contents(names))
}

fn contents(shards: Vec<String>) -> Contents {
    Contents {
        files: shards
            .iter()
            .map(|name| ListedFile::new(name, "application/x-tar"))
            .collect(),
        sets: vec![FileSet {
            archives: shards.clone(),
            ..FileSet::new(
                SAMPLE_FILES,
                "*.json",
                JSON,
                "What is known of a tick; its pictures have the same key.",
            )
        }],
        records: vec![RecordSet {
            name: "samples",
            what: "A record per tick.".into(),
            fields: vec![
                Field::new(
                    "key",
                    Kind::Text,
                    "scenario and tick; what its files' names begin with",
                    part_of_path(SAMPLE_FILES, "(?:.*/)?([^/]+)[.]json$"),
                ),
                // Readers of Croissant do not look into the JSON of an archive.
                Field::new(
                    "sample",
                    Kind::Text,
                    "what is known of it, as JSON",
                    content_of(SAMPLE_FILES),
                ),
            ],
        }],
        lists: vec![NameList {
            id: "shards",
            what: "Tar archives of samples, named after their split.",
            names: shards,
        }],
    }
}

fn shard_path(folder: &Path, scenario: &str, number: u32) -> PathBuf {
    folder.join(format!("{scenario}-{number:06}.tar"))
}

/// The shards of a scenario while they are written.
struct Shards<'a> {
    folder: PathBuf,
    scenario: &'a str,
    most_bytes: u64,
    begun: u32,
    open: Option<(Builder<BufWriter<File>>, u64)>,
}

/// Bytes of a header, and what contents are padded to.
const BLOCK: u64 = 512;

impl<'a> Shards<'a> {
    fn new(folder: PathBuf, scenario: &'a str, most_bytes: u64) -> Self {
        Self {
            folder,
            scenario,
            most_bytes,
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

    /// Adds the files of a sample, which stay together.
    fn append(&mut self, key: &str, files: &[(String, Vec<u8>)]) -> Result<()> {
        let of_file = |bytes: &Vec<u8>| BLOCK + (bytes.len() as u64).next_multiple_of(BLOCK);
        let added: u64 = files.iter().map(|(_, bytes)| of_file(bytes)).sum();
        // Two empty blocks end an archive.
        if let Some((_, written)) = &self.open
            && written + added + 2 * BLOCK > self.most_bytes
        {
            self.close()?;
        }
        if self.open.is_none() {
            let path = self.path();
            let file = File::create(&path).map_err(dataset::Error::io("create", &path))?;
            self.open = Some((Builder::new(BufWriter::new(file)), 0));
            self.begun += 1;
        }
        let path = self.path();
        if let Some((archive, written)) = &mut self.open {
            for (name, bytes) in files {
                let appended = append_file(archive, &format!("{key}.{name}"), bytes);
                appended.map_err(dataset::Error::io("write", &path))?;
            }
            *written += added;
        }
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        let path = self.path();
        if let Some((archive, _)) = self.open.take() {
            let ended = archive.into_inner().and_then(|mut file| file.flush());
            ended.map_err(dataset::Error::io("write", &path))?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<u32> {
        self.close()?;
        Ok(self.begun)
    }
}

/// The same bytes on every machine: no times, owners or rights of this one.
fn append_file(
    archive: &mut Builder<BufWriter<File>>,
    name: &str,
    bytes: &[u8],
) -> std::io::Result<()> {
    let mut header = Header::new_ustar();
    header.set_entry_type(EntryType::Regular);
    header.set_mode(0o644);
    header.set_mtime(0);
    header.set_size(bytes.len() as u64);
    archive.append_data(&mut header, name, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_stays_together_and_no_shard_is_larger_than_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let most_bytes = 8 * BLOCK;
        let mut shards = Shards::new(folder.path().to_owned(), "a", most_bytes);
        for tick in 0..5 {
            let files = [
                ("left.png".to_owned(), vec![tick; 100]),
                ("json".to_owned(), vec![0; 513]),
            ];
            shards.append(&format!("a_{tick}"), &files).unwrap();
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
