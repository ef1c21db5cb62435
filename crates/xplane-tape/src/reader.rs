//! Reads a tape from its beginning, and single messages again.
//!
//! Reads what there is: a tape whose recorder was killed ends with its last complete chunk. Only one chunk is kept in memory, since
//! tapes contain images.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use dataset::files::outside_file::{self, FileKind};
use mcap::MAGIC;
use mcap::records::{MessageHeader, Record, op};

use super::chunk::{MAX_RECORD_BYTES, channels_and_messages, parse};
use super::error::TapeError;
use super::format::{Channel, LINK_VERSION_KEY, METADATA_NAME, PROFILE, check_metadata};

/// Location of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessagePosition {
    chunk_at: u64,
    sequence: u32,
}

impl MessagePosition {
    /// The message's number, counted from 0 over the whole tape.
    pub fn sequence(&self) -> u32 {
        self.sequence
    }
}

/// A message on a tape.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Location on the tape.
    pub place: MessagePosition,
    /// The message's channel.
    pub channel: Channel,
    /// Time of passing the recorder, nanoseconds since 1970 in UTC.
    pub time_ns: u64,
    /// The message.
    pub data: Vec<u8>,
}

/// A tape that is being read.
pub struct TapeReader {
    path: PathBuf,
    file: BufReader<File>,
    /// Channels by MCAP's number; foreign ones are ignored.
    channels: HashMap<u16, Channel>,
    link_version: Option<u32>,
    ready: VecDeque<Entry>,
    whole: bool,
    /// The most recently reread chunk.
    kept: Option<(u64, HashMap<u32, Vec<u8>>)>,
}

impl TapeReader {
    /// Opens a tape.
    ///
    /// # Errors
    /// It cannot be read, is not a tape, or has another version.
    pub fn open(path: &Path) -> Result<Self, TapeError> {
        let file = outside_file::open(path, FileKind::TAPE)?;
        let no_tape = |found: String| {
            TapeError::BadInput(format!(
                "{} is not a tape that this version reads: {found}; expected an MCAP file of `dtd tape`",
                path.display()
            ))
        };
        let mut file = BufReader::new(file);
        let mut magic = [0; MAGIC.len()];
        match file.read_exact(&mut magic) {
            Ok(()) if magic == *MAGIC => {}
            _ => return Err(no_tape("it does not begin as MCAP does".into())),
        }
        let mut profile = None;
        loop {
            let Some((_, op, body)) = next_record(&mut file, path)? else {
                return Err(no_tape(format!("its metadata has no {METADATA_NAME}")));
            };
            // Foreign records are not examined.
            let record = match op {
                op::HEADER | op::METADATA => parse(op, &body, path)?,
                op::CHUNK | op::DATA_END => {
                    return Err(no_tape(format!("its metadata has no {METADATA_NAME}")));
                }
                _ => continue,
            };
            match record {
                Record::Header(header) => profile = Some(header.profile),
                Record::Metadata(metadata) if metadata.name == METADATA_NAME => {
                    if profile.as_deref() != Some(PROFILE) {
                        return Err(no_tape(format!("its profile is {profile:?}")));
                    }
                    check_metadata(&metadata.metadata).map_err(no_tape)?;
                    return Ok(Self {
                        path: path.to_owned(),
                        file,
                        channels: HashMap::new(),
                        link_version: None,
                        ready: VecDeque::new(),
                        whole: false,
                        kept: None,
                    });
                }
                _ => {}
            }
        }
    }

    /// Path of the tape.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True if its recorder finished. Known once [`TapeReader::next_entry`] has returned the last message.
    pub fn is_whole(&self) -> bool {
        self.whole
    }

    /// Capture link version that the clients used; `None` if there were none.
    pub fn link_version(&self) -> Option<u32> {
        self.link_version
    }

