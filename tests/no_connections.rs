//! `dtd` opens no unrequested connection: every verb runs in a separate network namespace with only the loopback device, and every
//! address that the processes try is recorded.

mod tiny;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use testkit::command::{Server, said};
use testkit::skipped;
use tiny::Tiny;

/// Brings up the loopback device of a new network namespace, without needing an installed tool, and becomes the command.
const INSIDE: &str = r#"
import fcntl, os, socket, struct, sys
IFF_UP, SIOCSIFFLAGS = 1, 0x8914
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any:
    fcntl.ioctl(any, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", IFF_UP))
os.execvp(sys.argv[1], sys.argv[1:])
"#;
/// System calls that name the peer.
const CALLS: &str = "trace=connect,sendto,sendmsg,sendmmsg";
/// X-Plane's beacon, which the stand-in sends as X-Plane does.
const BEACON: (&str, &str) = ("239.255.1.1", "49707");

/// A separate network and home.
struct Cell {
    folder: PathBuf,
    home: PathBuf,
    trace: PathBuf,
    /// Commands that create a network namespace: some systems allow it only to root, some only to the root of a user namespace.
    unshare: &'static [&'static str],
}

impl Cell {
    /// `None` if this system does not allow it, which is reported.
    fn new(folder: &Path) -> Option<Self> {
        let (home, trace) = (folder.join("home"), folder.join("trace"));
        fs::create_dir(&home).unwrap();
        let mut cell = Self {
            folder: folder.to_owned(),
            home,
            trace,
            unshare: &["--net"],
        };
        let mut tried = cell.command("true", &[]).output();
        if !tried.as_ref().is_ok_and(|output| output.status.success()) {
            cell.unshare = &["--net", "--map-root-user"];
            tried = cell.command("true", &[]).output();
        }
        if tried.as_ref().is_ok_and(|output| output.status.success()) {
            return Some(cell);
        }
        skipped(&format!(
            "it needs unshare (root, or user namespaces), python3 and strace: {tried:?}"
        ));
        None
    }

    fn command(&self, program: &str, arguments: &[&str]) -> Command {
        let mut command = Command::new("unshare");
        command
            .args(self.unshare)
            .args(["python3", "-c", INSIDE])
            .args(["strace", "-f", "-qq", "--seccomp-bpf", "-A", "-e", CALLS])
            .arg("-o")
            .arg(&self.trace)
            .arg(program)
            .args(arguments)
            .current_dir(&self.folder)
            .env("HOME", &self.home)
            .env("http_proxy", "http://192.0.2.1:3128")
            .env_remove("XDG_CACHE_HOME")
            .env_remove("ORT_DYLIB_PATH")
            .env_remove("ORT_DISABLE_TELEMETRY");
        command
    }

    fn dtd(&self, arguments: &[&str]) -> Output {
        self.command(env!("CARGO_BIN_EXE_dtd"), arguments)
            .output()
            .unwrap()
    }
}

/// The text between two marks.
fn between<'a>(line: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let (_, rest) = line.split_once(before)?;
    Some(rest.split_once(after)?.0)
}

/// The address in a line of the trace, unless it is this computer's or the beacon's.
fn foreign(line: &str) -> Option<String> {
    let address = between(line, "inet_addr(\"", "\"").or(between(line, "AF_INET6, \"", "\""))?;
    let port = between(line, "_port=htons(", ")").unwrap_or_default();
    // The system's resolver may be local, but resolving means contacting somebody elsewhere.
    let here = ["127.", "::1", "0.0.0.0"]
        .iter()
        .any(|own| address.starts_with(own))
        && port != "53";
    (!here && (address, port) != BEACON).then(|| line.to_owned())
}

#[test]
fn addresses_of_others_are_seen_in_a_trace() {
    let line = |address: &str, port: u32| {
        format!(
            r#"7 connect(5, {{sa_family=AF_INET, sin_port=htons({port}), sin_addr=inet_addr("{address}")}}, 16) = -1 ENETUNREACH"#
        )
    };
    assert!(foreign(&line("127.0.0.1", 49_000)).is_none());
    assert!(foreign(&line("127.0.0.53", 53)).is_some());
    assert!(foreign(&line("239.255.1.1", 49_707)).is_none());
    assert!(foreign(&line("8.8.8.8", 53)).is_some());
    let six = r#"7 connect(5, {sa_family=AF_INET6, sin6_port=htons(443), sin6_flowinfo=htonl(0), inet_pton(AF_INET6, "2620:1ec::42", &sin6_addr), sin6_scope_id=0}, 28) = -1"#;
    assert!(foreign(six).is_some());
    assert!(foreign(&six.replace("2620:1ec::42", "::1")).is_none());
}

#[test]
fn no_verb_calls_anybody_who_was_not_named_or_leaves_anything_at_home() {
    let tiny = Tiny::made().copy();
    let Some(cell) = Cell::new(tiny.root()) else {
        return;
    };
    let store = format!("file://{}", tiny.path("store").display());
    let training = "training.toml";
    let verbs: [&[&str]; 13] = [
        &["schema"],
        &["plan", "sweep.toml", "--against", "corpus"],
        &["generate", "sweep.toml", "--out", "again"],
        &["label", "again"],
        &["detect", "again", "--model", tiny::MODEL],
        &["evaluate-detector", "corpus", "--out", "judged"],
        &["verify", "corpus"],
        &["train", "corpus", "--out", "another", "--config", training],
        &["evaluate", "run", "--corpus", "corpus"],
        &["export-estimators", "run", "--out", "models"],
        &["push", "corpus", &store],
        &["fetch", &store, "--out", "fetched"],
        &[
            "train-detector",
            "corpus",
            "--out",
            "new.onnx",
            "--minutes",
            "0.001",
        ],
    ];
    for arguments in verbs {
        let output = cell.dtd(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", said(&output));
    }
    // Nobody answers, nothing is there: it is enough that they end.
    cell.dtd(&["doctor", "--sim", "127.0.0.1:9"]);
    cell.dtd(&["install-plugin", "no-x-plane"]);
    let tape = ["tape", "--sim", "127.0.0.1:9", "--out", "session.mcap"];
    let view = ["view", "corpus", "--run", "run", "--no-open"];
    for serving in [&["mock-xplane"][..], &tape, &view] {
        let serving = [serving, &["--port", "0", "--until-stdin-ends"]].concat();
        Server::start(&mut cell.command(env!("CARGO_BIN_EXE_dtd"), &serving)).end();
    }
    let trace = fs::read_to_string(&cell.trace).unwrap();
    assert!(trace.contains("127.0.0.1"), "nothing was traced");
    let tried: Vec<String> = trace.lines().filter_map(foreign).collect();
    assert!(tried.is_empty(), "{tried:#?}");
    let left: Vec<_> = fs::read_dir(&cell.home).unwrap().collect();
    assert!(left.is_empty(), "{left:?}");
}
