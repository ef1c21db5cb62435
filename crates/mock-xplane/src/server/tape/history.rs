//! The recorded values of datarefs, and how a replay walks through them.
//!
//! A dataref's history consists of its readings, with the writes and commands in between:
//!
//! ```text
//! 0.3 | write 0.5 | 0.5 | command a | 0.7 0.8
//! ```
//!
//! Reading gives the next value, and repeats the last one if a write or a command comes next: a client must send the same write or
//! command to get past it. So a client that repeats the recorded writes reads the recorded values, however often it reads. A write that
//! the tape does not have is not acknowledged: from then on the dataref reads as after the recorded write in its place, so that the client
//! can name the difference.
//!
//! The history is cut where a second client began to read during the recording: its readings are not for the first one, which may read on
//! for longer than it did then. Only a new reader gets past the cut.

use std::collections::BTreeMap;
use std::net::SocketAddr;

/// All datarefs on a tape.
#[derive(Debug, Default)]
pub(super) struct Histories {
    by_path: BTreeMap<String, History>,
}

#[derive(Debug, Default)]
struct History {
    steps: Vec<Step>,
    /// The client of the recording whose value was added last.
    recorded_reader: Option<u32>,
    /// The last reader in the replay.
    reader: Option<SocketAddr>,
    /// The step that comes next.
    at: usize,
    /// The value that was read last.
    last: Option<f32>,
}

#[derive(Debug, Clone, PartialEq)]
enum Step {
    Value(f32),
    Write(f32),
    Command(String),
    /// The next client reads from here on.
    OtherReader,
}

impl Histories {
    /// A client read a value on the tape. A repetition of the previous value is the same reading.
    pub(super) fn add_value(&mut self, client: u32, path: &str, value: f32) {
        let history = self.history(path);
        if history
            .recorded_reader
            .replace(client)
            .is_some_and(|before| before != client)
        {
            history.add(Step::OtherReader);
        }
        history.add(Step::Value(value));
    }

    /// A client wrote on the tape. A write repeated at once counts once.
    pub(super) fn add_write(&mut self, path: &str, value: f32) {
        self.history(path).add(Step::Write(value));
    }

    /// A client sent a command on the tape, which may have changed any dataref.
    pub(super) fn add_command(&mut self, command: &str) {
        for history in self.by_path.values_mut() {
            history.add(Step::Command(command.to_owned()));
        }
    }

    fn history(&mut self, path: &str) -> &mut History {
        self.by_path.entry(path.to_owned()).or_default()
    }

    /// True if a recorded client has read this dataref.
    pub(super) fn has(&self, path: &str) -> bool {
        self.by_path.get(path).is_some_and(History::has_values)
    }

    /// Number of datarefs that were read.
    pub(super) fn count(&self) -> usize {
        self.by_path
            .values()
            .filter(|history| history.has_values())
            .count()
    }

    /// A client reads.
    pub(super) fn read(&mut self, reader: SocketAddr, path: &str) -> Option<f32> {
        self.by_path.get_mut(path)?.read(reader)
    }

    /// The first value of this dataref on the tape.
    pub(super) fn first_value(&self, path: &str) -> Option<f32> {
        self.by_path.get(path)?.first_value()
    }

    /// A client writes; returns whether the tape has this write.
    pub(super) fn write(&mut self, path: &str, value: f32) -> bool {
        self.by_path
            .get_mut(path)
            .is_some_and(|history| history.write(value))
    }

    /// A client sends a command; returns whether the tape has it, here or later.
    pub(super) fn command(&mut self, command: &str) -> bool {
        let mut found = false;
        for history in self.by_path.values_mut() {
            found |= history.command(command);
        }
        found
    }
}

impl History {
    fn add(&mut self, step: Step) {
        if self.steps.last() != Some(&step) {
            self.steps.push(step);
        }
    }

    fn has_values(&self) -> bool {
        self.steps.iter().any(|step| matches!(step, Step::Value(_)))
    }

    fn first_value(&self) -> Option<f32> {
        self.steps.iter().find_map(|step| match step {
            Step::Value(value) => Some(*value),
            _ => None,
        })
    }

    /// Advances past the values left for the previous reader, if a different one reads now and no write came in between.
    fn turn_to(&mut self, reader: SocketAddr) {
        if self.reader == Some(reader) {
            return;
        }
        let is_first = self.reader.replace(reader).is_none();
        let left = self.steps[self.at..]
            .iter()
            .take_while(|step| matches!(step, Step::Value(_)))
            .count();
        if !is_first && self.steps.get(self.at + left) == Some(&Step::OtherReader) {
            self.at += left + 1;
        }
    }

