//! `dtd estimate`: recordings against `dtd predict --online`, a real RTSP server with faults, signals, and what is refused.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use dataset::tables::columns::Table;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use testkit::command::{Dtd, said, text};
use testkit::{repository, skipped};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
/// Debian's Python, for which its GStreamer is built.
const PYTHON: &str = "/usr/bin/python3";
/// No test takes longer.
const LONGEST: Duration = Duration::from_secs(100);
const VIEWS: [&str; 2] = ["left", "right"];
const SETTINGS: &str = "
[calibration]
hidden = [16]
features = 16
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[estimator]
lstm = [16]
head_hidden = [16]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
[mono]
optimisation = { steps = 60, batch_size = 64, learning_rate = 0.003 }
";

/// A corpus with detections, and a run.
struct Workshop {
    folder: tempfile::TempDir,
}

impl Workshop {
    /// Made once per run of the tests.
    fn shared() -> &'static Self {
        static SHARED: OnceLock<Workshop> = OnceLock::new();
        SHARED.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let made = Self { folder };
            let corpus = made.corpus();
            let settings = made.folder.path().join("train.toml");
            fs::write(&settings, SETTINGS).unwrap();
            let run = made.run();
            for arguments in [
                &["generate", "tests/data/chain.toml", "--out", text(&corpus)][..],
                &["label", text(&corpus)],
                &["detect", text(&corpus)],
                &[
                    "train",
                    text(&corpus),
                    "--out",
                    text(&run),
                    "--config",
                    text(&settings),
                ],
            ] {
                let output = DTD.run(arguments);
                assert!(output.status.success(), "{}", said(&output));
            }
            made
        })
    }

    fn corpus(&self) -> PathBuf {
        self.folder.path().join("corpus")
    }

    fn run(&self) -> PathBuf {
        self.folder.path().join("run")
    }

    /// Identifiers of the scenarios.
    fn scenarios(&self) -> Vec<String> {
        let corpus = Corpus::open(&self.corpus()).unwrap();
        let mut ids: Vec<String> = (corpus.scenarios().unwrap().iter())
            .map(|folder| folder.id())
            .collect();
        ids.sort();
        ids
    }

    fn command(&self, sources: [&str; 2]) -> Command {
        let mut command = DTD.command(&["estimate", text(&self.run())]);
        for (view, source) in VIEWS.iter().zip(sources) {
            command.args(["--view", &format!("{view}={source}")]);
        }
        command
    }

    fn lines(&self, sources: [&str; 2], more: &[&str]) -> Vec<Value> {
        let output = self.command(sources).args(more).output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let lines = String::from_utf8(output.stdout).unwrap();
        let lines = lines.lines();
        lines
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }
}

/// The distances of arrivals by time in milliseconds.
fn distances(lines: &[Value]) -> BTreeMap<i64, f64> {
    let answers = lines.iter().filter(|line| line["phase"] == "arrival");
    let known = answers.filter_map(|line| {
        let time_ms = (line["time_s"].as_f64()? * 1e3).round() as i64;
        Some((time_ms, line["dtd_m"].as_f64()?))
    });
    known.collect()
}

