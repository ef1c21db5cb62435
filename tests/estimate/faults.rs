//! A flight with consecutive faults: no stale answer is called fresh, the other view goes on, and the faulty one comes back.

use std::io::BufRead;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use chrono::DateTime;
use rustix::pipe::fcntl_setpipe_size;
use rustix::process::Signal;
use serde_json::Value;
use testkit::command::text;

use crate::running::Running;
use crate::server::Server;
use crate::workshop::{VIEWS, Workshop, ffmpeg};

/// Fresh answers are from images that are not older, seconds; and the reader of this test may be late by this on a busy machine.
const FRESH_S: f64 = 0.3;
const LATE_READER_S: f64 = 0.5;
/// Maximum time until views are used again after a fault, s.
const BACK_S: f64 = 5.0;
/// Maximum time between fresh answers of a healthy view, s.
const GAP_S: f64 = 1.5;
/// Bytes of the pipe to the reader, so that it is full soon.
const PIPE_BYTES: usize = 4_096;

/// A fault: seconds since the videos began.
struct Fault {
    name: &'static str,
    from_s: f64,
    to_s: f64,
    /// Views that have it.
    views: &'static [&'static str],
    /// A state that it causes.
    state: Option<&'static str>,
    /// Seconds after which its views are not used, where none of their images can be.
    noticed_s: Option<f64>,
    begin: Step,
    end: Step,
}

/// Action that causes or ends a fault.
#[derive(Clone, Copy)]
enum Step {
    /// The videos show it, or its time is over.
    Nothing,
    Server(&'static str),
    Signal(Signal),
    /// All cores are used by others, or no more.
    Busy(bool),
    /// The lines are not read, or again.
    Read(bool),
}

const FROZEN_S: [f64; 2] = [18.0, 21.0];
const DARK_S: [f64; 2] = [23.0, 26.0];

/// Faults by time.
const FAULTS: [Fault; 10] = [
    Fault {
        name: "a view that starts late",
        from_s: 0.0,
        to_s: 6.5,
        views: &["right"],
        state: Some("down"),
        noticed_s: Some(0.0),
        begin: Step::Nothing,
        end: Step::Server("offer right"),
    },
    Fault {
        name: "a feed that is killed",
        from_s: 12.0,
        to_s: 14.0,
        views: &["left"],
        state: Some("down"),
        noticed_s: Some(0.3),
        begin: Step::Server("drop left"),
        end: Step::Server("offer left"),
    },
    Fault {
        name: "a frozen image",
        from_s: FROZEN_S[0],
        to_s: FROZEN_S[1],
        views: &["left"],
        state: Some("frozen"),
        noticed_s: Some(1.0),
        begin: Step::Nothing,
        end: Step::Nothing,
    },
    Fault {
        name: "a black image",
        from_s: DARK_S[0],
        to_s: DARK_S[1],
        views: &["right"],
        state: Some("dark"),
        noticed_s: Some(1.0),
        begin: Step::Nothing,
        end: Step::Nothing,
    },
    Fault {
        name: "a server that stops",
        from_s: 29.0,
        to_s: 31.0,
        views: &VIEWS,
        state: Some("down"),
        noticed_s: Some(0.5),
        begin: Step::Signal(Signal::STOP),
        end: Step::Signal(Signal::CONT),
    },
    Fault {
        name: "1 % of lost packets",
        from_s: 36.0,
        to_s: 39.0,
        views: &["right"],
        state: Some("damaged"),
        noticed_s: None,
        begin: Step::Server("lose right 0.01"),
        end: Step::Server("lose right 0"),
    },
    Fault {
        name: "20 % of lost packets",
        from_s: 41.0,
        to_s: 44.0,
        views: &["right"],
        state: Some("damaged"),
        noticed_s: Some(1.5),
        begin: Step::Server("lose right 0.2"),
        end: Step::Server("lose right 0"),
    },
    Fault {
        name: "another size",
        from_s: 49.0,
        to_s: 51.0,
        views: &["left"],
        state: Some("damaged"),
        noticed_s: Some(1.5),
        begin: Step::Server("switch left small"),
        end: Step::Server("switch left"),
    },
    Fault {
        name: "another codec",
        from_s: 56.0,
        to_s: 56.5,
        views: &["right"],
        state: Some("down"),
        noticed_s: None,
        begin: Step::Server("drop right"),
        end: Step::Server("offer right jpeg"),
    },
    Fault {
        name: "a busy machine",
        from_s: 61.0,
        to_s: 64.0,
        views: &[],
        state: None,
        noticed_s: None,
        begin: Step::Busy(true),
        end: Step::Busy(false),
    },
];
/// Then the reader stops for this time, and the program is killed.
const UNREAD_S: [f64; 2] = [66.0, 70.0];
const KILLED_S: f64 = 73.0;

#[test]
fn no_fault_makes_an_old_answer_fresh_and_each_is_overcome() {
    let workshop = Workshop::alone();
    let films = Films::made(&workshop);
    let cameras: Vec<(&str, &Path)> = films
        .0
        .iter()
        .map(|(name, path)| (*name, &**path))
        .collect();
    let Some(mut server) = Server::start(&["--absent", "right"], &cameras) else {
        return;
    };
    let sources = [
        server.address("left"),
        format!("{}?transport=udp", server.address("right")),
    ];
    let sources = [&*sources[0], &*sources[1]];
    let first = Life::start(workshop.command(sources), true);
    let began_s = server.playing_s();
    let mut steps: Vec<(f64, Step)> = FAULTS
        .iter()
        .flat_map(|fault| [(fault.from_s, fault.begin), (fault.to_s, fault.end)])
        .collect();
    steps.extend(
        UNREAD_S
            .into_iter()
            .zip([Step::Read(false), Step::Read(true)]),
    );
    let mut busy: Vec<Child> = Vec::new();
    for (at_s, step) in steps {
        sleep_until(began_s + at_s);
        match step {
            Step::Nothing => {}
            Step::Server(command) => server.command(command),
            Step::Signal(signal) => server.signal(signal),
            Step::Busy(true) => busy = (0..2).map(|_| busy_process()).collect(),
            Step::Busy(false) => busy.drain(..).for_each(end),
            Step::Read(reads) => first.reads(reads),
        }
    }
    sleep_until(began_s + KILLED_S);
    let lines = first.kill();
    let restarted_s = now_s();
    let mut second = Life::start(workshop.command(sources), false);
    sleep_until(restarted_s + BACK_S);
    second.running.signal(Signal::TERM);
    assert!(second.running.child.wait().unwrap().success());
    let after = second.lines();
    let said = Said {
        lines: lines
            .into_iter()
            .map(|(read_s, line)| (read_s - began_s, line))
            .collect(),
        began_s,
    };
    said.judge_ages();
    for fault in &FAULTS {
        said.judge(fault);
    }
    assert!(
        after.iter().any(|(_, line)| line["state"] == "fresh"),
        "no fresh answer after a restart: {after:#?}"
    );
    let end = &after.last().unwrap().1;
    assert_eq!(
        (&end["event"], &end["cause"]),
        (&"end".into(), &"signal".into())
    );
}

/// Lines of the program, with times since the videos began.
struct Said {
    lines: Vec<(f64, Value)>,
    began_s: f64,
}

impl Said {
    /// Fresh answers with the times of reading, and of their images.
    fn fresh(&self) -> impl Iterator<Item = (f64, f64, &Value)> {
        let fresh = self
            .lines
            .iter()
            .filter(|(_, line)| line["state"] == "fresh");
        fresh.map(|(read_s, line)| {
            let utc = DateTime::parse_from_rfc3339(line["time_utc"].as_str().unwrap()).unwrap();
            let image_s = utc.timestamp_micros() as f64 * 1e-6 - self.began_s;
            (*read_s, image_s, line)
        })
    }

