//! The simulators of a run, as the user names them: `mock`, `mock:2`, `127.0.0.1:49000`, or several separated by commas.

use std::str::FromStr;

use super::session::{AWKWARD, BadSimulator, MOST_STAND_INS, SimulatorTarget};

/// At least one simulator; each records its own scenarios.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulators(Vec<SimulatorTarget>);

impl Simulators {
    /// The simulators.
    pub(super) fn targets(&self) -> &[SimulatorTarget] {
        &self.0
    }
}

impl From<SimulatorTarget> for Simulators {
    fn from(target: SimulatorTarget) -> Self {
        Self(vec![target])
    }
}

impl From<Vec<SimulatorTarget>> for Simulators {
    fn from(targets: Vec<SimulatorTarget>) -> Self {
        Self(targets)
    }
}

impl FromStr for Simulators {
    type Err = BadSimulator;

    fn from_str(text: &str) -> Result<Self, BadSimulator> {
        let mut targets = Vec::new();
        for part in text.split(',').map(str::trim) {
            if let Some(number) = part.strip_prefix("mock:").filter(|_| part != AWKWARD) {
                let number: usize = number
                    .parse()
                    .ok()
                    .filter(|number| (1..=MOST_STAND_INS).contains(number))
                    .ok_or_else(|| BadSimulator::StandIns { text: part.into() })?;
                targets.extend(std::iter::repeat_n(SimulatorTarget::StandIn, number));
                continue;
            }
            let target: SimulatorTarget = part.parse()?;
            if target.runs_already() && targets.contains(&target) {
                return Err(BadSimulator::Twice { text: part.into() });
            }
            targets.push(target);
        }
        Ok(Self(targets))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(text: &str) -> usize {
        text.parse::<Simulators>().unwrap().targets().len()
    }

    #[test]
    fn one_or_several_are_read() {
        assert_eq!(number("mock"), 1);
        assert_eq!(number("mock:3"), 3);
        assert_eq!(number("mock:awkward,mock"), 2);
        assert_eq!(number("127.0.0.1:49000, 127.0.0.1:49100,mock:2"), 4);
    }

    #[test]
    fn a_slip_is_explained() {
        for (wrong, words) in [
            ("mock:0", "from 1"),
            ("mock:many", "mock:N"),
            ("127.0.0.1:49000,127.0.0.1:49000", "twice"),
            ("auto,auto", "twice"),
            ("127.0.0.1:49000,", "HOST:PORT"),
            ("mok", "HOST:PORT"),
        ] {
            let message = wrong.parse::<Simulators>().unwrap_err().to_string();
            assert!(message.contains(words), "{wrong}: {message}");
        }
    }
}
