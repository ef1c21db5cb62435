//! Malicious and broken clients: one that is silent, slow, from elsewhere, or asks for the impossible never disturbs others.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use mock_xplane::server::{LinkPatience, MockError, ServerOptions, serve, serve_tape};
use testkit_simulator::{Running, quiet};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;
use xplane_bridge::link::{Answer, LinkToken, exchange_greetings, read_header};

/// Timeout for expected events.
const PATIENCE: Duration = Duration::from_secs(30);
const HELLO: &str = r#"{"message":"hello","client":"test"}"#;
/// More connections than any server accepts at a time.
const IDLE: usize = 120;

async fn start(patience: LinkPatience, token: Option<LinkToken>) -> Running {
    Running::start(ServerOptions {
        patience,
        token,
        ..quiet()
    })
    .await
}

/// The usual limits, but little time to say hello.
fn hasty() -> LinkPatience {
    LinkPatience {
        hello: Duration::from_millis(300),
        ..LinkPatience::default()
    }
}

async fn greeted(running: &Running) -> TcpStream {
    let mut stream = TcpStream::connect(running.addresses.capture_link)
        .await
        .unwrap();
    exchange_greetings(&mut stream).await.unwrap();
    stream
}

async fn send(stream: &mut TcpStream, header: &str) {
    let mut bytes = (header.len() as u32).to_le_bytes().to_vec();
    bytes.extend([0; 4]);
    bytes.extend(header.as_bytes());
    stream.write_all(&bytes).await.unwrap();
}

async fn receive(stream: &mut TcpStream) -> Option<Answer> {
    let answer = timeout(PATIENCE, read_header(stream)).await.unwrap();
    answer.unwrap().map(|(answer, _)| answer)
}

async fn ask(stream: &mut TcpStream, header: &str) -> Answer {
    send(stream, header).await;
    receive(stream).await.unwrap()
}

async fn refused(stream: &mut TcpStream, header: &str) -> String {
    match ask(stream, header).await {
        Answer::Error { text, .. } => text,
        other => panic!("expected a refusal of {header}, found {other:?}"),
    }
}

/// Everything that comes until the other side closes.
async fn all_of(mut stream: TcpStream) -> Vec<u8> {
    let mut received = Vec::new();
    let read = timeout(PATIENCE, stream.read_to_end(&mut received)).await;
    // It may close before it has read everything.
    let _ = read.expect("the server closes the connection");
    received
}

#[tokio::test]
async fn who_says_no_hello_does_not_hold_the_seat_and_leaves_in_time() {
    let running = start(hasty(), None).await;
    let silent = greeted(&running).await;
    let mut half = greeted(&running).await;
    half.write_all(&[16]).await.unwrap();
    let mut client = greeted(&running).await;
    let answer = ask(&mut client, HELLO).await;
    assert!(matches!(answer, Answer::Hello { .. }), "{answer:?}");
    assert!(all_of(silent).await.is_empty());
    assert!(all_of(half).await.is_empty());
}

#[tokio::test]
async fn a_silent_client_loses_its_seat_to_the_next_one_and_one_that_asks_keeps_it() {
    let patience = LinkPatience {
        seat: Duration::from_millis(300),
        silence: Duration::from_millis(600),
        ..LinkPatience::default()
    };
    let running = start(patience, None).await;
    let mut first = greeted(&running).await;
    ask(&mut first, HELLO).await;
    let mut second = greeted(&running).await;
    let text = refused(&mut second, HELLO).await;
    assert!(text.contains("another client holds"), "{text}");
    // It asks for images and takes none: that counts as silence as well.
    let bad = r#"{"message":"command","path":"sim/none/none"}"#;
    let flood = bad.len() as u32;
    let mut message = flood.to_le_bytes().to_vec();
    message.extend([0; 4]);
    message.extend(bad.as_bytes());
    let many = message.repeat(2_000);
    // Until neither side's buffers take more.
    while let Ok(sent) = timeout(Duration::from_millis(200), first.write_all(&many)).await {
        sent.unwrap();
    }
    let third = async {
        loop {
            let mut third = greeted(&running).await;
            if let Answer::Hello { .. } = ask(&mut third, HELLO).await {
                return;
            }
        }
    };
    timeout(PATIENCE, third).await.unwrap();
}

