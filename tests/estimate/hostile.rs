//! Cameras that answer with anything but their images: each is down with its cause and tried again, and the other one goes on.

use std::fs;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use testkit::command::text;

use crate::running::Running;
use crate::server::Server;
use crate::streams::{cameras, stills};
use crate::workshop::{Workshop, ffmpeg};

/// Maximum memory of the program, KiB, with `--max-memory 600M`.
const MAX_KIB: u64 = 700 << 10;
/// Longest time from a connection to the next one: opening is given up after 32 s at most, and tried again after one more.
const MAX_TIME_OF_AN_ACT: Duration = Duration::from_secs(40);

/// A server's behaviour on a connection, and part of the cause in the event; empty if it is the cause of the act before or after, which is
/// told once.
type Act = (fn(TcpStream, &str), &'static str);

const ACTS: [Act; 8] = [
    (
        |stream, _| {
            let head = "401 Unauthorized\r\nWWW-Authenticate: Basic realm=\"all\"";
            answer(stream, |_| reply(head, ""));
        },
        "asks for a password",
    ),
    (
        |stream, other| {
            let head = format!("302 Moved\r\nLocation: rtsp://{other}/elsewhere");
            answer(stream, |_| reply(&head, ""));
        },
        "redirects to rtsp://",
    ),
    (
        |mut stream, _| {
            let _ = stream.write_all(&[0xa5; 4_096]);
        },
        "does not answer as an RTSP server",
    ),
    (
        |mut stream, _| {
            answer(stream.try_clone().unwrap(), |method| match method {
                "DESCRIBE" => reply("200 OK\r\nContent-Length: 2000000000", "")
                    .replace("Content-Length: 0\r\n", ""),
                _ => reply("200 OK", ""),
            });
            while stream.write_all(&[b'a'; 1 << 16]).is_ok() {}
        },
        "2000000000 bytes",
    ),
    (
        |mut stream, _| {
            let _ = stream.write_all(b"RTSP/1.0 200 OK\r\n");
            while stream.write_all(b"X: y\r\n").is_ok() {}
        },
        "bytes of headers",
    ),
    (
        |stream, _| {
            answer(
                stream,
                described("m=audio 0 RTP/AVP 0\r\na=control:one\r\n"),
            );
        },
        "no video",
    ),
    (
        |stream, _| {
            let video = "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=control:one\r\n";
            answer(stream, described(&video.repeat(2_000)));
        },
        "no image came",
    ),
    (
        |stream, _| answer(stream, |_| reply("404 Not Found", "")),
        "404",
    ),
];

#[test]
fn a_camera_that_is_none_is_told_with_its_cause_and_the_other_one_goes_on() {
    let workshop = Workshop::shared();
    let Some(server) = Server::start(&[], &cameras(&workshop)) else {
        return;
    };
    let other = TcpListener::bind("127.0.0.1:0").unwrap();
    let elsewhere = other.local_addr().unwrap().to_string();
    let (right, connected) = hostile(&ACTS, elsewhere);
    let mut command = workshop.command([&server.address("left"), &right]);
    command
        .args(["--max-memory", "600M"])
        .env("DTD_PASSWORD_RIGHT", "secret");
    let mut running = Running::start(&mut command);
    let left = goes_on(&mut running, ACTS.iter().map(|(_, cause)| *cause));
    assert!(left.contains(&"up".into()), "{left:?}");
    let connected: Vec<Instant> = connected.try_iter().collect();
    for (act, times) in connected.windows(2).enumerate() {
        let took = times[1] - times[0];
        assert!(took < MAX_TIME_OF_AN_ACT, "act {act} took {took:?}");
    }
    assert!(connected.len() >= ACTS.len(), "{connected:?}");
    other.set_nonblocking(true).unwrap();
    match other.accept() {
        Ok((mut stream, _)) => {
            stream.set_nonblocking(false).unwrap();
            assert_eq!(
                stream.read(&mut [0; 64]).unwrap(),
                0,
                "it was sent something"
            );
        }
        Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock),
    }
}

#[test]
fn a_recording_beside_a_camera_that_is_wrong_ends() {
    let workshop = Workshop::shared();
    let short = workshop.folder.path().join("short.mp4");
    let left = text(&stills(&workshop)["left"]);
    ffmpeg(&["-i", left, "-t", "2", "-c", "copy", text(&short)]);
    let (right, _connected) = hostile(&ACTS[..1], String::new());
    let mut running = Running::start(&mut workshop.command([text(&short), &right]));
    assert_eq!(running.last()["cause"], "recordings");
    assert!(running.child.wait().unwrap().success());
}

