//! Events about views that are not used for an aircraft, one for each aircraft.

use std::collections::BTreeSet;

use trainer::live::Answer;

use crate::output::Event;

/// Aircraft that have had an event.
#[derive(Debug, Clone, Default)]
pub(crate) struct WithheldNews {
    said: BTreeSet<u32>,
}

impl WithheldNews {
    /// Events for newly withheld aircraft. `views`: the names of all views.
    pub(crate) fn next(&mut self, time_s: f64, found: &[Answer], views: &[String]) -> Vec<Event> {
        let is_in_sight = |track: &u32| found.iter().any(|of| of.aircraft == *track);
        self.said.retain(is_in_sight);
        let withheld = found.iter().filter_map(|of| {
            let withheld = of.withheld.as_ref()?;
            self.said
                .insert(of.aircraft)
                .then_some((of.aircraft, withheld))
        });
        let events = withheld.map(|(track, withheld)| {
            let names = withheld.views.iter().map(|view| views[*view].clone());
            let (views, why) = (names.collect(), withheld.to_string());
            Event::Withheld {
                time_s,
                track,
                views,
                why,
            }
        });
        events.collect()
    }
}

#[cfg(test)]
mod tests {
    use trainer::live::{Evidence, Phase, Withheld};

    use super::*;

    fn seen(aircraft: u32, deviations: Option<f64>) -> Answer {
        Answer {
            aircraft,
            phase: Phase::Arrival,
            views: Vec::new(),
            seen_s: 0.0,
            dtd_m: None,
            ground_speed_mps: None,
            time_to_touchdown_s: None,
            position: None,
            withheld: deviations.map(|deviations| Withheld {
                views: vec![1],
                evidence: Evidence::Paths,
                deviations,
                limit: 9.0,
            }),
        }
    }

    #[test]
    fn each_aircraft_is_said_once_to_be_withheld_and_another_one_again() {
        let views = ["left".to_owned(), "right".to_owned()];
        let mut news = WithheldNews::default();
        assert_eq!(news.next(12.0, &[seen(3, None)], &views).len(), 0);
        let mut events = news.next(12.0, &[seen(3, Some(57.0)), seen(4, None)], &views);
        let event = events.pop().unwrap();
        assert!(events.is_empty());
        let Event::Withheld {
            time_s,
            track,
            views: named,
            why,
        } = event
        else {
            panic!("{event:?}")
        };
        assert_eq!((time_s, track, named), (12.0, 3, vec!["right".to_owned()]));
        assert!(
            why.contains("57.0 joint") && why.contains("limit 9.0"),
            "{why}"
        );
        assert_eq!(news.next(12.0, &[seen(3, Some(58.0))], &views).len(), 0);
        assert_eq!(news.next(12.0, &[seen(5, Some(58.0))], &views).len(), 1);
        // Out of sight and back under the same number.
        assert_eq!(news.next(12.0, &[seen(3, Some(58.0))], &views).len(), 1);
    }
}