    fn read(&mut self, reader: SocketAddr) -> Option<f32> {
        self.turn_to(reader);
        if let Some(Step::Value(value)) = self.steps.get(self.at) {
            self.at += 1;
            self.last = Some(*value);
        }
        // No value was read yet, and a write or command comes first: the value after it is the nearest there is.
        self.last.or_else(|| self.first_value())
    }

    fn write(&mut self, value: f32) -> bool {
        let same = |step: &Step| matches!(step, Step::Write(written) if written.to_bits() == value.to_bits());
        let (behind, ahead) = self.steps.split_at(self.at);
        let due = ahead
            .iter()
            .position(|step| !matches!(step, Step::Command(_) | Step::OtherReader));
        let due = due.filter(|&steps| same(&ahead[steps]));
        // Values read since the current write, if it is this one.
        let standing = behind
            .iter()
            .rposition(|step| matches!(step, Step::Write(_)));
        let standing = standing.filter(|&step| same(&behind[step]));
        let unread = standing.is_some_and(|step| {
            !behind[step..]
                .iter()
                .any(|step| matches!(step, Step::Value(_)))
        });
        let found = match due {
            Some(steps) => self.at + steps,
            // Written again before anything was read, as after a loss.
            None if unread => return true,
            None => match ahead.iter().position(same) {
                Some(steps) => self.at + steps,
                None => match standing {
                    // Past the last write of the tape: a client that repeats it reads again the values after it, not later ones.
                    Some(step) if !ahead.iter().any(|step| matches!(step, Step::Write(_))) => step,
                    Some(_) => return true,
                    None => match behind.iter().position(same) {
                        Some(step) => step,
                        None => {
                            self.stand_before_the_recorded_write();
                            return false;
                        }
                    },
                },
            },
        };
        self.at = found + 1;
        // The recorded client may have written several times before it read.
        if let Some(read_back) = self.read_back_after(found, same) {
            self.last = Some(read_back);
        }
        true
    }

    /// A client wrote something else: the dataref reads as it did after the write that comes next, or after the last one. The recorded
    /// write itself stays due.
    fn stand_before_the_recorded_write(&mut self) {
        let is_write = |step: &Step| matches!(step, Step::Write(_));
        let next = self.steps[self.at..].iter().position(is_write);
        let place = match next {
            Some(steps) => self.at + steps,
            None => match self.steps[..self.at].iter().rposition(is_write) {
                Some(step) => step,
                None => return,
            },
        };
        if let Step::Write(written) = self.steps[place] {
            let same = |step: &Step| matches!(step, Step::Write(other) if other.to_bits() == written.to_bits());
            self.last = self.read_back_after(place, same).or(Some(written));
            if next.is_some() {
                self.at = place;
            }
        }
    }

    /// The first value after a write, as long as the same value is written.
    fn read_back_after(&self, write: usize, same: impl Fn(&Step) -> bool) -> Option<f32> {
        for step in &self.steps[write..] {
            match step {
                Step::Value(value) => return Some(*value),
                Step::Write(_) if !same(step) => return None,
                _ => {}
            }
        }
        None
    }

