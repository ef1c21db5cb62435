//! Fault injection for testing clients: a lossy network, a simulator that hangs, a simulator that restarts at any moment.
//!
//! Input: a text such as `loss=0.1,dup=0.05,restart=captures:20:2.5` or a [`Faults`]. The network's faults are in [`disorder`], the
//! simulator's in [`outages`], those of its start and end in [`life`], the cameras' in [`cameras`], and those of what a hosted plugin's
//! window shows in [`drawing`]. All randomness comes from a seed, and outages can be counted in frames or captures instead of seconds, so
//! that a test meets the same fault at the same point every time.

pub(super) mod cameras;
pub(super) mod disorder;
pub(super) mod drawing;
pub(super) mod life;
pub(super) mod outages;

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

pub use cameras::{AimChange, CameraFault, CameraFaultKind};
pub use drawing::{CodeFaults, Swing};
pub use life::LifeFaults;

/// Default downtime for restarts: slightly more than clients need to notice.
const DEFAULT_DOWN: Duration = Duration::from_secs(3);
/// The syntax of the text form, for messages.
const EXPECTED: &str = "loss=0..1, dup=0..1, reorder=0..1, seed=NUMBER, freeze=WHEN[:FOR_S], restart=WHEN[:DOWN_S], \
                        late=VIEW:MS[:AFTER_S], shake=VIEW:RMS_PX:HZ, stick=VIEW:SHARE, turn=VIEW:RIGHT_DEG:AFTER_S, tilt=VIEW:DOWN_DEG:AFTER_S, \
                        zoom=VIEW:PERCENT:AFTER_S, drift=VIEW:RIGHT_DEG:OVER_S, source=VIEW:OTHER, swing=THINGS:PERIOD_S:PX:LEVELS, \
                        repeat=0..1, vanish=0..1, half=0..1, insert=0..1, cold=SECONDS, held=SECONDS, menu=yes or asks=FILE, where WHEN is seconds, \
                        frames:N or captures:N and views count from 0";

/// The faults' words, and the form of each one's value.
const FORMS: [(&str, &str); 23] = [
    ("loss", "a ratio, 0 to 1"),
    ("dup", "a ratio, 0 to 1"),
    ("reorder", "a ratio, 0 to 1"),
    ("seed", "a whole number"),
    (
        "freeze",
        "AFTER_S[:FOR_S], frames:N[:FOR_S] or captures:N[:FOR_S]",
    ),
    (
        "restart",
        "AFTER_S[:DOWN_S], frames:N[:DOWN_S] or captures:N[:DOWN_S]",
    ),
    ("late", "VIEW:MS[:AFTER_S]"),
    ("shake", "VIEW:RMS_PX:HZ"),
    ("stick", "VIEW:SHARE, a share from 0 to 1"),
    ("turn", "VIEW:RIGHT_DEG:AFTER_S"),
    ("tilt", "VIEW:DOWN_DEG:AFTER_S"),
    ("zoom", "VIEW:PERCENT:AFTER_S, more than -100 percent"),
    ("drift", "VIEW:RIGHT_DEG:OVER_S, more than 0 seconds"),
    ("source", "VIEW:OTHER"),
    ("swing", "THINGS:PERIOD_S:PX:LEVELS, more than 0 each"),
    ("repeat", "a ratio, 0 to 1"),
    ("vanish", "a ratio, 0 to 1"),
    ("half", "a ratio, 0 to 1"),
    ("insert", "a ratio, 0 to 1"),
    ("cold", "a number of seconds"),
    ("held", "a number of seconds"),
    ("menu", "yes"),
    ("asks", "the path of a file"),
];

/// The faults. The default is none.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    /// Share of the UDP datagrams that get lost, each way, 0 to 1.
    pub loss: f64,
    /// Share of the UDP datagrams that are duplicated, each way, 0 to 1.
    pub duplication: f64,
    /// Share of the UDP datagrams that arrive after their successor, each way, 0 to 1.
    pub reordering: f64,
    /// Seed of the three above and of the cameras' faults.
    pub seed: u64,
    /// Failures of the simulator itself. Each outage happens once; any number may follow each other.
    pub outages: Vec<Outage>,
    /// Faults of the cameras; a view can have several. Only the built-in capture link has them.
    pub cameras: Vec<CameraFault>,
    /// Things that move slowly, even in a pause. Only a hosted plugin's images have them.
    pub swing: Option<Swing>,
    /// Faults of the numbers that a hosted plugin draws around its images.
    pub codes: CodeFaults,
    /// Faults of the process: how it starts and ends.
    pub life: LifeFaults,
}

