//! A run's simulators, as the user names them: `mock`, `mock:2`, `127.0.0.1:49000`, or several separated by commas.

use std::str::FromStr;

use xplane_bridge::LocalUdp;

use crate::generate::session::{AWKWARD, BadSimulator, MAX_STAND_INS, SimulatorTarget};

/// List with at least one simulator; each records its own scenarios.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Simulators(Vec<SimulatorTarget>);

impl Simulators {
    pub(crate) fn targets(&self) -> &[SimulatorTarget] {
        &self.0
    }

    /// Number of those that run already: only they may be behind a firewall.
    pub fn running_already(&self) -> usize {
        self.0.iter().filter(|one| one.runs_already()).count()
    }

    /// Pairs each simulator with the local side of a UDP socket: running simulators get the chosen port and the ports after it; stand-ins
    /// and tapes end with this run, and need neither port nor note.
    pub(crate) fn with_local_udp<'a>(
        &'a self,
        local: &'a LocalUdp,
    ) -> impl Iterator<Item = (&'a SimulatorTarget, LocalUdp)> {
        let mut port = local.port;
        self.0.iter().map(move |target| {
            if !target.runs_already() {
                return (target, LocalUdp::default());
            }
            let own = LocalUdp {
                port,
                notes: local.notes.clone(),
            };
            port = port.map(|port| port.saturating_add(1));
            (target, own)
        })
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
                    .filter(|number| (1..=MAX_STAND_INS).contains(number))
                    .ok_or_else(|| {
                        BadSimulator::BadText(format!(
                            "{part:?}: expected mock:awkward, or mock:N with N from 1 to {MAX_STAND_INS}"
                        ))
                    })?;
                targets.extend(std::iter::repeat_n(SimulatorTarget::StandIn, number));
                continue;
            }
            let target: SimulatorTarget = part.parse()?;
            if target.runs_already() && targets.contains(&target) {
                return Err(BadSimulator::BadText(format!(
                    "{part} is named twice; a simulator makes one scenario at a time"
                )));
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
    fn simulators_that_run_already_have_ports_in_a_row_and_stand_ins_any() {
        let simulators: Simulators = "127.0.0.1:49000,mock,auto".parse().unwrap();
        assert_eq!(simulators.running_already(), 2);
        let local = LocalUdp {
            port: Some(50_000),
            notes: Some("state".into()),
        };
        let all: Vec<LocalUdp> = simulators
            .with_local_udp(&local)
            .map(|(_, local)| local)
            .collect();
        assert_eq!(all[0], local);
        assert_eq!(all[1], LocalUdp::default());
        assert_eq!(all[2].port, Some(50_001));
        assert!(all[2].notes.is_some());
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
