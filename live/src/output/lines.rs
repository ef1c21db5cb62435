//! Answers and events as lines of JSON, on a thread of their own: whoever reads them slowly delays nothing.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::conductor::answers::{MAX_COASTING_S, MAX_FRESH_S};
use crate::error::{Error, Result};
use crate::output::line::{AnswerState, Line};
use crate::output::metrics::Metrics;

/// Lines that wait for a reader; then the oldest is dropped.
const MAX_WAITING: usize = 2_000;

/// Output of lines.
pub(crate) struct Lines {
    queue: Arc<Queue>,
}

struct Queue {
    state: Mutex<State>,
    changed: Condvar,
    metrics: Arc<Metrics>,
    /// Time passes: answers grow older while they wait.
    is_timed: bool,
}

#[derive(Default)]
struct State {
    waiting: VecDeque<(Line, Instant)>,
    is_closed: bool,
    /// The writer took a line and has not written it yet.
    is_writing: bool,
    failure: Option<io::Error>,
}

impl Lines {
    /// Writes lines to an output. `is_timed`: answers grow older while they wait for a reader.
    pub(crate) fn to(
        output: Box<dyn Write + Send>,
        metrics: Arc<Metrics>,
        is_timed: bool,
    ) -> Result<Self> {
        let queue = Arc::new(Queue {
            state: Mutex::default(),
            changed: Condvar::new(),
            metrics,
            is_timed,
        });
        let of_thread = queue.clone();
        thread::Builder::new()
            .name("lines".into())
            .spawn(move || of_thread.write_to(output))
            .map_err(Error::Thread)?;
        Ok(Self { queue })
    }

    /// Puts a line in the queue, at once.
    pub(crate) fn put(&self, line: &Line) {
        let mut state = self.queue.lock();
        if state.waiting.len() >= MAX_WAITING {
            state.waiting.pop_front();
            self.queue.metrics.count_dropped_line();
        }
        state.waiting.push_back((line.clone(), Instant::now()));
        self.queue.changed.notify_all();
    }

    /// False once the reader of the lines is gone.
    ///
    /// # Errors
    /// The output takes no more lines for another reason.
    pub(crate) fn has_reader(&self) -> Result<bool> {
        match &self.queue.lock().failure {
            None => Ok(true),
            Some(failure) if failure.kind() == io::ErrorKind::BrokenPipe => Ok(false),
            Some(failure) => Err(Error::Output(copy_of(failure))),
        }
    }

    /// Waits until all lines are written, but not longer than this.
    ///
    /// # Errors
    /// The output takes no more lines, although somebody reads it.
    pub(crate) fn finish(self, most: Duration) -> Result<()> {
        let mut state = self.queue.lock();
        state.is_closed = true;
        self.queue.changed.notify_all();
        let is_busy = |state: &mut State| {
            state.failure.is_none() && (state.is_writing || !state.waiting.is_empty())
        };
        drop(self.queue.changed.wait_timeout_while(state, most, is_busy));
        self.has_reader().map(drop)
    }
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, output: &mut dyn Write, line: Line, waited: Duration) -> io::Result<()> {
        let waited_s = if self.is_timed {
            waited.as_secs_f64()
        } else {
            0.0
        };
        let Some(line) = aged(line, waited_s) else {
            self.metrics.count_dropped_line();
            return Ok(());
        };
        let text = serde_json::to_string(&line)?;
        writeln!(output, "{text}").and_then(|()| output.flush())
    }

    fn write_to(&self, mut output: Box<dyn Write + Send>) {
        let mut state = self.lock();
        loop {
            if let Some((line, since)) = state.waiting.pop_front() {
                state.is_writing = true;
                drop(state);
                let written = self.write(&mut *output, line, since.elapsed());
                state = self.lock();
                state.is_writing = false;
                state.failure = written.err();
                self.changed.notify_all();
                if state.failure.is_some() {
                    return;
                }
            } else if state.is_closed {
                return;
            } else {
                let waited = self.changed.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
            }
        }
    }
}

/// A line that waited for its reader: an answer is as old as it is now, and `None` if nobody should act on it any more.
fn aged(line: Line, waited_s: f64) -> Option<Line> {
    let Line::Answer(mut answer) = line else {
        return Some(line);
    };
    answer.age_s += waited_s;
    match answer.state {
        // It withdraws the ones before.
        AnswerState::Lost => {}
        _ if waited_s > MAX_COASTING_S => return None,
        AnswerState::Fresh if waited_s > 0.0 && answer.age_s > MAX_FRESH_S => {
            answer.state = AnswerState::Coasting;
        }
        AnswerState::Fresh | AnswerState::Coasting => {}
    }
    Some(Line::Answer(answer))
}

