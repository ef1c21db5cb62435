//! `dtd train --search`: trains with several settings and seeds, and compares them.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::toml_file::TomlFile;
use serde::Deserialize;
use toml::{Table, Value};
use trainer::{Search, SearchTable, TrainConfig};

use super::{checked, failure_of, judged_next, overridden};
use crate::args::estimator::TrainArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;
use crate::verbs::Outcome;
use crate::verbs::output::{finish, print_json, print_table};

/// The content of SEARCH.toml.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SearchFile {
    /// Seeds of each variant.
    seeds: Vec<u64>,
    /// Settings of all variants.
    #[serde(default)]
    settings: Table,
    /// Additional settings of each variant.
    variants: BTreeMap<String, Table>,
}

/// Searches instead of training once.
pub(super) fn run(args: &TrainArgs, path: &Path, corpora: &[Corpus]) -> Outcome {
    let began = Instant::now();
    let search = search_in(path, args)?;
    let watch = VerbWatch::new("train", "steps");
    let table = trainer::search(corpora, &args.out, &search, &watch).map_err(failure_of)?;
    drop(watch);
    if args.json {
        print_json(&table)?;
    } else {
        print(&search, &table);
    }
    let Some(best) = &table.best else {
        return Ok(Ending::Losses);
    };
    let next = judged_next(&args.out.join(best), &corpora[0]);
    finish("train", began, &next);
    Ok(Ending::Done)
}

fn search_in(path: &Path, args: &TrainArgs) -> Result<Search, Failure> {
    let text = outside_file::read_text(path, FileKind::SETTINGS).map_err(Failure::bad_input)?;
    let file = TomlFile::new(path, &text);
    let SearchFile {
        seeds,
        settings,
        variants,
    } = file.parse().map_err(Failure::bad_input)?;
    let config = |settings: Table, place: &str| {
        let config: TrainConfig = settings.try_into().map_err(|error: toml::de::Error| {
            Failure::bad_input(file.rejected(place, error.message()))
        })?;
        checked(config, file, &format!("{place}."))
    };
    config(settings.clone(), "settings")?;
    let variant = |(name, own): (String, Table)| {
        let mut all = settings.clone();
        merge(&mut all, own);
        let config = config(all, &format!("variants.{name}"))?;
        Ok((name, overridden(config, args)))
    };
    Ok(Search {
        variants: variants
            .into_iter()
            .map(variant)
            .collect::<Result<_, Failure>>()?,
        seeds,
    })
}

/// Adds settings to others, and replaces settings of the same name.
fn merge(into: &mut Table, from: Table) {
    for (key, value) in from {
        match (into.get_mut(&key), value) {
            (Some(Value::Table(inner)), Value::Table(more)) => merge(inner, more),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

fn print(search: &Search, table: &SearchTable) {
    let number = |error: Option<f64>| error.map_or("-".into(), |error| format!("{error:.3}"));
    let seeds = search.seeds.iter().map(|seed| format!("seed {seed}"));
    let heading: Vec<String> = ["validation MAPE, %".to_owned()]
        .into_iter()
        .chain(seeds)
        .chain(["mean", "spread"].map(String::from))
        .collect();
    let heading: Vec<&str> = heading.iter().map(String::as_str).collect();
    let row = |result: &trainer::VariantResult| {
        let errors = result
            .trainings
            .iter()
            .map(|t| number(t.validation_mape_pct));
        [result.variant.clone()]
            .into_iter()
            .chain(errors)
            .chain([number(result.mean_pct), number(result.spread_pct)])
            .collect()
    };
    let rows: Vec<Vec<String>> = table.variants.iter().map(row).collect();
    print_table(&heading, &rows);
    if let Some(best) = &table.best {
        println!("best: {best}");
    }
}
