//! Images for the report: what was found, what was missed, and what is no aircraft.
//!
//! Input: every image with its boxes. Output: a few of each kind, cut out of the videos. Hits are the farthest ones, misses the nearest,
//! false boxes the surest; no two from the same mile of a view, or of the same track.

use std::collections::{BTreeMap, BTreeSet};

use dataset::corpus::Corpus;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::tables::pixel_box::PixelBox;
use report_page::crop::Crop;
use serde::Serialize;

use crate::error::Result;
use crate::outcome::{Outcome, Searched};
use dataset::conditions::sight::Sight;

/// Examples of each kind and mode.
const SHOWN: usize = 8;

/// Example type.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Kind {
    Hit,
    Miss,
    FalseAlarm,
}

/// An example that may be shown.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Candidate {
    kind: Kind,
    scenario: String,
    view: String,
    tick: u32,
    distance_nm: f64,
    truth: Option<PixelBox>,
    found: Option<PixelBox>,
    /// Score, or the reason for a miss.
    note: String,
    /// Rank: smaller ones come first.
    rank: f64,
    /// Group with a single shown example: view, and mile or track.
    alike: (String, i64),
}

/// The best candidates, by type.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates {
    by_kind: BTreeMap<Kind, Vec<Candidate>>,
}

/// An example as the report shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Example {
    #[serde(skip)]
    pub(crate) kind: Kind,
    crop: Crop,
    /// Lines around the ground-truth box and the found one: left, top, width and height in the crop, pixels.
    truth: Option<[f64; 4]>,
    found: Option<[f64; 4]>,
    place: String,
    note: String,
}

impl Candidates {
    pub(crate) fn offer(
        &mut self,
        scenario: &OpenScenario,
        searched: &[Searched<'_>],
    ) -> Result<()> {
        let record = scenario.record()?;
        for searched in searched {
            let picture = searched.picture;
            let view = &record.views[picture.view];
            let mile = picture.distance_nm.floor() as i64;
            let candidate =
                |kind, found: Option<PixelBox>, note: String, rank, group: i64| Candidate {
                    kind,
                    scenario: record.id.clone(),
                    view: view.clone(),
                    tick: picture.tick,
                    distance_nm: picture.distance_nm,
                    truth: picture.truth.as_ref().map(|truth| truth.pixel_box),
                    found,
                    note,
                    rank,
                    alike: (format!("{}/{view}", record.id), group),
                };
            let scored = |score: f64| format!("score {score:.2}");
            match searched.outcome() {
                Some(Outcome::Found(hit)) => {
                    let (found, note) = (Some(hit.pixel_box), scored(hit.score));
                    self.take(candidate(
                        Kind::Hit,
                        found,
                        note,
                        -picture.distance_nm,
                        mile,
                    ));
                }
                Some(Outcome::Missed(reason)) if picture.sight == Sight::Open => {
                    let nearest = searched.boxes.first().map(|found| found.pixel_box);
                    let (note, rank) = (reason.to_owned(), picture.distance_nm.abs());
                    self.take(candidate(Kind::Miss, nearest, note, rank, mile));
                }
                _ => {}
            }
            for found in searched.false_boxes() {
                // Tracks count from 0, ticks too: the sign keeps them apart.
                let group = found.track.map_or(-1 - i64::from(picture.tick), i64::from);
                let (at, note) = (Some(found.pixel_box), scored(found.score));
                self.take(candidate(Kind::FalseAlarm, at, note, -found.score, group));
            }
        }
        Ok(())
    }

    fn take(&mut self, candidate: Candidate) {
        let kept = self.by_kind.entry(candidate.kind).or_default();
        if let Some(like) = kept.iter_mut().find(|kept| kept.alike == candidate.alike) {
            if candidate.rank < like.rank {
                *like = candidate;
            }
        } else if kept.len() < SHOWN {
            kept.push(candidate);
        } else if let Some(worst) = kept.iter_mut().max_by(|a, b| a.rank.total_cmp(&b.rank))
            && candidate.rank < worst.rank
        {
            *worst = candidate;
        }
    }

    /// Cuts the candidates out of the videos: hits, then misses, then false boxes, the best first.
    pub(crate) fn cut(self, corpus: &Corpus) -> Result<Vec<Example>> {
        let mut chosen: Vec<Candidate> = self.by_kind.into_values().flatten().collect();
        chosen.sort_by(|a, b| a.kind.cmp(&b.kind).then(a.rank.total_cmp(&b.rank)));
        let videos: BTreeSet<_> = chosen
            .iter()
            .map(|c| (c.scenario.clone(), c.view.clone()))
            .collect();
        let mut cut: Vec<Option<Example>> = chosen.iter().map(|_| None).collect();
        for (id, view) in videos {
            let mut here: Vec<usize> = (0..chosen.len())
                .filter(|&index| chosen[index].scenario == id && chosen[index].view == view)
                .collect();
            here.sort_by_key(|&index| chosen[index].tick);
            let mut reader = corpus.scenario(&id).open()?.open_video(&view)?;
            let (mut next_tick, mut rgb) = (0, Vec::new());
            for index in here {
                let candidate = &chosen[index];
                while next_tick < candidate.tick {
                    reader.skip_frame()?;
                    next_tick += 1;
                }
                if next_tick == candidate.tick {
                    reader.next_frame(&mut rgb)?;
                    next_tick += 1;
                }
                let size = [reader.width(), reader.height()];
                cut[index] = Some(Example::of(candidate, &rgb, size)?);
            }
        }
        Ok(cut.into_iter().flatten().collect())
    }
}

impl Example {
    fn of(candidate: &Candidate, rgb: &[u8], picture: [u32; 2]) -> Result<Self> {
        let Candidate {
            kind, truth, found, ..
        } = *candidate;
        // A miss is shown where the aircraft is.
        let shown = match kind {
            Kind::Miss => truth.or(found),
            Kind::Hit | Kind::FalseAlarm => found,
        };
        let around = shown.unwrap_or(PixelBox::from_edges(0.0, 0.0, 0.0, 0.0));
        let crop = Crop::around(&around, rgb, picture)?;
        Ok(Self {
            kind,
            truth: truth.map(|truth| crop.frame_of(&truth)),
            found: found.map(|found| crop.frame_of(&found)),
            place: format!(
                "{:.1} NM; {}, {}, tick {}",
                candidate.distance_nm, candidate.scenario, candidate.view, candidate.tick
            ),
            note: candidate.note.clone(),
            crop,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(rank: f64, group: i64) -> Candidate {
        Candidate {
            kind: Kind::Miss,
            scenario: "1200-clear-r1".into(),
            view: "left".into(),
            tick: 0,
            distance_nm: rank,
            truth: Some(PixelBox::from_edges(100.0, 40.0, 120.0, 47.0)),
            found: None,
            note: "nothing".into(),
            rank,
            alike: ("1200-clear-r1/left".into(), group),
        }
    }

    #[test]
    fn the_best_of_a_kind_are_kept_one_of_each_mile_or_track() {
        let mut candidates = Candidates::default();
        for rank in [5.5, 5.1, 5.9] {
            candidates.take(candidate(rank, 5));
        }
        for mile in 6..20 {
            candidates.take(candidate(mile as f64, mile));
        }
        candidates.take(candidate(1.0, 1));
        let kept = &candidates.by_kind[&Kind::Miss];
        let mut ranks: Vec<_> = kept.iter().map(|kept| kept.rank).collect();
        ranks.sort_by(f64::total_cmp);
        assert_eq!(ranks, [1.0, 5.1, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
    }
}