    /// Values after a different command are not reached without that one.
    fn command(&mut self, command: &str) -> bool {
        let mut passed_another = false;
        for (ahead, step) in self.steps[self.at..].iter().enumerate() {
            match step {
                Step::Command(found) if found == command => {
                    self.at += ahead + 1;
                    return true;
                }
                Step::Command(_) => passed_another = true,
                Step::Write(_) => return false,
                Step::Value(_) | Step::OtherReader if passed_another => return false,
                Step::Value(_) | Step::OtherReader => {}
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use std::net::{IpAddr, Ipv4Addr};

    use super::*;

    const US: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 1);
    const LATER: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 2);

    fn recorded() -> Histories {
        let mut tape = Histories::default();
        tape.add_value(1, "a", 0.3);
        tape.add_value(1, "a", 0.3);
        tape.add_write("a", 0.5);
        tape.add_write("a", 0.5);
        tape.add_value(1, "a", 0.49);
        tape.add_command("go");
        tape.add_value(1, "a", 0.7);
        tape.add_value(1, "a", 0.8);
        tape.add_write("a", 0.5);
        tape.add_value(1, "a", 0.51);
        tape.add_write("b", 1.0);
        tape
    }

    #[test]
    fn a_client_that_does_the_same_reads_the_same_however_often_it_reads() {
        for times in [1, 5] {
            let mut tape = recorded();
            let mut read = || {
                let mut last = None;
                (0..times).for_each(|_| last = tape.read(US, "a"));
                last
            };
            assert_eq!(read(), Some(0.3));
            assert!(tape.write("a", 0.5));
            assert_eq!(tape.read(US, "a"), Some(0.49));
            assert_eq!(
                tape.read(US, "a"),
                Some(0.49),
                "without the command nothing changes"
            );
            assert!(tape.command("go"));
            assert_eq!(tape.read(US, "a"), Some(0.7));
            assert_eq!(tape.read(US, "a"), Some(0.8));
            assert_eq!(tape.read(US, "a"), Some(0.8));
            assert!(tape.write("a", 0.5));
            assert_eq!(tape.read(US, "a"), Some(0.51));
        }
    }

    #[test]
    fn a_write_repeated_before_it_is_read_does_not_run_ahead() {
        let mut tape = Histories::default();
        for later in [10.1, 10.2] {
            tape.add_write("clock", 10.0);
            tape.add_command("regenerate");
            tape.add_write("clock", 10.0);
            tape.add_value(1, "clock", later);
        }
        for _ in 0..3 {
            assert!(tape.write("clock", 10.0));
        }
        // The repetition may count as the second write or the first: either way the command does not change any value that is read.
        tape.command("regenerate");
        assert!(tape.write("clock", 10.0));
        assert_eq!(tape.read(US, "clock"), Some(10.1));
        assert!(tape.write("clock", 10.0));
        assert!(tape.command("regenerate"));
        assert!(tape.write("clock", 10.0));
        assert_eq!(tape.read(US, "clock"), Some(10.2));
    }

    #[test]
    fn a_command_of_later_does_not_run_past_one_that_is_due() {
        let mut tape = Histories::default();
        tape.add_value(1, "mode", 0.0);
        tape.add_command("servos");
        tape.add_value(1, "mode", 2.0);
        tape.add_command("regenerate");
        tape.add_value(1, "mode", 5.0);
        tape.command("regenerate");
        assert_eq!(tape.read(US, "mode"), Some(0.0));
        assert!(tape.command("servos"));
        assert_eq!(tape.read(US, "mode"), Some(2.0));
        assert!(tape.command("regenerate"));
        assert_eq!(tape.read(US, "mode"), Some(5.0));
    }

    #[test]
    fn what_a_later_client_read_is_for_a_later_client() {
        let mut tape = Histories::default();
        tape.add_write("clock", 10.0);
        for value in [10.0, 10.0, 10.0] {
            tape.add_value(1, "clock", value);
        }
        for value in [12.8, 12.9] {
            tape.add_value(2, "clock", value);
        }
        for pass in ["first", "second"] {
            assert!(tape.write("clock", 10.0));
            for _ in 0..20 {
                assert_eq!(tape.read(US, "clock"), Some(10.0), "{pass}");
            }
        }
        assert_eq!(tape.read(LATER, "clock"), Some(12.8));
        assert_eq!(tape.read(LATER, "clock"), Some(12.9));
        assert_eq!(tape.first_value("clock"), Some(10.0));
    }

    #[test]
    fn the_last_write_of_a_tape_reads_back_in_every_pass_although_the_clock_ran_on_after_it() {
        let mut tape = Histories::default();
        tape.add_write("clock", 10.0);
        tape.add_value(1, "clock", 10.0);
        tape.add_command("go on");
        tape.add_value(1, "clock", 10.05);
        for _ in 0..3 {
            assert!(tape.write("clock", 10.0));
            for _ in 0..3 {
                assert_eq!(tape.read(US, "clock"), Some(10.0));
            }
            assert!(tape.command("go on"));
            assert_eq!(tape.read(US, "clock"), Some(10.05));
        }
    }

    #[test]
    fn what_is_not_on_the_tape_is_not_acknowledged() {
        let mut tape = recorded();
        assert_eq!(tape.read(US, "a"), Some(0.3));
        for _ in 0..3 {
            assert!(!tape.write("a", 0.6));
            assert_eq!(
                tape.read(US, "a"),
                Some(0.49),
                "as after the write in its place"
            );
        }
        assert!(tape.write("a", 0.5), "which stays due");
        assert_eq!(tape.read(US, "a"), Some(0.49));
        assert!(!tape.command("stop"));
        assert!(!tape.has("b"), "written, but never read");
        assert!(!tape.has("c") && tape.read(US, "c").is_none() && !tape.write("c", 1.0));
        assert_eq!(tape.count(), 1);
    }

    #[test]
    fn a_second_pass_over_the_tape_finds_its_writes_again() {
        let mut tape = recorded();
        tape.add_write("a", 0.9);
        tape.add_value(1, "a", 0.9);
        assert!(tape.write("a", 0.9));
        assert_eq!(tape.read(US, "a"), Some(0.9));
        assert!(tape.write("a", 0.9), "again, as after a loss");
        assert_eq!(tape.read(US, "a"), Some(0.9));
        assert!(tape.write("a", 0.5));
        assert_eq!(tape.read(US, "a"), Some(0.49));
    }
}
