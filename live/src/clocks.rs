//! The clocks of all views: comparison with the first view's, their offsets, and the file that keeps these for the next start.

pub(crate) mod clock_offset;
pub(crate) mod free_clocks;
pub(crate) mod vertical_lag;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use dataset::files::json_file::{read_json, write_json};
use serde::{Deserialize, Serialize};
use sight::lag::Sighting;

use crate::clock::Tie;
use crate::clocks::clock_offset::{Offset, RECORDING_DRIFT_SD, STREAM_DRIFT_SD};
use crate::clocks::free_clocks::{FreeClock, MAX_SD_S, News};
use crate::error::{Error, Result};
use crate::options::Options;
use crate::source::Source;

/// Offsets that an earlier start stored, for a single run.
#[derive(Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredOffsets {
    /// BLAKE3 of the run, whose cameras they are measured with.
    run: String,
    views: BTreeMap<String, StoredOffset>,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredOffset {
    /// Sources of the first view and of this one, without secrets.
    sources: [String; 2],
    /// Tie of the clocks that the offset belongs to.
    #[serde(default)]
    tie: Tie,
    offset: Offset,
}

impl StoredOffsets {
    /// Reads the file, if it exists. A different run, different cameras and impossible numbers are refused.
    fn read(
        path: &Path,
        run: &str,
        sources: &[Option<[String; 2]>],
        names: &[String],
    ) -> Result<Self> {
        if !path.exists() {
            return Ok(Self {
                run: run.into(),
                ..Self::default()
            });
        }
        let refused = |why: String| {
            Error::Views(format!(
                "--keep-offsets {}: {why}; name another file, or remove this one to measure the offset again",
                path.display()
            ))
        };
        let kept: Self = read_json(path, "file of kept offsets").map_err(|error| {
            if error.is_bad_content() {
                refused(error.to_string())
            } else {
                error.into()
            }
        })?;
        if kept.run != run {
            return Err(refused(format!(
                "it is of the run {}, and this one is {run}",
                kept.run
            )));
        }
        for (name, here) in names.iter().zip(sources) {
            let (Some(of_view), Some(here)) = (kept.views.get(name), here) else {
                continue;
            };
            if of_view.sources != *here {
                let [first, other] = &of_view.sources;
                return Err(refused(format!(
                    "its offset of view {name} is between {first} and {other}, and now the sources are {} and {}",
                    here[0], here[1]
                )));
            }
            if !of_view.offset.is_sound() {
                return Err(refused(format!(
                    "its offset of view {name} cannot be one that was measured, because its standard deviations are not positive"
                )));
            }
        }
        Ok(kept)
    }
}

/// The clocks of all views.
#[derive(Debug)]
pub(crate) struct Clocks {
    names: Vec<String>,
    /// Clocks by view and by their tie to the first view; none for the first view and for views with a given offset.
    clocks: BTreeMap<(usize, Tie), FreeClock>,
    /// The clocks that are in use.
    ties: Vec<Tie>,
    /// Sources of the first view and of this one; `None` without both sources, or if the offset is given.
    sources: Vec<Option<[String; 2]>>,
    had_images: Vec<bool>,
    kept: StoredOffsets,
    file: Option<PathBuf>,
}