#[tokio::test]
async fn what_a_request_announces_and_the_server_does_not_know_is_refused_by_its_place() {
    let running = start(LinkPatience::default(), LinkToken::new("open sesame")).await;
    // Before the token no other message is accepted: no payload, no other request, no wrong token.
    let mut greedy = greeted(&running).await;
    let mut message = 2_u32.to_le_bytes().to_vec();
    message.extend((190_u32 << 20).to_le_bytes());
    greedy.write_all(&message).await.unwrap();
    let answer = receive(&mut greedy).await.unwrap();
    assert!(format!("{answer:?}").contains("no payload"), "{answer:?}");
    for (header, expected) in [
        (r#"{"message":"release"}"#, "not hello"),
        (HELLO, "DTD_LINK_TOKEN"),
        (
            r#"{"message":"hello","client":"x","token":""}"#,
            "DTD_LINK_TOKEN",
        ),
    ] {
        let mut stream = greeted(&running).await;
        let text = refused(&mut stream, header).await;
        assert!(text.contains(expected), "{text}");
        assert!(receive(&mut stream).await.is_none());
    }
    // After it, requests that are not understood are reported, and the conversation goes on.
    let mut client = greeted(&running).await;
    let hello = r#"{"message":"hello","client":"x","token":"open sesame","of_a_later_version":1}"#;
    assert!(matches!(
        ask(&mut client, hello).await,
        Answer::Hello { .. }
    ));
    for (header, expected) in [
        (r#"{"message":"dance"}"#, "dance"),
        ("no JSON", "no JSON"),
        (r#"{"message":"capture","more":1}"#, "more"),
    ] {
        let text = refused(&mut client, header).await;
        assert!(text.contains(expected), "{text}");
    }
    let answer = ask(&mut client, r#"{"message":"release"}"#).await;
    assert!(matches!(answer, Answer::Released), "{answer:?}");
}

#[tokio::test]
async fn an_empty_token_opens_nothing() {
    assert_eq!(LinkToken::new(""), None);
    let open = || ServerOptions {
        bind: Ipv4Addr::UNSPECIFIED.into(),
        port: 0,
        beacon: false,
        token: LinkToken::new(" "),
        ..ServerOptions::default()
    };
    let error = serve(open(), |_| panic!("listens")).await.unwrap_err();
    assert!(matches!(error, MockError::NoToken { .. }), "{error}");
    assert!(error.to_string().contains("DTD_LINK_TOKEN"), "{error}");
    let error = serve_tape("no.mcap".as_ref(), &open(), |_| panic!("listens")).await;
    assert!(matches!(error, Err(MockError::NoToken { .. })));
}

async fn idle(address: SocketAddr) -> Vec<TcpStream> {
    let mut connections = Vec::new();
    for _ in 0..IDLE {
        connections.push(TcpStream::connect(address).await.unwrap());
    }
    connections
}

/// The status of the answer to a request.
async fn status(web: SocketAddr, headers: &str) -> u16 {
    let mut stream = TcpStream::connect(web).await.unwrap();
    let request = format!("GET /api/capabilities HTTP/1.1\r\nConnection: close\r\n{headers}\r\n");
    stream.write_all(request.as_bytes()).await.unwrap();
    let answer = String::from_utf8(all_of(stream).await).unwrap();
    answer.split(' ').nth(1).unwrap().parse().unwrap()
}

#[tokio::test]
async fn idle_connections_keep_nobody_out_for_long() {
    let running = start(hasty(), None).await;
    let web = running.addresses.web_api.unwrap();
    let _to_link = idle(running.addresses.capture_link).await;
    let _to_web = idle(web).await;
    let link = async {
        let mut client = greeted(&running).await;
        ask(&mut client, HELLO).await
    };
    let (answer, status) = tokio::join!(
        timeout(PATIENCE, link),
        timeout(PATIENCE, status(web, "Host: localhost\r\n"))
    );
    assert!(matches!(answer.unwrap(), Answer::Hello { .. }));
    assert_eq!(status.unwrap(), 200);
}

#[tokio::test]
async fn a_request_that_does_not_end_is_ended() {
    let running = start(LinkPatience::default(), None).await;
    let web = running.addresses.web_api.unwrap();
    let begin = async |text: &str| {
        let mut stream = TcpStream::connect(web).await.unwrap();
        stream.write_all(text.as_bytes()).await.unwrap();
        all_of(stream).await
    };
    let head = "POST /api/v3/flight HTTP/1.1\r\nHost: localhost\r\n";
    let no_body = format!("{head}Content-Type: application/json\r\nContent-Length: 1000\r\n\r\n{{");
    let (in_head, in_body) = tokio::join!(begin(head), begin(&no_body));
    assert!(in_head.is_empty() || in_head.starts_with(b"HTTP/1.1 4"));
    assert!(in_body.starts_with(b"HTTP/1.1 408"));
}

#[cfg(target_os = "linux")]
#[tokio::test]
async fn clients_that_leave_their_answers_unread_keep_nobody_out_for_long() {
    let running = start(LinkPatience::default(), None).await;
    let web = running.addresses.web_api.unwrap();
    let request = "GET /api/v3/datarefs HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(1_000);
    let mut clients = idle(web).await;
    for client in &mut clients {
        // Beyond the number of clients served at a time, the server does not read.
        let _ = timeout(
            Duration::from_millis(50),
            client.write_all(request.as_bytes()),
        )
        .await;
    }
    let answered = timeout(2 * PATIENCE, status(web, "Host: localhost\r\n")).await;
    assert_eq!(answered.unwrap(), 200);
}

#[tokio::test]
async fn web_pages_from_elsewhere_are_refused() {
    let running = start(LinkPatience::default(), None).await;
    let web = running.addresses.web_api.unwrap();
    for (headers, expected) in [
        ("Host: localhost\r\n", 200),
        (
            "Host: 127.0.0.1:8086\r\nOrigin: http://localhost:3000\r\n",
            200,
        ),
        ("Host: evil.example\r\n", 403),
        ("Host: localhost\r\nOrigin: https://evil.example\r\n", 403),
        ("Host: localhost\r\nOrigin: null\r\n", 403),
    ] {
        assert_eq!(status(web, headers).await, expected, "{headers}");
    }
}
