//! Reading of sweeps for the comparison of two copies of a corpus ([`store::Mirror`]).

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::{Leak, Splits};
use dataset::plan::{Difference, Plan};
use serde::Deserialize;
use serde::de::IgnoredAny;
use store::SweepLanguage;

use crate::plan::{assign_sides, expand, is_seeded_by};
use crate::sweep::{Corpus as CorpusTable, SplitFractions, Sweep};

/// Reader of sweeps.
#[derive(Debug, Clone, Copy)]
pub struct Sweeps;

/// Information that a sweep's text determines without the files that it names.
#[derive(Deserialize)]
struct Head {
    corpus: CorpusTable,
    #[serde(default)]
    split: SplitFractions,
    /// Rules that name recordings, which are files beside the sweep.
    #[serde(default)]
    recorded: Vec<IgnoredAny>,
}

impl Head {
    /// The head, or the reason why this is not a sweep.
    fn parse(sweep: &[u8]) -> Result<Self, String> {
        let text = std::str::from_utf8(sweep).map_err(|error| error.to_string())?;
        // In the middle of a sentence: without the line that it is about.
        toml::from_str(text).map_err(|error| error.message().to_owned())
    }
}

impl SweepLanguage for Sweeps {
    fn fault(&self, sweep: &[u8]) -> Option<String> {
        Head::parse(sweep).err()
    }

    fn other_corpus(&self, sweep: &[u8], plan: &Plan) -> Option<String> {
        let CorpusTable { name, seed } = Head::parse(sweep).ok()?.corpus;
        (name != plan.corpus || !is_seeded_by(plan, seed)).then(|| {
            format!(
                "its corpus {name:?} with seed {seed} is not the one that plan.json was made from, {:?}",
                plan.corpus
            )
        })
    }

    fn difference_from_expansion(&self, sweep: &[u8], plan: &Plan) -> Option<String> {
        match Head::parse(sweep) {
            Err(fault) => return Some(fault),
            Ok(head) if !head.recorded.is_empty() => return None,
            Ok(_) => {}
        }
        let text = String::from_utf8_lossy(sweep).into_owned();
        // It names no files, so its folder does not matter.
        let expanded = match Sweep::parse(Path::new(Corpus::SWEEP), Path::new(""), text) {
            Ok(sweep) => expand(&sweep),
            Err(error) => return Some(error.message),
        };
        if plan.plan_hash == expanded.plan_hash {
            return None;
        }
        let difference = Difference::between(plan, &expanded);
        let added = difference.added.first();
        let added = added.map(|id| format!("scenario {id} is not in plan.json"));
        let conflict = difference.conflict().or(added);
        Some(conflict.unwrap_or_else(|| "it gives another order of scenarios".into()))
    }

    fn split(&self, sweep: &[u8], plan: &Plan) -> Option<Result<Splits, Leak>> {
        let head = Head::parse(sweep).ok()?;
        Some(assign_sides(plan, &head.split, head.corpus.seed, None))
    }
}
