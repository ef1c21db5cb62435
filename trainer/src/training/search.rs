//! Comparison of trainings with several settings and seeds by their errors on the validation side.
//!
//! Each training is a separate run, beside the others. Finished runs stay, and killed ones continue from their checkpoint, so a search
//! resumes. A setting counts by its mean over the seeds: differences below their spread are chance.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use dataset::corpus::Corpus;
use dataset::files::json_file::write_json;
use dataset::work::watch::Watch;
use serde::{Deserialize, Serialize};

use crate::config::TrainConfig;
use crate::error::{Error, Result};
use crate::run::folder::RunFolder;
use crate::training::train_on_all;

const TABLE: &str = "search.json";
/// Link to the best run.
const BEST: &str = "best";

/// Search over settings and seeds.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Settings by name; their seeds are ignored.
    pub variants: BTreeMap<String, TrainConfig>,
    /// Seeds of each variant.
    pub seeds: Vec<u64>,
}

/// Results (`search.json`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SearchTable {
    /// Variants, in the order of their names.
    pub variants: Vec<VariantResult>,
    /// Run name: the best seed of the variant with the lowest mean error; `null` if all trainings diverged.
    pub best: Option<String>,
}

/// Trainings that differ only in the seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VariantResult {
    /// Variant name.
    pub variant: String,
    /// Trainings, in the order of the seeds.
    pub trainings: Vec<TrainingResult>,
    /// Mean error, percent; `null` if a training diverged.
    pub mean_pct: Option<f64>,
    /// Standard deviation of the errors, percent; `null` also for a single seed.
    pub spread_pct: Option<f64>,
}

/// Training of a variant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainingResult {
    /// Seed.
    pub seed: u64,
    /// Run name within the search folder.
    pub run: String,
    /// Validation error of `paper_lstm`, percent; `null` if the training diverged.
    pub validation_mape_pct: Option<f64>,
}

/// Trains all variants with all seeds into folders of `out`, and writes the table and a link to the best run beside them.
pub fn search(
    corpora: &[Corpus],
    out: &Path,
    search: &Search,
    watch: &dyn Watch,
) -> Result<SearchTable> {
    search.check()?;
    if RunFolder::at(out).path(RunFolder::SUMMARY).exists() {
        let fault = "is a run, and a search has a folder of its own with a run for each training; name another folder with --out";
        return Err(Error::run(out, fault));
    }
    fs::create_dir_all(out).map_err(dataset::Error::io("create", out))?;
    let count = search.variants.len() * search.seeds.len();
    let mut variants: Vec<VariantResult> = Vec::new();
    for (index, (variant, config)) in search.variants.iter().enumerate() {
        let mut trainings = Vec::new();
        for (number, &seed) in search.seeds.iter().enumerate() {
            let number = index * search.seeds.len() + number + 1;
            watch.say(&format!(
                "training {number} of {count}: {variant}, seed {seed}"
            ));
            let config = TrainConfig {
                seed,
                ..config.clone()
            };
            let run = format!("{variant}-{seed}");
            let trained = train_on_all(corpora, &out.join(&run), &config, true, watch);
            let validation_mape_pct = match trained {
                Ok(outcome) => Some(outcome.validation_mape_pct),
                Err(error @ Error::Diverged { .. }) => {
                    watch.say(&format!("{variant}, seed {seed}: {error}"));
                    None
                }
                Err(error) => return Err(error),
            };
            trainings.push(TrainingResult {
                seed,
                run,
                validation_mape_pct,
            });
        }
        variants.push(VariantResult::of(variant, trainings));
        let best = best_of(&variants);
        let table = SearchTable { variants, best };
        write_json(&out.join(TABLE), &table)?;
        variants = table.variants;
    }
    let best = best_of(&variants);
    if let Some(run) = &best {
        link(run, &out.join(BEST))?;
    }
    Ok(SearchTable { variants, best })
}

impl Search {
    fn check(&self) -> Result<()> {
        if self.variants.is_empty() {
            return Err(Error::setting("variants", "empty", "at least one table"));
        }
        for (name, config) in &self.variants {
            if dataset::files::file_name::check(name).is_err() || name == BEST {
                let expected = "names of letters, digits, - and _, not \"best\"";
                return Err(Error::setting(
                    "variants",
                    format_args!("{name:?}"),
                    expected,
                ));
            }
            config.check()?;
        }
        let mut seeds = self.seeds.clone();
        seeds.sort_unstable();
        seeds.dedup();
        if seeds.is_empty() || seeds.len() < self.seeds.len() {
            let found = format!("{:?}", self.seeds);
            return Err(Error::setting("seeds", found, "numbers, each once"));
        }
        Ok(())
    }
}

impl VariantResult {
    fn of(variant: &str, trainings: Vec<TrainingResult>) -> Self {
        let errors: Option<Vec<f64>> = trainings.iter().map(|t| t.validation_mape_pct).collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let mean_pct = errors.as_deref().map(mean);
        let spread_pct = errors.zip(mean_pct).and_then(|(errors, mean)| {
            let squares = errors
                .iter()
                .map(|error| (error - mean).powi(2))
                .sum::<f64>();
            (errors.len() > 1).then(|| (squares / (errors.len() - 1) as f64).sqrt())
        });
        Self {
            variant: variant.to_owned(),
            trainings,
            mean_pct,
            spread_pct,
        }
    }
}

fn best_of(variants: &[VariantResult]) -> Option<String> {
    let lowest = |a: Option<f64>, b: Option<f64>| {
        let [a, b] = [a, b].map(|error| error.unwrap_or(f64::INFINITY));
        a.total_cmp(&b)
    };
    let best = variants.iter().filter(|variant| variant.mean_pct.is_some());
    let best = best.min_by(|a, b| lowest(a.mean_pct, b.mean_pct))?;
    let trainings = best.trainings.iter();
    let run = trainings.min_by(|a, b| lowest(a.validation_mape_pct, b.validation_mape_pct))?;
    Some(run.run.clone())
}

/// Replaces the symbolic link `link` atomically.
fn link(run: &str, link: &Path) -> Result<()> {
    let new: PathBuf = link.with_extension("new");
    let failed = |error| Error::from(dataset::Error::io("link the best run as", link)(error));
    let _ = fs::remove_file(&new);
    symlink(run, &new).map_err(failed)?;
    fs::rename(&new, link).map_err(failed)
}
