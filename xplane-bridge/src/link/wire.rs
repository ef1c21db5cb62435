//! Greeting and framing of the capture link, for both sides.
//!
//! Lengths above a limit are rejected, and no input panics: the other side is a separate program, perhaps of a different version. Socket
//! buffers keep the system's automatic size, which grows beyond what may be requested manually.

use std::io::ErrorKind;

use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};

use super::Request;
use crate::error::peer_text::quoted;

/// First bytes in each direction, before the version.
pub const MAGIC: [u8; 4] = *b"DTDL";
/// Version of the capture link that this code speaks. Any change that an older side would misread raises it.
pub const LINK_VERSION: u32 = 2;
/// Longest header, bytes.
pub const MAX_HEADER_BYTES: usize = 64 << 10;
/// Longest payload, bytes: an image of the largest size.
pub const MAX_PAYLOAD_BYTES: usize = 192 << 20;

/// Failure to read or write the link.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The socket failed.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// A different program listens there, or one that speaks another version of the link.
    #[error("{0}")]
    OtherSide(String),
    /// The connection ended inside a message, or its lengths are impossible: what follows cannot be read.
    #[error("{0}")]
    Broken(String),
    /// A header that is not a valid message. The next message can be read nevertheless.
    #[error("{0}")]
    BadHeader(String),
}

impl LinkError {
    /// The connection ended inside this part of the conversation.
    pub fn ended(inside: &str) -> Self {
        Self::Broken(format!(
            "the other side closed the connection inside {inside}"
        ))
    }

    /// True if the other side hung up, as an interrupted client does.
    pub fn is_hang_up(&self) -> bool {
        matches!(self, Self::Io(error)
            if matches!(error.kind(), ErrorKind::ConnectionReset | ErrorKind::BrokenPipe))
    }
}

/// Sends our greeting and checks the other side's. Ours goes first, so that sides of different versions both learn why.
pub async fn exchange_greetings(
    stream: &mut (impl AsyncRead + AsyncWrite + Unpin),
) -> Result<(), LinkError> {
    let mut ours = [0; 8];
    ours[..4].copy_from_slice(&MAGIC);
    ours[4..].copy_from_slice(&LINK_VERSION.to_le_bytes());
    stream.write_all(&ours).await?;
    let mut magic = [0; 4];
    read_exact(stream, &mut magic, "the greeting").await?;
    if magic != MAGIC {
        return Err(not_the_link(magic));
    }
    let mut version = [0; 4];
    read_exact(stream, &mut version, "the greeting").await?;
    match u32::from_le_bytes(version) {
        LINK_VERSION => Ok(()),
        found => Err(LinkError::OtherSide(format!(
            "the other side speaks version {found} of the capture link, expected {LINK_VERSION}: install the plugin and the program of the \
             same release"
        ))),
    }
}

/// The error about another program, which greets with these bytes.
pub fn not_the_link(magic: [u8; 4]) -> LinkError {
    LinkError::OtherSide(format!(
        "the other side greets with \"{}\", expected \"DTDL\": that is not a capture link",
        magic.escape_ascii()
    ))
}

/// Writes one message.
pub async fn write_message(
    stream: &mut (impl AsyncWrite + Unpin),
    header: &impl Serialize,
    payload: &[u8],
) -> Result<(), LinkError> {
    let mut head = vec![0; 8];
    serde_json::to_writer(&mut head, header).map_err(std::io::Error::from)?;
    let header_bytes = within("header", head.len() - 8, MAX_HEADER_BYTES)?;
    let payload_bytes = within("payload", payload.len(), MAX_PAYLOAD_BYTES)?;
    head[..4].copy_from_slice(&header_bytes.to_le_bytes());
    head[4..8].copy_from_slice(&payload_bytes.to_le_bytes());
    stream.write_all(&head).await?;
    stream.write_all(payload).await?;
    Ok(())
}

/// Reads the header of the next message and the length of the payload that follows it; `None` if the other side has closed
/// the connection between two messages.
pub async fn read_header<H: DeserializeOwned>(
    stream: &mut (impl AsyncRead + Unpin),
) -> Result<Option<(H, usize)>, LinkError> {
    match read_lengths(stream).await? {
        None => Ok(None),
        Some((header_bytes, payload_bytes)) => {
            let header = read_text(stream, header_bytes).await?;
            Ok(Some((header, payload_bytes)))
        }
    }
}

/// Reads the next request, which never has a payload; `None` if the client has closed the connection between two requests. After
/// [`LinkError::BadHeader`] the next request can be read nevertheless.
pub async fn read_request(
    stream: &mut (impl AsyncRead + Unpin),
) -> Result<Option<Request>, LinkError> {
    match read_request_length(stream).await? {
        None => Ok(None),
        Some(header_bytes) => Ok(Some(read_text(stream, header_bytes).await?)),
    }
}

/// Reads the length of the next request's header; `None` if the client has closed the connection between two requests.
pub async fn read_request_length(
    stream: &mut (impl AsyncRead + Unpin),
) -> Result<Option<usize>, LinkError> {
    match read_lengths(stream).await? {
        None => Ok(None),
        Some((header_bytes, 0)) => Ok(Some(header_bytes)),
        Some((_, announced)) => Err(LinkError::Broken(format!(
            "a request has no payload, but {announced} bytes are announced"
        ))),
    }
}

