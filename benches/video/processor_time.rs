//! Processor time, which is also valid on a busy machine.

use std::time::Duration;

/// Processor time so far of this process and of its child processes.
pub(crate) fn cpu_so_far() -> [Duration; 2] {
    const TICKS_PER_S: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").expect("Linux's /proc");
    // From field 14 on: user and system time, then those of children.
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
