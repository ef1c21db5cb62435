//! The replay's capture link: each request gets its recorded answer, or an `error` with the reason.

use std::sync::Arc;
use std::time::Duration;

use doorway::Doorway;
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::spawn_blocking;
use tokio::time::timeout;
use xplane_bridge::link::{Answer, LinkError, MAGIC};
use xplane_tape::{LinkMessage, MessagePosition};

use super::loading::is_hello;
use super::{Playback, Player};
use crate::server::MockError;
use crate::server::capture_link::{WANTS_TOKEN, log_end};

/// Connections at a time.
const MAX_CONNECTIONS: usize = 32;
/// A client that sends no requests, or reads no answers, for this long is considered gone.
const MAX_SILENCE: Duration = Duration::from_secs(600);

/// Accepts clients forever.
pub(super) async fn run(listener: Arc<TcpListener>, player: Arc<Player>) -> Result<(), MockError> {
    let doorway = Doorway::new("the capture link", MAX_CONNECTIONS);
    let serve = |stream, from| {
        let player = player.clone();
        async move { log_end(from, serve(stream, player).await) }
    };
    match doorway.serve(&listener, serve).await {}
}

async fn serve(mut stream: TcpStream, player: Arc<Player>) -> Result<(), LinkError> {
    stream.set_nodelay(true)?;
    let hello = timeout(player.patience.hello, admit(&mut stream, &player)).await;
    let mut next = hello.unwrap_or_else(|_late| Err(LinkError::ended("the time for a hello")))?;
    while let Some(message) = next {
        let player = player.clone();
        let answer = spawn_blocking(move || player.answer(&message)).await;
        let answer =
            answer.unwrap_or_else(|panicked| error(&format!("the replay failed: {panicked}")));
        let exchange = async {
            stream.write_all(answer.bytes()).await?;
            LinkMessage::read_request(&mut stream).await
        };
        next = timeout(MAX_SILENCE, exchange)
            .await
            .unwrap_or_else(|_late| Err(LinkError::ended("a long silence")))?;
    }
    Ok(())
}

/// Exchanges greetings and reads the hello; `None` if the client is rejected.
async fn admit(stream: &mut TcpStream, player: &Player) -> Result<Option<LinkMessage>, LinkError> {
    stream.write_all(&MAGIC).await?;
    // The recorded version: a client that expects a different one must learn it, as it would from that simulator.
    stream.write_all(&player.link_version.to_le_bytes()).await?;
    let mut greeting = [0; 8];
    stream.read_exact(&mut greeting).await?;
    if greeting[..4] != MAGIC || greeting[4..] != player.link_version.to_le_bytes() {
        tracing::warn!(
            "a client greets with \"{}\"; the tape was recorded with version {} of the link",
            greeting.escape_ascii(),
            player.link_version
        );
        return Ok(None);
    }
    let hello = LinkMessage::read_request(stream).await?;
    match (&hello, &player.token) {
        (Some(message), Some(token)) if !token.is(message.token().as_deref()) => {
            stream.write_all(error(WANTS_TOKEN).bytes()).await?;
            Ok(None)
        }
        _ => Ok(hello),
    }
}

impl Player {
    fn answer(&self, message: &LinkMessage) -> LinkMessage {
        let request: Value = match serde_json::from_slice(message.header()) {
            Ok(request) => request,
            Err(reason) => return error(&format!("the header is not JSON: {reason}")),
        };
        let mut playback = self.playback();
        if is_hello(&request) {
            playback.context.clear();
        }
        let Playback {
            conversation,
            context,
            ..
        } = &mut *playback;
        match conversation.find(&request, context, |place| self.request_at(place)) {
            Err(text) => {
                tracing::warn!("{text}");
                error(&text)
            }
            Ok(place) if is_hello(&request) => marked_as_replayed(&self.whole(place)),
            Ok(place) => self.whole(place),
        }
    }

    fn request_at(&self, place: MessagePosition) -> Option<Value> {
        let bytes = self.reader().read_again(place).ok()?;
        serde_json::from_slice(LinkMessage::parse(bytes).ok()?.header()).ok()
    }

    fn whole(&self, place: MessagePosition) -> LinkMessage {
        let bytes = self.reader().read_again(place);
        let message = bytes
            .map_err(|failed| failed.to_string())
            .and_then(|bytes| LinkMessage::parse(bytes).map_err(|bad| bad.to_string()));
        message.unwrap_or_else(|text| error(&text))
    }
}

/// Marks a recorded hello as a replay: clients do not wait for answers that a tape does not have.
fn marked_as_replayed(hello: &LinkMessage) -> LinkMessage {
    match serde_json::from_slice(hello.header()) {
        Ok(Value::Object(mut header)) => {
            header.insert("replayed".into(), true.into());
            // A tape holds no screen.
            header.remove("frame_codes");
            LinkMessage::new(Value::Object(header).to_string().as_bytes(), &[])
        }
        _ => error("the recorded answer to hello is not an object"),
    }
}

fn error(text: &str) -> LinkMessage {
    let answer = Answer::refusal(text);
    LinkMessage::new(&serde_json::to_vec(&answer).unwrap_or_default(), &[])
}