#[test]
fn a_recording_gives_what_predict_gives_online_from_the_corpus_and_from_its_videos() {
    let workshop = Workshop::shared();
    let table = workshop.folder.path().join("online.parquet");
    let predicted = DTD.run(&[
        "predict",
        text(&workshop.run()),
        "--corpus",
        text(&workshop.corpus()),
        "--online",
        "--out",
        text(&table),
    ]);
    assert!(predicted.status.success(), "{}", said(&predicted));
    let table = Table::read(&table, 10_000).unwrap();
    let ids = table.text("scenario").unwrap();
    let times_ns = table.i64("time_ns").unwrap();
    let scenario = &workshop.scenarios()[0];
    let source = format!("corpus:{}/{scenario}", text(&workshop.corpus()));
    let lines = workshop.lines([&source, &source], &["--as-fast-as-possible"]);
    assert_eq!(lines[0]["event"], "start");
    assert_eq!(lines[0]["run"].as_str().unwrap().len(), 64);
    assert_eq!(lines.last().unwrap()["event"], "end");
    let estimator = lines[0]["estimator"].as_str().unwrap();
    let expected = table.optional_f64(&format!("{estimator}_dtd_m")).unwrap();
    let found = distances(&lines);
    let mut compared = 0;
    for ((id, time_ns), expected_m) in ids.iter().zip(&times_ns).zip(expected) {
        let Some(expected_m) = expected_m.filter(|_| id == scenario) else {
            continue;
        };
        let found_m = found.get(&(time_ns / 1_000_000));
        let found_m = found_m.unwrap_or_else(|| panic!("nothing at {time_ns} ns: {lines:#?}"));
        assert!(
            (found_m / expected_m - 1.0).abs() < 1e-9,
            "{found_m} m, {expected_m} m"
        );
        compared += 1;
    }
    assert!(compared >= 5, "{compared} of {}: {lines:#?}", ids.len());
    let videos = VIEWS.map(|view| {
        let corpus = Corpus::open(&workshop.corpus()).unwrap();
        let scenario = corpus.scenario(scenario).open().unwrap();
        scenario.video_path(view).unwrap()
    });
    let sources = [text(&videos[0]), text(&videos[1])];
    let of_videos = workshop.lines(sources, &["--as-fast-as-possible"]);
    assert_eq!(distances(&of_videos), found);
}

#[test]
fn an_answer_has_the_names_that_scripts_rely_on() {
    let workshop = Workshop::shared();
    let source = format!(
        "corpus:{}/{}",
        text(&workshop.corpus()),
        workshop.scenarios()[0]
    );
    let lines = workshop.lines([&source, &source], &["--as-fast-as-possible"]);
    let answer = lines.iter().find(|line| line["state"] == "fresh").unwrap();
    let mut names: Vec<&String> = answer.as_object().unwrap().keys().collect();
    names.sort();
    let expected = [
        "age_s",
        "dtd_from_m",
        "dtd_m",
        "dtd_sd_m",
        "dtd_to_m",
        "ground_speed_mps",
        "height_m",
        "latitude_deg",
        "longitude_deg",
        "phase",
        "position_sd_m",
        "state",
        "time_s",
        "time_to_touchdown_s",
        "time_utc",
        "track",
        "views",
    ];
    assert_eq!(names, expected);
    assert_eq!(answer["time_utc"], Value::Null);
    for event in lines.iter().filter(|line| line["event"].is_string()) {
        assert!(
            event["time_s"].is_f64() && event["dtd_m"].is_null(),
            "{event}"
        );
    }
}

#[test]
fn a_signal_ends_it_with_zero_within_two_seconds() {
    let workshop = Workshop::shared();
    let source = format!(
        "corpus:{}/{}",
        text(&workshop.corpus()),
        workshop.scenarios()[0]
    );
    // Played in its own time, eight seconds an image.
    let mut running = Running::start(&mut workshop.command([&source, &source]));
    assert_eq!(running.next()["event"], "start");
    let began = Instant::now();
    running.signal(Signal::TERM);
    assert_eq!(running.last()["cause"], "signal");
    assert!(running.child.wait().unwrap().success());
    assert!(began.elapsed() < Duration::from_secs(2));
}

