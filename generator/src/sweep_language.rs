//! Reading of sweeps for the comparison of two copies of a corpus ([`store::SweepLanguage`]).

use dataset::corpus::splits::{Leak, Splits};
use dataset::plan::Plan;
use serde::Deserialize;
use store::SweepLanguage;

use crate::plan::{assign_sides, is_seeded_by};
use crate::sweep::{Corpus as CorpusTable, SplitFractions};

/// Reader of sweeps.
#[derive(Debug, Clone, Copy)]
pub struct Sweeps;

/// Information that a sweep's text determines without the files that it names.
#[derive(Deserialize)]
struct Head {
    corpus: CorpusTable,
    #[serde(default)]
    split: SplitFractions,
}

impl Head {
    /// The head, or the reason why this is not a sweep.
    fn parse(sweep: &[u8]) -> Result<Self, String> {
        let text = std::str::from_utf8(sweep).map_err(|error| error.to_string())?;
        // The message is embedded in a sentence: without the line itself.
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

    fn split(&self, sweep: &[u8], plan: &Plan) -> Option<Result<Splits, Leak>> {
        let head = Head::parse(sweep).ok()?;
        Some(assign_sides(plan, &head.split, head.corpus.seed, None))
    }
}