/// A period without answers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outage {
    /// Begin of the outage.
    pub begins: Moment,
    /// Effect on clients.
    pub kind: OutageKind,
    /// Duration; `None` means forever.
    pub lasts: Option<Duration>,
}

/// Effect of outages on clients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutageKind {
    /// Sockets stay open, requests remain unanswered, simulated time stands still; then everything continues, including queued requests.
    Freeze,
    /// Connections close, datagrams are lost; then a new simulator runs on the same ports: datarefs, weather and frame numbers are
    /// at their initial values, subscriptions forgotten.
    Restart,
}

/// A moment in the life of the process, independent of restarts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// This long after the start. Not reproducible to the frame.
    After(Duration),
    /// The n-th simulated frame, counted from 1.
    Frame(u64),
    /// The n-th requested capture, counted from 1, which is the first one not to be answered in time.
    Capture(u64),
}

/// A text that describes no valid faults.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct FaultsError(String);

impl Faults {
    /// True if there are no faults.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// True if there are faults that only a hosted plugin's window shows.
    pub fn are_of_a_window(&self) -> bool {
        self.swing.is_some() || self.codes != CodeFaults::default()
    }

    /// Adds a fault; `None` if its value does not have the form of [`FORMS`].
    fn add(&mut self, key: &str, value: &str) -> Option<()> {
        let parts: Vec<&str> = value.split(':').collect();
        match (key, &parts[..]) {
            ("loss", [share]) => self.loss = ratio(share)?,
            ("dup", [share]) => self.duplication = ratio(share)?,
            ("reorder", [share]) => self.reordering = ratio(share)?,
            ("seed", [seed]) => self.seed = seed.parse().ok()?,
            ("freeze", when) => self.outages.push(outage(OutageKind::Freeze, when, None)?),
            ("restart", when) => {
                let outage = outage(OutageKind::Restart, when, Some(DEFAULT_DOWN))?;
                self.outages.push(outage);
            }
            ("swing", _) => self.swing = Some(value.parse().ok()?),
            ("repeat", [share]) => self.codes.repeated = ratio(share)?,
            ("vanish", [share]) => self.codes.vanished = ratio(share)?,
            ("half", [share]) => self.codes.half = ratio(share)?,
            ("insert", [share]) => self.codes.inserted = ratio(share)?,
            ("cold", [time]) => self.life.cold = seconds(time)?,
            ("held", [time]) => self.life.held = seconds(time)?,
            ("menu", ["yes"]) => self.life.menu = true,
            ("asks", _) if !value.is_empty() => self.life.asks = Some(value.into()),
            ("repeat" | "vanish" | "half" | "insert" | "cold" | "held" | "menu" | "asks", _) => {
                return None;
            }
            (_, [view, values @ ..]) => self.cameras.push(CameraFault {
                view: view.parse().ok()?,
                kind: camera_fault(key, values)?,
            }),
            (_, []) => return None,
        }
        Some(())
    }
}

impl FromStr for Faults {
    type Err = FaultsError;

    /// Reads `loss=0.1,dup=0.05,reorder=0.05,seed=7,freeze=10:2,restart=captures:20:3`.
    fn from_str(text: &str) -> Result<Self, FaultsError> {
        let mut faults = Self::default();
        for part in text
            .split(',')
            .map(str::trim)
            .filter(|part| !part.is_empty())
        {
            let (key, value) = part.split_once('=').unwrap_or((part, ""));
            let Some((_, form)) = FORMS.iter().find(|(word, _)| *word == key) else {
                return Err(FaultsError(format!(
                    "unknown fault {key:?}; expected {EXPECTED}"
                )));
            };
            faults
                .add(key, value)
                .ok_or_else(|| FaultsError(format!("fault {key} is {value:?}; expected {form}")))?;
        }
        Ok(faults)
    }
}

