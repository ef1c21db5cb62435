//! Faults of what a hosted plugin's window shows: things that move slowly in a pause, numbers that are not of the frame around which they
//! are drawn, and frames that a driver inserts.
//!
//! Laminar describes OpenGL drawing of plugins that flickers or is missing without Zink; whether numbers are shown again, nobody has
//! reported. Nor has anybody looked for slow motion in a pause (`docs/x-plane-evidence.md`, "Open questions").

use std::f64::consts::TAU;
use std::fmt;
use std::str::FromStr;

use crate::render::overlay::Canvas;

/// Things beside the runway that swing from side to side, as trees, flags and lights do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Number of things in the window.
    pub things: u32,
    /// The longest period, seconds; the shortest is a third of it.
    pub period_s: f64,
    /// Their width and height, and how far they swing to each side, pixels.
    pub px: f64,
    /// Brightness above the scene, levels.
    pub levels: f64,
}

/// Shares of the numbered frames whose number is wrong, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CodeFaults {
    /// The number that was shown last is shown again.
    pub repeated: f64,
    /// There is no number.
    pub vanished: f64,
    /// Only a part is drawn.
    pub half: f64,
    /// The number is right, but a driver shows the mean of the last frame and this one before it, as frame generation does.
    pub inserted: f64,
}

/// A fault of a frame's number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::server) enum CodeFault {
    Repeated,
    Vanished,
    Half,
    Inserted,
}

impl CodeFaults {
    /// The fault of a frame, if it has one.
    pub(in crate::server) fn of_frame(&self, frame: u64, seed: u64) -> Option<CodeFault> {
        let random = unit(seed, frame);
        let shares = [
            (CodeFault::Repeated, self.repeated),
            (CodeFault::Vanished, self.vanished),
            (CodeFault::Half, self.half),
            (CodeFault::Inserted, self.inserted),
        ];
        let mut below = 0.0;
        for (fault, share) in shares {
            below += share;
            if random < below {
                return Some(fault);
            }
        }
        None
    }
}

impl Swing {
    /// Draws the things as they are after some time.
    pub(in crate::server) fn draw(&self, canvas: &mut Canvas<'_>, time_s: f64, seed: u64) {
        let (width, height) = (canvas.width_px as f64, canvas.height_px as f64);
        for thing in 0..u64::from(self.things) {
            let random = |what: u64| unit(seed ^ (what << 32), thing);
            let period_s = self.period_s * (1.0 + 2.0 * random(1)) / 3.0;
            let sway_px = self.px * (TAU * (time_s / period_s + random(2))).sin();
            let left = (width - self.px) * random(3) + sway_px;
            // The lower part, where the ground is.
            let top = height * (0.4 + 0.6 * random(4)) - self.px;
            canvas.brighten_px([left, top, left + self.px, top + self.px], self.levels);
        }
    }
}

/// A reproducible random number from 0 to just below 1.
fn unit(seed: u64, number: u64) -> f64 {
    let mut mixed =
        (seed ^ number.wrapping_mul(0xbf58_476d_1ce4_e5b9)).wrapping_add(0x9e37_79b9_7f4a_7c15);
    mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A text that describes no [`Swing`].
#[derive(Debug)]
pub struct NoSwing;

impl FromStr for Swing {
    type Err = NoSwing;

    /// Reads `THINGS:PERIOD_S:PX:LEVELS`.
    fn from_str(text: &str) -> Result<Self, NoSwing> {
        let parts: Vec<&str> = text.split(':').collect();
        let [things, numbers @ ..] = &parts[..] else {
            return Err(NoSwing);
        };
        let numbers: Option<Vec<f64>> = numbers.iter().map(|text| super::positive(text)).collect();
        match (things.parse(), numbers.as_deref()) {
            (Ok(things), Some(&[period_s, px, levels])) => Ok(Self {
                things,
                period_s,
                px,
                levels,
            }),
            _ => Err(NoSwing),
        }
    }
}

impl fmt::Display for Swing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            things,
            period_s,
            px,
            levels,
        } = self;
        write!(f, "{things}:{period_s}:{px}:{levels}")
    }
}

impl fmt::Display for CodeFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shares = [
            ("repeat", self.repeated),
            ("vanish", self.vanished),
            ("half", self.half),
            ("insert", self.inserted),
        ];
        let mut there = shares.into_iter().filter(|(_, share)| *share > 0.0);
        there.try_for_each(|(word, share)| write!(f, ",{word}={share}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_numbers_are_wrong_as_asked_for() {
        let faults = CodeFaults {
            repeated: 0.05,
            vanished: 0.01,
            half: 0.2,
            inserted: 0.03,
        };
        let mut found = [0; 4];
        for frame in 0..100_000 {
            if let Some(fault) = faults.of_frame(frame, 7) {
                found[fault as usize] += 1;
            }
        }
        for (found, share) in found.into_iter().zip([0.05, 0.01, 0.2, 0.03]) {
            let expected: f64 = 100_000.0 * share;
            assert!(
                (f64::from(found) - expected).abs() < 5.0 * expected.sqrt(),
                "{found} of {expected}"
            );
        }
    }

    #[test]
    fn things_swing_by_their_size_and_come_back_after_their_period() {
        let swing = Swing {
            things: 1,
            period_s: 2.0,
            px: 6.0,
            levels: 20.0,
        };
        let drawn = |time_s: f64| {
            let mut rgb = vec![100; 120 * 60 * 3];
            let mut canvas = Canvas {
                rgb: &mut rgb,
                width_px: 120,
                height_px: 60,
            };
            swing.draw(&mut canvas, time_s, 3);
            rgb
        };
        let period_s = 2.0 * (1.0 + 2.0 * unit(3 ^ (1 << 32), 0)) / 3.0;
        assert_eq!(drawn(0.3), drawn(0.3 + period_s));
        let differ = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a != b).count();
        assert!(differ(&drawn(0.0), &drawn(period_s / 2.0)) > 20);
        let brightest = drawn(0.0).into_iter().max();
        assert_eq!(brightest, Some(120));
    }
}