/// Reads the lengths of header and payload, within their limits; `None` if the connection was closed between two messages.
pub async fn read_lengths(
    stream: &mut (impl AsyncRead + Unpin),
) -> Result<Option<(usize, usize)>, LinkError> {
    let mut lengths = [0; 8];
    if stream.read(&mut lengths[..1]).await? == 0 {
        return Ok(None);
    }
    read_exact(stream, &mut lengths[1..], "the lengths of a message").await?;
    let [h0, h1, h2, h3, p0, p1, p2, p3] = lengths;
    let header_bytes = u32::from_le_bytes([h0, h1, h2, h3]) as usize;
    let payload_bytes = u32::from_le_bytes([p0, p1, p2, p3]) as usize;
    within("header", header_bytes, MAX_HEADER_BYTES)?;
    within("payload", payload_bytes, MAX_PAYLOAD_BYTES)?;
    Ok(Some((header_bytes, payload_bytes)))
}

async fn read_text<H: DeserializeOwned>(
    stream: &mut (impl AsyncRead + Unpin),
    header_bytes: usize,
) -> Result<H, LinkError> {
    let mut text = vec![0; header_bytes];
    read_exact(stream, &mut text, "a header").await?;
    serde_json::from_slice(&text).map_err(|error| {
        let begin: String = String::from_utf8_lossy(&text).chars().take(80).collect();
        let reason = quoted(&error.to_string());
        LinkError::BadHeader(format!(
            "the header is not a known message: {reason}; it begins {begin:?}"
        ))
    })
}

/// Reads a payload to the end of `buffer`, whose memory is reused without zeroing: at 7 MB per frame both matter.
pub async fn read_payload(
    stream: &mut (impl AsyncRead + Unpin),
    payload_bytes: usize,
    buffer: &mut Vec<u8>,
) -> Result<(), LinkError> {
    buffer.reserve_exact(payload_bytes);
    let mut payload = stream.take(payload_bytes as u64);
    while payload.limit() > 0 {
        if payload.read_buf(buffer).await? == 0 {
            return Err(LinkError::ended("a payload"));
        }
    }
    Ok(())
}

fn within(part: &str, announced: usize, limit: usize) -> Result<u32, LinkError> {
    match u32::try_from(announced) {
        Ok(length) if announced <= limit => Ok(length),
        _ => Err(LinkError::Broken(format!(
            "a {part} of {announced} bytes is announced, expected at most {limit}"
        ))),
    }
}

/// Fills a buffer; if the stream ends before that, the error names `inside`.
async fn read_exact(
    stream: &mut (impl AsyncRead + Unpin),
    buffer: &mut [u8],
    inside: &str,
) -> Result<(), LinkError> {
    match stream.read_exact(buffer).await {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Err(LinkError::ended(inside)),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Answer, Request};

    #[tokio::test]
    async fn a_message_comes_back_with_its_payload() {
        let (mut here, mut there) = tokio::io::duplex(64);
        let answer = Answer::refusal("because");
        let payload: Vec<u8> = (0..1_000).map(|i| i as u8).collect();
        let sent = (answer.clone(), payload.clone());
        let writer = tokio::spawn(async move { write_message(&mut here, &sent.0, &sent.1).await });
        let (header, bytes) = read_header::<Answer>(&mut there).await.unwrap().unwrap();
        assert_eq!((header, bytes), (answer, 1_000));
        let mut buffer = Vec::new();
        read_payload(&mut there, bytes, &mut buffer).await.unwrap();
        assert_eq!(buffer, payload);
        writer.await.unwrap().unwrap();
        assert!(read_header::<Answer>(&mut there).await.unwrap().is_none());
    }

    #[tokio::test]
    async fn a_side_of_another_version_or_kind_is_told_apart() {
        for (greeting, expected) in [
            (
                *b"DTDL\x07\0\0\0",
                "speaks version 7 of the capture link, expected 2",
            ),
            (*b"HTTP/1.1", "greets with \"HTTP\""),
        ] {
            let (mut here, mut there) = tokio::io::duplex(64);
            there.write_all(&greeting).await.unwrap();
            let error = exchange_greetings(&mut here).await.unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            let mut ours = [0; 8];
            there.read_exact(&mut ours).await.unwrap();
            assert_eq!(&ours, b"DTDL\x02\0\0\0");
        }
    }

    async fn error_of(bytes: &[u8]) -> LinkError {
        read_header::<Request>(&mut &bytes[..]).await.unwrap_err()
    }

    #[tokio::test]
    async fn lengths_beyond_their_limits_are_not_believed() {
        let error = error_of(&[0xff; 8]).await;
        assert!(
            error.to_string().contains("header of 4294967295 bytes"),
            "{error}"
        );
        let error = error_of(&[2, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, b'{', b'}']).await;
        assert!(
            error.to_string().contains("payload of 4294967295 bytes"),
            "{error}"
        );
    }

    #[tokio::test]
    async fn broken_headers_are_errors_that_show_them() {
        for (cut, inside) in [
            (&[1, 0, 0][..], "inside the lengths of a message"),
            (&[9, 0, 0, 0, 0, 0, 0, 0, b'{'], "inside a header"),
        ] {
            let error = error_of(cut).await;
            assert!(error.to_string().ends_with(inside), "{error}");
        }
        let error = error_of(b"\x12\0\0\0\0\0\0\0{\"message\":\"nope\"}").await;
        assert!(error.to_string().contains("nope"), "{error}");
        let error = error_of(&[2, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xfe]).await;
        assert!(matches!(error, LinkError::BadHeader(_)), "{error}");
    }

    #[tokio::test]
    async fn a_payload_that_stops_early_is_an_error() {
        let error = read_payload(&mut &[1_u8, 2, 3][..], 4, &mut Vec::new())
            .await
            .unwrap_err();
        assert_eq!(
            error.to_string(),
            "the other side closed the connection inside a payload"
        );
    }
}
