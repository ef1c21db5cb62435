//! Processor time, which is also valid on a busy machine.

use std::fs;
use std::time::Duration;

const TICKS_PER_S: f64 = 100.0;

/// Processor time used by this process, and by its child processes that have ended.
pub fn own_and_children() -> [Duration; 2] {
    let stat = fs::read_to_string("/proc/self/stat").expect("Linux's /proc");
    // From field 14 on: user and system time, then those of children. The name in parentheses may contain spaces.
    let after_name = stat.rsplit(") ").next().unwrap_or_default();
    let ticks: Vec<f64> = after_name
        .split(' ')
        .skip(11)
        .take(4)
        .map(|ticks| ticks.parse().expect("a number of ticks"))
        .collect();
    [ticks[0] + ticks[1], ticks[2] + ticks[3]]
        .map(|ticks| Duration::from_secs_f64(ticks / TICKS_PER_S))
}
