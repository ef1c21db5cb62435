//! Messages of the capture link as bytes, independent of their content: for a recorder that must not change them.

use serde_json::Value;
use tokio::io::AsyncRead;

use xplane_bridge::link::{
    LinkError, ScreenRequest, read_lengths, read_payload, read_request_length,
};

/// Bytes of the two lengths before a header.
const LENGTHS: usize = 8;
/// Replacement for a token on a tape.
const TOKEN_LEFT_OUT: &str = "left out of the tape";

/// Reason why bytes are not a message of the link.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BadLinkMessage(String);

/// A link message: lengths, header and payload, as on the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinkMessage {
    bytes: Vec<u8>,
    header_end: usize,
}

impl LinkMessage {
    /// Parses the bytes of a whole message.
    pub fn parse(bytes: Vec<u8>) -> Result<Self, BadLinkMessage> {
        let (header, payload) = lengths(&bytes)?;
        let expected = LENGTHS + header + payload;
        if bytes.len() != expected {
            let found = bytes.len();
            return Err(BadLinkMessage(format!(
                "{expected} bytes announced, {found} found"
            )));
        }
        Ok(Self {
            bytes,
            header_end: LENGTHS + header,
        })
    }

    /// Builds a message from header and payload.
    pub fn new(header: &[u8], payload: &[u8]) -> Self {
        let mut message = Self::begin(header.len(), payload.len());
        message.bytes.extend(header);
        message.bytes.extend(payload);
        message
    }

    /// The lengths of a message whose header and payload are to follow.
    fn begin(header_bytes: usize, payload_bytes: usize) -> Self {
        let mut bytes = Vec::with_capacity(LENGTHS + header_bytes + payload_bytes);
        bytes.extend((header_bytes as u32).to_le_bytes());
        bytes.extend((payload_bytes as u32).to_le_bytes());
        Self {
            bytes,
            header_end: LENGTHS + header_bytes,
        }
    }

    /// Reads the next one; `None` if the other side has closed the connection between two messages.
    pub async fn read(stream: &mut (impl AsyncRead + Unpin)) -> Result<Option<Self>, LinkError> {
        match read_lengths(stream).await? {
            None => Ok(None),
            Some((header, payload)) => Self::read_rest(stream, header, payload).await,
        }
    }

    /// Reads a client's next request, which has no payload.
    pub async fn read_request(
        stream: &mut (impl AsyncRead + Unpin),
    ) -> Result<Option<Self>, LinkError> {
        match read_request_length(stream).await? {
            None => Ok(None),
            Some(header) => Self::read_rest(stream, header, 0).await,
        }
    }

    async fn read_rest(
        stream: &mut (impl AsyncRead + Unpin),
        header_bytes: usize,
        payload_bytes: usize,
    ) -> Result<Option<Self>, LinkError> {
        let mut message = Self::begin(header_bytes, payload_bytes);
        read_payload(stream, header_bytes + payload_bytes, &mut message.bytes).await?;
        Ok(Some(message))
    }

    /// The message as on the wire.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The header, which should be JSON.
    pub fn header(&self) -> &[u8] {
        &self.bytes[LENGTHS..self.header_end]
    }

    /// A hello's token.
    pub fn token(&self) -> Option<String> {
        let header: Value = serde_json::from_slice(self.header()).ok()?;
        Some(header.get("token")?.as_str()?.to_owned())
    }

    /// True if it begins a conversation about the screen.
    pub(super) fn opens_the_screen(&self) -> bool {
        let request = serde_json::from_slice(self.header());
        matches!(request, Ok(ScreenRequest::OpenScreen { .. }))
    }

    /// The message without a token, a secret that must not be stored: tapes are passed on.
    pub(super) fn without_token(&self) -> Option<Self> {
        let mut header: Value = serde_json::from_slice(self.header()).ok()?;
        let token = header.get_mut("token")?;
        *token = TOKEN_LEFT_OUT.into();
        let payload = &self.bytes[self.header_end..];
        Some(Self::new(header.to_string().as_bytes(), payload))
    }
}

fn lengths(bytes: &[u8]) -> Result<(usize, usize), BadLinkMessage> {
    match bytes {
        [h0, h1, h2, h3, p0, p1, p2, p3, ..] => Ok((
            u32::from_le_bytes([*h0, *h1, *h2, *h3]) as usize,
            u32::from_le_bytes([*p0, *p1, *p2, *p3]) as usize,
        )),
        _ => Err(BadLinkMessage(format!(
            "{} bytes are too few for two lengths",
            bytes.len()
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_message_is_read_byte_for_byte() {
        let message = LinkMessage::new(br#"{"message":"frame" }"#, &[1, 2, 3]);
        let mut stream = message.bytes();
        let read = LinkMessage::read(&mut stream).await.unwrap().unwrap();
        assert_eq!(read, message);
        assert_eq!(LinkMessage::parse(read.bytes), Ok(message.clone()));
        assert!(LinkMessage::read(&mut stream).await.unwrap().is_none());
        let error = LinkMessage::read(&mut &message.bytes()[..12])
            .await
            .unwrap_err();
        assert!(
            error.to_string().contains("closed the connection"),
            "{error}"
        );
        let error = LinkMessage::read(&mut &[0xff; 8][..]).await.unwrap_err();
        assert!(
            error.to_string().contains("header of 4294967295"),
            "{error}"
        );
    }

    #[test]
    fn a_token_does_not_reach_the_tape() {
        let hello = LinkMessage::new(br#"{"message":"hello","client":"x","token":"secret"}"#, &[]);
        let kept = hello.without_token().unwrap();
        let text = String::from_utf8_lossy(kept.header()).into_owned();
        assert!(
            !text.contains("secret") && text.contains("left out"),
            "{text}"
        );
        let hello = LinkMessage::new(br#"{"message":"hello","client":"x"}"#, &[]);
        assert_eq!(hello.without_token(), None);
    }
}
