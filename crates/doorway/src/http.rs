//! Serves HTTP to a limited number of clients, none of which may hold its place by silence.

use std::convert::Infallible;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
#[cfg(target_os = "linux")]
use socket2::SockRef;
use tokio::net::{TcpListener, TcpStream};

use crate::limit::Doorway;

/// Maximum connections.
const MAX_CONNECTIONS: usize = 64;
/// Time limit for the head of a request, from the end of the previous one.
const HEAD_WITHIN: Duration = Duration::from_secs(10);
/// Time for which a client may leave data unread.
const READ_WITHIN: Duration = Duration::from_secs(10);

/// Serves until dropped. `what` is named in the log. `may_pause`: clients may leave an answer unread, as a player does with a paused video.
pub async fn serve_http(
    what: &'static str,
    listener: &TcpListener,
    router: Router,
    may_pause: bool,
) -> Infallible {
    let service = TowerToHyperService::new(router);
    let serve = |stream, from| {
        let service = service.clone();
        if !may_pause {
            end_if_unread(&stream);
        }
        async move {
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD_WITHIN)
                .serve_connection(TokioIo::new(stream), service)
                .await;
            if let Err(error) = served {
                tracing::debug!(%from, %error, "connection closed");
            }
        }
    };
    Doorway::new(what, MAX_CONNECTIONS)
        .serve(listener, serve)
        .await
}

/// Lets the system close a connection whose client does not read. Elsewhere such clients are limited by their number alone.
fn end_if_unread(stream: &TcpStream) {
    #[cfg(target_os = "linux")]
    if let Err(error) = SockRef::from(stream).set_tcp_user_timeout(Some(READ_WITHIN)) {
        tracing::debug!(%error, "a client may leave its answers unread");
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (stream, READ_WITHIN);
}

#[cfg(test)]
mod tests {
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    use super::*;

    #[tokio::test(start_paused = true)]
    async fn silent_clients_leave_their_places_to_one_that_asks() {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let router = Router::new().route("/", get(async || "here"));
        tokio::spawn(
            async move { match serve_http("the test", &listener, router, false).await {} },
        );
        let mut silent = Vec::new();
        for begin in ["", "GET / HT"].into_iter().cycle().take(MAX_CONNECTIONS) {
            let mut client = TcpStream::connect(address).await.unwrap();
            client.write_all(begin.as_bytes()).await.unwrap();
            silent.push(client);
        }
        let began = tokio::time::Instant::now();
        let mut client = TcpStream::connect(address).await.unwrap();
        let request = b"GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
        client.write_all(request).await.unwrap();
        let mut answer = String::new();
        client.read_to_string(&mut answer).await.unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
        assert!(began.elapsed() >= HEAD_WITHIN);
    }
}