impl fmt::Display for Faults {
    /// The text that reads back as these faults.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            loss,
            duplication,
            reordering,
            seed,
            outages,
            cameras,
            swing,
            codes,
            life,
        } = self;
        write!(
            f,
            "loss={loss},dup={duplication},reorder={reordering},seed={seed}"
        )?;
        for Outage {
            begins,
            kind,
            lasts,
        } in outages
        {
            match kind {
                OutageKind::Freeze => write!(f, ",freeze=")?,
                OutageKind::Restart => write!(f, ",restart=")?,
            }
            match begins {
                Moment::After(time) => write!(f, "{}", time.as_secs_f64())?,
                Moment::Frame(n) => write!(f, "frames:{n}")?,
                Moment::Capture(n) => write!(f, "captures:{n}")?,
            }
            if let Some(lasts) = lasts {
                write!(f, ":{}", lasts.as_secs_f64())?;
            }
        }
        cameras.iter().try_for_each(|fault| write!(f, ",{fault}"))?;
        if let Some(swing) = swing {
            write!(f, ",swing={swing}")?;
        }
        write!(f, "{codes}{life}")
    }
}

impl fmt::Display for CameraFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { view, kind } = self;
        match kind {
            CameraFaultKind::Late { by, after } => {
                let by_ms = by.as_secs_f64() * 1_000.0;
                write!(f, "late={view}:{by_ms}:{}", after.as_secs_f64())
            }
            CameraFaultKind::Shakes {
                rms_px,
                frequency_hz,
            } => write!(f, "shake={view}:{rms_px}:{frequency_hz}"),
            CameraFaultKind::Sticks(share) => write!(f, "stick={view}:{share}"),
            CameraFaultKind::Aims { change, by, time } => {
                write!(f, "{}={view}:{by}:{}", change.word(), time.as_secs_f64())
            }
            CameraFaultKind::Source(other) => write!(f, "source={view}:{other}"),
        }
    }
}

fn camera_fault(key: &str, values: &[&str]) -> Option<CameraFaultKind> {
    Some(match (key, values) {
        ("late", [by_ms, after @ ..]) if after.len() <= 1 => CameraFaultKind::Late {
            by: Duration::try_from_secs_f64(positive(by_ms)? / 1e3).ok()?,
            after: after
                .first()
                .map_or(Some(Duration::ZERO), |after| seconds(after))?,
        },
        ("shake", [rms_px, frequency_hz]) => CameraFaultKind::Shakes {
            rms_px: positive(rms_px)?,
            frequency_hz: positive(frequency_hz)?,
        },
        ("stick", [share]) => CameraFaultKind::Sticks(ratio(share)?),
        ("source", [other]) => CameraFaultKind::Source(other.parse().ok()?),
        (_, [by, time]) => {
            let change = AimChange::ALL
                .into_iter()
                .find(|change| change.word() == key)?;
            let by = by.parse().ok().filter(|by| change.allows(*by))?;
            let time = seconds(time)?;
            if change == AimChange::Drift && time.is_zero() {
                return None;
            }
            CameraFaultKind::Aims { change, by, time }
        }
        _ => return None,
    })
}

fn positive(text: &str) -> Option<f64> {
    let number: f64 = text.parse().ok()?;
    (number.is_finite() && number > 0.0).then_some(number)
}

fn ratio(text: &str) -> Option<f64> {
    let ratio: f64 = text.parse().ok()?;
    (0.0..=1.0).contains(&ratio).then_some(ratio)
}

fn seconds(text: &str) -> Option<Duration> {
    Duration::try_from_secs_f64(text.parse().ok()?).ok()
}

