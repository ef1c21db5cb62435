//! Counters and latencies of the live estimation, in the OpenMetrics format.

use std::fmt::{self, Write};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use crate::output::AnswerState;
use crate::view_state::ViewState;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fate {
    Searched,
    /// A newer one came before the search had time.
    Overload,
    Damaged,
    Frozen,
    Dark,
    Moved,
    OtherSize,
    /// The time is not after the previous image's.
    Disordered,
}

impl Fate {
    /// Names in the order of the variants.
    const NAMES: [&'static str; 8] = [
        "searched",
        "overload",
        "damaged",
        "frozen",
        "dark",
        "moved",
        "other_size",
        "disordered",
    ];

    /// Fate of images in this state.
    pub(crate) fn of(state: ViewState) -> Self {
        match state {
            ViewState::Frozen => Self::Frozen,
            ViewState::Dark => Self::Dark,
            ViewState::Moved => Self::Moved,
            _ => Self::Damaged,
        }
    }
}

/// A part of the way from a packet to an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stage {
    /// Last packet's arrival to decoded image.
    Decode,
    /// Until the search begins.
    Wait,
    Search,
    /// Pair's later image to answer.
    Join,
    /// Arrival of the later image's last packet to answer.
    Total,
}

impl Stage {
    /// Names in the order of the variants.
    const NAMES: [&'static str; 5] = ["decode", "wait", "search", "join", "total"];
}

/// Upper ends of the histogram's classes, milliseconds: no wider than 5 ms up to 0.1 s, and than a quarter up to 1 s.
const CLASSES_MS: [u64; 41] = [
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60, 65, 70, 75, 80, 85,
    90, 95, 100, 120, 150, 180, 220, 270, 330, 400, 500, 610, 740, 880, 1_000,
];

/// Counts of all views.
#[derive(Debug)]
pub(crate) struct Metrics {
    run: String,
    views: Vec<OfView>,
    latencies: [Histogram; Stage::NAMES.len()],
    answers: AtomicU64,
    /// When the last fresh answer was made, milliseconds since the start of the program; 0: none yet.
    last_fresh_ms: AtomicU64,
    dropped_lines: AtomicU64,
}

#[derive(Debug)]
struct OfView {
    name: String,
    fates: [AtomicU64; Fate::NAMES.len()],
    state: AtomicUsize,
    reopened: AtomicU64,
}

#[derive(Debug)]
struct Histogram {
    /// The last class has no end.
    classes: [AtomicU64; CLASSES_MS.len() + 1],
    sum_us: AtomicU64,
}

impl Metrics {
    pub(crate) fn new(run: String, views: &[String]) -> Self {
        let of_view = |name: &String| OfView {
            name: name.clone(),
            fates: Default::default(),
            state: AtomicUsize::new(ViewState::Down as usize),
            reopened: AtomicU64::new(0),
        };
        Self {
            run,
            views: views.iter().map(of_view).collect(),
            latencies: Default::default(),
            answers: AtomicU64::new(0),
            last_fresh_ms: AtomicU64::new(0),
            dropped_lines: AtomicU64::new(0),
        }
    }

