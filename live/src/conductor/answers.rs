//! Answers about each aircraft, with their freshness, and without numbers that are out of date.

use std::collections::BTreeMap;
use std::time::SystemTime;

use chrono::{DateTime, SecondsFormat, Utc};
use trainer::live as online;

use crate::options::Pace;
use crate::output::{Answer, AnswerState, MAX_COASTING_S, MAX_FRESH_S};

pub(crate) struct Answers {
    views: Vec<String>,
    pace: Pace,
    /// State and phase of each aircraft that were written last.
    told: BTreeMap<u32, (AnswerState, &'static str)>,
}

impl Answers {
    pub(crate) fn new(views: Vec<String>, pace: Pace) -> Self {
        Self {
            views,
            pace,
            told: BTreeMap::new(),
        }
    }

    /// Answers at a time. `age_s`: current age of the images. A lost aircraft is reported once.
    pub(crate) fn of(
        &mut self,
        found: Vec<online::Answer>,
        time_s: f64,
        utc: Option<SystemTime>,
        age_s: f64,
    ) -> Vec<Answer> {
        let time_utc =
            utc.map(|utc| DateTime::<Utc>::from(utc).to_rfc3339_opts(SecondsFormat::Millis, true));
        let mut all: Vec<Answer> = Vec::new();
        for aircraft in &found {
            let state = self.state(aircraft, time_s, age_s);
            let told = (state, aircraft.phase.word());
            let before = self.told.insert(aircraft.aircraft, told);
            let was_lost = before.is_none_or(|(before, _)| before == AnswerState::Lost);
            if state == AnswerState::Lost && was_lost {
                continue;
            }
            let since_seen_s = (time_s - aircraft.seen_s).max(0.0);
            all.push(self.answer(aircraft, state, time_s, &time_utc, age_s + since_seen_s));
        }
        // The estimator has forgotten these.
        let is_known = |track: u32| found.iter().any(|answer| answer.aircraft == track);
        let told = std::mem::take(&mut self.told);
        for (track, (state, phase)) in told {
            if is_known(track) {
                self.told.insert(track, (state, phase));
            } else if state != AnswerState::Lost {
                all.push(Answer {
                    phase,
                    time_utc: time_utc.clone(),
                    ..Answer::lost(track, time_s, age_s)
                });
            }
        }
        all
    }

    fn state(&self, aircraft: &online::Answer, time_s: f64, age_s: f64) -> AnswerState {
        let age_s = match self.pace {
            Pace::AsFastAsPossible => 0.0,
            _ => age_s,
        };
        if age_s + (time_s - aircraft.seen_s).max(0.0) > MAX_COASTING_S {
            AnswerState::Lost
        } else if aircraft.views.is_empty() || age_s > MAX_FRESH_S {
            AnswerState::Coasting
        } else {
            AnswerState::Fresh
        }
    }

    fn answer(
        &self,
        aircraft: &online::Answer,
        state: AnswerState,
        time_s: f64,
        time_utc: &Option<String>,
        age_s: f64,
    ) -> Answer {
        let is_lost = state == AnswerState::Lost;
        let known = |stated: Option<online::Stated>| stated.filter(|_| !is_lost);
        let dtd = known(aircraft.dtd_m);
        let position = aircraft.position.filter(|_| !is_lost);
        let interval = dtd.and_then(|dtd| dtd.interval);
        Answer {
            phase: aircraft.phase.word(),
            dtd_m: dtd.map(|dtd| dtd.value),
            dtd_sd_m: dtd.and_then(|dtd| dtd.sd),
            dtd_from_m: interval.map(|[from, _]| from),
            dtd_to_m: interval.map(|[_, to]| to),
            ground_speed_mps: known(aircraft.ground_speed_mps).map(|stated| stated.value),
            time_to_touchdown_s: known(aircraft.time_to_touchdown_s).map(|stated| stated.value),
            latitude_deg: position.map(|(place, _)| place.latitude_deg),
            longitude_deg: position.map(|(place, _)| place.longitude_deg),
            height_m: position.map(|(place, _)| place.altitude_msl_m),
            position_sd_m: position.map(|(_, sd_m)| sd_m),
            views: (aircraft.views.iter())
                .map(|view| self.views[*view].clone())
                .collect(),
            state,
            time_utc: time_utc.clone(),
            ..Answer::lost(aircraft.aircraft, time_s, age_s)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_at(seen_s: f64, views: &[usize]) -> online::Answer {
        let stated = |value| {
            Some(online::Stated {
                value,
                sd: Some(1.0),
                interval: Some([value - 2.0, value + 2.0]),
            })
        };
        online::Answer {
            aircraft: 3,
            phase: online::Phase::Arrival,
            views: views.to_vec(),
            seen_s,
            dtd_m: stated(9_000.0),
            ground_speed_mps: stated(70.0),
            time_to_touchdown_s: stated(130.0),
            position: None,
            withheld: None,
        }
    }

    #[test]
    fn an_answer_is_fresh_then_coasting_then_lost_once_and_then_silent() {
        let mut answers = Answers::new(vec!["left".into(), "right".into()], Pace::Cameras);
        let fresh = answers.of(vec![seen_at(10.0, &[1])], 10.0, None, 0.05);
        assert_eq!(fresh[0].state, AnswerState::Fresh);
        assert_eq!(
            (fresh[0].dtd_m, &*fresh[0].views),
            (Some(9_000.0), &["right".to_owned()][..])
        );
        let coasting = answers.of(vec![seen_at(10.0, &[])], 12.0, None, 0.05);
        assert_eq!(coasting[0].state, AnswerState::Coasting);
        assert!((coasting[0].age_s - 2.05).abs() < 1e-9);
        let lost = answers.of(vec![seen_at(10.0, &[])], 15.1, None, 0.05);
        assert_eq!((lost[0].state, lost[0].dtd_m), (AnswerState::Lost, None));
        assert!(
            answers
                .of(vec![seen_at(10.0, &[])], 15.2, None, 0.05)
                .is_empty()
        );
        assert_eq!(
            answers.of(vec![seen_at(20.0, &[0])], 20.0, None, 0.0).len(),
            1
        );
        let gone = answers.of(Vec::new(), 21.0, None, 0.0);
        assert_eq!((gone[0].state, gone[0].track), (AnswerState::Lost, 3));
        assert!(answers.of(Vec::new(), 22.0, None, 0.0).is_empty());
    }

    #[test]
    fn images_that_are_older_than_a_third_of_a_second_give_no_fresh_answer_and_after_five_none() {
        let mut answers = Answers::new(vec!["left".into()], Pace::Cameras);
        let late = answers.of(vec![seen_at(10.0, &[0])], 10.0, None, 0.31);
        assert_eq!(late[0].state, AnswerState::Coasting);
        let lost = answers.of(vec![seen_at(11.0, &[0])], 11.0, None, 5.1);
        assert_eq!(lost[0].state, AnswerState::Lost);
    }
}
