//! The client's end of the capture link. A failure inside a message closes it, because the position of the next message is then unknown.

use std::net::SocketAddr;
use std::time::Duration;

use futures_util::FutureExt;
use tokio::io::BufReader;
use tokio::net::TcpStream;
use tokio::time::{Instant, timeout_at};

use super::SWITCH_TIMEOUT;
use crate::error::BridgeError;
use crate::error::peer_text::quoted;
use crate::link::{
    Answer, LinkError, Request, exchange_greetings, read_header, read_payload, write_message,
};

/// A link, open or closed.
#[derive(Debug)]
pub(super) struct LinkClient {
    /// Buffered for the small reads of headers; a payload goes past the buffer into its own memory.
    stream: Option<BufReader<TcpStream>>,
    payload_bytes: usize,
    /// True if the simulator can draw the check pattern under its own windows.
    pub(super) patterns_under: bool,
}

impl LinkClient {
    /// Connects and exchanges greetings.
    pub(super) async fn open(address: SocketAddr, deadline: Instant) -> Result<Self, BridgeError> {
        let connected = match timeout_at(deadline, TcpStream::connect(address)).await {
            Ok(connected) => connected,
            Err(_) => Err(std::io::ErrorKind::TimedOut.into()),
        };
        let stream = connected
            .and_then(|stream| stream.set_nodelay(true).map(|()| stream))
            .map_err(|source| BridgeError::CannotOpenLink { address, source })?;
        let mut stream = BufReader::new(stream);
        let limit = deadline.saturating_duration_since(Instant::now());
        before("the greeting", limit, exchange_greetings(&mut stream)).await?;
        Ok(Self {
            stream: Some(stream),
            payload_bytes: 0,
            patterns_under: false,
        })
    }

    /// Sends a request and waits for its answer.
    pub(super) async fn ask(
        &mut self,
        doing: &'static str,
        request: &Request,
        limit: Duration,
    ) -> Result<Answer, BridgeError> {
        self.send(doing, request, limit).await?;
        self.receive(doing, limit).await
    }

    /// Sends a request whose answer can only be `expected`.
    pub(super) async fn tell(
        &mut self,
        doing: &'static str,
        request: &Request,
        limit: Duration,
        expected: &Answer,
    ) -> Result<(), BridgeError> {
        match self.ask(doing, request, limit).await? {
            answer if answer == *expected => Ok(()),
            other => Err(wrong(expected.name(), &other)),
        }
    }

    /// Sends a request.
    pub(super) async fn send(
        &mut self,
        doing: &'static str,
        request: &Request,
        limit: Duration,
    ) -> Result<(), BridgeError> {
        let stream = self.stream.as_mut().ok_or(BridgeError::LinkClosed)?;
        let sent = before(doing, limit, write_message(stream, request, &[])).await;
        self.close_on_error(sent)
    }

    /// True if it is closed on either side.
    pub(super) fn has_ended(&self) -> bool {
        let seen = self.stream.as_ref().and_then(|stream| {
            let mut byte = [0];
            stream.get_ref().peek(&mut byte).now_or_never()
        });
        self.stream.is_none() || matches!(seen, Some(Ok(0) | Err(_)))
    }

    /// The next answer. Its payload, if it has one, must be read next.
    pub(super) async fn receive(
        &mut self,
        doing: &'static str,
        limit: Duration,
    ) -> Result<Answer, BridgeError> {
        let stream = self.stream.as_mut().ok_or(BridgeError::LinkClosed)?;
        let read = before(doing, limit, async {
            read_header::<Answer>(stream)
                .await?
                .ok_or_else(|| LinkError::ended("a conversation"))
        });
        let read = read.await;
        let (answer, payload_bytes) = self.close_on_error(read)?;
        self.payload_bytes = payload_bytes;
        let expects_payload = matches!(answer, Answer::Frame(_) | Answer::Flown { .. });
        match answer {
            Answer::Error { text, repeats } if payload_bytes == 0 => Err(BridgeError::Refused {
                doing,
                text: quoted(&text),
                repeats,
            }),
            answer if expects_payload || payload_bytes == 0 => Ok(answer),
            answer => {
                self.close();
                Err(BridgeError::wrong_answer(
                    format_args!("no payload behind {}", answer.name()),
                    format_args!("{payload_bytes} bytes"),
                ))
            }
        }
    }

    /// Draws or removes the check pattern, over the simulator's own windows or `under` them. Returns the first frame that shows it so.
    pub(super) async fn check_pattern(
        &mut self,
        code: Option<u32>,
        under: bool,
    ) -> Result<u64, BridgeError> {
        let request = Request::CheckPattern { code, under };
        match self
            .ask("the check pattern", &request, SWITCH_TIMEOUT)
            .await?
        {
            Answer::CheckPatternShown { sim_frame } => Ok(sim_frame),
            other => Err(wrong("check_pattern_shown", &other)),
        }
    }

    /// Length of the payload of the answer just received, bytes.
    pub(super) fn payload_bytes(&self) -> usize {
        self.payload_bytes
    }

    /// Reads that payload.
    pub(super) async fn take_payload(
        &mut self,
        doing: &'static str,
        buffer: &mut Vec<u8>,
        limit: Duration,
    ) -> Result<(), BridgeError> {
        let stream = self.stream.as_mut().ok_or(BridgeError::LinkClosed)?;
        let bytes = std::mem::take(&mut self.payload_bytes);
        buffer.clear();
        let read = before(doing, limit, read_payload(stream, bytes, buffer)).await;
        self.close_on_error(read)
    }

    /// Closes the link for good.
    pub(super) fn close(&mut self) {
        self.stream = None;
    }

    fn close_on_error<T>(&mut self, result: Result<T, BridgeError>) -> Result<T, BridgeError> {
        if result.is_err() {
            self.close();
        }
        result
    }
}

/// Waits for the link until a deadline.
async fn before<T>(
    doing: &'static str,
    limit: Duration,
    work: impl Future<Output = Result<T, LinkError>>,
) -> Result<T, BridgeError> {
    match timeout_at(Instant::now() + limit, work).await {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(source)) => Err(BridgeError::Link { doing, source }),
        Err(_) => Err(BridgeError::Failed(format!(
            "the simulator did not answer over the capture link within {:.1} s, while waiting for {doing}",
            limit.as_secs_f64()
        ))),
    }
}

/// An answer that does not match its request.
pub(crate) fn wrong(expected: &str, found: &Answer) -> BridgeError {
    BridgeError::wrong_answer(expected, found.name())
}
