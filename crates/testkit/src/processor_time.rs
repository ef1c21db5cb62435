//! Processor time, which is also valid on a busy machine.

use std::fs;
use std::time::Duration;

const TICKS_PER_S: f64 = 100.0;

/// Processor time used by this process, and by its child processes that have ended.
pub fn own_and_children() -> [Duration; 2] {
    own_and_children_of("self")
}

/// Processor time used by the process with this id.
pub fn of_process(id: u32) -> Duration {
    own_and_children_of(&id.to_string())[0]
}

/// Processor time used by this process and its running children.
pub fn own_and_running_children() -> Duration {
    let tasks = fs::read_dir("/proc/self/task").expect("Linux's /proc");
    let children = tasks.map(|task| {
        let path = task.expect("a task").path().join("children");
        fs::read_to_string(path).unwrap_or_default()
    });
    let children: String = children.collect();
    let ids = children.split_whitespace();
    let of_children = ids.map(|id| of_process(id.parse().expect("a process")));
    own_and_children()[0] + of_children.sum::<Duration>()
}

fn own_and_children_of(process: &str) -> [Duration; 2] {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).expect("Linux's /proc");
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