    /// When there were fresh answers from a view.
    fn used_s(&self, view: &str) -> Vec<f64> {
        let uses = |line: &Value| line["views"].as_array().unwrap().contains(&view.into());
        let fresh = self.fresh().filter(|(_, _, line)| uses(line));
        fresh.map(|(read_s, ..)| read_s).collect()
    }

    fn judge_ages(&self) {
        for (read_s, image_s, line) in self.fresh() {
            assert!(line["age_s"].as_f64().unwrap() <= FRESH_S, "{line}");
            // The stopped reader reads the pipe's content later.
            let is_unread = (UNREAD_S[0]..UNREAD_S[1] + 1.0).contains(&read_s);
            let age_s = read_s - image_s;
            assert!(
                is_unread || age_s <= FRESH_S + LATE_READER_S,
                "read {age_s:.2} s after its images, {read_s:.1} s after the start: {line}"
            );
        }
    }

    fn judge(&self, fault: &Fault) {
        let Fault {
            name, from_s, to_s, ..
        } = *fault;
        for view in VIEWS {
            let used_s = self.used_s(view);
            if !fault.views.contains(&view) {
                // At the start, what one view alone sees counts after ten seconds, when the other one is there.
                if from_s == 0.0 {
                    continue;
                }
                let mut before_s = from_s;
                let meanwhile = used_s
                    .iter()
                    .filter(|at_s| (before_s..to_s).contains(*at_s));
                for at_s in meanwhile.copied().chain([to_s]).collect::<Vec<_>>() {
                    assert!(
                        at_s - before_s <= GAP_S,
                        "{name}: no fresh answer from {view} from {before_s:.2} to {at_s:.2} s"
                    );
                    before_s = at_s;
                }
                continue;
            }
            if let Some(noticed_s) = fault.noticed_s {
                let wrong_s =
                    (used_s.iter()).find(|at_s| (from_s + noticed_s..to_s).contains(*at_s));
                assert!(wrong_s.is_none(), "{name}: {view} is used at {wrong_s:?} s");
            }
            let back_s = used_s.iter().find(|at_s| **at_s >= to_s).copied();
            assert!(
                back_s.is_some_and(|at_s| at_s <= to_s + BACK_S),
                "{name}: {view} is used again at {back_s:?}, expected within {BACK_S} s of {to_s} s"
            );
            if let Some(state) = fault.state {
                let is_told = |(read_s, line): &(f64, Value)| {
                    line["event"] == "view"
                        && line["view"] == view
                        && line["state"] == state
                        && (from_s..to_s + 1.0).contains(read_s)
                };
                // Before the first image every view is down.
                assert!(
                    from_s == 0.0 || self.lines.iter().any(is_told),
                    "{name}: {view} is never {state}"
                );
            }
        }
    }
}

/// A program from start to end; its lines with their reading times.
struct Life {
    running: Running,
    lines: Receiver<(f64, Value)>,
    /// Stops the reader, or lets it go on.
    reads: Sender<bool>,
}

impl Life {
    fn start(mut command: Command, has_short_pipe: bool) -> Self {
        let mut running = Running::start(&mut command);
        let output = running.take_output();
        if has_short_pipe {
            fcntl_setpipe_size(output.get_ref(), PIPE_BYTES).unwrap();
        }
        let (send, lines) = channel();
        let (reads, is_read) = channel();
        thread::spawn(move || {
            for line in output.lines() {
                let Ok(line) = line else { return };
                let line = serde_json::from_str(&line).expect(&line);
                if send.send((now_s(), line)).is_err() {
                    return;
                }
                if is_read.try_recv() == Ok(false) {
                    // Until it may go on, or the test is over.
                    let _ = is_read.recv();
                }
            }
        });
        Self {
            running,
            lines,
            reads,
        }
    }

