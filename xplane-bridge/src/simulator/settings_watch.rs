//! Checks, while a scenario is recorded, that the simulator is still the one that was set up.
//!
//! Every confirmed setting stays subscribed, and so does the simulator's running time. A restarted simulator has a shorter running
//! time and its own settings; both end the attempt with an error, before an image under other conditions can be mistaken for one of the
//! scenario.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use crate::datarefs::{DatarefWrite, RUNNING_TIME_S};
use crate::error::{BridgeError, reads};
use crate::udp::socket::SimulatorSocket;
use crate::udp::subscription::{Reading, SILENCE, Subscription};

/// Values per second of every dataref: nine of ten may be lost before SILENCE counts as silence.
const FREQUENCY_HZ: i32 = 4;
/// Datagrams are reordered by less than this. An older value is no evidence.
const OVERTAKING: Duration = Duration::from_secs(1);

/// Watches a simulator.
#[derive(Debug)]
pub(super) struct SettingsWatch {
    subscription: Subscription,
    judge: Judge,
}

/// The comparison. Pure.
#[derive(Debug)]
struct Judge {
    address: SocketAddr,
    /// The datarefs in the order of the readings; the first is [`RUNNING_TIME_S`].
    names: Vec<String>,
    expected: BTreeMap<String, DatarefWrite>,
    /// Readings from before this may show the state before the settings.
    expected_from: Instant,
    running: Option<Reading>,
}

impl SettingsWatch {
    /// Starts watching the datarefs of `writes`, without expectations yet.
    pub(super) fn begin(socket: &Arc<SimulatorSocket>, writes: &[DatarefWrite]) -> Self {
        let names: Vec<String> = std::iter::once(RUNNING_TIME_S.to_owned())
            .chain(writes.iter().map(|write| write.name.clone()))
            .collect();
        Self {
            subscription: Subscription::on(socket, names.clone(), FREQUENCY_HZ),
            judge: Judge::new(socket.simulator(), names),
        }
    }

    /// Watches these settings, which have just been confirmed; any other may change.
    pub(super) fn expect(&mut self, writes: impl IntoIterator<Item = DatarefWrite>) {
        self.judge.expect(writes, Instant::now());
    }

    pub(super) fn expected(&self) -> Vec<DatarefWrite> {
        self.judge.expected.values().cloned().collect()
    }

    /// Compares what arrived since the last call. Cheap if no value arrived.
    ///
    /// # Errors
    /// The simulator was restarted, or a setting was lost.
    pub(super) fn check(&mut self) -> Result<(), BridgeError> {
        if self.subscription.has_changed() {
            self.judge.check(&self.subscription.readings())
        } else {
            Ok(())
        }
    }
}

impl Judge {
    fn new(address: SocketAddr, names: Vec<String>) -> Self {
        Self {
            address,
            names,
            expected: BTreeMap::new(),
            expected_from: Instant::now(),
            running: None,
        }
    }

    fn expect(&mut self, writes: impl IntoIterator<Item = DatarefWrite>, now: Instant) {
        self.expected = writes
            .into_iter()
            .map(|write| (write.name.clone(), write))
            .collect();
        self.expected_from = now + OVERTAKING;
    }

    fn check(&mut self, readings: &[Option<Reading>]) -> Result<(), BridgeError> {
        if let Some(Some(running)) = readings.first() {
            self.check_running(*running)?;
        }
        for (name, reading) in self.names.iter().zip(readings) {
            if let (Some(write), Some(reading)) = (self.expected.get(name), reading)
                && reading.at >= self.expected_from
                && !write.is_met_by(reading.value)
            {
                return Err(setting_lost(write, Some(reading.value)));
            }
        }
        Ok(())
    }

    fn check_running(&mut self, now: Reading) -> Result<(), BridgeError> {
        if let Some(before) = self.running {
            // After a silence datagrams are no longer reordered: then the smallest step back means a restart.
            let tolerance_s = if now.at.duration_since(before.at) >= SILENCE {
                0.0
            } else {
                OVERTAKING.as_secs_f32()
            };
            if now.value < before.value - tolerance_s {
                return Err(BridgeError::Failed(format!(
                    "the simulator at {} was restarted: it runs for {:.1} s, and ran for {:.1} s before. What was set is lost; connect \
                     again and repeat the settings",
                    self.address, now.value, before.value
                )));
            }
            if now.value < before.value {
                return Ok(());
            }
        }
        self.running = Some(now);
        Ok(())
    }
}

/// A confirmed setting that has changed.
pub(super) fn setting_lost(write: &DatarefWrite, found: Option<f32>) -> BridgeError {
    BridgeError::Failed(format!(
        "dataref {} was set to {} and confirmed, but {} now. Was the simulator restarted, or does another program change it?",
        write.name,
        write.value,
        reads(found, "does not answer")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIND: &str = "sim/weather/region/wind_speed_msc[0]";

    fn judge(begin: Instant) -> Judge {
        let names = vec![RUNNING_TIME_S.to_owned(), WIND.to_owned()];
        let mut judge = Judge::new(([127, 0, 0, 1], 49_000).into(), names);
        judge.expect([DatarefWrite::new(WIND, 5.0)], begin);
        judge
    }

    /// Running time and wind at this time after the beginning.
    fn readings(begin: Instant, after_s: f32, running_s: f32, wind: f32) -> [Option<Reading>; 2] {
        let at = begin + Duration::from_secs_f32(after_s);
        [running_s, wind].map(|value| Some(Reading { value, at }))
    }

    #[test]
    fn a_setting_that_changes_is_named_but_not_one_from_before_it_was_set() {
        let begin = Instant::now();
        let mut judge = judge(begin);
        assert!(judge.check(&readings(begin, 0.5, 100.0, 0.0)).is_ok());
        assert!(judge.check(&readings(begin, 2.0, 101.5, 5.0)).is_ok());
        let error = judge
            .check(&readings(begin, 2.5, 102.0, 0.0))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(WIND) && error.contains("set to 5") && error.contains("reads 0"),
            "{error}"
        );
    }

    #[test]
    fn a_value_that_was_overtaken_is_no_restart_and_one_from_long_ago_is() {
        let begin = Instant::now();
        let mut judge = judge(begin);
        assert!(judge.check(&readings(begin, 2.0, 100.0, 5.0)).is_ok());
        assert!(judge.check(&readings(begin, 2.1, 99.5, 5.0)).is_ok());
        let error = judge.check(&readings(begin, 2.2, 3.0, 5.0)).unwrap_err();
        let restarted = "was restarted: it runs for 3.0 s, and ran for 100.0 s before";
        assert!(error.to_string().contains(restarted), "{error}");
    }

    #[test]
    fn after_a_silence_a_simulator_that_runs_a_little_less_long_was_restarted() {
        let begin = Instant::now();
        let mut judge = judge(begin);
        assert!(judge.check(&readings(begin, 0.0, 3.0, 5.0)).is_ok());
        let later = readings(begin, 3.0, 2.8, 5.0);
        let error = judge.check(&later).unwrap_err().to_string();
        assert!(error.contains("was restarted"), "{error}");
    }
}
