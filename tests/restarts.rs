//! `dtd generate --restart-simulator`: simulators in separate processes that are ended during a run and started again by its command, also
//! by the documented one, `scripts/restart-x-plane.sh`.

use std::fs;
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use tempfile::{TempDir, tempdir};
use testkit::command::{Dtd, Ending, json, said};
use testkit::files::assert_same_contents;
use testkit::free_udp_port;
use testkit::sweep::{FROM_2_NM, SmallSweep};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
/// Far longer than anything here takes.
const TOO_LONG: Duration = Duration::from_secs(180);
const WEATHERS: &str = r#"
[weather.clear]
visibility_m = 30000

[weather.hazy]
visibility_m = 15000

[weather.windy]
visibility_m = 30000
wind_speed_mps = 6
wind_from_true_deg = 60
"#;

/// A simulator that scripts start and end.
struct Scripted {
    folder: TempDir,
    port: u16,
}

impl Scripted {
    /// The first one, already started.
    fn start() -> Self {
        let port = free_udp_port();
        let folder = tempdir().unwrap();
        let scripted = Self { folder, port };
        let started = Command::new("sh")
            .args(["-c", &scripted.script("")])
            .env("DTD_SIMULATOR", scripted.address())
            .status();
        assert!(started.unwrap().success());
        let began = Instant::now();
        loop {
            let log = fs::read_to_string(scripted.file("log")).unwrap_or_default();
            if log.contains("\"udp\"") {
                break;
            }
            assert!(began.elapsed() < TOO_LONG, "it did not start: {log}");
            sleep(Duration::from_millis(10));
        }
        scripted
    }

    fn address(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Ends the old simulator, starts one with these arguments in the background, and notes for which simulator.
    fn script(&self, arguments: &str) -> String {
        format!(
            "kill -9 $(cat {pid}) 2>/dev/null; \
             {dtd} mock-xplane --port {port} --no-beacon --web-port 0 --quirks=none {arguments} </dev/null >>{log} 2>&1 & \
             echo $! >{pid}; echo $DTD_SIMULATOR >>{starts}",
            pid = self.file("pid").display(),
            dtd = DTD.program(),
            port = self.port,
            log = self.file("log").display(),
            starts = self.file("starts").display(),
        )
    }

    fn kill(&self) {
        self.signal("-9");
    }

    fn signal(&self, signal: &str) {
        let text = fs::read_to_string(self.file("pid")).unwrap_or_default();
        // The documented script notes when the process began as well.
        let pid = text.split_whitespace().next().unwrap_or_default();
        let _ = Command::new("kill").args([signal, pid]).output();
    }

    /// X-Plane's own command to end.
    fn quit(&self) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let packet = b"CMND\0sim/operation/quit\0";
        socket.send_to(packet, self.address()).unwrap();
    }

    /// The simulators that were named when one was started, the first by this test.
    fn starts(&self) -> Vec<String> {
        let text = fs::read_to_string(self.file("starts")).unwrap();
        text.lines().map(str::to_owned).collect()
    }

    /// A run whose patience is eight seconds: a quarter until the first restart, and for each try.
    fn generate(&self, sweep: &Path, corpus: &Path, more: &[&str]) -> Command {
        self.generate_within("8", sweep, corpus, more)
    }

    fn generate_within(
        &self,
        seconds: &str,
        sweep: &Path,
        corpus: &Path,
        more: &[&str],
    ) -> Command {
        let mut command = DTD.command(&["generate", "--json", "--timeout", seconds]);
        command
            .arg(sweep)
            .arg("--out")
            .arg(corpus)
            .args(["--sim", &self.address()])
            .args(more);
        command
    }
}

impl Drop for Scripted {
    fn drop(&mut self) {
        self.kill();
    }
}

/// A sweep of live flights in three weathers.
fn sweep(folder: &Path, repeats: u32) -> PathBuf {
    let path = folder.join("sweep.toml");
    let sweep = SmallSweep {
        name: "restarts",
        seed: 5,
        weathers: &["clear", "hazy", "windy"],
        repeats,
        size_px: (64, 64),
        frame_rate: "1/2",
        tables: &format!("{FROM_2_NM}{WEATHERS}"),
    };
    fs::write(&path, sweep.toml()).unwrap();
    path
}

fn made(corpus: &Path) -> usize {
    let folders = fs::read_dir(corpus.join("scenarios")).into_iter().flatten();
    folders
        .filter(|folder| {
            let name = folder.as_ref().unwrap().file_name();
            !name.to_string_lossy().ends_with(".partial")
        })
        .count()
}

/// Waits until a run has made this many scenarios.
fn until_made(run: &mut Child, corpus: &Path, wanted: usize) {
    let began = Instant::now();
    while made(corpus) < wanted {
        let ended = run.try_wait().unwrap();
        assert!(ended.is_none(), "it ended by itself: {ended:?}");
        assert!(began.elapsed() < TOO_LONG, "{} made", made(corpus));
        sleep(Duration::from_millis(2));
    }
}

/// A run that is disturbed whenever the corpus has as many scenarios.
fn run_with(mut command: Command, corpus: &Path, disturb: &[(usize, &dyn Fn())]) -> Output {
    let mut run = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    for (at, disturb) in disturb {
        until_made(&mut run, corpus, *at);
        disturb();
    }
    run.wait_with_output().unwrap()
}

fn count(outcome: &serde_json::Value, list: &str) -> usize {
    outcome[list].as_array().unwrap().len()
}

