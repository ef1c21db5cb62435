//! The recorded `RPOS` datagrams, and how a replay walks through them.

/// Positions sent to clients, and places to which clients moved the aircraft in between.
#[derive(Debug, Default)]
pub(super) struct Positions {
    steps: Vec<Step>,
    /// The step that comes next.
    at: usize,
    last: Option<usize>,
}

#[derive(Debug, PartialEq)]
enum Step {
    Sent(Vec<u8>),
    /// Placed by `PREL`, as it was sent.
    Placed(Vec<u8>),
}

impl Positions {
    /// The simulator sent a position on the tape.
    pub(super) fn add(&mut self, datagram: Vec<u8>) {
        self.steps.push(Step::Sent(datagram));
    }

    /// A client placed the aircraft on the tape.
    pub(super) fn add_placing(&mut self, datagram: &[u8]) {
        let placed = Step::Placed(datagram.to_owned());
        if self.steps.last() != Some(&placed) {
            self.steps.push(placed);
        }
    }

    /// Number of positions sent.
    pub(super) fn count(&self) -> usize {
        self.steps
            .iter()
            .filter(|step| matches!(step, Step::Sent(_)))
            .count()
    }

    /// A client places the aircraft; returns whether the tape has that. The positions after it come next.
    pub(super) fn place(&mut self, datagram: &[u8]) -> bool {
        let same = |step: &Step| matches!(step, Step::Placed(placed) if placed == datagram);
        let ahead = self.steps[self.at..]
            .iter()
            .position(same)
            .map(|steps| self.at + steps);
        let found = ahead.or_else(|| self.steps.iter().position(same));
        if let Some(found) = found {
            self.at = found + 1;
        }
        found.is_some()
    }

    /// The next position; the last one stays at the end of the tape. `None` if there are none.
    pub(super) fn next(&mut self) -> Option<&[u8]> {
        let ahead = self.steps[self.at..]
            .iter()
            .position(|step| matches!(step, Step::Sent(_)));
        if let Some(steps) = ahead {
            self.last = Some(self.at + steps);
            self.at += steps + 1;
        }
        match self.steps.get(self.last?)? {
            Step::Sent(datagram) => Some(datagram),
            Step::Placed(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_come_in_order_and_again_behind_the_same_placing() {
        let mut tape = Positions::default();
        tape.add(b"parked".to_vec());
        for (placed, sent) in [(b"here ", b"here1"), (b"there", b"there")] {
            tape.add_placing(placed);
            tape.add_placing(placed);
            tape.add(sent.to_vec());
        }
        assert_eq!(tape.count(), 3);
        assert!(tape.place(b"there"));
        assert_eq!(tape.next(), Some(&b"there"[..]));
        assert_eq!(tape.next(), Some(&b"there"[..]), "the last one stays");
        assert!(tape.place(b"here ") && !tape.place(b"nowhere"));
        assert_eq!(tape.next(), Some(&b"here1"[..]));
        assert_eq!(tape.next(), Some(&b"there"[..]));
    }
}
