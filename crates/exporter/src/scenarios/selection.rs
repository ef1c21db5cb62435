//! Scenarios, views and ticks selected by a request, checked before any file is written.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::splits::{Assignment, Side};
use dataset::corpus::{Corpus, ScenarioFolder};
use serde::Serialize;

use crate::about::split_of;
use crate::error::{Error, Result};
use crate::request::ExportRequest;

/// Maximum names in a message.
const MAX_NAMED: usize = 8;

/// A requested scenario.
pub(crate) struct Selected {
    pub(crate) folder: ScenarioFolder,
    pub(crate) side: Option<Side>,
    /// Requested views, in the scenario's order.
    pub(crate) views: Vec<String>,
}

impl Selected {
    /// Identifier of the scenario.
    pub(crate) fn id(&self) -> String {
        self.folder.id()
    }
}

/// A requested scenario that cannot be exported.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LostScenario {
    /// Scenario identifier.
    pub id: String,
    /// The fault.
    pub reason: String,
}

/// The scenarios that a request asks for, by name, and the lost ones among them, which miss a video or have a truncated one.
pub(crate) fn select(
    corpus: &Corpus,
    request: &ExportRequest,
) -> Result<(Vec<Selected>, Vec<LostScenario>)> {
    let folders = corpus.scenarios()?;
    let ids: Vec<String> = folders.iter().map(ScenarioFolder::id).collect();
    for id in request.only.iter().flatten() {
        refuse_unknown("scenario", id, &ids)?;
    }
    let sides = sides(corpus, request.side.is_some())?;
    let (mut selected, mut lost) = (Vec::new(), Vec::new());
    let mut all_views: Vec<String> = Vec::new();
    for (folder, id) in folders.into_iter().zip(ids) {
        let side = sides.get(&id).map(|assignment| assignment.side);
        let is_asked_for = |asked: &Vec<String>| asked.contains(&id);
        if !request.only.as_ref().is_none_or(is_asked_for)
            || request.side.is_some_and(|asked| side != Some(asked))
        {
            continue;
        }
        let scenario = folder.open()?;
        let record = scenario.record()?;
        if record.recorded.is_some() {
            return Err(Error::Request(format!(
                "scenario {id} was imported from tables and has no images, which every export needs; read its tables in Python or with any \
                 Parquet reader (docs/dataset.md)"
            )));
        }
        let mut views = record.views;
        all_views.extend(views.clone());
        if let Some(asked) = &request.views {
            views.retain(|view| asked.contains(view));
        }
        let check = |view: &String| scenario.check_video_unread(view);
        match views.iter().try_for_each(check) {
            Ok(()) if views.is_empty() => {}
            Ok(()) => selected.push(Selected {
                folder,
                side,
                views,
            }),
            Err(error) if error.is_damage() => lost.push(LostScenario {
                id,
                reason: format!(
                    "{error}; move its folder out of {}/scenarios and run `dtd generate` or `dtd fetch` again",
                    corpus.root().display()
                ),
            }),
            Err(error) => return Err(error.into()),
        }
    }
    all_views.sort();
    all_views.dedup();
    for view in request.views.iter().flatten() {
        refuse_unknown("view", view, &all_views)?;
    }
    if let Some(asked) = request.side {
        let known: BTreeSet<&str> = (sides.values())
            .map(|assignment| split_of(Some(assignment.side)))
            .collect();
        let known: Vec<String> = known.into_iter().map(str::to_owned).collect();
        refuse_unknown("side", split_of(Some(asked)), &known)?;
    }
    if selected.is_empty() {
        let why = match lost.first() {
            None => "no scenario is left with these options".to_owned(),
            Some(first) => format!(
                "every selected scenario is damaged; the first one: {}",
                first.reason
            ),
        };
        return Err(Error::Request(format!("nothing to export: {why}")));
    }
    Ok((selected, lost))
}

/// The split; a corpus may lack it unless a side is requested.
fn sides(corpus: &Corpus, is_asked_for: bool) -> Result<BTreeMap<String, Assignment>> {
    match corpus.splits() {
        Ok(splits) => Ok(splits.scenarios),
        Err(_) if !is_asked_for && !corpus.splits_path().exists() => Ok(BTreeMap::new()),
        Err(error) => Err(error.into()),
    }
}

fn refuse_unknown(what: &'static str, found: &str, known: &[String]) -> Result<()> {
    if known.iter().any(|name| name == found) {
        return Ok(());
    }
    let known = some_of(known.iter().map(String::as_str));
    Err(Error::unknown(what, found, &known))
}

/// The first few names, as text.
pub(crate) fn some_of<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.take(MAX_NAMED + 1).collect();
    match names.get(..MAX_NAMED) {
        Some(first) if names.len() > MAX_NAMED => format!("{}, ...", first.join(", ")),
        _ => names.join(", "),
    }
}
