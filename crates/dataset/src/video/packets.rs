//! Video packets: the coded images, for formats that take packets without re-encoding.
//!
//! MP4 keeps the parameter sets of H.264 in its header, and writes the length of each unit before it (ISO/IEC 14496-15). Streams have start
//! codes instead (Annex B), and repeat the parameter sets at key frames, so that a reader may begin there.
#![allow(unsafe_code)]

use std::path::{Path, PathBuf};

use ffmpeg_next::{Packet, codec, format};

use super::{TimeBase, fault, open_stream};
use crate::error::{Error, Result};
use crate::numbers::frame_rate::FrameRate;

const START_CODE: [u8; 4] = [0, 0, 0, 1];

/// A coded image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CodedPicture {
    /// Timestamp, in units of the `pts` of tables.
    pub pts: i64,
    /// True if decoding can begin here.
    pub is_key: bool,
    /// Decoder input.
    pub data: Vec<u8>,
}

/// A video in H.264 whose packets are read.
pub struct PacketReader {
    path: PathBuf,
    input: format::context::Input,
    stream: usize,
    /// Unit of the file's timestamps, and of those that are returned.
    time_base: TimeBase,
    unit: TimeBase,
    framing: Framing,
}

/// Boundaries of units in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Framing {
    /// Bytes of the unit's length.
    length_bytes: usize,
    /// Parameter sets, with start codes.
    parameter_sets: Vec<u8>,
}

impl PacketReader {
    /// Opens a scenario's video.
    ///
    /// # Errors
    /// It cannot be read, has no video, or is not H.264.
    pub fn open(path: &Path, frame_rate: FrameRate) -> Result<Self> {
        let (input, stream, time_base) = open_stream(path)?;
        let parameters = input.stream(stream).map(|stream| stream.parameters());
        let parameters = parameters.expect("the stream was found in the file");
        if parameters.id() != codec::Id::H264 {
            return Err(fault(path, "read its packets", "it is not H.264"));
        }
        let framing = framing_of_avc(&header_of(&parameters))
            .ok_or_else(|| fault(path, "read its parameter sets", "the header is damaged"))?;
        Ok(Self {
            stream,
            time_base,
            unit: TimeBase::of_ticks(frame_rate),
            path: path.to_owned(),
            framing,
            input,
        })
    }

    /// The next image, or `None` after the last.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn next_picture(&mut self) -> Result<Option<CodedPicture>> {
        let packet = loop {
            // As in [`VideoReader`](super::VideoReader): never read into twice.
            let mut packet = Packet::empty();
            match packet.read(&mut self.input) {
                Ok(()) if packet.stream() != self.stream => {}
                Ok(()) => break packet,
                Err(ffmpeg_next::Error::Eof) => return Ok(None),
                Err(e) => return Err(self.fault("read on", e)),
            }
        };
        let pts = packet.pts();
        let pts = pts.and_then(|pts| self.time_base.convert(pts, self.unit));
        let pts = pts.ok_or_else(|| self.fault("place an image", "its time is between ticks"))?;
        let mut data = Vec::new();
        if packet.is_key() {
            data.extend_from_slice(&self.framing.parameter_sets);
        }
        let coded = packet.data().unwrap_or_default();
        append_units(coded, self.framing.length_bytes, &mut data)
            .ok_or_else(|| self.fault("divide an image", "the lengths of its parts are wrong"))?;
        Ok(Some(CodedPicture {
            pts,
            is_key: packet.is_key(),
            data,
        }))
    }

    fn fault(&self, action: &str, cause: impl std::fmt::Display + 'static) -> Error {
        fault(&self.path, action, cause)
    }
}

/// The codec parameters in the container's header.
fn header_of(parameters: &codec::Parameters) -> Vec<u8> {
    // SAFETY: the parameters are alive while the pointer is used. FFmpeg keeps `extradata_size` bytes at `extradata`, or a null pointer.
    unsafe {
        let parameters = &*parameters.as_ptr();
        let bytes = usize::try_from(parameters.extradata_size).unwrap_or(0);
        if parameters.extradata.is_null() {
            Vec::new()
        } else {
            std::slice::from_raw_parts(parameters.extradata, bytes).to_vec()
        }
    }
}

/// Appends a packet's units with start codes in the place of their lengths; `None` if these do not fit.
fn append_units(mut coded: &[u8], length_bytes: usize, to: &mut Vec<u8>) -> Option<()> {
    while !coded.is_empty() {
        let (length, rest) = coded.split_at_checked(length_bytes)?;
        let length = length
            .iter()
            .fold(0, |length, byte| length << 8 | usize::from(*byte));
        let (unit, rest) = rest.split_at_checked(length)?;
        to.extend_from_slice(&START_CODE);
        to.extend_from_slice(unit);
        coded = rest;
    }
    Some(())
}

/// Reads an `AVCDecoderConfigurationRecord`.
fn framing_of_avc(header: &[u8]) -> Option<Framing> {
    let mut rest = header.get(5..)?;
    let mut parameter_sets = Vec::new();
    // Sequence parameter sets, then picture parameter sets.
    for most in [0x1f, 0xff] {
        let (count, after) = rest.split_first()?;
        rest = append_sets(usize::from(count & most), after, &mut parameter_sets)?;
    }
    Some(Framing {
        length_bytes: usize::from(header[4] & 3) + 1,
        parameter_sets,
    })
}

/// Appends parameter sets, each after a length of two bytes; returns what follows them.
fn append_sets<'a>(count: usize, mut rest: &'a [u8], to: &mut Vec<u8>) -> Option<&'a [u8]> {
    for _ in 0..count {
        let (length, after) = rest.split_at_checked(2)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        let (set, after) = after.split_at_checked(length)?;
        to.extend_from_slice(&START_CODE);
        to.extend_from_slice(set);
        rest = after;
    }
    Some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_become_start_codes_and_wrong_lengths_are_found() {
        let mut units = Vec::new();
        append_units(&[0, 2, 7, 8, 0, 1, 9], 2, &mut units).unwrap();
        assert_eq!(units, [0, 0, 0, 1, 7, 8, 0, 0, 0, 1, 9]);
        assert_eq!(append_units(&[0, 3, 7, 8], 2, &mut units), None);
        assert_eq!(append_units(&[0], 2, &mut units), None);
    }

    #[test]
    fn a_header_that_was_cut_gives_no_parameter_sets() {
        let header = [1, 100, 0, 31, 0xff, 0xe1, 0, 2, 0x67, 1, 1, 0, 1, 0x68];
        let framing = framing_of_avc(&header).unwrap();
        assert_eq!(framing.length_bytes, 4);
        let sets = [0, 0, 0, 1, 0x67, 1, 0, 0, 0, 1, 0x68];
        assert_eq!(framing.parameter_sets, sets);
        for end in 0..header.len() {
            assert_eq!(framing_of_avc(&header[..end]), None, "{end}");
        }
    }
}