impl Clocks {
    /// Clocks that are compared where no offset is given.
    ///
    /// # Errors
    /// The stored offsets cannot be read, or belongs to a different run or to different cameras.
    pub(crate) fn of(options: &Options) -> Result<Self> {
        let run = &options.run;
        let names = run.views();
        let shown = |name: &String| options.sources.get(name).map(Source::identity);
        let pair = |name: &String| Some([shown(names.first()?)?, shown(name)?]);
        let is_given = |name: &String| options.offsets_s.contains_key(name);
        let compared = names
            .iter()
            .map(|name| pair(name).filter(|_| !is_given(name)));
        let sources: Vec<Option<[String; 2]>> = compared.collect();
        let file = options.keep_offsets.clone();
        let kept = match &file {
            Some(path) => StoredOffsets::read(path, run.blake3(), &sources, names)?,
            None => StoredOffsets::default(),
        };
        let clock = |(view, name): (usize, &String), tie: Tie| {
            let cameras = [0, view].map(|view| run.camera(view));
            let drift_sd = if options.measured.contains(name) {
                RECORDING_DRIFT_SD
            } else {
                STREAM_DRIFT_SD
            };
            let of_view = kept.views.get(name).filter(|of_view| of_view.tie == tie);
            let known = of_view.map(|of_view| of_view.offset);
            let expected = known.or_else(|| (tie == Tie::Senders).then(Offset::of_senders));
            let clock = FreeClock::of(cameras, expected, drift_sd);
            ((view, tie), clock)
        };
        let compared = (names.iter().enumerate().skip(1)).filter(|(_, name)| !is_given(name));
        Ok(Self {
            had_images: vec![false; names.len()],
            clocks: compared
                .flat_map(|view| [Tie::Senders, Tie::Free].map(|tie| clock(view, tie)))
                .collect(),
            ties: vec![Tie::Common; names.len()],
            names: names.to_vec(),
            sources,
            kept,
            file,
        })
    }

    fn clock(&self, view: usize) -> Option<&FreeClock> {
        self.clocks.get(&(view, self.ties[view]))
    }

    /// True if a view's times can be compared with the first view's.
    pub(crate) fn is_known(&self, view: usize) -> bool {
        self.clock(view).is_none_or(FreeClock::is_known)
    }

    /// The best offset of a view, although it may not be in use; `None` if nothing is known.
    pub(crate) fn best(&self, view: usize, time_s: f64) -> Option<Offset> {
        self.clock(view)?.best(time_s)
    }

    /// Standard deviation of a view's offset that is in use, s.
    pub(crate) fn error_s(&self, view: usize, time_s: f64) -> f64 {
        let clock = self.clock(view);
        clock
            .and_then(|clock| clock.error_s(time_s))
            .unwrap_or_default()
    }

    /// The first image of every connection; later connections may have a different delay.
    pub(crate) fn connected(&mut self, view: usize, time_s: f64) {
        if !std::mem::replace(&mut self.had_images[view], true) {
            return;
        }
        self.clocks_of(view).for_each(|clock| clock.restart(time_s));
    }

    /// A view's camera looks elsewhere from now on.
    pub(crate) fn turned(&mut self, view: usize) {
        self.clocks_of(view).for_each(FreeClock::forget_arrival);
    }

    /// The clocks that are compared by a view's images.
    fn clocks_of(&mut self, view: usize) -> impl Iterator<Item = &mut FreeClock> {
        let all = self.clocks.iter_mut();
        all.filter_map(move |((other, _), clock)| (view == 0 || view == *other).then_some(clock))
    }

    /// Takes an aircraft that the first view and a different one see at the same time. `tie`: what ties their clocks now.
    pub(crate) fn take(
        &mut self,
        (view, tie): (usize, Tie),
        time_s: f64,
        sighting: Option<Sighting>,
    ) -> Option<News> {
        let is_other = std::mem::replace(&mut self.ties[view], tie) != tie;
        let clock = self.clocks.get_mut(&(view, tie))?;
        if is_other {
            clock.resume();
        }
        let news = clock.take(time_s, sighting);
        if let Some(News::Known(offset)) = news
            && clock.has_measured()
        {
            self.keep(view, offset);
        }
        news
    }

    /// The offsets that the last arrivals told, by view.
    pub(crate) fn at_end(&mut self) -> Vec<(usize, Offset)> {
        let in_use = |(view, tie): (usize, Tie)| self.ties[view] == tie;
        let clocks = self.clocks.iter_mut().filter(|(of, _)| in_use(**of));
        let ends = clocks.filter_map(|((view, _), clock)| Some((*view, clock.at_end()?)));
        let ends: Vec<(usize, Offset)> = ends.collect();
        for (view, offset) in &ends {
            self.keep(*view, *offset);
        }
        ends
    }

