//! The screen of a remote X-Plane: grabbed by the plugin, over a separate connection.
//!
//! X-Plane's main thread never handles this connection. The client treats it as any screen, with the same proof. The plugin reports that it
//! is on a different computer, because it sees both addresses, even behind a recorder.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::BufReader;
use tokio::net::TcpStream;
use tokio::runtime::Handle;
use tokio::time::timeout;

use super::{Grab, Screen};
use crate::error::peer_text::quoted;
use crate::link::{
    LinkError, ScreenAnswer, ScreenRequest, exchange_greetings, read_header, read_payload,
    write_message,
};
use crate::pixels::{PixelError, Rectangle, RgbPicture};

/// Timeout of opening or a grab: slightly less than the caller's, so that the thread ends first.
const PATIENCE: Duration = Duration::from_secs(4);

/// Buffered for the small reads of headers; a payload goes past the buffer into its own memory.
type Stream = BufReader<TcpStream>;

/// That computer's screen.
#[derive(Clone)]
pub struct RemoteScreen {
    link: SocketAddr,
    token: Option<String>,
}

impl RemoteScreen {
    /// The screen grabbed by the plugin whose capture link is at `link`, with the link's token. It is opened and grabbed on runtime threads
    /// that may block (`spawn_blocking`).
    pub fn new(link: SocketAddr, token: Option<String>) -> Self {
        Self { link, token }
    }
}

impl fmt::Debug for RemoteScreen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Without the token.
        f.debug_tuple("RemoteScreen").field(&self.link).finish()
    }
}

impl Screen for RemoteScreen {
    fn name(&self) -> String {
        format!("of {}, grabbed by its plugin,", self.link.ip())
    }

    fn open(&self, part: Option<Rectangle>) -> Result<Box<dyn Grab>, PixelError> {
        let stream = before_timeout(self.link, self.opened())?;
        Ok(Box::new(RemoteGrab {
            link: self.link,
            part,
            stream: Some(stream),
        }))
    }
}

impl RemoteScreen {
    async fn opened(&self) -> Result<Stream, PixelError> {
        let link = self.link;
        let failed = |error| unreachable_screen(link, &error);
        let connected = TcpStream::connect(link).await;
        let connected = connected.and_then(|stream| stream.set_nodelay(true).map(|()| stream));
        let mut stream = BufReader::new(connected.map_err(|error| failed(error.into()))?);
        exchange_greetings(&mut stream).await.map_err(failed)?;
        let open = ScreenRequest::OpenScreen {
            client: concat!("dtd ", env!("CARGO_PKG_VERSION")).to_owned(),
            token: self.token.clone(),
        };
        match ask(&mut stream, link, &open).await? {
            (ScreenAnswer::ScreenOpened { .. }, 0) => Ok(stream),
            other => Err(wrong(link, format!("{other:?}, expected screen_opened"))),
        }
    }
}

/// Region that is being grabbed.
struct RemoteGrab {
    link: SocketAddr,
    part: Option<Rectangle>,
    /// Missing after a failure, which leaves the position of the next message unknown.
    stream: Option<Stream>,
}

impl Grab for RemoteGrab {
    fn grab(&mut self, picture: &mut RgbPicture) -> Result<(), PixelError> {
        let (link, part) = (self.link, self.part);
        let mut stream = self
            .stream
            .take()
            .ok_or_else(|| wrong(link, "nothing more after an earlier failure".into()))?;
        before_timeout(link, grabbed(&mut stream, link, part, picture))?;
        self.stream = Some(stream);
        Ok(())
    }
}

async fn grabbed(
    stream: &mut Stream,
    link: SocketAddr,
    part: Option<Rectangle>,
    picture: &mut RgbPicture,
) -> Result<(), PixelError> {
    let (answer, payload_bytes) = ask(stream, link, &ScreenRequest::Grab { part }).await?;
    let ScreenAnswer::Grabbed {
        width_px,
        height_px,
    } = answer
    else {
        return Err(wrong(link, format!("{answer:?}, expected grabbed")));
    };
    let size = (width_px, height_px);
    if let Some(asked) = part.filter(|part| (part.width_px, part.height_px) != size) {
        return Err(wrong(
            link,
            format!("{width_px}x{height_px} pixels, asked for {asked}"),
        ));
    }
    if u64::from(width_px) * u64::from(height_px) * 3 != payload_bytes as u64 {
        let found = format!("{payload_bytes} bytes as {width_px}x{height_px} pixels");
        return Err(wrong(link, found));
    }
    picture.rgb.clear();
    read_payload(stream, payload_bytes, &mut picture.rgb)
        .await
        .map_err(|error| unreachable_screen(link, &error))?;
    (picture.width_px, picture.height_px) = size;
    Ok(())
}

/// Sends a request; returns the answer and the size of its unread payload.
async fn ask(
    stream: &mut Stream,
    link: SocketAddr,
    request: &ScreenRequest,
) -> Result<(ScreenAnswer, usize), PixelError> {
    let answer = async {
        write_message(stream, request, &[]).await?;
        read_header::<ScreenAnswer>(stream)
            .await?
            .ok_or_else(|| LinkError::ended("a conversation"))
    };
    match answer.await {
        Ok((ScreenAnswer::Error { text }, _)) => Err(PixelError::Unusable(format!(
            "the plugin at {link} gives no image of its screen: {}",
            quoted(&text)
        ))),
        Ok(answer) => Ok(answer),
        Err(error) => Err(unreachable_screen(link, &error)),
    }
}

/// Waits on the blocking thread that opens and grabs screens.
fn before_timeout<T>(
    link: SocketAddr,
    work: impl Future<Output = Result<T, PixelError>>,
) -> Result<T, PixelError> {
    let done = Handle::current().block_on(async { timeout(PATIENCE, work).await });
    done.unwrap_or_else(|_| {
        let late = LinkError::Io(io::ErrorKind::TimedOut.into());
        Err(unreachable_screen(link, &late))
    })
}

/// The connection to the plugin fails.
fn unreachable_screen(link: SocketAddr, error: &LinkError) -> PixelError {
    PixelError::Unusable(format!(
        "the screen of X-Plane's computer cannot be grabbed through its plugin at {link}: {error}"
    ))
}

/// Unexpected answer.
fn wrong(link: SocketAddr, found: String) -> PixelError {
    PixelError::grab(format!("the plugin at {link} sends {found}"))
}
