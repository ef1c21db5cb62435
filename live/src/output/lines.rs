//! Answers and events as lines of JSON, on a thread of their own: whoever reads them slowly delays nothing.

use std::io::{self, Write};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::output::metrics::Metrics;
use crate::output::{AnswerState, Line, MAX_COASTING_S, MAX_FRESH_S};
use crate::queue::{Queue, Taken, lock};

/// Maximum number of lines that wait for a reader; then the oldest is dropped.
const MAX_WAITING: usize = 2_000;
/// Interval between the writer's looks at an empty queue.
const WAIT: Duration = Duration::from_millis(500);

pub(crate) struct Lines {
    writer: Arc<Writer>,
    thread: JoinHandle<()>,
}

struct Writer {
    waiting: Queue<(Line, Instant)>,
    failure: Mutex<Option<io::Error>>,
    metrics: Arc<Metrics>,
    /// Time passes: answers grow older while they wait.
    is_timed: bool,
}

impl Lines {
    /// Writes lines to an output. `is_timed`: answers grow older while they wait for a reader.
    pub(crate) fn to(
        output: Box<dyn Write + Send>,
        metrics: Arc<Metrics>,
        is_timed: bool,
    ) -> Result<Self> {
        let writer = Arc::new(Writer {
            waiting: Queue::of(MAX_WAITING),
            failure: Mutex::default(),
            metrics,
            is_timed,
        });
        let of_thread = writer.clone();
        let thread = thread::Builder::new()
            .name("lines".into())
            .spawn(move || of_thread.run(output))
            .map_err(Error::Thread)?;
        Ok(Self { writer, thread })
    }

    /// Puts a line in the queue, at once.
    pub(crate) fn put(&self, line: Line) {
        let dropped = self.writer.waiting.put((line, Instant::now()));
        if dropped.is_some() {
            self.writer.metrics.count_dropped_line();
        }
    }

    /// False once the reader of the lines is gone.
    ///
    /// # Errors
    /// The output takes no more lines for a different reason.
    pub(crate) fn has_reader(&self) -> Result<bool> {
        match &*lock(&self.writer.failure) {
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
        self.writer.waiting.close();
        let until = Instant::now() + most;
        while !self.thread.is_finished() && Instant::now() < until {
            thread::sleep(Duration::from_millis(2));
        }
        self.has_reader().map(drop)
    }
}

impl Writer {
    fn run(&self, mut output: Box<dyn Write + Send>) {
        loop {
            let (line, since) = match self.waiting.take(WAIT) {
                Taken::Content(waited) => waited,
                Taken::Nothing => continue,
                Taken::Closed => return,
            };
            if let Err(failure) = self.write(&mut *output, line, since.elapsed()) {
                *lock(&self.failure) = Some(failure);
                return;
            }
        }
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
    use crate::output::{Answer, Event};

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
            lines.put(offset(number));
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
        lines.put(offset(1));
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
        lines.put(offset(1));
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
            dtd_m: Some(9_000.0),
            state,
            ..Answer::lost(1, 10.0, age_s)
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
