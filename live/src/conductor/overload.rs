//! Reports of images that were not searched, and of lines that no reader took.

use crate::output::Event;
use crate::output::metrics::{Fate, Metrics};

/// Seconds between two reports.
const REPORT_INTERVAL_S: f64 = 5.0;

pub(crate) struct Overload {
    reported_s: f64,
    not_searched: Vec<u64>,
    dropped_lines: u64,
}

impl Overload {
    pub(crate) fn of(views: usize) -> Self {
        Self {
            reported_s: 0.0,
            not_searched: vec![0; views],
            dropped_lines: 0,
        }
    }

    /// The event about the time since the last report, if a report is due. `time_s`: the event's time, `names`: names of the views.
    pub(crate) fn news(
        &mut self,
        [now_s, time_s]: [f64; 2],
        metrics: &Metrics,
        names: &mut dyn Iterator<Item = &String>,
    ) -> Option<Event> {
        if now_s < self.reported_s + REPORT_INTERVAL_S {
            return None;
        }
        self.reported_s = now_s;
        let mut not_searched = Vec::new();
        for (view, (name, before)) in names.zip(&mut self.not_searched).enumerate() {
            let now = metrics.images(view, Fate::Overload);
            not_searched.push((name.clone(), now - std::mem::replace(before, now)));
        }
        let now = metrics.dropped_lines();
        let dropped_lines = now - std::mem::replace(&mut self.dropped_lines, now);
        let is_news = dropped_lines > 0 || not_searched.iter().any(|(_, images)| *images > 0);
        is_news.then_some(Event::Overload {
            time_s,
            not_searched,
            dropped_lines,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overload_is_reported_once_and_not_without_cause() {
        let names = ["left".to_owned(), "right".to_owned()];
        let metrics = Metrics::new(String::new(), &names);
        let mut overload = Overload::of(2);
        let mut news = |now_s| overload.news([now_s; 2], &metrics, &mut names.iter());
        assert!(news(10.0).is_none());
        metrics.count(1, Fate::Overload);
        assert!(news(11.0).is_none(), "too soon");
        let event = news(16.0).unwrap();
        let Event::Overload { not_searched, .. } = event else {
            panic!("{event:?}")
        };
        assert_eq!(
            not_searched,
            [("left".to_owned(), 0), ("right".to_owned(), 1)]
        );
        assert!(news(22.0).is_none());
    }
}