    fn reads(&self, reads: bool) {
        self.reads.send(reads).unwrap();
    }

    fn kill(mut self) -> Vec<(f64, Value)> {
        assert!(self.running.child.try_wait().unwrap().is_none(), "it ended");
        self.running.child.kill().unwrap();
        self.lines()
    }

    /// All lines, until the output is closed.
    fn lines(&mut self) -> Vec<(f64, Value)> {
        self.lines.iter().collect()
    }
}

/// The videos of the cameras by name and variant.
struct Films(Vec<(&'static str, PathBuf)>);

impl Films {
    /// Makes the videos from a recorded flight.
    fn made(workshop: &Workshop) -> Self {
        let [left, right] = workshop.flight();
        let images = |seconds: f64| (5.0 * seconds) as u32;
        let [frozen, moves] = FROZEN_S.map(images);
        let freeze = format!(
            "{NOISE},split[a][b];[a][b]freezeframes=first={frozen}:last={}:replace={frozen}",
            moves - 1
        );
        let [dark, bright] = DARK_S;
        let black = format!("{NOISE},drawbox=c=black:t=fill:enable='between(t,{dark},{bright})'");
        let to = |name: &str| workshop.folder.path().join(name);
        let h264 = [
            "-g",
            "5",
            "-c:v",
            "libx264",
            "-preset",
            "ultrafast",
            "-crf",
            "24",
        ];
        let h264 = [
            &h264[..],
            &["-tune", "zerolatency", "-x264-params", "sliced-threads=0"],
        ]
        .concat();
        let jpeg = [
            "-c:v", "mjpeg", "-huffman", "default", "-q:v", "4", "-pix_fmt", "yuvj420p",
        ];
        let made = [
            ("left", left, freeze, &h264[..]),
            ("left:small", left, "scale=640:480".into(), &h264[..]),
            ("right", right, black, &h264[..]),
            ("right:jpeg", right, NOISE.into(), &jpeg[..]),
        ];
        let made = made.map(|(name, recorded, filter, codec)| {
            let path = to(&format!("{}.mp4", name.replace(':', "-")));
            // As long as it is served.
            let input = ["-t", "82", "-i", text(recorded), "-filter_complex", &filter];
            let arguments = [&input[..], codec, &[text(&path)]];
            ffmpeg(&arguments.concat());
            (name, path)
        });
        Self(made.into())
    }
}

const NOISE: &str = "noise=alls=4:allf=t";

/// A process that takes a whole core.
fn busy_process() -> Child {
    let mut shell = Command::new("sh");
    shell
        .args(["-c", "while :; do :; done"])
        .stdin(Stdio::null());
    shell.spawn().unwrap()
}

fn end(mut process: Child) {
    process.kill().unwrap();
    process.wait().unwrap();
}

/// UTC seconds.
fn now_s() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.unwrap().as_secs_f64()
}

fn sleep_until(at_s: f64) {
    thread::sleep(Duration::from_secs_f64((at_s - now_s()).max(0.0)));
}
