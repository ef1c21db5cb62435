//! Files for `datasets.load_dataset`: a long Parquet table per kind of record and split (`data/<table>/<split>.parquet`), the videos as
//! they are in the corpus (`videos/<scenario>/`), and a dataset card that lists both (`README.md`).

mod long_tables;
mod predictions;

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use dataset::files::json_file::write_unsynced;
use dataset::tables::columns::{TableParts, TableWriter};
use serde_json::{Value, json};

use self::predictions::Predictions;
use crate::about::{About, split_of};
use crate::columns;
use crate::error::{Error, Result};
use crate::file_format::{Export, FileFormat, Writing, Written};
use crate::request::{Abilities, BoxSource};
use crate::scenarios::{Source, some_of};

/// Tables by name and split.
type Tables = BTreeMap<(&'static str, &'static str), TableParts>;

/// The format.
#[derive(Default)]
pub(super) struct HuggingFace {
    /// Requested runs, each with whether it has predictions for a scenario of the export.
    runs: Vec<(Predictions, bool)>,
    /// True if a scenario has several aircraft.
    has_traffic: bool,
}

impl FileFormat for HuggingFace {
    fn abilities(&self) -> Abilities {
        Abilities {
            has_license: true,
            has_predictions: true,
            ..Abilities::of_videos("huggingface")
        }
    }

    fn prepare(&mut self, export: &Export<'_>) -> Result<()> {
        for run in &export.request.runs {
            let read = Predictions::read(run)?;
            if self.runs.iter().any(|(other, _)| other.run() == read.run()) {
                return Err(Error::Request(format!(
                    "two runs are named {}; predictions are identified by run name, so rename one of the folders",
                    read.run()
                )));
            }
            self.runs.push((read, false));
        }
        Ok(())
    }

    fn hash(&self, hasher: &mut blake3::Hasher) {
        for (run, _) in &self.runs {
            run.hash(hasher);
        }
    }

    fn check(&mut self, source: &Source<'_>, _: &Export<'_>) -> Result<()> {
        self.has_traffic |= !source.record.traffic.is_empty();
        for (run, is_answered) in &mut self.runs {
            *is_answered |= run.check(source)?;
        }
        Ok(())
    }

    fn check_all(&self, _: &Export<'_>) -> Result<Option<&'static str>> {
        match self.runs.iter().find(|(_, is_answered)| !is_answered) {
            None => Ok(None),
            Some((run, _)) => Err(Error::Request(format!(
                "run {} has predictions for none of the selected scenarios, only for {}; leave it out, choose others, or evaluate it on \
                 this corpus first",
                run.run(),
                some_of(run.scenarios())
            ))),
        }
    }

    /// Copies the videos.
    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let source = &scenario.source;
        for view in &source.selected.views {
            scenario.watch.check()?;
            let video = scenario.folder.join(video_of(source, view)?);
            let parent = video.parent().unwrap_or(&scenario.folder);
            fs::create_dir_all(parent).map_err(dataset::Error::io("create", parent))?;
            source.scenario.copy_video(view, &video)?;
            scenario.pictures_done(source.rows().count() as u64);
        }
        Ok(Value::Null)
    }

    /// Writes the tables and the card.
    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let folder = written.folder();
        let mut tables = Tables::new();
        for source in written.sources() {
            let source = source?;
            let split = split_of(source.selected.side);
            let mut append = |table, rows| append(&mut tables, &folder, table, split, rows);
            append("scenarios", long_tables::scenario_row(&source))?;
            append(
                "views",
                long_tables::views(&source, |view| video_of(&source, view))?,
            )?;
            append("ticks", long_tables::ticks(&source))?;
            if written.export.request.boxes == BoxSource::Truth {
                append("boxes", long_tables::boxes(&source, self.has_traffic)?)?;
            }
            append("detections", long_tables::detections(&source)?)?;
            for (run, _) in &self.runs {
                append("predictions", run.of(&source))?;
            }
        }
        let card = card_of(&written.export.about, &tables, self.has_traffic);
        for open in tables.into_values() {
            open.finish()?;
        }
        Ok(write_unsynced(&folder.join("README.md"), card.as_bytes())?)
    }
}

/// Path relative to the export.
fn video_of(source: &Source<'_>, view: &str) -> Result<String> {
    let name = source.scenario.video_name(view)?;
    let file = name.rsplit('/').next().unwrap_or(name);
    Ok(format!("videos/{}/{file}", source.record.id))
}

fn append(
    tables: &mut Tables,
    folder: &Path,
    table: &'static str,
    split: &'static str,
    rows: TableWriter,
) -> Result<()> {
    if rows.rows() == 0 {
        return Ok(());
    }
    let parts = match tables.entry((table, split)) {
        Entry::Occupied(open) => open.into_mut(),
        Entry::Vacant(place) => {
            let parent = folder.join("data").join(table);
            fs::create_dir_all(&parent).map_err(dataset::Error::io("create", &parent))?;
            place.insert(TableParts::new(&parent.join(format!("{split}.parquet"))))
        }
    };
    Ok(parts.add(rows)?)
}

/// The dataset card: configurations and splits for the library, tables and columns for people.
fn card_of(about: &About, written: &Tables, has_traffic: bool) -> String {
    let mut card = String::from("---\n");
    let _ = writeln!(card, "pretty_name: {}", json!(about.name));
    card.push_str(&about.card_license());
    card.push_str("tags: [aviation, multi-camera, simulation]\nconfigs:\n");
    let mut tables = String::new();
    for (table, section) in columns::tables() {
        // Training first, as everywhere.
        let splits = ["train", "validation", "test"];
        let mut splits = splits
            .into_iter()
            .filter(|split| written.contains_key(&(table, *split)))
            .peekable();
        if splits.peek().is_none() {
            continue;
        }
        let _ = writeln!(card, "- config_name: {table}");
        if table == "ticks" {
            card.push_str("  default: true\n");
        }
        card.push_str("  data_files:\n");
        for split in splits {
            let _ = writeln!(
                card,
                "  - split: {split}\n    path: data/{table}/{split}.parquet"
            );
        }
        let lines = section.lines();
        let is_there = |line: &&str| has_traffic || !line.contains("| only with traffic:");
        let lines: Vec<_> = lines.filter(is_there).collect();
        let _ = writeln!(tables, "\n## {}", lines.join("\n"));
    }
    let _ = write!(
        card,
        "---\n\n{}\n\nUnits are in the names of the columns. The image of tick k is image k of each video \
         (`videos/<scenario>/<view>.*`).\n\n```python\nfrom datasets import load_dataset\n\nticks = load_dataset(\"FOLDER\", \"ticks\")\n```\n{tables}",
        about.introduction(),
    );
    card
}
