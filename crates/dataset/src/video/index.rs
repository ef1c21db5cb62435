//! Converts a fragmented file into a plain one.
//!
//! Fragments survive a kill, but a fragmented file does not say how many images it has, and many tools read it from end to end before they
//! show it. So a finished recording's packets are copied, without re-encoding, into a file with one index, which then replaces the
//! fragmented file atomically.

pub(crate) mod fragments;

use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use ffmpeg_next::{Packet, encoder, format, media};

use super::writer::{CONTAINER, check_time_base, exact_timestamps};
use super::{fault, ffmpeg_path, open_file};
use crate::error::{Error, Result};

/// Suffix of the plain file until it replaces the fragmented one.
const UNFINISHED: &str = ".indexing";

/// Adds the index to a finished recording of `pictures` images and makes it durable.
pub(super) fn add(path: &Path, pictures: u32) -> Result<()> {
    let plain = beside(path);
    let copied = copy(path, &plain)?;
    if copied != pictures {
        return Err(fault(
            path,
            "write the index",
            format!("{copied} images can be read back, {pictures} were written"),
        ));
    }
    File::open(&plain)
        .and_then(|file| file.sync_all())
        .map_err(Error::io("sync", &plain))?;
    fs::rename(&plain, path).map_err(Error::io("rename", &plain))
}

fn beside(path: &Path) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(UNFINISHED);
    name.into()
}

/// Copies all packets, and returns their number.
fn copy(from: &Path, to: &Path) -> Result<u32> {
    let mut input = open_file(from, || false)?;
    let recorded = input
        .streams()
        .best(media::Type::Video)
        .ok_or_else(|| fault(from, "read it back", "there is no video stream in it"))?;
    let time_base = recorded.time_base();
    let mut output =
        format::output_as(&ffmpeg_path(to)?, CONTAINER).map_err(|e| fault(to, "create it", e))?;
    let mut stream = output
        .add_stream(encoder::find(ffmpeg_next::codec::Id::None))
        .map_err(|e| fault(to, "add the stream", e))?;
    stream.set_parameters(recorded.parameters());
    stream.set_time_base(time_base);
    stream.set_avg_frame_rate(recorded.avg_frame_rate());
    output
        .write_header_with(exact_timestamps(time_base.denominator()))
        .map_err(|e| fault(to, "write the header", e))?;
    check_time_base(to, &output, time_base)?;
    let mut packet = Packet::empty();
    let mut copied = 0;
    loop {
        match packet.read(&mut input) {
            Ok(()) => {
                packet.set_position(-1);
                packet.set_stream(0);
                packet
                    .write_interleaved(&mut output)
                    .map_err(|e| fault(to, "write", e))?;
                copied += 1;
            }
            Err(ffmpeg_next::Error::Eof) => break,
            Err(e) => return Err(fault(from, "read it back", e)),
        }
    }
    output
        .write_trailer()
        .map_err(|e| fault(to, "write the index", e))?;
    Ok(copied)
}