    pub(crate) fn count(&self, view: usize, fate: Fate) {
        self.views[view].fates[fate as usize].fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn images(&self, view: usize, fate: Fate) -> u64 {
        self.views[view].fates[fate as usize].load(Ordering::Relaxed)
    }

    pub(crate) fn all_images(&self, view: usize) -> u64 {
        let fates = self.views[view].fates.iter();
        fates.map(|count| count.load(Ordering::Relaxed)).sum()
    }

    pub(crate) fn has_images(&self, view: usize) -> bool {
        self.all_images(view) > 0
    }

    pub(crate) fn set_state(&self, view: usize, state: ViewState) {
        self.views[view]
            .state
            .store(state as usize, Ordering::Relaxed);
    }

    pub(crate) fn count_reopened(&self, view: usize) {
        self.views[view].reopened.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn time(&self, stage: Stage, seconds: f64) {
        let of_stage = &self.latencies[stage as usize];
        let seconds = seconds.max(0.0);
        let class = CLASSES_MS.partition_point(|end_ms| seconds * 1e3 > *end_ms as f64);
        of_stage.classes[class].fetch_add(1, Ordering::Relaxed);
        (of_stage.sum_us).fetch_add((seconds * 1e6) as u64, Ordering::Relaxed);
    }

    /// An answer was made; only fresh ones count for the age of the last one.
    pub(crate) fn answered(&self, state: AnswerState, now_s: f64) {
        self.answers.fetch_add(1, Ordering::Relaxed);
        if state == AnswerState::Fresh {
            self.last_fresh_ms
                .store((now_s * 1e3) as u64, Ordering::Relaxed);
        }
    }

    pub(crate) fn count_dropped_line(&self) {
        self.dropped_lines.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn dropped_lines(&self) -> u64 {
        self.dropped_lines.load(Ordering::Relaxed)
    }

    /// Text in the OpenMetrics format. `now_s`: seconds since the start.
    pub(crate) fn text(&self, now_s: f64) -> String {
        let mut text = String::new();
        // Writing to a string does not fail.
        let _ = self.write(&mut text, now_s);
        text
    }

    fn write(&self, to: &mut String, now_s: f64) -> fmt::Result {
        writeln!(to, "# TYPE dtd_run info")?;
        writeln!(to, "dtd_run_info{{blake3=\"{}\"}} 1", self.run)?;
        writeln!(to, "# TYPE dtd_images counter")?;
        for view in &self.views {
            for (fate, count) in Fate::NAMES.iter().zip(&view.fates) {
                let name = quoted(&view.name);
                let count = count.load(Ordering::Relaxed);
                writeln!(
                    to,
                    "dtd_images_total{{view=\"{name}\",fate=\"{fate}\"}} {count}"
                )?;
            }
        }
        writeln!(to, "# TYPE dtd_view_state stateset")?;
        for view in &self.views {
            let now = view.state.load(Ordering::Relaxed);
            for (state, word) in ViewState::NAMES.iter().enumerate() {
                let name = quoted(&view.name);
                let is_now = u8::from(state == now);
                writeln!(
                    to,
                    "dtd_view_state{{view=\"{name}\",dtd_view_state=\"{word}\"}} {is_now}"
                )?;
            }
        }
        writeln!(to, "# TYPE dtd_view_reopened counter")?;
        for view in &self.views {
            let count = view.reopened.load(Ordering::Relaxed);
            writeln!(
                to,
                "dtd_view_reopened_total{{view=\"{}\"}} {count}",
                quoted(&view.name)
            )?;
        }
        writeln!(to, "# TYPE dtd_latency_seconds histogram")?;
        writeln!(to, "# UNIT dtd_latency_seconds seconds")?;
        for (stage, histogram) in Stage::NAMES.iter().zip(&self.latencies) {
            histogram.write(to, stage)?;
        }
        writeln!(to, "# TYPE dtd_answers counter")?;
        writeln!(
            to,
            "dtd_answers_total {}",
            self.answers.load(Ordering::Relaxed)
        )?;
        let last_ms = self.last_fresh_ms.load(Ordering::Relaxed);
        if last_ms > 0 {
            let age_s = now_s - last_ms as f64 * 1e-3;
            writeln!(to, "# TYPE dtd_last_answer_age_seconds gauge")?;
            writeln!(to, "# UNIT dtd_last_answer_age_seconds seconds")?;
            writeln!(to, "dtd_last_answer_age_seconds {age_s:.3}")?;
        }
        writeln!(to, "# TYPE dtd_dropped_lines counter")?;
        writeln!(to, "dtd_dropped_lines_total {}", self.dropped_lines())?;
        writeln!(to, "# EOF")
    }
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            classes: std::array::from_fn(|_| AtomicU64::default()),
            sum_us: AtomicU64::default(),
        }
    }
}

impl Histogram {
    fn write(&self, to: &mut String, stage: &str) -> fmt::Result {
        let mut below = 0;
        let ends = CLASSES_MS
            .iter()
            .map(|end_ms| format!("{}", *end_ms as f64 / 1e3));
        for (end, count) in ends.chain(["+Inf".into()]).zip(&self.classes) {
            below += count.load(Ordering::Relaxed);
            writeln!(
                to,
                "dtd_latency_seconds_bucket{{stage=\"{stage}\",le=\"{end}\"}} {below}"
            )?;
        }
        let sum_s = self.sum_us.load(Ordering::Relaxed) as f64 * 1e-6;
        writeln!(to, "dtd_latency_seconds_count{{stage=\"{stage}\"}} {below}")?;
        writeln!(
            to,
            "dtd_latency_seconds_sum{{stage=\"{stage}\"}} {sum_s:.6}"
        )
    }
}

fn quoted(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_tell_percentiles_apart() {
        for pair in CLASSES_MS.windows(2) {
            let [from, to] = [pair[0] as f64, pair[1] as f64];
            assert!(to - from <= 5.0 || to <= 1.25 * from, "{from} to {to} ms");
        }
        assert_eq!(CLASSES_MS[CLASSES_MS.len() - 1], 1_000);
    }

    #[test]
    fn the_text_has_every_view_fate_state_and_stage_and_ends() {
        let metrics = Metrics::new("abc".into(), &["left".into(), "ri\"ght".into()]);
        metrics.count(1, Fate::Overload);
        metrics.set_state(0, ViewState::Frozen);
        metrics.time(Stage::Total, 0.0123);
        metrics.answered(AnswerState::Fresh, 1.0);
        metrics.answered(AnswerState::Coasting, 1.3);
        metrics.answered(AnswerState::Lost, 1.4);
        let text = metrics.text(1.5);
        for line in [
            "dtd_run_info{blake3=\"abc\"} 1",
            "dtd_images_total{view=\"ri\\\"ght\",fate=\"overload\"} 1",
            "dtd_view_state{view=\"left\",dtd_view_state=\"frozen\"} 1",
            "dtd_view_state{view=\"left\",dtd_view_state=\"down\"} 0",
            "dtd_latency_seconds_bucket{stage=\"total\",le=\"0.01\"} 0",
            "dtd_latency_seconds_bucket{stage=\"total\",le=\"0.015\"} 1",
            "dtd_latency_seconds_count{stage=\"total\"} 1",
            "dtd_last_answer_age_seconds 0.500",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        assert!(text.ends_with("# EOF\n"));
    }
}
