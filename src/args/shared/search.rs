//! Options of every verb that searches images for aircraft.

use std::collections::BTreeSet;
use std::path::Path;
use std::str::FromStr;

use clap::Args;
use dataset::corpus::{Corpus, ScenarioFolder};
use labeller::tiling::TilingSettings;
use labeller::{Mode, RowBand, SearchBands};

use super::choice::Choices;
use crate::failure::Failure;
use crate::verbs::output::listed;

/// Parts of images to search.
#[derive(Debug, Args)]
pub(crate) struct SearchArgs {
    /// Only these scenarios, separated by commas
    #[arg(long, value_name = "ID,..", value_delimiter = ',')]
    only: Vec<String>,
    /// Rows of the images to search: `training`, where the training side has aircraft, or TOP:BOTTOM [default: all]
    ///
    /// A third of the rows takes a third of the time. `training` needs labels; it searches the rows where aircraft are
    /// large at half the scale, which takes a quarter of the time.
    #[arg(long, value_name = "ROWS")]
    rows: Option<Rows>,
    /// Search in tiles with sides of N pixels, not in the whole image at once
    ///
    /// Only for a model that takes any size; others have tiles of their own size.
    #[arg(long, value_name = "N")]
    tile: Option<u32>,
}

/// Modes of searching images.
pub(crate) const MODES: Choices<Mode, 4> = [
    ("full", "Every image whole", Mode::Full),
    (
        "tracked",
        "Small windows around known aircraft; whole images from time to time, and if one is lost",
        Mode::Tracked,
    ),
    (
        "scaled",
        "Every image shrunk to the model's usual size, for comparison",
        Mode::Scaled,
    ),
    (
        "auto",
        "Tracked, but an image whole if an aircraft moves by more than its length from one to the next",
        Mode::Auto,
    ),
];

/// A choice of rows.
#[derive(Debug, Clone, Copy)]
enum Rows {
    OfTraining,
    Band(RowBand),
}

impl FromStr for Rows {
    type Err = <RowBand as FromStr>::Err;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "training" => Ok(Self::OfTraining),
            rows => rows.parse().map(Self::Band),
        }
    }
}

impl SearchArgs {
    /// The scenarios to search; rejects identifiers of others.
    pub(crate) fn scenarios(&self, corpus: &Corpus) -> Result<Option<BTreeSet<String>>, Failure> {
        if self.only.is_empty() {
            return Ok(None);
        }
        let known = corpus.scenarios().map_err(Failure::of_corpus)?;
        let known: BTreeSet<String> = known.iter().map(ScenarioFolder::id).collect();
        match self.only.iter().find(|id| !known.contains(*id)) {
            None => Ok(Some(self.only.iter().cloned().collect())),
            Some(id) => Err(Failure::bad_input_message(format!(
                "--only {id}: {} has no complete scenario of this name; its scenarios are {}",
                corpus.root().display(),
                listed(&known)
            ))),
        }
    }

    /// Settings for searching this corpus.
    pub(crate) fn settings(&self, corpus: &Corpus) -> Result<TilingSettings, Failure> {
        let (rows, half_scale_rows) = match self.rows {
            None => (None, None),
            Some(Rows::Band(band)) => (Some(band), None),
            Some(Rows::OfTraining) => {
                let SearchBands { small, large } = of_training(corpus)?;
                (Some(small), large)
            }
        };
        Ok(TilingSettings {
            tile_px: self.tile,
            rows,
            half_scale_rows,
            ..TilingSettings::default()
        })
    }
}

fn of_training(corpus: &Corpus) -> Result<SearchBands, Failure> {
    let root: &Path = corpus.root();
    let (sound, _) = corpus.without_damaged()?;
    let bands = SearchBands::of_training_side(&sound)?.ok_or_else(|| {
        Failure::bad_input_message(format!(
            "--rows training: the training side of {} has no ground-truth boxes; run `dtd label {0}` if it has no labels yet, or give TOP:BOTTOM",
            root.display()
        ))
    })?;
    let at_half = match bands.large {
        Some(rows) => format!(", and at half the scale rows {rows}, where they are large"),
        None => String::new(),
    };
    eprintln!(
        "detect: searching rows {}, where the training side has aircraft{at_half}",
        bands.small
    );
    Ok(bands)
}