#[test]
fn what_can_never_work_is_refused_with_what_to_do() {
    let workshop = Workshop::shared();
    let scenario = &workshop.scenarios()[0];
    let source = format!("corpus:{}/{scenario}", text(&workshop.corpus()));
    let run = workshop.run();
    let no_video = workshop.folder.path().join("words.mp4");
    fs::write(&no_video, "these are words").unwrap();
    let small = workshop.folder.path().join("small.mp4");
    ffmpeg(&["-f", "lavfi", "-i", "testsrc2=s=640x480:d=1", text(&small)]);
    let of = |view: &str, source: &str| format!("{view}={source}");
    let [left, right] = VIEWS.map(|view| of(view, &source));
    let cases: &[(&[&str], &str)] = &[
        (&["--view", &left], "--without right"),
        (
            &["--view", &left, "--view", &of("tower", &source)],
            "its views are left, right",
        ),
        (
            &["--view", &left, "--view", &left, "--view", &right],
            "given twice",
        ),
        (
            &["--view", &left, "--view", &of("right", "missing.mp4")],
            "missing.mp4",
        ),
        (
            &["--view", &left, "--view", &of("right", text(&no_video))],
            "no video",
        ),
        (
            &["--view", &left, "--view", &of("right", text(&small))],
            "640x480 pixels, expected 1920x1280",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &of("right", "rtsp://me:secret@host/x"),
            ],
            "DTD_PASSWORD",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &of("right", "rtsp://host/x"),
                "--as-fast-as-possible",
            ],
            "is a camera",
        ),
        (
            &["--view", &left, "--view", &right, "--without", "right"],
            "leave one of them out",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "tower=1"],
            "no such view",
        ),
        (
            &["--view", &left, "--view", &right, "--offset", "left=1e300"],
            "expected -3600 to 3600",
        ),
        (
            &[
                "--view",
                &left,
                "--view",
                &right,
                "--password-file",
                "tower=missing",
            ],
            "its views are left, right",
        ),
    ];
    for (arguments, expected) in cases {
        let output = DTD
            .command(&["estimate", text(&run)])
            .args(*arguments)
            .output()
            .unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(
            said.contains(expected) && !said.contains("secret"),
            "{arguments:?}: {said}"
        );
        assert!(!String::from_utf8_lossy(&output.stdout).contains("dtd_m"));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn an_output_that_is_full_is_a_failure() {
    let workshop = Workshop::shared();
    let scenario = &workshop.scenarios()[0];
    let source = format!("corpus:{}/{scenario}", text(&workshop.corpus()));
    let output = workshop
        .command([&source, &source])
        .arg("--as-fast-as-possible")
        .stdout(fs::File::create("/dev/full").unwrap())
        .output()
        .unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("No space"), "{said}");
}

#[test]
fn a_port_in_use_is_refused() {
    let workshop = Workshop::shared();
    let source = format!(
        "corpus:{}/{}",
        text(&workshop.corpus()),
        workshop.scenarios()[0]
    );
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = workshop
        .command([&source, &source])
        .args(["--metrics", &address])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", said(&output));
    assert!(said(&output).contains(&address), "{}", said(&output));
}

#[test]
fn streams_that_stop_are_noticed_and_come_back() {
    let workshop = Workshop::shared();
    let Some(server) = Server::start(workshop, &[]) else {
        return;
    };
    let [left, right] = VIEWS.map(|view| server.address(view));
    let mut running = Running::start(&mut workshop.command([&left, &right]));
    assert_eq!(running.next()["event"], "start");
    running.until_both("up");
    // Nothing ends, and nothing comes.
    server.signal(Signal::STOP);
    running.until_both("down");
    server.signal(Signal::CONT);
    running.until_both("up");
    let port = server.port.clone();
    drop(server);
    running.until_both("down");
    let Some(_server) = Server::start(workshop, &["--port", &port]) else {
        return;
    };
    running.until_both("up");
    running.signal(Signal::TERM);
    let end = running.last();
    assert_eq!(end["cause"], "signal");
    assert!(running.child.wait().unwrap().success());
}

#[test]
fn a_server_gets_its_password_from_the_environment_and_nobody_sees_it() {
    let workshop = Workshop::shared();
    let Some(server) = Server::start(workshop, &["--user", "me:hidden"]) else {
        return;
    };
    let sources = VIEWS.map(|view| server.address(view).replace("rtsp://", "rtsp://me@"));
    let sources = [&*sources[0], &*sources[1]];
    let refused = workshop.command(sources).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert!(
        said(&refused).contains("DTD_PASSWORD_VIEW"),
        "{}",
        said(&refused)
    );
    let checked = workshop
        .command(sources)
        .args(["--check", "-vv"])
        .envs(VIEWS.map(|view| (format!("DTD_PASSWORD_{}", view.to_uppercase()), "hidden")))
        .output()
        .unwrap();
    assert!(checked.status.success(), "{}", said(&checked));
    let found: Value = serde_json::from_slice(&checked.stdout).unwrap();
    assert_eq!(found[0]["size_px"], json!([1920, 1280]));
    assert!(!said(&checked).contains("hidden") && !found.to_string().contains("hidden"));
}

