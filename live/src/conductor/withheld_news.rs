//! Events about views that see an aircraft without a distance, and the reasons.

use trainer::live::{Answer, MIN_WITHHELD_S, Phase};

use crate::output::{Event, MAX_COASTING_S, Reason};

/// Shortest time between two reports for a view, s.
const EACH_S: f64 = 20.0;

/// Content of a view at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Sees {
    /// No aircraft, or the view cannot be measured.
    Nothing,
    /// An aircraft.
    Aircraft,
    /// An aircraft whose boxes do not reach the estimator.
    LeftOut(Reason),
}

impl Sees {
    /// The reason if the aircraft has no distance. `unlike`: its boxes are unlike the training's.
    fn reason(self, view: usize, found: &[Answer], unlike: bool) -> Option<Reason> {
        match self {
            Self::Nothing => return None,
            Self::LeftOut(reason) => return Some(reason),
            Self::Aircraft => {}
        }
        let using = || found.iter().filter(|answer| answer.views.contains(&view));
        let withheld = found.iter().filter_map(|answer| answer.withheld.as_ref());
        let mut withheld = withheld.filter(|of| of.views.contains(&view));
        if using().any(|answer| answer.dtd_m.is_some()) {
            None
        } else if let Some(withheld) = withheld.next() {
            Some(Reason::Contradicts(withheld.cause))
        } else if using().next().is_none() {
            Some(if unlike {
                Reason::Unlike
            } else {
                Reason::Unpaired
            })
        } else {
            // Other phases have no distance.
            let arrives = using().any(|answer| answer.phase == Phase::Arrival);
            arrives.then_some(Reason::NoDistance)
        }
    }
}

/// Events of a view.
#[derive(Debug, Clone, Default)]
pub(crate) struct WithheldNews {
    /// When it last saw an aircraft.
    seen_s: f64,
    /// The reason, and since when it lasts.
    lasting: Option<(Reason, f64)>,
    /// The reason that was told, unless it is over.
    told: Option<Reason>,
    told_s: Option<f64>,
}

impl WithheldNews {
    /// The event if a reason has lasted, or is over. `name`, `view`: the view's; `unlike`: its boxes are unlike the training's.
    pub(crate) fn next(
        &mut self,
        time_s: f64,
        (name, view): (&str, usize),
        (sees, unlike): (Sees, bool),
        found: &[Answer],
    ) -> Option<Event> {
        if sees != Sees::Nothing {
            self.seen_s = time_s;
        } else if time_s - self.seen_s <= MAX_COASTING_S {
            // It may have been missed in this image.
            return None;
        }
        let event = |reason: Option<Reason>| Event::Withheld {
            time_s,
            view: name.to_owned(),
            reason: reason.map(|reason| reason.name()),
            why: reason.map(|reason| reason.why()),
        };
        let Some(reason) = sees.reason(view, found, unlike) else {
            self.lasting = None;
            return self.told.take().map(|_| event(None));
        };
        let is_same = |of: &Reason| of.name() == reason.name();
        let since_s = match self.lasting {
            Some((before, since_s)) if is_same(&before) => since_s,
            _ => time_s,
        };
        self.lasting = Some((reason, since_s));
        // A contradiction has lasted before it is one.
        let is_contradiction = matches!(reason, Reason::Contradicts(_));
        let is_due = is_contradiction
            || time_s - since_s >= MIN_WITHHELD_S
                && self.told_s.is_none_or(|told_s| time_s - told_s >= EACH_S);
        let is_due = is_due && !self.told.as_ref().is_some_and(is_same);
        is_due.then(|| {
            (self.told, self.told_s) = (Some(reason), Some(time_s));
            event(Some(reason))
        })
    }
}

#[cfg(test)]
mod tests {
    use trainer::live::{Cause, Evidence, Stated, Withheld};

    use super::*;

