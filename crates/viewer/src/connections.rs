//! The connections of browsers: a few at a time, and none of them is held by a silent client.
//!
//! A browser opens about six. A program that opens many and leaves them idle must not keep browsers out: its connections end soon, and at
//! once if others need their places.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::Router;
use axum::body::Bytes;
use hyper::body::{Frame, SizeHint};
use hyper::server::conn::http1;
use hyper::service::{Service, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
#[cfg(target_os = "linux")]
use socket2::SockRef;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Notify, Semaphore};
use tokio::task::JoinSet;
use tokio::time::sleep;

use crate::error::ViewError;

/// Maximum connections.
const MOST_CONNECTIONS: usize = 64;
/// Timeout of a request, from the beginning of its connection or the end of the previous one.
const REQUEST_WITHIN: Duration = Duration::from_secs(10);
/// Longest time a client may leave data unread: a browser whose video is paused requests the rest again.
#[cfg(target_os = "linux")]
const READ_WITHIN: Duration = Duration::from_secs(60);
/// Delay after a connection could not be accepted: others must first release descriptors.
const PAUSE: Duration = Duration::from_millis(100);

/// A connection as those see it that need its place.
#[derive(Default)]
struct Guest {
    /// From a complete request until its answer is sent.
    is_busy: AtomicBool,
    has_to_leave: Notify,
}

/// A request of a guest, until this is dropped.
struct Busy(Arc<Guest>);

impl Busy {
    fn begin(guest: &Arc<Guest>) -> Self {
        guest.is_busy.store(true, Ordering::Relaxed);
        Self(guest.clone())
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.is_busy.store(false, Ordering::Relaxed);
    }
}

/// The body of an answer. Its guest is busy until it is sent.
struct BusyBody {
    body: axum::body::Body,
    _busy: Busy,
}

impl hyper::body::Body for BusyBody {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// Serves until dropped; its connections end with it.
pub(crate) async fn serve(listener: TcpListener, router: Router) -> Result<(), ViewError> {
    let service = TowerToHyperService::new(router);
    let room = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let mut guests = VecDeque::new();
    let mut connections = JoinSet::new();
    loop {
        while connections.try_join_next().is_some() {}
        guests.retain(|guest: &Weak<Guest>| guest.strong_count() > 0);
        let (stream, from) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::debug!(%error, "no connection can be accepted now");
                sleep(PAUSE).await;
                continue;
            }
        };
        if room.available_permits() == 0 {
            dismiss_the_oldest_idle(&mut guests);
        }
        // The semaphore is never closed; without a permit the connection would only not be counted.
        let permit = room.clone().acquire_owned().await.ok();
        end_if_unread(&stream);
        let guest = Arc::new(Guest::default());
        guests.push_back(Arc::downgrade(&guest));
        let service = service.clone();
        connections.spawn(async move {
            let _permit = permit;
            let asks = service_fn(|request| {
                let busy = Busy::begin(&guest);
                let answer = service.call(request);
                async move {
                    let answer = answer.await?;
                    Ok::<_, Infallible>(answer.map(|body| BusyBody { body, _busy: busy }))
                }
            });
            let served = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(REQUEST_WITHIN)
                .serve_connection(TokioIo::new(stream), asks);
            tokio::select! {
                served = served => if let Err(error) = served {
                    tracing::debug!(%from, %error, "connection closed");
                },
                () = guest.has_to_leave.notified() => {
                    tracing::debug!(%from, "connection closed: it was idle, and others wait");
                }
            }
        });
    }
}

/// Ends the oldest connection without a complete request that waits for its answer, if there is one.
fn dismiss_the_oldest_idle(guests: &mut VecDeque<Weak<Guest>>) {
    let is_idle = |guest: &Weak<Guest>| {
        let guest = guest.upgrade();
        guest.is_some_and(|guest| !guest.is_busy.load(Ordering::Relaxed))
    };
    let oldest = guests.iter().position(is_idle);
    if let Some(guest) = oldest.and_then(|at| guests.remove(at)?.upgrade()) {
        guest.has_to_leave.notify_one();
    }
}

/// Lets the system close a connection whose client does not read. Elsewhere such clients are limited by their number alone.
#[cfg(target_os = "linux")]
fn end_if_unread(stream: &TcpStream) {
    if let Err(error) = SockRef::from(stream).set_tcp_user_timeout(Some(READ_WITHIN)) {
        tracing::debug!(%error, "a client may leave its answers unread");
    }
}