    /// The next message in the order of recording; `None` at the end, or where the recorder was killed.
    ///
    /// # Errors
    /// If the file cannot be read, or a chunk is damaged.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, TapeError> {
        while self.ready.is_empty() && !self.whole {
            let Some((at, op, body)) = next_record(&mut self.file, &self.path)? else {
                return Ok(None);
            };
            match op {
                op::CHUNK => {
                    let mut ready = std::mem::take(&mut self.ready);
                    for record in channels_and_messages(&body, &self.path)? {
                        match record {
                            Record::Channel(channel) => {
                                let version = channel.metadata.get(LINK_VERSION_KEY);
                                let version = version.and_then(|version| version.parse().ok());
                                self.link_version = version.or(self.link_version);
                                if let Some(known) = Channel::of_topic(&channel.topic) {
                                    self.channels.insert(channel.id, known);
                                }
                            }
                            Record::Message { header, data } => {
                                ready.extend(self.entry(at, &header, data.into_owned()));
                            }
                            _ => {}
                        }
                    }
                    self.ready = ready;
                }
                op::DATA_END => self.whole = true,
                _ => {}
            }
        }
        Ok(self.ready.pop_front())
    }

    fn entry(&self, chunk_at: u64, header: &MessageHeader, data: Vec<u8>) -> Option<Entry> {
        Some(Entry {
            place: MessagePosition {
                chunk_at,
                sequence: header.sequence,
            },
            channel: *self.channels.get(&header.channel_id)?,
            time_ns: header.log_time,
            data,
        })
    }

    /// Reads a message again. Cheap for consecutive messages in the same chunk.
    ///
    /// # Errors
    /// If the file cannot be read any more, or was changed.
    pub fn read_again(&mut self, place: MessagePosition) -> Result<Vec<u8>, TapeError> {
        let position = |source| TapeError::Io {
            path: self.path.clone(),
            doing: "read a message again",
            source,
        };
        if self
            .kept
            .as_ref()
            .is_none_or(|(at, _)| *at != place.chunk_at)
        {
            let back = self.file.stream_position().map_err(position)?;
            self.file
                .seek(SeekFrom::Start(place.chunk_at))
                .map_err(position)?;
            let record = next_record(&mut self.file, &self.path)?;
            self.file.seek(SeekFrom::Start(back)).map_err(position)?;
            let mut messages = HashMap::new();
            if let Some((_, op::CHUNK, body)) = record {
                for record in channels_and_messages(&body, &self.path)? {
                    if let Record::Message { header, data } = record {
                        messages.insert(header.sequence, data.into_owned());
                    }
                }
            }
            self.kept = Some((place.chunk_at, messages));
        }
        let found = self
            .kept
            .as_ref()
            .and_then(|(_, messages)| messages.get(&place.sequence));
        found.cloned().ok_or_else(|| {
            position(std::io::Error::new(
                ErrorKind::InvalidData,
                "it is not where it was: the file was changed",
            ))
        })
    }
}

