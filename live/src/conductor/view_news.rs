//! View events: state changes and their causes.

use crate::clock::ClockSource;
use crate::output::Event;
use crate::view_state::ViewState;
use crate::views::feed::Report;

/// The view's last event, and the state of the source.
#[derive(Debug, Clone, Default)]
pub(crate) struct ViewNews {
    told: Option<ViewState>,
    told_clock: Option<ClockSource>,
    told_why: Option<String>,
    why: Option<String>,
    clock: Option<ClockSource>,
    has_ended: bool,
}

impl ViewNews {
    pub(crate) fn take(&mut self, report: Report) {
        match report {
            Report::Opened { .. } => {}
            Report::FirstImage { clock, .. } => (self.clock, self.why) = (Some(clock), None),
            Report::Clock(clock) => self.clock = Some(clock),
            Report::Lost(why) | Report::Useless(why) => self.why = Some(why),
            Report::Ended => {
                self.has_ended = true;
                self.why.get_or_insert("the recording is over".into());
            }
        }
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// The event, if the state, the loss's cause or the clock has changed. Views are down at first. `why_late`: reason if it is late.
    pub(crate) fn of(
        &mut self,
        time_s: f64,
        view: &str,
        state: ViewState,
        why_late: impl FnOnce() -> String,
    ) -> Option<Event> {
        // A view without images is down before its connection is given up, which tells why.
        let is_other_cause =
            state == ViewState::Down && self.why.is_some() && self.told_why != self.why;
        // While a view is down, its clock belongs to images that it has not shown yet.
        let is_other_clock = state != ViewState::Down && self.told_clock != self.clock;
        let is_told = self.told.unwrap_or(ViewState::Down) == state && !is_other_clock;
        if is_told && !is_other_cause {
            return None;
        }
        (self.told, self.told_clock) = (Some(state), self.clock);
        self.told_why = self.why.clone();
        let why = match state {
            ViewState::Late => Some(why_late()),
            _ => self.why_of(view, state),
        };
        let (clock, view) = (self.clock, view.to_owned());
        Some(Event::View {
            time_s,
            view,
            state,
            why,
            clock,
        })
    }

    fn why_of(&self, view: &str, state: ViewState) -> Option<String> {
        let why = match state {
            ViewState::Up | ViewState::Late => return None,
            // The connection is still open, so no cause is known yet.
            ViewState::Down => self.why.as_deref().unwrap_or("no images come"),
            ViewState::Moved => {
                return Some(format!(
                    "the camera looks elsewhere, and its images are not measured; once it stands still, they are compared with the training \
                     again, and if that fails, `dtd refit RUN --view {view}`"
                ));
            }
            ViewState::Frozen => "its images repeat, and are not measured",
            ViewState::Dark => "its images are black, and are not measured",
            ViewState::Damaged => "its images are damaged or of another size, and are not measured",
        };
        Some(why.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(news: &mut ViewNews, time_s: f64, state: ViewState) -> Option<Event> {
        news.of(time_s, "left", state, || "it is slow".into())
    }

    #[test]
    fn a_state_and_a_clock_are_told_once_and_a_view_that_is_down_from_the_beginning_with_its_fault()
    {
        let mut news = ViewNews::default();
        assert!(of(&mut news, 0.0, ViewState::Down).is_none());
        news.take(Report::Lost("nobody answers".into()));
        let event = of(&mut news, 1.0, ViewState::Down).unwrap();
        let Event::View { why, state, .. } = event else {
            panic!("{event:?}")
        };
        assert_eq!(
            (why.as_deref(), state),
            (Some("nobody answers"), ViewState::Down)
        );
        assert!(of(&mut news, 0.0, ViewState::Down).is_none());
        // It is reported before the state changes.
        news.take(Report::FirstImage {
            size_px: [1920, 1280],
            clock: ClockSource::Timestamps,
        });
        assert!(of(&mut news, 0.0, ViewState::Down).is_none());
        assert!(of(&mut news, 0.0, ViewState::Up).is_some());
        assert!(of(&mut news, 0.0, ViewState::Up).is_none());
        news.take(Report::Clock(ClockSource::Sender));
        let event = of(&mut news, 1.5, ViewState::Up).unwrap();
        let Event::View { clock, .. } = event else {
            panic!("{event:?}")
        };
        assert_eq!(clock, Some(ClockSource::Sender));
        assert!(of(&mut news, 0.0, ViewState::Up).is_none());
        let event = of(&mut news, 1.8, ViewState::Late).unwrap();
        assert!(format!("{event:?}").contains("it is slow"));
        let event = of(&mut news, 2.0, ViewState::Moved).unwrap();
        assert!(format!("{event:?}").contains("dtd refit RUN --view left"));
        let event = of(&mut news, 3.0, ViewState::Down).unwrap();
        assert!(format!("{event:?}").contains("no images come"));
        assert!(of(&mut news, 0.0, ViewState::Down).is_none());
        for cause in ["no image came for 2000 ms", "nobody answers"] {
            news.take(Report::Lost(cause.into()));
            let event = of(&mut news, 4.0, ViewState::Down).unwrap();
            assert!(format!("{event:?}").contains(cause));
            news.take(Report::Lost(cause.into()));
            assert!(of(&mut news, 0.0, ViewState::Down).is_none());
        }
    }
}