    fn keep(&mut self, view: usize, offset: Offset) {
        let Some(sources) = self.sources[view].clone() else {
            return;
        };
        let of_view = StoredOffset {
            sources,
            tie: self.ties[view],
            offset,
        };
        self.kept.views.insert(self.names[view].clone(), of_view);
        let written = self.file.as_ref().map(|path| write_json(path, &self.kept));
        if let Some(Err(error)) = written {
            tracing::warn!(
                "the offset of view {} is not kept: {error}",
                self.names[view]
            );
        }
    }
}

/// A view's clock at a tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ComparedClock {
    pub(crate) tie: Tie,
    /// True if its times can be compared with the first view's.
    pub(crate) is_known: bool,
    pub(crate) sees_aircraft: bool,
}

/// Views whose times cannot be compared with those of the views that count: the first one with all known ones, or a view alone. Of those
/// that see an aircraft, the strongest tie counts, because nothing says how late the images of a free clock are.
pub(crate) fn out_of_time(clocks: &[ComparedClock]) -> Vec<usize> {
    let is_first = |view: usize| view == 0 || clocks[view].is_known;
    let are_together = |a: usize, b: usize| a == b || is_first(a) && is_first(b);
    let sees = |view: usize| {
        (0..clocks.len()).any(|other| are_together(view, other) && clocks[other].sees_aircraft)
    };
    let groups = (0..clocks.len()).filter(|&view| view == 0 || !is_first(view));
    let strongest = |view: usize| {
        let group = clocks.iter().enumerate();
        let group = group.filter(|(other, _)| are_together(view, *other));
        group.map(|(_, clock)| clock.tie).min()
    };
    let counting = groups.min_by_key(|&view| (!sees(view), strongest(view), view));
    let counting = counting.unwrap_or(0);
    let all = 0..clocks.len();
    all.filter(|&view| !are_together(view, counting)).collect()
}