/// The next record of the file with its position; `None` at the end, which may be anywhere after a kill.
fn next_record(
    file: &mut BufReader<File>,
    path: &Path,
) -> Result<Option<(u64, u8, Vec<u8>)>, TapeError> {
    let failed = |source| TapeError::Io {
        path: path.into(),
        doing: "read it",
        source,
    };
    let at = file.stream_position().map_err(failed)?;
    let mut head = [0; 9];
    match file.read_exact(&mut head) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        Err(error) => return Err(failed(error)),
    }
    let [op, length @ ..] = head;
    let length = u64::from_le_bytes(length);
    // A chunk that is not closed: the recorder is still running, or was killed.
    if length == u64::MAX {
        return Ok(None);
    }
    if length > MAX_RECORD_BYTES {
        return Err(failed(std::io::Error::new(
            ErrorKind::InvalidData,
            format!(
                "a record of {length} bytes at byte {at} is announced, expected at most {MAX_RECORD_BYTES}"
            ),
        )));
    }
    let mut body = Vec::new();
    file.take(length).read_to_end(&mut body).map_err(failed)?;
    Ok((body.len() as u64 == length).then_some((at, op, body)))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::{Direction, TapeWriter, Traffic};

    const CHANNEL: Channel = Channel {
        traffic: Traffic::Udp,
        number: 1,
        direction: Direction::ToSimulator,
    };

    fn new_tape(path: &Path) -> Result<TapeWriter, TapeError> {
        TapeWriter::create(path, "127.0.0.1:49000", "2026-01-01T00:00:00Z")
    }

    fn datagram(number: u32) -> Vec<u8> {
        // Long enough for several chunks, and incompressible.
        (0..50_000_u32)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> (number % 24)) as u8)
            .collect()
    }

    fn tape_of(path: &Path, messages: u32) {
        let mut tape = new_tape(path).unwrap();
        for number in 0..messages {
            tape.write(CHANNEL, u64::from(number), &datagram(number))
                .unwrap();
        }
        let summary = tape.finish().unwrap();
        assert_eq!(
            (summary.messages, summary.bytes),
            (messages, fs::metadata(path).unwrap().len())
        );
    }

    fn read_all(path: &Path) -> (Vec<Entry>, bool) {
        let mut tape = TapeReader::open(path).unwrap();
        let mut entries = Vec::new();
        while let Some(entry) = tape.next_entry().unwrap() {
            entries.push(entry);
        }
        (entries, tape.is_whole())
    }

    #[test]
    fn what_was_written_is_read_in_order_and_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        tape_of(&path, 100);
        let (entries, whole) = read_all(&path);
        assert!(whole);
        assert_eq!(entries.len(), 100);
        let mut tape = TapeReader::open(&path).unwrap();
        for (number, entry) in entries.iter().enumerate().rev().step_by(7) {
            assert_eq!((entry.time_ns, entry.channel), (number as u64, CHANNEL));
            assert_eq!(entry.data, datagram(number as u32));
            assert_eq!(tape.read_again(entry.place).unwrap(), entry.data);
        }
        // Rereading does not lose the position in the order.
        assert_eq!(tape.next_entry().unwrap().unwrap().time_ns, 0);
    }

    #[test]
    fn log_times_keep_to_the_order_on_the_tape_whatever_was_stamped_first() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut tape = new_tape(&path).unwrap();
        for stamped_ns in [10, 30, 20, 40] {
            tape.write(CHANNEL, stamped_ns, &datagram(stamped_ns as u32))
                .unwrap();
        }
        tape.finish().unwrap();
        let (entries, _) = read_all(&path);
        let times: Vec<u64> = entries.iter().map(|entry| entry.time_ns).collect();
        assert_eq!(times, [10, 30, 30, 40]);
        assert_eq!(entries[2].data, datagram(20));
    }

    #[test]
    fn a_tape_cut_anywhere_is_read_up_to_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        tape_of(&path, 100);
        let bytes = fs::read(&path).unwrap();
        let cut = folder.path().join("cut.mcap");
        for part in [3, 5, 9] {
            fs::write(&cut, &bytes[..bytes.len() * part / 10]).unwrap();
            let (entries, whole) = read_all(&cut);
            assert!(!whole);
            assert!(
                (1..100).contains(&entries.len()),
                "{} of 100",
                entries.len()
            );
            let last = entries.last().unwrap();
            assert_eq!(last.data, datagram(entries.len() as u32 - 1));
        }
    }

    #[test]
    fn damage_other_files_and_overwriting_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        tape_of(&path, 100);
        let error = new_tape(&path).err().unwrap().to_string();
        assert!(
            error.contains("there is a file of that name already"),
            "{error}"
        );

        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x55;
        let damaged = folder.path().join("damaged.mcap");
        fs::write(&damaged, &bytes).unwrap();
        let mut tape = TapeReader::open(&damaged).unwrap();
        let error = loop {
            match tape.next_entry() {
                Ok(Some(_)) => {}
                Ok(None) => panic!("the damage was not noticed"),
                Err(error) => break error,
            }
        };
        assert!(error.to_string().contains("damaged.mcap"), "{error}");

        for other in [&b"hello, this is no MCAP file"[..], b""] {
            fs::write(&damaged, other).unwrap();
            let error = TapeReader::open(&damaged).err().unwrap();
            assert!(error.to_string().contains("is not a tape"), "{error}");
        }
        let error = TapeReader::open(&folder.path().join("lost.mcap"))
            .err()
            .unwrap();
        assert!(error.to_string().contains("lost.mcap"), "{error}");
    }
}