    fn answer(views: &[usize], dtd_m: Option<f64>) -> Answer {
        Answer {
            aircraft: 3,
            phase: Phase::Arrival,
            views: views.to_vec(),
            seen_s: 0.0,
            dtd_m: dtd_m.map(|value| Stated {
                value,
                sd: None,
                interval: None,
            }),
            ground_speed_mps: None,
            time_to_touchdown_s: None,
            position: None,
            withheld: None,
        }
    }

    /// Events of the right view while it sees this for some seconds: time and reason.
    fn told(
        news: &mut WithheldNews,
        [from_s, to_s]: [u32; 2],
        sees: Sees,
        found: &[Answer],
    ) -> Vec<(f64, Option<&'static str>)> {
        let seconds = (from_s..to_s).map(f64::from);
        let events =
            seconds.filter_map(|time_s| news.next(time_s, ("right", 1), (sees, false), found));
        let parts = events.map(|event| match event {
            Event::Withheld {
                time_s,
                view,
                reason,
                why,
            } => {
                assert_eq!((&*view, why.is_some()), ("right", reason.is_some()));
                (time_s, reason)
            }
            event => panic!("{event:?}"),
        });
        parts.collect()
    }

    #[test]
    fn a_reason_is_told_within_twenty_seconds_once_while_it_lasts_and_its_end_as_well() {
        let mut news = WithheldNews::default();
        let clock = Sees::LeftOut(Reason::Clock);
        let found = [answer(&[0], Some(9_000.0))];
        assert_eq!(told(&mut news, [0, 5], clock, &found), []);
        assert_eq!(told(&mut news, [5, 9], Sees::Nothing, &found), [], "missed");
        let begin = [(12.0, Some("clock"))];
        assert_eq!(told(&mut news, [9, 100], clock, &found), begin);
        // It is gone.
        assert_eq!(
            told(&mut news, [100, 120], Sees::Nothing, &[]),
            [(105.0, None)]
        );
        let begin = [(132.0, Some("clock"))];
        assert_eq!(told(&mut news, [120, 133], clock, &found), begin);
        let both = [answer(&[0, 1], Some(8_000.0))];
        assert_eq!(
            told(&mut news, [133, 140], Sees::Aircraft, &both),
            [(133.0, None)]
        );
        // The last reason was told at 132 s.
        let next = told(&mut news, [140, 160], Sees::LeftOut(Reason::Turned), &found);
        assert_eq!(next, [(152.0, Some("turned"))]);
    }

    #[test]
    fn an_aircraft_without_a_distance_has_the_estimators_reason_unless_it_does_not_arrive() {
        let cause = Cause {
            evidence: Evidence::Paths,
            deviations: 5.7,
            limit: 3.6,
        };
        let contradicts = Answer {
            withheld: Some(Withheld {
                views: vec![1],
                cause,
            }),
            ..answer(&[], None)
        };
        let mut news = WithheldNews::default();
        let found = [contradicts.clone()];
        let event = news.next(5.0, ("right", 1), (Sees::Aircraft, false), &found);
        assert!(event.is_some(), "it has lasted already");
        let departs = Answer {
            phase: Phase::Other,
            ..answer(&[1], None)
        };
        for (found, unlike, expected) in [
            (answer(&[0, 1], Some(9_000.0)), false, None),
            (answer(&[0, 1], None), false, Some("no_distance")),
            (departs, false, None),
            (answer(&[0], Some(9_000.0)), false, Some("unpaired")),
            (answer(&[0], Some(9_000.0)), true, Some("unlike")),
            (contradicts, false, Some("contradicts")),
        ] {
            let reason = Sees::Aircraft.reason(1, std::slice::from_ref(&found), unlike);
            assert_eq!(reason.map(|reason| reason.name()), expected, "{found:?}");
        }
        let why = Reason::Contradicts(cause).why();
        assert!(
            why.contains("5.7 joint") && why.contains("limit 3.6"),
            "{why}"
        );
    }
}
