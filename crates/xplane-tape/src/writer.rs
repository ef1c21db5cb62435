//! Writes a tape so that it is readable up to the last second, however the recorder stops.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufWriter, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Compression, WriteOptions, Writer};
use serde::Serialize;

use super::error::TapeError;
use super::format::{Channel, Direction, METADATA_NAME, PROFILE, metadata};

/// Uncompressed size at which chunks are closed.
const CHUNK_BYTES: u64 = 1 << 20;
/// Maximum age of an open chunk: a kill loses at most that much.
const FLUSH_AFTER: Duration = Duration::from_secs(1);

/// Summary of a finished recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TapeSummary {
    /// The tape.
    pub path: PathBuf,
    /// Messages on it.
    pub messages: u32,
    /// Number of those that the simulator sent.
    pub from_simulator: u32,
    /// File size, bytes.
    pub bytes: u64,
}

/// A tape that is being written.
pub struct TapeWriter {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: HashMap<Channel, u16>,
    messages: u32,
    from_simulator: u32,
    /// Log time of the last message. Log times never decrease, see [`TapeWriter::write`].
    last_log_time_ns: u64,
    flushed: Instant,
}

impl TapeWriter {
    /// Creates a tape of the simulator at this address, begun at this time (RFC 3339 in UTC). Never overwrites a file.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn create(path: &Path, simulator: &str, began: &str) -> Result<Self, TapeError> {
        let file = File::create_new(path).map_err(|source| match source.kind() {
            ErrorKind::AlreadyExists => TapeError::BadInput(format!(
                "tape {}: there is a file of that name already; move it away or name another one",
                path.display()
            )),
            _ => TapeError::Io {
                path: path.into(),
                doing: "make it",
                source,
            },
        })?;
        let failed = failed_to(path, "begin it");
        let mut writer = WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("dtd ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .chunk_size(Some(CHUNK_BYTES))
            .create(BufWriter::new(file))
            .map_err(&failed)?;
        let metadata = Metadata {
            name: METADATA_NAME.into(),
            metadata: metadata(simulator, began),
        };
        writer.write_metadata(&metadata).map_err(&failed)?;
        writer.flush().map_err(&failed)?;
        Ok(Self {
            path: path.to_owned(),
            writer,
            channels: HashMap::new(),
            messages: 0,
            from_simulator: 0,
            last_log_time_ns: 0,
            flushed: Instant::now(),
        })
    }

    /// Adds a channel. `about` is for people who inspect the tape.
    ///
    /// # Errors
    /// There are 65,534 already, or the file cannot be written.
    pub(crate) fn add_channel(
        &mut self,
        channel: Channel,
        about: &BTreeMap<String, String>,
    ) -> Result<(), TapeError> {
        let added = self
            .writer
            .add_channel(0, &channel.topic(), channel.encoding(), about);
        let id = added.map_err(failed_to(&self.path, "add a channel"))?;
        self.channels.insert(channel, id);
        Ok(())
    }

    /// Adds a message to a channel. `time_ns` counts from 1970 in UTC.
    ///
    /// The order on the tape is the order of these calls, and log times keep to it: a message with an earlier time than the
    /// previous one (two connections, or a clock that was set back) gets that one's log time. Its own stays its publish time.
    ///
    /// # Errors
    /// The channel is unknown, or the file cannot be written.
    pub fn write(&mut self, channel: Channel, time_ns: u64, data: &[u8]) -> Result<(), TapeError> {
        if !self.channels.contains_key(&channel) {
            self.add_channel(channel, &BTreeMap::new())?;
        }
        self.last_log_time_ns = self.last_log_time_ns.max(time_ns);
        let header = MessageHeader {
            channel_id: self.channels[&channel],
            sequence: self.messages,
            log_time: self.last_log_time_ns,
            publish_time: time_ns,
        };
        let written = self.writer.write_to_known_channel(&header, data);
        written.map_err(failed_to(&self.path, "write a message"))?;
        self.messages += 1;
        self.from_simulator += u32::from(channel.direction == Direction::FromSimulator);
        self.flush_if_due()
    }

    /// Closes the open chunk if it is old enough. Call it now and then while the tape is idle.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn flush_if_due(&mut self) -> Result<(), TapeError> {
        if self.flushed.elapsed() >= FLUSH_AFTER {
            let flushed = self.writer.flush();
            flushed.map_err(failed_to(&self.path, "flush it"))?;
            self.flushed = Instant::now();
        }
        Ok(())
    }

    /// Ends the tape with MCAP's summary.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self) -> Result<TapeSummary, TapeError> {
        let finished = self.writer.finish();
        finished.map_err(failed_to(&self.path, "finish it"))?;
        let failed = |source| TapeError::Io {
            path: self.path.clone(),
            doing: "finish it",
            source,
        };
        let file = self.writer.into_inner().into_inner();
        let file = file.map_err(|error| failed(error.into_error()))?;
        file.sync_all().map_err(failed)?;
        let bytes = file.metadata().map_err(failed)?.len();
        Ok(TapeSummary {
            path: self.path.clone(),
            messages: self.messages,
            from_simulator: self.from_simulator,
            bytes,
        })
    }
}

fn failed_to(path: &Path, doing: &'static str) -> impl Fn(mcap::McapError) -> TapeError {
    let path = path.to_owned();
    move |error| TapeError::mcap(&path, doing, &error)
}
