//! Cameras that answer with anything but their images: each is down with its cause and tried again, and the other one goes on.

use std::fs;
use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
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

/// Answers that are none, or not the ones of this program's camera.
const ANSWERS: [Act; 8] = [
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
            play(&stream, &H264.repeat(2_000));
            thread::sleep(Duration::from_secs(3));
        },
        "no image came",
    ),
    (
        |stream, _| answer(stream, |_| reply("404 Not Found", "")),
        "404",
    ),
];

/// Conversations that lead nowhere.
const CONVERSATIONS: [Act; 10] = [
    (
        |mut stream, _| {
            let _ = stream.read(&mut [0; 1_000]);
        },
        "the server closed the connection",
    ),
    (
        |stream, _| {
            answer(stream, |_| {
                let head =
                    "401 Unauthorized\r\nWWW-Authenticate: Digest realm=\"all\", nonce=\"7\"";
                reply(head, "")
            });
        },
        "asks for a password;",
    ),
    (
        |stream, _| {
            let head = "401 Unauthorized\r\nWWW-Authenticate: Negotiate x=y";
            answer(stream, |_| reply(head, ""));
        },
        "in an unknown way",
    ),
    (
        |stream, _| answer(stream, |_| reply("200 OK", "")),
        "no description",
    ),
    (
        |stream, _| {
            let noise = random(7, 200_000).map(|byte| char::from(byte & 0x7f));
            let noise: String = noise.collect();
            answer(stream, |_| reply("200 OK", &noise));
        },
        "no video in it",
    ),
    (
        |stream, _| {
            answer(stream, described(&H264.replace("H264", "AV1")));
        },
        "\"AV1\"",
    ),
    (
        |stream, _| {
            let describe = described(H264);
            answer(stream, |method| match method {
                "SETUP" => reply("461 Unsupported Transport", ""),
                _ => describe(method),
            });
        },
        "461 Unsupported",
    ),
    (
        |mut stream, _| {
            for_a_second(|_| stream.write_all(b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n"));
        },
        "",
    ),
    (
        |mut stream, _| {
            let other = reply("200 OK", "").replace("CSEQ", "7654321");
            for_a_second(|_| stream.write_all(other.as_bytes()));
        },
        "",
    ),
    // The last one of each list is repeated; this one takes longer each time.
    (
        |mut stream, _| {
            let slow = reply("200 OK", "").repeat(100);
            for byte in slow.as_bytes().chunks(1) {
                thread::sleep(Duration::from_millis(100));
                if stream.write_all(byte).is_err() {
                    return;
                }
            }
        },
        "no answer to OPTIONS in time",
    ),
];

/// Streams that never become an image.
const STREAMS: [Act; 8] = [
    (
        |stream, _| play(&stream, H264),
        "the server closed the connection",
    ),
    (
        |mut stream, _| {
            play(&stream, H264);
            for_a_second(|at| {
                let payload: Vec<u8> = random(at, 1_000).collect();
                stream.write_all(&packet(0, at as u16, at / 8, true, &payload))
            });
        },
        "",
    ),
    (
        // An image that never ends.
        |mut stream, _| {
            play(&stream, H264);
            let part = [&[0x7c, 5][..], &[7; 60_000]].concat();
            let begin = packet(0, 0, 5, false, &[0x7c, 0x85, 7]);
            let _ = stream.write_all(&begin);
            for_a_second(|at| stream.write_all(&packet(0, 1 + at as u16, 5, false, &part)));
        },
        "",
    ),
    (
        // Sequence numbers and timestamps from everywhere.
        |mut stream, _| {
            play(&stream, H264);
            for_a_second(|at| {
                let far = at.wrapping_mul(2_654_435_761);
                stream.write_all(&packet(0, far as u16, far, at % 2 == 0, &[0x41, 7]))
            });
        },
        "",
    ),
    (
        // A channel that nobody has set up.
        |mut stream, _| {
            play(&stream, H264);
            for_a_second(|at| stream.write_all(&packet(9, at as u16, at, true, &[7; 60_000])));
        },
        "",
    ),
    (
        // Reports of impossible clocks.
        |mut stream, _| {
            play(&stream, H264);
            for_a_second(|at| {
                let clock = if at % 2 == 0 { [0; 12] } else { [0xff; 12] };
                let report = [&[0x80, 200, 0, 6, 0, 0, 0, 7][..], &clock, &[0; 8]].concat();
                stream.write_all(&framed(1, &report))
            });
        },
        "",
    ),
    (
        // Parameters of a stream, and packets of nothing.
        |mut stream, _| {
            play(&stream, H264);
            for_a_second(|at| stream.write_all(&packet(0, at as u16, at, true, &[])));
        },
        "",
    ),
    (
        // A packet that does not come.
        |mut stream, _| {
            play(&stream, H264);
            let _ = stream.write_all(&[b'$', 0, 0xff, 0xff]);
            thread::sleep(Duration::from_secs(3));
        },
        "no image came",
    ),
];

const H264: &str = "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=control:one\r\n";

#[test]
fn a_camera_that_is_none_is_told_with_its_cause_and_the_other_one_goes_on() {
    goes_on_beside(&ANSWERS);
}

#[test]
fn a_camera_that_never_comes_to_the_point_is_told_and_the_other_one_goes_on() {
    goes_on_beside(&CONVERSATIONS);
}

#[test]
fn a_camera_that_streams_rubbish_is_told_and_the_other_one_goes_on() {
    goes_on_beside(&STREAMS);
}

/// A good camera, whose images come on, beside one that does these acts.
fn goes_on_beside(acts: &'static [Act]) {
    let workshop = Workshop::shared();
    let Some(server) = Server::start(&[], &cameras(&workshop)) else {
        return;
    };
    let other = TcpListener::bind("127.0.0.1:0").unwrap();
    let elsewhere = other.local_addr().unwrap().to_string();
    let (right, begin, connected) = hostile(acts, elsewhere);
    let mut command = workshop.command([&server.address("left"), &right]);
    command
        .args(["--max-memory", "600M"])
        .env("DTD_PASSWORD_RIGHT", "secret");
    let mut running = Running::start(&mut command);
    until_up(&mut running, "left");
    begin.send(()).unwrap();
    goes_on(&mut running, acts.iter().map(|(_, cause)| *cause));
    let connected: Vec<Instant> = connected.try_iter().collect();
    for (act, times) in connected.windows(2).enumerate() {
        let took = times[1] - times[0];
        assert!(took < MAX_TIME_OF_AN_ACT, "act {act} took {took:?}");
    }
    assert!(connected.len() >= acts.len(), "{connected:?}");
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
    let (right, begin, _connected) = hostile(&ANSWERS[..1], String::new());
    begin.send(()).unwrap();
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
    // From the start of a connection; a cause is told once, so a good one is in between.
    server.command("drop right");
    server.command("offer right");
    until_up(&mut running, "right");
    server.command("drop right");
    server.command("offer right huge");
    goes_on(&mut running, [size].into_iter());
}

/// The address of a server that does these acts, one for each connection, and the last one again and again; what lets it begin; and the
/// times of connections.
fn hostile(acts: &'static [Act], elsewhere: String) -> (String, Sender<()>, Receiver<Instant>) {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("rtsp://me@{}/right", server.local_addr().unwrap());
    let (connected, times) = channel();
    let (begin, begins) = channel();
    thread::spawn(move || {
        let _ = begins.recv();
        for (act, _) in acts.iter().chain(acts.last().into_iter().cycle()) {
            let Ok((stream, _)) = server.accept() else {
                return;
            };
            let _ = connected.send(Instant::now());
            // The cause before is told meanwhile.
            thread::sleep(Duration::from_millis(300));
            act(stream, &elsewhere);
        }
    });
    (address, begin, times)
}

fn until_up(running: &mut Running, view: &str) {
    loop {
        let line = running.next();
        if line["view"] == view && line["state"] == "up" {
            return;
        }
    }
}

/// Reads on until the right view was down for these causes, one after the other. The left one never is.
fn goes_on(running: &mut Running, causes: impl Iterator<Item = &'static str>) {
    for cause in causes.filter(|cause| !cause.is_empty()) {
        loop {
            let line = running.next();
            if line["event"] == "view" && line["view"] == "left" {
                assert_ne!(line["state"], "down", "{line}");
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
}

/// Answers requests, until the client leaves, the stream is to begin, or an answer is followed by a body that the caller sends.
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
        let is_over = method == "PLAY" || text.contains("2000000000");
        if stream.write_all(text.as_bytes()).is_err() || is_over {
            return;
        }
    }
}

fn reply(head: &str, body: &str) -> String {
    let bytes = body.len();
    format!("RTSP/1.0 {head}\r\nCSeq: CSEQ\r\nContent-Length: {bytes}\r\n\r\n{body}")
}

/// Answers until the client expects this stream.
fn play(stream: &TcpStream, media: &str) {
    answer(stream.try_clone().unwrap(), described(media));
}

/// Sends numbered pieces for a second.
fn for_a_second(mut send: impl FnMut(u32) -> io::Result<()>) {
    let began = Instant::now();
    let mut pieces = 0..u32::MAX;
    while began.elapsed() < Duration::from_secs(1)
        && pieces.next().is_some_and(|at| send(at).is_ok())
    {}
}

fn framed(channel: u8, bytes: &[u8]) -> Vec<u8> {
    let length = (bytes.len() as u16).to_be_bytes();
    [&[b'$', channel][..], &length, bytes].concat()
}

/// An RTP packet of a channel.
fn packet(channel: u8, sequence: u16, timestamp: u32, is_last: bool, payload: &[u8]) -> Vec<u8> {
    let head = [0x80, 96 | u8::from(is_last) << 7];
    let [sequence, timestamp] = [&sequence.to_be_bytes()[..], &timestamp.to_be_bytes()];
    framed(
        channel,
        &[&head[..], sequence, timestamp, &[0, 0, 0, 7], payload].concat(),
    )
}

fn random(seed: u32, bytes: usize) -> impl Iterator<Item = u8> {
    let mut random = ChaCha8Rng::seed_from_u64(seed.into());
    (0..bytes).map(move |_| random.random())
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
