//! Servers with few descriptors and many silent clients: they survive, and serve active clients.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::process::Command;
use std::time::{Duration, Instant};

use testkit::command::Server;

const IDLE: usize = 120;
/// Limit of descriptors, below the number of idle clients.
const DESCRIPTORS: u32 = 64;
const PATIENCE: Duration = Duration::from_secs(60);

/// A `dtd` that serves with few descriptors.
fn serving(arguments: &[&str]) -> Server {
    Server::start(
        Command::new("bash")
            .arg("-c")
            .arg(format!("ulimit -n {DESCRIPTORS} && exec \"$0\" \"$@\""))
            .arg(env!("CARGO_BIN_EXE_dtd"))
            .args(arguments)
            .args(["--port", "0", "--until-stdin-ends"]),
    )
}

fn idle(address: SocketAddr) -> Vec<TcpStream> {
    let clients = (0..IDLE).map(|_| TcpStream::connect(address).unwrap());
    clients.collect()
}

/// Waits for a complete greeting of the capture link. While all descriptors are taken, a connection may be turned away.
fn is_greeted(link: SocketAddr) {
    let began = Instant::now();
    let greeting = || {
        let mut stream = TcpStream::connect(link)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.write_all(b"DTDL\x02\0\0\0")?;
        let mut greeting = [0; 8];
        stream.read_exact(&mut greeting)?;
        Ok::<_, io::Error>(greeting)
    };
    loop {
        match greeting() {
            Ok(greeting) => return assert!(greeting.starts_with(b"DTDL")),
            Err(error) => assert!(began.elapsed() < PATIENCE, "no greeting: {error}"),
        }
    }
}

#[test]
fn a_hundred_and_twenty_idle_connections_end_no_stand_in() {
    let server = serving(&["mock-xplane", "--no-beacon", "--quirks=none"]);
    let (link, web) = (server.address("capture_link"), server.address("web_api"));
    let _idle = [idle(link), idle(web)];
    is_greeted(link);
    let mut stream = TcpStream::connect(web).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
        .write_all(
            b"GET /api/capabilities HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n",
        )
        .unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    server.end();
}

#[test]
fn a_hundred_and_twenty_idle_connections_and_clients_end_no_recorder() {
    let stand_in = serving(&["mock-xplane", "--no-beacon", "--quirks=none"]);
    let folder = tempfile::tempdir().unwrap();
    let tape = folder.path().join("session.mcap");
    let recorder = serving(&[
        "tape",
        "--sim",
        &stand_in.address("udp").to_string(),
        "--out",
        tape.to_str().unwrap(),
    ]);
    // Requesting the link's port tells the recorder where it is.
    let mut request = b"RREF\0\x0a\0\0\0\0\0\0\0dtd/bridge/capture_port".to_vec();
    request.resize(413, 0);
    let asks = |socket: &UdpSocket| {
        socket
            .set_read_timeout(Some(Duration::from_millis(500)))
            .unwrap();
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            socket.send_to(&request, recorder.address("udp")).unwrap();
            if socket.recv(&mut [0; 64]).is_ok() {
                return;
            }
        }
        panic!("no value came back");
    };
    asks(&UdpSocket::bind("127.0.0.1:0").unwrap());
    let link = recorder.address("capture_link");
    let _idle = idle(link);
    let sockets: Vec<UdpSocket> = (0..IDLE)
        .map(|_| UdpSocket::bind("127.0.0.1:0").unwrap())
        .collect();
    for socket in &sockets {
        socket.send_to(&request, recorder.address("udp")).unwrap();
    }
    is_greeted(link);
    recorder.end();
    stand_in.end();
}
