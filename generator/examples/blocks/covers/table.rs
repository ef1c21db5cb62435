//! The figures of `covers` by cover and weather. Runs with other seeds are added to a file, since all of them together take an hour.

use std::error::Error;
use std::fs::File;
use std::io::{Read, Seek, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

const COMMAND: &str = "cargo run --release --workspace --example blocks -- covers REPEATS SEED docs/results/blocks-covers.json";

/// The figures of some runs.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Table {
    command: String,
    runs: Vec<Run>,
    rows: Vec<Row>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Run {
    repeats: u32,
    seed: u32,
}

/// Scenarios by cover and weather.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) cover: String,
    pub(crate) weather: String,
    pub(crate) scenarios: u32,
    /// Scenarios in which something was noticed: without a cover, false alarms.
    pub(crate) noticed_in: u32,
    /// Images of the corpus that show the cover.
    pub(crate) covered_pictures: u32,
    /// Covered scenarios in which nothing was noticed.
    pub(crate) not_noticed: Vec<String>,
    /// Attempts that ended, and why.
    pub(crate) repeated_attempts: Vec<String>,
}

impl Table {
    pub(crate) fn of_run(repeats: u32, seed: u32, rows: Vec<Row>) -> Self {
        Self {
            command: COMMAND.to_owned(),
            runs: vec![Run { repeats, seed }],
            rows,
        }
    }

    /// Adds these figures to a file. Several processes may do so at once.
    pub(crate) fn add_to(self, path: &Path) -> Result<(), Box<dyn Error>> {
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)?;
        file.lock()?;
        let mut text = String::new();
        file.read_to_string(&mut text)?;
        let mut all = if text.is_empty() {
            Self {
                command: COMMAND.to_owned(),
                runs: Vec::new(),
                rows: Vec::new(),
            }
        } else {
            serde_json::from_str(&text)?
        };
        let seeds = |table: &Self| table.runs.iter().map(|run| run.seed).collect::<Vec<_>>();
        let known = seeds(&all);
        if let Some(seed) = seeds(&self).into_iter().find(|seed| known.contains(seed)) {
            return Err(format!("{} already has seed {seed}", path.display()).into());
        }
        all.add(self);
        let mut text = serde_json::to_string_pretty(&all)?;
        text.push('\n');
        file.rewind()?;
        file.set_len(0)?;
        Ok(file.write_all(text.as_bytes())?)
    }

    fn add(&mut self, other: Self) {
        self.runs.extend(other.runs);
        for row in other.rows {
            let same =
                |known: &&mut Row| (&known.cover, &known.weather) == (&row.cover, &row.weather);
            match self.rows.iter_mut().find(same) {
                Some(known) => {
                    known.scenarios += row.scenarios;
                    known.noticed_in += row.noticed_in;
                    known.covered_pictures += row.covered_pictures;
                    known.not_noticed.extend(row.not_noticed);
                    known.repeated_attempts.extend(row.repeated_attempts);
                }
                None => self.rows.push(row),
            }
        }
    }
}
