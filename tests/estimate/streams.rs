//! Kinds of streams: servers with passwords, and descriptions of streams that come without a server.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::thread;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use testkit::command::{Ending, said, text};
use testkit::free_udp_port;

use crate::running::Running;
use crate::server::Server;
use crate::workshop::{VIEWS, Workshop, ffmpeg, videos};

const SECRET: &str = "hid%64en word";

#[test]
fn passwords_from_the_environment_and_from_files_reach_servers_and_nobody_sees_them() {
    let workshop = Workshop::shared();
    let file = workshop.folder.path().join("password");
    fs::write(&file, format!("{SECRET}\n")).unwrap();
    let user = &*format!("me:{SECRET}");
    for options in [&["--user", user][..], &["--user", user, "--digest"]] {
        let Some(server) = Server::start(options, &cameras(&workshop)) else {
            return;
        };
        let sources = VIEWS.map(|view| server.address(view).replace("rtsp://", "rtsp://me@"));
        let sources = [&*sources[0], &*sources[1]];
        workshop
            .command(sources)
            .ends_with(2, &["DTD_PASSWORD_VIEW"]);
        let with_passwords = |more: &[&str]| {
            let mut command = workshop.command(sources);
            command
                .args(more)
                .args(["-vv", "--password-file", &format!("left={}", text(&file))])
                .env("DTD_PASSWORD_RIGHT", SECRET);
            command
        };
        let checked = with_passwords(&["--check"]).succeeds();
        let found: Value = serde_json::from_slice(&checked.stdout).unwrap();
        assert_eq!(found[0]["size_px"], json!([960, 640]));
        let mut seen = said(&checked) + &found.to_string();
        let mut command = with_passwords(&["--metrics", "127.0.0.1:0"]);
        let mut running = Running::start(command.stderr(Stdio::piped()));
        let mut stderr = BufReader::new(running.child.stderr.take().unwrap());
        let address = line_with(&mut stderr, "http://");
        let reading = thread::spawn(move || {
            let mut text = String::new();
            stderr.read_to_string(&mut text).unwrap();
            text
        });
        seen += &running.until_both("up");
        seen += &metrics(&address);
        let process = format!("/proc/{}/cmdline", running.child.id());
        seen += &String::from_utf8_lossy(&fs::read(process).unwrap());
        running.signal(Signal::TERM);
        seen += &running.last().to_string();
        seen += &reading.join().unwrap();
        for secret in [SECRET, "hid%", "hidden"] {
            assert!(!seen.contains(secret), "{secret}: {seen}");
        }
    }
}

#[test]
fn a_certificate_must_be_trusted_or_allowed() {
    let workshop = Workshop::shared();
    let folder = workshop.folder.path();
    let [certificate, key, both] = ["certificate", "key", "both"].map(|name| folder.join(name));
    let subject = [
        "-subj",
        "/CN=camera",
        "-addext",
        "subjectAltName=IP:127.0.0.1",
    ];
    Command::new("openssl")
        .args([
            "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2",
        ])
        .args(["-addext", "basicConstraints=critical,CA:FALSE"])
        .args(subject)
        .args(["-out", text(&certificate), "-keyout", text(&key)])
        .succeeds();
    let texts = [&certificate, &key].map(|path| fs::read_to_string(path).unwrap());
    fs::write(&both, texts.concat()).unwrap();
    let Some(server) = Server::start(&["--tls", text(&both)], &cameras(&workshop)) else {
        return;
    };
    let sources = VIEWS.map(|view| server.address(view).replace("rtsp:", "rtsps:"));
    let sources = [&*sources[0], &*sources[1]];
    let said = workshop.command(sources).ends_with(2, &["--insecure-tls"]);
    assert!(said.contains("does not trust its certificate"), "{said}");
    let any = ["--insecure-tls", "left", "--insecure-tls", "right"];
    for (options, trusted) in [(&any[..], None), (&[], Some(&certificate))] {
        let mut command = workshop.command(sources);
        command.args(options).args(["--check"]);
        if let Some(trusted) = trusted {
            command.env("SSL_CERT_FILE", trusted);
        }
        let checked = command.succeeds();
        let found: Value = serde_json::from_slice(&checked.stdout).unwrap();
        assert_eq!(found[1]["size_px"], json!([960, 640]));
    }
}

#[test]
fn descriptions_name_streams_that_come_without_a_server() {
    let workshop = Workshop::shared();
    let stills = stills(&workshop);
    let senders = VIEWS.map(|view| Sender::start(workshop.folder.path(), view, &stills[view], &[]));
    let sources = [text(&senders[0].description), text(&senders[1].description)];
    let mut running = Running::start(&mut workshop.command(sources));
    let said = running.until_both("up");
    assert!(said.contains("\"clock\""), "{said}");
    running.signal(Signal::TERM);
    assert_eq!(running.last()["cause"], "signal");
}