#[cfg(not(target_os = "linux"))]
fn end_if_unread(_stream: &TcpStream) {}

#[cfg(test)]
mod tests {
    use axum::routing::get;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::time::Instant;

    use super::*;

    const REQUEST: &[u8] = b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";

    async fn served() -> std::net::SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let router = Router::new()
            .route("/", get("here"))
            .route("/busy", get(std::future::pending::<&str>));
        tokio::spawn(serve(listener, router));
        address
    }

    async fn answer(stream: &mut TcpStream) -> String {
        let mut answer = String::new();
        stream.read_to_string(&mut answer).await.unwrap();
        answer
    }

    /// A connection whose request was answered, and that may make another.
    async fn asked(address: std::net::SocketAddr) -> TcpStream {
        let mut stream = TcpStream::connect(address).await.unwrap();
        let request = b"GET / HTTP/1.1\r\nHost: x\r\n\r\n";
        stream.write_all(request).await.unwrap();
        let mut answer = Vec::new();
        while !answer.ends_with(b"here") {
            assert!(stream.read_buf(&mut answer).await.unwrap() > 0);
        }
        stream
    }

    #[tokio::test]
    async fn three_hundred_silent_connections_do_not_delay_one_that_asks() {
        let address = served().await;
        let mut silent = Vec::new();
        for _ in 0..300 {
            let mut half = TcpStream::connect(address).await.unwrap();
            half.write_all(b"GET / HTTP/1.1\r\nHo").await.unwrap();
            silent.push(half);
        }
        let mut browser = TcpStream::connect(address).await.unwrap();
        browser.write_all(REQUEST).await.unwrap();
        let began = Instant::now();
        assert!(answer(&mut browser).await.ends_with("here"));
        assert!(began.elapsed() < REQUEST_WITHIN);
    }

    #[tokio::test]
    async fn sixty_four_idle_connections_that_have_asked_do_not_delay_another_one() {
        let address = served().await;
        let mut idle = Vec::new();
        for _ in 0..MOST_CONNECTIONS {
            idle.push(asked(address).await);
        }
        let mut browser = TcpStream::connect(address).await.unwrap();
        browser.write_all(REQUEST).await.unwrap();
        let began = Instant::now();
        assert!(answer(&mut browser).await.ends_with("here"));
        assert!(began.elapsed() < REQUEST_WITHIN);
        // Only the oldest had to leave.
        assert_eq!(idle[0].read(&mut [0; 1]).await.unwrap(), 0);
        idle[1].write_all(REQUEST).await.unwrap();
        assert!(answer(&mut idle[1]).await.ends_with("here"));
    }

    #[tokio::test]
    async fn sixty_four_connections_that_wait_for_answers_are_kept_and_the_next_one_waits() {
        let address = served().await;
        let mut busy = Vec::new();
        for _ in 0..MOST_CONNECTIONS {
            let mut stream = TcpStream::connect(address).await.unwrap();
            let request = b"GET /busy HTTP/1.1\r\nHost: x\r\n\r\n";
            stream.write_all(request).await.unwrap();
            busy.push(stream);
        }
        // All requests have arrived.
        tokio::time::sleep(Duration::from_millis(300)).await;
        let mut beyond = TcpStream::connect(address).await.unwrap();
        beyond.write_all(REQUEST).await.unwrap();
        let waiting = tokio::time::timeout(Duration::from_millis(300), beyond.readable());
        assert!(waiting.await.is_err());
        busy.pop();
        assert!(answer(&mut beyond).await.ends_with("here"));
    }

    #[tokio::test(start_paused = true)]
    async fn a_request_that_is_not_complete_after_ten_seconds_ends_its_connection() {
        let address = served().await;
        let began = Instant::now();
        let mut half = TcpStream::connect(address).await.unwrap();
        half.write_all(b"GET / HTTP/1.1\r\nHo").await.unwrap();
        assert_eq!(half.read(&mut [0; 64]).await.unwrap(), 0);
        let took = began.elapsed();
        assert!(
            (REQUEST_WITHIN..2 * REQUEST_WITHIN).contains(&took),
            "{took:?}"
        );
    }
}