#[test]
fn a_simulator_that_is_ended_at_each_third_of_a_run_is_restarted_and_the_corpus_has_the_same_bytes()
{
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 4);
    let [corpus, undisturbed] = ["corpus", "undisturbed"].map(|name| folder.path().join(name));
    let simulator = Scripted::start();
    let command = simulator.script("");
    let run = simulator.generate(&sweep, &corpus, &["--restart-simulator", &command]);
    let end = || simulator.kill();
    let output = run_with(run, &corpus, &[(4, &end), (8, &end), (11, &end)]);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(count(&json(&output), "committed"), 12);
    assert_eq!(simulator.starts(), vec![simulator.address(); 4]);
    assert!(said(&output).contains("restarting simulator"));

    simulator.generate(&sweep, &undisturbed, &[]).succeeds();
    assert_same_contents(&corpus, &undisturbed);
}

/// The documented script starts a simulator that is in its main menu after a slow start, holds its ports after its end, and asks for safe
/// mode after an unclean one.
#[test]
fn the_documented_script_restarts_a_simulator_however_it_ended_and_however_it_starts() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 4);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    let web_port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let faults = format!(
        "cold=1,held=1.5,menu=yes,asks={}",
        simulator.file("runs").display()
    );
    let start = format!(
        "echo $DTD_SIMULATOR >>{starts}; exec {dtd} mock-xplane --port {port} --no-beacon --web-port {web_port} --quirks=none --faults {faults}",
        starts = simulator.file("starts").display(),
        dtd = DTD.program(),
        port = simulator.port,
    );
    let script = testkit::repository().join("scripts/restart-x-plane.sh");
    let mut run = simulator.generate_within("24", &sweep, &corpus, &["--restart-simulator"]);
    run.arg(script)
        .env("DTD_WEB_API", format!("127.0.0.1:{web_port}"))
        .env("X_PLANE", start)
        .env("X_PLANE_PID_FILE", simulator.file("pid"))
        .envs([("QUIT_S", "3"), ("TERM_S", "3"), ("PORT_S", "5")]);
    let quit = || simulator.quit();
    let term = || simulator.signal("-TERM");
    let kill = || simulator.kill();
    let output = run_with(run, &corpus, &[(4, &quit), (8, &term), (11, &kill)]);
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(count(&json(&output), "committed"), 12);
    // The last start asked for safe mode, and was ended and followed by another one.
    assert_eq!(simulator.starts().len(), 5, "{}", said(&output));
    assert!(said(&output).contains("safe mode"), "{}", said(&output));

    let verified = DTD.command(&["verify"]).arg(&corpus).output().unwrap();
    assert!(verified.status.success(), "{}", said(&verified));
}

#[test]
fn a_simulator_that_is_starting_when_the_run_begins_is_waited_for() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 1);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    simulator.kill();
    let started = Command::new("sh")
        .args(["-c", &simulator.script("--faults cold=6")])
        .status();
    assert!(started.unwrap().success());
    // The port is taken before anything answers.
    sleep(Duration::from_millis(500));
    let output = simulator
        .generate_within("30", &sweep, &corpus, &[])
        .output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert!(
        said(&output).contains("may still be starting"),
        "{}",
        said(&output)
    );
}

#[test]
fn a_simulator_without_the_plugin_is_waited_for_with_its_remedy() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 1);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    // One that has run for minutes starts no plugin any more.
    let started = Command::new("sh")
        .args([
            "-c",
            &simulator.script("--state no-plugin --clock-rate 100"),
        ])
        .status();
    assert!(started.unwrap().success());
    let run = simulator.generate_within("2", &sweep, &corpus, &[]);
    let output = run_with(run, &corpus, &[]);
    assert!(!output.status.success());
    let said = said(&output);
    let waits = said
        .lines()
        .find(|line| line.contains("may still be starting"));
    let waits = waits.unwrap_or_else(|| panic!("{said}"));
    assert!(waits.contains("dtd install-plugin"), "{waits}");
}

#[test]
fn a_simulator_is_restarted_after_as_many_live_flights_as_wanted() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 2);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    let command = simulator.script("");
    let arguments = ["--restart-simulator", &command, "--restart-every", "2"];
    let output = simulator.generate(&sweep, &corpus, &arguments).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", said(&output));
    assert_eq!(count(&json(&output), "committed"), 6);
    // After two and after four: after six nothing is left to record.
    assert_eq!(simulator.starts().len(), 3, "{}", said(&output));
}

#[test]
fn another_version_that_comes_back_ends_the_run_with_what_to_do() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 2);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    let command = simulator.script("--xplane 11");
    let run = simulator.generate(&sweep, &corpus, &["--restart-simulator", &command]);
    let end = || simulator.kill();
    let output = run_with(run, &corpus, &[(2, &end)]);
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    let outcome = json(&output);
    assert_eq!(outcome["stopped"]["cause"], "setup", "{outcome}");
    assert_eq!(count(&outcome, "failed"), 0);
    assert!(count(&outcome, "not_made") > 0);
    let reason = outcome["stopped"]["reason"].as_str().unwrap();
    assert!(
        reason.contains("when the run began") && reason.contains("Run the same command again"),
        "{reason}"
    );
}

#[test]
fn a_command_that_fails_ends_the_run_with_its_last_output() {
    let folder = tempdir().unwrap();
    let sweep = sweep(folder.path(), 2);
    let corpus = folder.path().join("corpus");
    let simulator = Scripted::start();
    let command = "echo no such machine; exit 4";
    let run = simulator.generate(&sweep, &corpus, &["--restart-simulator", command]);
    let end = || simulator.kill();
    let output = run_with(run, &corpus, &[(2, &end)]);
    assert_eq!(output.status.code(), Some(75), "{}", said(&output));
    assert_eq!(json(&output)["stopped"]["cause"], "no_simulator");
    assert!(
        said(&output).contains("exit status: 4") && said(&output).contains("no such machine"),
        "{}",
        said(&output)
    );
}
