//! A Web API for the client's tests: answers as it was told, and keeps the requests.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{TcpListener, TcpStream};

pub(crate) const CAPABILITIES: &str =
    r#"{"api":{"versions":["v1","v2","v3"]},"x-plane":{"version":"12.4.0"}}"#;

/// Requests received: method and path, and the body.
pub(crate) type Requests = Arc<Mutex<Vec<(String, String)>>>;

/// A server that answers with the first entry whose beginning fits "METHOD /path".
pub(crate) async fn server(
    answers: &'static [(&'static str, u16, &'static str)],
) -> (SocketAddr, Requests) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let requests = Requests::default();
    let kept = requests.clone();
    tokio::spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            answer(stream, answers, &kept).await;
        }
    });
    (address, requests)
}

async fn answer(stream: TcpStream, answers: &[(&str, u16, &str)], requests: &Requests) {
    let mut stream = BufReader::new(stream);
    let mut line = String::new();
    stream.read_line(&mut line).await.unwrap();
    let request = line.trim_end().trim_end_matches(" HTTP/1.1").to_owned();
    let mut length = 0;
    loop {
        let mut header = String::new();
        stream.read_line(&mut header).await.unwrap();
        let header = header.to_ascii_lowercase();
        if let Some(value) = header.strip_prefix("content-length:") {
            length = value.trim().parse().unwrap();
        }
        if header.trim().is_empty() {
            break;
        }
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body).await.unwrap();
    let found = answers
        .iter()
        .find(|(begins, ..)| request.starts_with(begins));
    let (_, status, text) = found.unwrap_or(&("", 404, r#"{"error_code":"not_found"}"#));
    requests
        .lock()
        .unwrap()
        .push((request, String::from_utf8(body).unwrap()));
    let head = format!(
        "HTTP/1.1 {status} X\r\nConnection: close\r\nContent-Length: {}\r\n\r\n",
        text.len()
    );
    stream.write_all(head.as_bytes()).await.unwrap();
    stream.write_all(text.as_bytes()).await.unwrap();
}