#[test]
fn a_camera_whose_images_stop_is_opened_again_although_its_sound_goes_on() {
    let workshop = Workshop::shared();
    let folder = tempfile::tempdir().unwrap();
    let stills = stills(&workshop);
    let port = format!("rtp://127.0.0.1:{}", free_udp_port());
    let sound = ["-map", "1:a", "-c:a", "pcm_mulaw", "-f", "rtp", &port];
    let senders = [
        Sender::start(folder.path(), "left", &stills["left"], &sound),
        Sender::start(folder.path(), "right", &stills["right"], &[]),
    ];
    let sources = [text(&senders[0].description), text(&senders[1].description)];
    let mut command = workshop.command(sources);
    command.args(["--metrics", "127.0.0.1:0"]);
    let mut running = Running::start(command.stderr(Stdio::piped()));
    let mut stderr = BufReader::new(running.child.stderr.take().unwrap());
    let address = line_with(&mut stderr, "http://");
    running.until_both("up");
    let reopened = || {
        let told = metrics(&address);
        let count = told.split("dtd_view_reopened_total{view=\"left\"} ").nth(1);
        count.unwrap().lines().next().unwrap().to_owned()
    };
    let before = reopened();
    let is_again = (0..1_200).any(|_| {
        thread::sleep(Duration::from_millis(50));
        reopened() != before
    });
    assert!(is_again, "{before}");
}

/// A camera that sends RTP to this computer.
struct Sender {
    process: Child,
    description: PathBuf,
}

impl Sender {
    /// `sound`: options for the audio output. With it, images stop after twenty seconds.
    fn start(folder: &Path, view: &str, video: &Path, sound: &[&str]) -> Self {
        let description = folder.join(format!("{view}.sdp"));
        let to = format!("rtp://127.0.0.1:{}", free_udp_port());
        let lasts_s = if sound.is_empty() { "60" } else { "20" };
        let process = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-sdp_file", text(&description)])
            .args(["-re", "-t", lasts_s, "-i", text(video)])
            .args(["-re", "-f", "lavfi", "-i", "sine=sample_rate=8000"])
            .args(["-map", "0:v", "-c:v", "copy", "-f", "rtp", &to])
            .args(sound)
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        let mut sender = Self {
            process,
            description,
        };
        while !sender.is_described() {
            assert!(sender.process.try_wait().unwrap().is_none(), "it ended");
            thread::sleep(Duration::from_millis(20));
        }
        sender
    }

    fn is_described(&self) -> bool {
        let text = fs::read_to_string(&self.description);
        text.is_ok_and(|text| text.contains("m=video"))
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn line_with(stderr: &mut impl BufRead, part: &str) -> String {
    loop {
        let mut line = String::new();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "it ended");
        if let Some(at) = line.find(part) {
            return line[at..].trim().into();
        }
    }
}

fn metrics(address: &str) -> String {
    let place = address.strip_prefix("http://").unwrap();
    let host = place.strip_suffix("/metrics").unwrap();
    let mut connection = TcpStream::connect(host).unwrap();
    write!(
        connection,
        "GET /metrics HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut text = String::new();
    connection.read_to_string(&mut text).unwrap();
    assert!(text.contains("dtd_images_total"), "{text}");
    text
}

pub(crate) fn cameras(workshop: &Workshop) -> [(&'static str, &'static Path); 2] {
    let stills = stills(workshop);
    VIEWS.map(|view| (view, &*stills[view]))
}

/// A minute of each camera's view at ten images per second, with noise. Made once.
pub(crate) fn stills(workshop: &Workshop) -> &'static BTreeMap<&'static str, PathBuf> {
    static VIDEOS: OnceLock<BTreeMap<&'static str, PathBuf>> = OnceLock::new();
    VIDEOS.get_or_init(|| {
        let recorded = videos(&workshop.corpus());
        let made = VIEWS.iter().zip(&recorded).map(|(view, recorded)| {
            let path = workshop.folder.path().join(format!("{view}.mp4"));
            let filter = "trim=end_frame=1,loop=loop=599:size=1,setpts=N/10/TB,noise=alls=4:allf=t";
            let noisy = ["-vf", filter, "-r", "10", "-g", "10", "-c:v", "libx264"];
            let fast = ["-preset", "ultrafast", "-tune", "zerolatency", "-crf", "30"];
            ffmpeg(&[&["-i", text(recorded)][..], &noisy, &fast, &[text(&path)]].concat());
            (*view, path)
        });
        made.collect()
    })
}
