//! Reads and writes the fields of packet bodies.

use super::{PacketError, bad_field};

/// Bytes before the body: four of the tag, one without meaning.
pub(super) const HEADER_BYTES: usize = 5;

/// Takes fields one after the other from a datagram.
pub(super) struct Fields<'a> {
    tag: &'static str,
    datagram: &'a [u8],
    at: usize,
}

macro_rules! take_number {
    ($name:ident, $number:ty) => {
        /// The next field, little-endian.
        pub(super) fn $name(&mut self, field: &'static str) -> Result<$number, PacketError> {
            self.array(field).map(<$number>::from_le_bytes)
        }
    };
}

impl<'a> Fields<'a> {
    /// Starts after a datagram's header. A bare tag is treated like an empty body.
    pub(super) fn new(tag: &'static str, datagram: &'a [u8]) -> Self {
        Self {
            tag,
            datagram,
            at: HEADER_BYTES.min(datagram.len()),
        }
    }

    take_number!(u8, u8);
    take_number!(u16, u16);
    take_number!(u32, u32);
    take_number!(i32, i32);
    take_number!(f32, f32);
    take_number!(f64, f64);

    /// True at the end of the datagram.
    pub(super) fn are_read(&self) -> bool {
        self.at == self.datagram.len()
    }

    /// The rest, which may be empty.
    pub(super) fn rest(&mut self) -> &'a [u8] {
        let rest = self.datagram.get(self.at..).unwrap_or_default();
        self.at = self.datagram.len();
        rest
    }

    /// The next `N` bytes.
    pub(super) fn array<const N: usize>(
        &mut self,
        field: &'static str,
    ) -> Result<[u8; N], PacketError> {
        let bytes = self
            .datagram
            .get(self.at..)
            .and_then(|rest| rest.first_chunk::<N>().copied());
        let bytes = bytes.ok_or(PacketError::TooShort {
            tag: self.tag,
            field,
            needed: self.at + N,
            found: self.datagram.len(),
        })?;
        self.at += N;
        Ok(bytes)
    }
}

/// The text in a character field: up to the first NUL or the end, without the spaces some clients pad with.
pub(super) fn text(
    tag: &'static str,
    field: &'static str,
    bytes: &[u8],
) -> Result<String, PacketError> {
    let end = bytes
        .iter()
        .position(|&byte| byte == 0)
        .unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) => Ok(text.trim_end_matches(' ').to_owned()),
        Err(_) => {
            let found = format!("\"{}\"", bytes[..end].escape_ascii());
            Err(bad_field(tag, field, "text in UTF-8", found))
        }
    }
}

/// A packet header, with room for the body.
pub(super) fn start(tag: &[u8; 4], body_bytes: usize) -> Vec<u8> {
    let mut datagram = Vec::with_capacity(HEADER_BYTES + body_bytes);
    datagram.extend(tag);
    datagram.push(0);
    datagram
}

/// Appends a text, and pads its field to `width` bytes with at least one NUL.
pub(super) fn push_text(
    datagram: &mut Vec<u8>,
    tag: &'static str,
    field: &'static str,
    text: &str,
    width: usize,
) -> Result<(), PacketError> {
    if text.len() >= width || text.contains('\0') || text.ends_with(' ') {
        let expected = "text without NUL or closing space that leaves a byte of its field free";
        let found = format!("{text:?} for a field of {width} bytes");
        return Err(bad_field(tag, field, expected, found));
    }
    datagram.extend(text.as_bytes());
    datagram.resize(datagram.len() + width - text.len(), 0);
    Ok(())
}