/// The view whose clock is right, if one is: by it no image arrives before it was taken, and images are the newest. `delays_s`: shortest
/// times to the arrivals by each clock; `offsets_s`: what is to be added to each clock to have the first one's time; `before`: the last
/// one, which stays right until it is wrong by twice as much, because a change moves all times.
pub(crate) fn right_clock(delays_s: &[Option<f64>], offsets_s: &[f64], before: usize) -> usize {
    let shortest_s = |of: usize| {
        delays_s[of]?;
        let all = delays_s.iter().zip(offsets_s);
        let all = all.filter_map(|(delay_s, offset_s)| Some((*delay_s)? - offset_s));
        all.min_by(f64::total_cmp)
            .map(|shortest_s| shortest_s + offsets_s[of])
    };
    let limit_s = |of: usize| {
        if of == before {
            2.0 * MAX_SD_S
        } else {
            MAX_SD_S
        }
    };
    let all = (0..delays_s.len()).filter_map(|of| Some((of, shortest_s(of)?)));
    let possible = all.filter(|(of, shortest_s)| *shortest_s >= -limit_s(*of));
    let newest_s = possible.clone().map(|(_, shortest_s)| shortest_s);
    let newest_s = newest_s.fold(f64::INFINITY, f64::min);
    let as_new = possible.filter(|(of, shortest_s)| *shortest_s <= newest_s + limit_s(*of));
    let right = as_new.min_by_key(|(of, _)| (*of != before, *of));
    right.map_or(0, |(of, _)| of)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_that_is_right_lets_no_image_arrive_before_it_was_taken_and_none_late_without_need()
    {
        for (case, delays_s, offset_s, expected) in [
            ("both right", [0.02, 0.05], 0.01, 0),
            ("left fast", [-0.18, 0.02], 0.2, 1),
            ("right slow", [0.02, 0.22], 0.2, 0),
            ("right fast", [0.02, -0.18], -0.2, 0),
            ("left slow", [0.22, 0.02], -0.2, 1),
            ("right late, placed by its arrivals", [0.02, 0.0], -2.0, 0),
            ("left late, both placed by arrivals", [0.0, 0.0], 2.0, 1),
            ("left late, right with a right clock", [0.0, 0.02], 1.98, 1),
            ("our clock slow", [-0.1, -0.1], 0.0, 0),
        ] {
            let delays_s = delays_s.map(Some);
            let found = right_clock(&delays_s, &[0.0, offset_s], 0);
            assert_eq!(found, expected, "{case}");
        }
        assert_eq!(right_clock(&[None, None], &[0.0, 0.4], 0), 0, "recordings");
        assert_eq!(right_clock(&[None, Some(0.0)], &[0.0, 0.4], 0), 1);
    }

    #[test]
    fn a_clock_stays_right_while_offsets_change_by_less_than_they_are_uncertain() {
        let delays_s = [0.02, 0.02].map(Some);
        for before in [0, 1] {
            let offsets_s = [-0.035, -0.025, 0.025, 0.035];
            let right = offsets_s.map(|offset_s| right_clock(&delays_s, &[0.0, offset_s], before));
            assert_eq!(right, [before; 4]);
        }
        assert_eq!(right_clock(&delays_s, &[0.0, 0.2], 0), 1);
    }

    #[test]
    fn of_three_views_only_those_with_comparable_times_count_and_the_strongest_tie_first() {
        use Tie::{Free, Senders};
        let out = |clocks: [(Tie, bool, bool); 3]| {
            out_of_time(&clocks.map(|(tie, is_known, sees_aircraft)| ComparedClock {
                tie,
                is_known,
                sees_aircraft,
            }))
        };
        let first = (Free, true, true);
        assert!(out([first, (Free, true, true), (Senders, true, true)]).is_empty());
        assert_eq!(out([first, (Free, true, true), (Free, false, true)]), [2]);
        assert_eq!(
            out([first, (Senders, false, true), (Free, false, true)]),
            [0, 2],
            "a sender's clock"
        );
        assert_eq!(
            out([first, (Free, true, true), (Senders, false, false)]),
            [2],
            "one that sees nothing"
        );
        let unseen = (Free, true, false);
        assert_eq!(
            out([unseen, (Free, false, true), (Free, false, true)]),
            [0, 2],
            "without the first view"
        );
    }

    fn kept_for(run: &str, sources: [&str; 2]) -> Result<StoredOffsets> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("offsets.json");
        let offset = Offset {
            offset_s: 0.5,
            sd_s: 0.004,
            drift_ppm: 0.0,
            drift_sd_ppm: 10.0,
        };
        let of_view = StoredOffset {
            sources: ["a", "b"].map(Into::into),
            tie: Tie::Free,
            offset,
        };
        let kept = StoredOffsets {
            run: "this".into(),
            views: [("right".into(), of_view)].into(),
        };
        write_json(&path, &kept).unwrap();
        let names = ["left", "right"].map(Into::into);
        let [left, right] = sources.map(String::from);
        let sources = [None, Some([left, right])];
        StoredOffsets::read(&path, run, &sources, &names)
    }

    #[test]
    fn offsets_of_another_run_or_of_other_cameras_are_refused_with_what_to_do() {
        let kept = kept_for("this", ["a", "b"]).unwrap();
        assert_eq!(kept.views["right"].offset.offset_s, 0.5);
        for (run, sources, expected) in [
            ("other", ["a", "b"], "it is of the run this"),
            ("this", ["b", "a"], "is between a and b"),
        ] {
            let error = kept_for(run, sources).unwrap_err();
            assert!(error.is_bad_input(), "{error}");
            let said = error.to_string();
            assert!(
                said.contains(expected) && said.contains("remove this one"),
                "{said}"
            );
        }
    }
}