/// A `dtd estimate` at work.
struct Running {
    child: Child,
    lines: std::io::Lines<BufReader<std::process::ChildStdout>>,
    /// The watchdog ends with it.
    _alive: Sender<()>,
}

impl Running {
    fn start(command: &mut Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let pid = Pid::from_child(&child);
        let (alive, is_over) = channel::<()>();
        thread::spawn(move || {
            if is_over.recv_timeout(LONGEST) == Err(RecvTimeoutError::Timeout) {
                // Whoever waits for its lines then sees that it ended.
                let _ = kill_process(pid, Signal::KILL);
            }
        });
        Self {
            child,
            lines,
            _alive: alive,
        }
    }

    fn next(&mut self) -> Value {
        let line = self.lines.next().expect("it ended").unwrap();
        serde_json::from_str(&line).unwrap()
    }

    /// Reads on until both views have been in this state.
    fn until_both(&mut self, state: &str) {
        let mut missing: Vec<&str> = VIEWS.to_vec();
        while !missing.is_empty() {
            let line = self.next();
            if line["event"] == "view" && line["state"] == state {
                missing.retain(|view| line["view"] != *view);
            }
        }
    }

    fn last(&mut self) -> Value {
        let mut last = Value::Null;
        for line in self.lines.by_ref() {
            last = serde_json::from_str(&line.unwrap()).unwrap();
        }
        last
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An RTSP server with a stream for each view.
struct Server {
    child: Child,
    port: String,
}

impl Server {
    /// `None` where there is no such server.
    fn start(workshop: &Workshop, options: &[&str]) -> Option<Self> {
        let script = repository().join("tests/judges/rtsp_server.py");
        let videos = VIEWS.iter().zip(videos(workshop));
        let videos = videos.map(|(view, path)| format!("{view}={}", text(path)));
        let child = Command::new(PYTHON)
            .arg(script)
            .args(options)
            .args(videos)
            .stdout(Stdio::piped())
            .spawn();
        let mut child = match child {
            Ok(child) => child,
            Err(error) => {
                skipped(&format!("{PYTHON} does not start: {error}"));
                return None;
            }
        };
        let mut port = String::new();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        stdout.read_line(&mut port).unwrap();
        if port.is_empty() {
            skipped("there is no GStreamer with its RTSP server; scripts/setup.sh installs it");
            return None;
        }
        Some(Self {
            child,
            port: port.trim().into(),
        })
    }

    fn address(&self, view: &str) -> String {
        format!("rtsp://127.0.0.1:{}/{view}", self.port)
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A minute of each camera's view at ten images a second, with noise. Made once.
fn videos(workshop: &Workshop) -> &'static [PathBuf; 2] {
    static VIDEOS: OnceLock<[PathBuf; 2]> = OnceLock::new();
    VIDEOS.get_or_init(|| {
        let corpus = Corpus::open(&workshop.corpus()).unwrap();
        let scenario = corpus.scenario(&workshop.scenarios()[0]).open().unwrap();
        VIEWS.map(|view| {
            let path = workshop.folder.path().join(format!("{view}.mp4"));
            encode(&scenario.video_path(view).unwrap(), &path);
            path
        })
    })
}

fn encode(recorded: &Path, to: &Path) {
    let filter = "trim=end_frame=1,loop=loop=599:size=1,setpts=N/10/TB,noise=alls=4:allf=t";
    let noisy = ["-vf", filter, "-r", "10", "-g", "10", "-c:v", "libx264"];
    let fast = ["-preset", "ultrafast", "-tune", "zerolatency", "-crf", "30"];
    ffmpeg(&[&["-i", text(recorded)][..], &noisy, &fast, &[text(to)]].concat());
}

fn ffmpeg(arguments: &[&str]) {
    let output = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-y"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", said(&output));
}