#[test]
fn a_camera_with_huge_images_takes_no_memory_for_them() {
    let workshop = Workshop::shared();
    let [once, huge] = ["once.mp4", "huge.mp4"].map(|name| workshop.folder.path().join(name));
    let picture = "testsrc2=s=8192x8192:r=1:d=6";
    let coding = ["-preset", "ultrafast", "-x264-params", "ref=16:keyint=3"];
    let input = ["-f", "lavfi", "-i", picture, "-pix_fmt", "yuv420p"];
    ffmpeg(&[&input[..], &["-c:v", "libx264"], &coding, &[text(&once)]].concat());
    let repeated = ["-stream_loop", "9", "-i", text(&once), "-c", "copy"];
    ffmpeg(&[&repeated[..], &[text(&huge)]].concat());
    let stills = stills(&workshop);
    let cameras = [
        ("left", &*stills["left"]),
        ("right", &*stills["right"]),
        ("right:huge", &*huge),
    ];
    let Some(mut server) = Server::start(&[], &cameras) else {
        return;
    };
    let sources = [server.address("left"), server.address("right")];
    let mut command = workshop.command([&sources[0], &sources[1]]);
    command.args(["--max-memory", "600M"]);
    let mut running = Running::start(&mut command);
    running.until_both("up");
    server.command("switch right huge");
    let size = "its images have 8192x8192 pixels, expected 960x640";
    goes_on(&mut running, [size].into_iter());
    server.command("drop right");
    server.command("offer right huge");
    goes_on(&mut running, [size].into_iter());
}

/// The address of a server that does these acts, one for each connection, and the last one again and again; and the times of connections.
fn hostile(acts: &'static [Act], elsewhere: String) -> (String, Receiver<Instant>) {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("rtsp://me@{}/right", server.local_addr().unwrap());
    let (connected, times) = channel();
    thread::spawn(move || {
        for (act, _) in acts.iter().chain(acts.last().into_iter().cycle()) {
            let Ok((stream, _)) = server.accept() else {
                return;
            };
            let _ = connected.send(Instant::now());
            act(stream, &elsewhere);
        }
    });
    (address, times)
}

/// Reads on until the right view was down for these causes, one after the other. Returns the states of the left one, never down.
fn goes_on(running: &mut Running, causes: impl Iterator<Item = &'static str>) -> Vec<Value> {
    let mut left = Vec::new();
    for cause in causes.filter(|cause| !cause.is_empty()) {
        loop {
            let line = running.next();
            if line["event"] == "view" && line["view"] == "left" {
                assert_ne!(line["state"], "down", "{line}");
                left.push(line["state"].clone());
            }
            let why = line["why"].as_str().unwrap_or_default();
            if line["view"] == "right" && why.contains(cause) {
                assert_eq!(line["state"], "down");
                break;
            }
        }
    }
    let status = fs::read_to_string(format!("/proc/{}/status", running.child.id())).unwrap();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let peak_kib: u64 = (peak.unwrap().trim().trim_end_matches(" kB"))
        .parse()
        .unwrap();
    assert!(peak_kib < MAX_KIB, "{peak_kib} KiB");
    left
}

/// Answers requests, until the client leaves or one is followed by a body that the caller sends.
fn answer(mut stream: TcpStream, reply_to: impl Fn(&str) -> String) {
    stream
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    let mut requests = BufReader::new(stream.try_clone().unwrap());
    loop {
        let (mut method, mut number) = (String::new(), String::new());
        loop {
            let mut line = String::new();
            if !requests.read_line(&mut line).is_ok_and(|bytes| bytes > 0) {
                return;
            }
            if let Some(of) = line.strip_prefix("CSeq:") {
                number = of.trim().into();
            }
            if method.is_empty() {
                method = line.split(' ').next().unwrap_or_default().into();
            }
            if line.trim().is_empty() {
                break;
            }
        }
        let text = reply_to(&method).replace("CSEQ", &number);
        if stream.write_all(text.as_bytes()).is_err() || text.contains("2000000000") {
            return;
        }
    }
}

fn reply(head: &str, body: &str) -> String {
    let bytes = body.len();
    format!("RTSP/1.0 {head}\r\nCSeq: CSEQ\r\nContent-Length: {bytes}\r\n\r\n{body}")
}

/// A server that describes this stream but never sends it.
fn described(media: &str) -> impl Fn(&str) -> String {
    let body = format!("v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=x\r\nt=0 0\r\n{media}");
    move |method| match method {
        "DESCRIBE" => reply("200 OK\r\nContent-Type: application/sdp", &body),
        "SETUP" => reply(
            "200 OK\r\nSession: 1\r\nTransport: RTP/AVP/TCP;unicast;interleaved=0-1",
            "",
        ),
        _ => reply("200 OK", ""),
    }
}