fn copy_of(error: &io::Error) -> io::Error {
    match error.raw_os_error() {
        Some(number) => io::Error::from_raw_os_error(number),
        None => error.kind().into(),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};

    use super::*;
    use crate::output::line::{Answer, Event};

    /// A reader that takes a line when it is told to.
    struct Slow(Receiver<()>, Sender<String>);

    impl Write for Slow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.recv().map_err(|_| io::ErrorKind::BrokenPipe)?;
            let _ = self.1.send(String::from_utf8_lossy(bytes).into_owned());
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn offset(number: u32) -> Line {
        Line::Event(Event::Offset {
            time_s: f64::from(number),
            view: "left".into(),
            offset_s: Some(0.5),
            sd_s: None,
            drift_ppm: None,
            drift_sd_ppm: None,
        })
    }

    #[test]
    fn a_reader_that_stops_delays_nothing_and_loses_the_oldest() {
        let metrics = Arc::new(Metrics::new(String::new(), &[]));
        let (_go, wait) = channel();
        let (texts, _read) = channel();
        let lines = Lines::to(Box::new(Slow(wait, texts)), metrics.clone(), true).unwrap();
        for number in 0..MAX_WAITING as u32 + 10 {
            lines.put(&offset(number));
        }
        // The writer holds one.
        assert!((9..=10).contains(&metrics.dropped_lines()));
        lines.finish(Duration::from_millis(10)).unwrap();
    }

    #[test]
    fn a_reader_that_is_gone_is_noticed() {
        let metrics = Arc::new(Metrics::new(String::new(), &[]));
        let (go, wait) = channel();
        let (texts, _read) = channel();
        let lines = Lines::to(Box::new(Slow(wait, texts)), metrics, true).unwrap();
        drop(go);
        lines.put(&offset(1));
        while lines.has_reader().unwrap() {
            thread::yield_now();
        }
        lines.finish(Duration::from_secs(60)).unwrap();
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_at_once_and_at_the_end() {
        let metrics = Arc::new(Metrics::new(String::new(), &[]));
        let full = std::fs::File::create("/dev/full").unwrap();
        let lines = Lines::to(Box::new(full), metrics, true).unwrap();
        lines.put(&offset(1));
        let error = loop {
            match lines.has_reader() {
                Ok(has_reader) => assert!(has_reader, "somebody could read it"),
                Err(error) => break error,
            }
            thread::yield_now();
        };
        assert!(!error.is_bad_input() && error.to_string().contains("No space"));
        lines.finish(Duration::from_secs(60)).unwrap_err();
    }

    fn answer(age_s: f64, state: AnswerState) -> Answer {
        Answer {
            time_s: 10.0,
            time_utc: None,
            track: 1,
            phase: "arrival",
            dtd_m: Some(9_000.0),
            dtd_sd_m: None,
            dtd_from_m: None,
            dtd_to_m: None,
            ground_speed_mps: None,
            time_to_touchdown_s: None,
            latitude_deg: None,
            longitude_deg: None,
            height_m: None,
            position_sd_m: None,
            views: vec!["left".into()],
            age_s,
            state,
        }
    }

    #[test]
    fn an_answer_that_waited_is_as_old_as_it_is_now_and_not_fresh_for_ever() {
        let after = |age_s, state, waited_s| {
            let line = aged(Line::Answer(Box::new(answer(age_s, state))), waited_s)?;
            let Line::Answer(answer) = line else {
                panic!("{line:?}")
            };
            Some((answer.state, (answer.age_s * 1e3).round() as i64))
        };
        let (fresh, coasting) = (AnswerState::Fresh, AnswerState::Coasting);
        assert_eq!(after(0.05, fresh, 0.1), Some((fresh, 150)));
        assert_eq!(after(0.05, fresh, 0.3), Some((coasting, 350)));
        assert_eq!(after(0.05, fresh, 5.1), None);
        assert_eq!(after(0.05, coasting, 5.1), None);
        let lost = AnswerState::Lost;
        assert_eq!(after(0.05, lost, 60.0), Some((lost, 60_050)));
        // Read as fast as possible, no answer is old.
        assert_eq!(after(9.0, fresh, 0.0), Some((fresh, 9_000)));
        assert!(aged(offset(1), 60.0).is_some());
    }

    #[test]
    fn an_event_names_itself_and_has_a_time() {
        let text = serde_json::to_string(&offset(3)).unwrap();
        assert_eq!(
            text,
            r#"{"event":"offset","time_s":3.0,"view":"left","offset_s":0.5,"sd_s":null,"drift_ppm":null,"drift_sd_ppm":null}"#
        );
    }
}
