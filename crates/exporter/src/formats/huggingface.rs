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
use serde_json::json;

use self::predictions::Predictions;
use super::{FileFormat, Writing, Written};
use crate::description::about::{About, split_of};
use crate::description::columns_text::{
    BOXES, DETECTIONS, PREDICTIONS, SCENARIOS, TABLES, TICKS, TableText, VIEWS,
};
use crate::description::croissant::{Contents, FileSet, ListedFile, PARQUET, table_records};
use crate::error::{Error, Result};
use crate::export::{Export, ExportOutcome};
use crate::request::BoxSource;
use crate::scenarios::{Source, some_of};

/// Tables by name and split.
type Tables = BTreeMap<(&'static str, &'static str), TableParts>;

/// The format.
#[derive(Default)]
pub(super) struct HuggingFace {
    /// Requested runs, each with whether it has predictions for a scenario of the export.
    runs: Vec<(Predictions, bool)>,
}

impl FileFormat for HuggingFace {
    type Part = ();

    fn prepare(&mut self, export: &Export<'_>) -> Result<()> {
        for run in &export.request.runs {
            let read = Predictions::read(run)?;
            if self.runs.iter().any(|(other, _)| other.run() == read.run()) {
                return Err(Error::SameRun {
                    run: read.run().to_owned(),
                });
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
        for (run, is_answered) in &mut self.runs {
            *is_answered |= run.check(source)?;
        }
        Ok(())
    }

    fn check_all(&self, _: &Export<'_>, _: &mut ExportOutcome) -> Result<()> {
        match self.runs.iter().find(|(_, is_answered)| !is_answered) {
            None => Ok(()),
            Some((run, _)) => Err(Error::NotOfRun {
                run: run.run().to_owned(),
                known: some_of(run.scenarios()),
            }),
        }
    }

    /// Copies the videos.
    fn write(&self, scenario: &Writing<'_>) -> Result<()> {
        let source = &scenario.source;
        for view in &source.selected.views {
            scenario.watch.check()?;
            let video = scenario.folder.join(video_of(source, view)?);
            let parent = video.parent().unwrap_or(&scenario.folder);
            fs::create_dir_all(parent).map_err(dataset::Error::io("create", parent))?;
            source.scenario.copy_video(view, &video)?;
            scenario.pictures_done(source.rows().count() as u64);
        }
        Ok(())
    }

    /// Writes the tables and the card.
    fn finish(&self, written: &Written<'_>) -> Result<Contents> {
        let folder = written.folder();
        let mut tables = Tables::new();
        for source in written.sources() {
            let source = source?;
            let split = split_of(source.selected.side);
            let mut append =
                |table: TableText, rows| append(&mut tables, &folder, table.name, split, rows);
            append(SCENARIOS, long_tables::scenario_row(&source))?;
            append(
                VIEWS,
                long_tables::views(&source, |view| video_of(&source, view))?,
            )?;
            append(TICKS, long_tables::ticks(&source))?;
            if written.export.request.boxes == BoxSource::Truth {
                append(BOXES, long_tables::boxes(&source)?)?;
            }
            append(DETECTIONS, long_tables::detections(&source)?)?;
            for (run, _) in &self.runs {
                let rows = run.of(&source.record.id, |tick| source.is_asked_for(tick));
                append(PREDICTIONS, rows)?;
            }
        }
        let mut contents = Contents::default();
        for ((table, split), open) in tables {
            open.finish()?;
            let name = format!("data/{table}/{split}.parquet");
            contents.files.push(ListedFile::new(name, PARQUET));
        }
        for table in TABLES {
            let files = format!("data/{}/", table.name);
            if contents
                .files
                .iter()
                .any(|file| file.name.starts_with(&files))
            {
                let includes = format!("{files}*.parquet");
                let id = format!("{}-tables", table.name);
                contents.records.push(table_records(&table, &id));
                let what = "A table, a file per split.";
                contents
                    .sets
                    .push(FileSet::new(id, includes, PARQUET, what));
            }
        }
        let videos = FileSet::new(
            "videos",
            "videos/*/*",
            "video/mp4",
            "An image per tick, a video per scenario and view, as in the corpus.",
        );
        contents.sets.push(videos);
        let card = folder.join("README.md");
        write_unsynced(&card, card_of(&written.export.about, &contents).as_bytes())?;
        contents
            .files
            .push(ListedFile::new("README.md", "text/markdown"));
        Ok(contents)
    }
}

/// Path of the video of a view, relative to the export.
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
fn card_of(about: &About, contents: &Contents) -> String {
    let mut card = String::from("---\n");
    let _ = writeln!(card, "pretty_name: {}", json!(about.name));
    card.push_str(&about.card_license());
    card.push_str("tags: [aviation, multi-camera, simulation]\nconfigs:\n");
    let mut tables = String::new();
    for table in TABLES {
        let files = format!("data/{}/", table.name);
        let names = contents.files.iter().map(|file| file.name.as_str());
        let splits: Vec<&str> = names
            .filter_map(|name| name.strip_prefix(&files)?.strip_suffix(".parquet"))
            .collect();
        if splits.is_empty() {
            continue;
        }
        let _ = writeln!(card, "- config_name: {}", table.name);
        if table.name == TICKS.name {
            card.push_str("  default: true\n");
        }
        card.push_str("  data_files:\n");
        // Training first, as everywhere.
        for split in ["train", "validation", "test"] {
            if splits.contains(&split) {
                let _ = writeln!(card, "  - split: {split}\n    path: {files}{split}.parquet");
            }
        }
        let _ = write!(
            tables,
            "\n## {}\n\nA row per {}.\n\n| column | meaning |\n|---|---|\n",
            table.name, table.row
        );
        for column in table.columns {
            let _ = writeln!(tables, "| `{}` | {} |", column.name, column.meaning);
        }
    }
    let _ = write!(
        card,
        "---\n\n{}\n\nUnits are in the names of the columns. The image of tick k is image k of each video \
         (`videos/<scenario>/<view>.*`).\n\n```python\nfrom datasets import load_dataset\n\nticks = load_dataset(\"FOLDER\", \"ticks\")\n```\n{tables}",
        about.introduction(),
    );
    card
}