/// An outage from `AFTER_S`, `frames:N` or `captures:N`, maybe with `:SECONDS` behind it.
fn outage(kind: OutageKind, parts: &[&str], usual: Option<Duration>) -> Option<Outage> {
    let count = |text: &str| text.parse().ok().filter(|&count: &u64| count > 0);
    let (begins, lasts) = match parts {
        ["frames", number, lasts @ ..] => (Moment::Frame(count(number)?), lasts),
        ["captures", number, lasts @ ..] => (Moment::Capture(count(number)?), lasts),
        [after, lasts @ ..] => (Moment::After(seconds(after)?), lasts),
        [] => return None,
    };
    let lasts = match lasts {
        [] => usual,
        [time] => Some(seconds(time)?),
        _ => return None,
    };
    Some(Outage {
        begins,
        kind,
        lasts,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Faults, FaultsError> {
        text.parse()
    }

    #[test]
    fn every_fault_has_a_word_and_what_is_printed_reads_back() {
        let text = "loss=0.1,dup=0.05,reorder=0.02,seed=9,freeze=10:2,freeze=frames:600,restart=captures:20:0.5,restart=3,late=1:450:60,shake=0:2:1.5,stick=1:0.04,turn=0:-0.3:120,tilt=1:0.01:0,zoom=1:0.02:60,drift=0:0.1:300,source=0:1,swing=40:3:6:20,repeat=0.05,vanish=0.01,half=0.02,insert=0.03,cold=300,held=180,menu=yes,asks=/tmp/unclean";
        let faults = parse(text).unwrap();
        assert_eq!((faults.loss, faults.duplication), (0.1, 0.05));
        assert_eq!((faults.reordering, faults.seed), (0.02, 9));
        let outage = |begins, kind, lasts_s: Option<f64>| Outage {
            begins,
            kind,
            lasts: lasts_s.map(Duration::from_secs_f64),
        };
        assert_eq!(
            faults.outages,
            [
                outage(
                    Moment::After(Duration::from_secs(10)),
                    OutageKind::Freeze,
                    Some(2.0)
                ),
                outage(Moment::Frame(600), OutageKind::Freeze, None),
                outage(Moment::Capture(20), OutageKind::Restart, Some(0.5)),
                outage(
                    Moment::After(Duration::from_secs(3)),
                    OutageKind::Restart,
                    Some(3.0)
                ),
            ]
        );
        assert_eq!(faults.cameras.len(), 8);
        assert_eq!(faults.swing.map(|swing| swing.things), Some(40));
        assert_eq!((faults.codes.repeated, faults.codes.half), (0.05, 0.02));
        assert_eq!(faults.life.held, Duration::from_secs(180));
        assert_eq!(parse(&faults.to_string()).unwrap(), faults);
        assert!(parse("").unwrap().is_none());
    }

    #[test]
    fn what_is_no_fault_is_refused_with_what_was_found_and_expected() {
        for (text, words) in [
            ("losss=0.1", r#"unknown fault "losss"; expected loss=0..1"#),
            ("loss=10", r#"fault loss is "10"; expected a ratio, 0 to 1"#),
            ("loss", r#"fault loss is "";"#),
            ("dup=NaN", r#"fault dup is "NaN""#),
            (
                "restart=soon",
                r#"fault restart is "soon"; expected AFTER_S[:DOWN_S]"#,
            ),
            ("restart=captures:0", r#""captures:0""#),
            ("restart=captures", r#""captures""#),
            ("freeze=1:-2", r#""1:-2""#),
            ("freeze=1:", r#""1:""#),
            ("seed=-1", "a whole number"),
            ("late=450", r#"fault late is "450"; expected VIEW:MS"#),
            ("late=0:-1", "VIEW:MS"),
            ("shake=0:2", "VIEW:RMS_PX:HZ"),
            ("stick=0:4", "a share from 0 to 1"),
            ("turn=left:0.3:120", "VIEW:RIGHT_DEG:AFTER_S"),
            ("tilt=0:NaN:0", "VIEW:DOWN_DEG:AFTER_S"),
            ("zoom=0:-100:0", "more than -100 percent"),
            ("drift=0:0.1:0", "more than 0 seconds"),
            ("source=0", "VIEW:OTHER"),
            ("swing=40:0:6:20", "THINGS:PERIOD_S:PX:LEVELS"),
            ("repeat=2", "fault repeat is \"2\"; expected a ratio"),
            ("cold=soon", "a number of seconds"),
            ("asks=", "the path of a file"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains(words), "{text}: {message}");
        }
    }
}
