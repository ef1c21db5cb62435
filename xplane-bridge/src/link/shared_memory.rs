//! Shared memory for images: on one computer, the simulator draws them into the client's memory.
//!
//! The client creates a file in memory (`memfd`) with slots for some images, and sends the simulator the process and the number under which
//! it is open. A request for an image lends a slot to the simulator; the answer returns it with the image in it. The file has no name,
//! so a killed process leaves no file behind; its size is sealed, so that no access can fail; and it begins with a secret, so that the file
//! of another process, perhaps in another container with the same numbers, is not mistaken for it. Over loopback each image was copied
//! twice and cost the client more than 5 % of a core (`docs/capture-link.md`).
//!
//! Images that pass a recorder, or come from another computer or from the plugin, travel over TCP.
#![allow(unsafe_code)]

#[cfg_attr(target_os = "linux", path = "shared_memory/memfd.rs")]
#[cfg_attr(not(target_os = "linux"), path = "shared_memory/no_memfd.rs")]
mod memfd;

use std::fs::File;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::ops::{Deref, DerefMut};
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use memmap2::{Mmap, MmapMut, MmapOptions};
use serde::{Deserialize, Serialize};

use super::MAX_PAYLOAD_BYTES;

/// Maximum number of slots that a simulator accepts.
const MAX_SLOTS: u32 = 64;
/// Slots begin at multiples of this; the secret is before the first. A page on every usual system.
const PAGE_BYTES: usize = 64 << 10;

/// Location and layout of a client's memory.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SharedMemory {
    /// The client's process.
    pub process: u32,
    /// The number of the open file in it.
    pub descriptor: i32,
    /// The secret at the beginning of the file, 32 hexadecimal digits.
    pub secret: String,
    /// Number of slots.
    pub slots: u32,
    /// Size of a slot, bytes, a multiple of 65,536. The first slot begins at byte 65,536.
    pub slot_bytes: usize,
}

impl SharedMemory {
    fn file_bytes(&self) -> u64 {
        (PAGE_BYTES + self.slots as usize * self.slot_bytes) as u64
    }

    fn slot_at(&self, slot: u32) -> u64 {
        (PAGE_BYTES + slot as usize * self.slot_bytes) as u64
    }

    /// The window of a file on a slot.
    fn slot(&self, slot: u32) -> MmapOptions {
        let mut options = MmapOptions::new();
        options.offset(self.slot_at(slot)).len(self.slot_bytes);
        options
    }

    /// The fault of an offer, if any.
    fn fault(&self) -> Option<UnusableMemory> {
        if self.slots == 0 || self.slots > MAX_SLOTS {
            return Some(UnusableMemory::Slots { slots: self.slots });
        }
        let fits = (1..=MAX_PAYLOAD_BYTES.next_multiple_of(PAGE_BYTES)).contains(&self.slot_bytes)
            && self.slot_bytes.is_multiple_of(PAGE_BYTES);
        (!fits).then_some(UnusableMemory::SlotBytes {
            slot_bytes: self.slot_bytes,
        })
    }
}

/// Reason why a client's memory cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum UnusableMemory {
    /// None, or more than a client needs.
    #[error("slots is {slots}, expected 1 to {MAX_SLOTS}")]
    Slots {
        /// Their number.
        slots: u32,
    },
    /// Slots that cannot be mapped.
    #[error(
        "slot_bytes is {slot_bytes}, expected a multiple of {PAGE_BYTES} up to {MAX_PAYLOAD_BYTES}"
    )]
    SlotBytes {
        /// Their size.
        slot_bytes: usize,
    },
    /// The file cannot be opened.
    #[error("{path}: {cause}")]
    NotOpened {
        /// Its path.
        path: String,
        /// Underlying error.
        cause: io::Error,
    },
    /// A file that could shrink while it is mapped.
    #[error("{path} is not sealed memory")]
    NotSealed {
        /// Its path.
        path: String,
    },
    /// Not the announced memory.
    #[error("{path} has {bytes} bytes, expected {expected}")]
    OtherSize {
        /// Its path.
        path: String,
        /// Its size.
        bytes: u64,
        /// The announced size.
        expected: u64,
    },
    /// A file of another program.
    #[error(
        "open file {descriptor} of process {process} does not begin with the client's secret: it belongs to somebody else"
    )]
    OtherSecret {
        /// The process.
        process: u32,
        /// Its file.
        descriptor: i32,
    },
    /// The file cannot be read or mapped.
    #[error("the client's memory: {0}")]
    Unreadable(io::Error),
    /// A system without files in memory.
    #[error("memory can be shared on Linux only")]
    NotHere,
}

/// Reason why there is no slot for an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoSlot {
    /// Too large a number.
    #[error("there is no slot {number}: the memory has {slots}")]
    NoSuch {
        /// The number.
        number: u32,
        /// Number of slots.
        slots: usize,
    },
    /// Another image is not finished.
    #[error("slot {number} is being drawn into already")]
    Lent {
        /// The number.
        number: u32,
    },
    /// The memory was shared for smaller images.
    #[error("an image of {picture_bytes} bytes does not fit slot {number} of {slot_bytes}")]
    TooSmall {
        /// The number.
        number: u32,
        /// Size of the slot.
        slot_bytes: usize,
        /// Size of the image.
        picture_bytes: usize,
    },
}

/// The client's side: memory for some images of one size.
#[derive(Debug)]
pub struct SharedPictures {
    /// Stays open as long as a simulator may need to open it.
    _file: File,
    memory: SharedMemory,
    free: Arc<Mutex<Vec<Slot>>>,
}

#[derive(Debug)]
struct Slot {
    number: u32,
    memory: Mmap,
}

impl SharedPictures {
    /// Memory for `slots` images of this size. It takes no memory until images are drawn into it.
    ///
    /// # Errors
    /// The system has no such memory.
    pub fn new(slots: u32, picture_bytes: usize) -> io::Result<Self> {
        let [first, second] = [(); 2].map(|()| RandomState::new().build_hasher().finish());
        let mut memory = SharedMemory {
            process: std::process::id(),
            descriptor: 0,
            secret: format!("{first:016x}{second:016x}"),
            slots,
            slot_bytes: picture_bytes.next_multiple_of(PAGE_BYTES),
        };
        if let Some(fault) = memory.fault() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, fault));
        }
        let file = memfd::create(memory.file_bytes())?;
        memory.descriptor = file.as_raw_fd();
        file.write_all_at(memory.secret.as_bytes(), 0)?;
        let slots = (0..slots).rev().map(|number| {
            // SAFETY: the file cannot shrink. Others write to it, but to this slot only while it is lent, when this process does not read
            // it: `SharedPicture` alone gives access to it. A simulator that breaks this rule corrupts its image; all bytes are valid.
            let memory = unsafe { memory.slot(number).map(&file) }?;
            Ok(Slot { number, memory })
        });
        let free = slots.collect::<io::Result<_>>()?;
        Ok(Self {
            _file: file,
            memory,
            free: Arc::new(Mutex::new(free)),
        })
    }

    /// The description for the simulator.
    pub fn offer(&self) -> &SharedMemory {
        &self.memory
    }

    /// Size of the largest image that it can hold, bytes.
    pub(crate) fn largest_picture_bytes(&self) -> usize {
        self.memory.slot_bytes
    }

    /// A free slot for an image of this size, the most recently used one; `None` if all are in use.
    pub(crate) fn lend(&self, picture_bytes: usize) -> Option<SharedPicture> {
        let slot = lock(&self.free).pop()?;
        Some(SharedPicture {
            slot: Some(slot),
            bytes: picture_bytes.min(self.memory.slot_bytes),
            free: self.free.clone(),
        })
    }
}

/// A slot of the client's memory, and the image in it once the simulator has answered. Dropping it frees the slot.
#[derive(Debug)]
pub struct SharedPicture {
    /// Taken only by `drop`.
    slot: Option<Slot>,
    bytes: usize,
    free: Arc<Mutex<Vec<Slot>>>,
}

impl SharedPicture {
    /// The slot's number.
    pub fn number(&self) -> u32 {
        self.slot.as_ref().map_or(0, |slot| slot.number)
    }
}

impl Deref for SharedPicture {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.slot
            .as_ref()
            .map_or(&[], |slot| &slot.memory[..self.bytes])
    }
}

impl Drop for SharedPicture {
    fn drop(&mut self) {
        lock(&self.free).extend(self.slot.take());
    }
}

/// The simulator's side: a client's memory, to draw into.
#[derive(Debug)]
pub struct DrawingSlots {
    slots: Vec<Arc<Mutex<Option<MmapMut>>>>,
}

impl DrawingSlots {
    /// True if this computer can share memory at all.
    pub const POSSIBLE: bool = memfd::POSSIBLE;

    /// Opens the memory that a client offers. If it cannot be used, images are sent over the link.
    pub fn open(offer: &SharedMemory) -> Result<Self, UnusableMemory> {
        if let Some(fault) = offer.fault() {
            return Err(fault);
        }
        let file = memfd::open(offer.process, offer.descriptor, offer.file_bytes())?;
        let mut secret = vec![0; offer.secret.len()];
        file.read_exact_at(&mut secret, 0)
            .map_err(UnusableMemory::Unreadable)?;
        if secret.len() != 32 || secret != offer.secret.as_bytes() {
            return Err(UnusableMemory::OtherSecret {
                process: offer.process,
                descriptor: offer.descriptor,
            });
        }
        let slots = (0..offer.slots).map(|number| {
            // SAFETY: the file cannot shrink. The client reads a slot only while it is not lent, and `DrawingSlot` alone gives access to
            // it, once at a time. A client that breaks this rule reads a torn image; all bytes are valid.
            let memory =
                unsafe { offer.slot(number).map_mut(&file) }.map_err(UnusableMemory::Unreadable)?;
            Ok(Arc::new(Mutex::new(Some(memory))))
        });
        Ok(Self {
            slots: slots.collect::<Result<_, UnusableMemory>>()?,
        })
    }

    /// The memory of a slot for an image of this size.
    pub fn borrow(&self, number: u32, picture_bytes: usize) -> Result<DrawingSlot, NoSlot> {
        let home = self.slots.get(number as usize).ok_or(NoSlot::NoSuch {
            number,
            slots: self.slots.len(),
        })?;
        let mut memory = lock(home);
        let slot_bytes = memory.as_ref().map(|memory| memory.len());
        match slot_bytes {
            None => Err(NoSlot::Lent { number }),
            Some(slot_bytes) if slot_bytes < picture_bytes => Err(NoSlot::TooSmall {
                number,
                slot_bytes,
                picture_bytes,
            }),
            Some(_) => Ok(DrawingSlot {
                memory: memory.take(),
                bytes: picture_bytes,
                home: home.clone(),
            }),
        }
    }
}

/// A slot while an image is drawn into it. Dropping it makes it available again.
#[derive(Debug)]
pub struct DrawingSlot {
    /// Taken only by `drop`.
    memory: Option<MmapMut>,
    bytes: usize,
    home: Arc<Mutex<Option<MmapMut>>>,
}

impl Deref for DrawingSlot {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.memory
            .as_ref()
            .map_or(&[], |memory| &memory[..self.bytes])
    }
}

impl DerefMut for DrawingSlot {
    fn deref_mut(&mut self) -> &mut [u8] {
        self.memory
            .as_mut()
            .map_or(&mut [], |memory| &mut memory[..self.bytes])
    }
}

impl Drop for DrawingSlot {
    fn drop(&mut self) {
        *lock(&self.home) = self.memory.take();
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PICTURE_BYTES: usize = 100_000;

    #[test]
    fn what_is_drawn_into_a_slot_is_seen_by_the_client_that_lent_it() {
        let pictures = SharedPictures::new(3, PICTURE_BYTES).unwrap();
        let slots = DrawingSlots::open(pictures.offer()).unwrap();
        let lent = [(); 3].map(|()| pictures.lend(PICTURE_BYTES).unwrap());
        assert!(pictures.lend(PICTURE_BYTES).is_none(), "only three");
        for picture in &lent {
            let mut slot = slots.borrow(picture.number(), PICTURE_BYTES).unwrap();
            slot.fill(picture.number() as u8 + 7);
        }
        for picture in &lent {
            assert_eq!(picture.len(), PICTURE_BYTES);
            assert!(
                picture
                    .iter()
                    .all(|&byte| byte == picture.number() as u8 + 7)
            );
        }
        let last = lent[2].number();
        drop(lent);
        assert_eq!(
            pictures.lend(10).map(|picture| picture.number()),
            Some(last)
        );
    }

    #[test]
    fn a_slot_is_drawn_into_once_at_a_time_and_only_what_fits() {
        let pictures = SharedPictures::new(2, PICTURE_BYTES).unwrap();
        let slots = DrawingSlots::open(pictures.offer()).unwrap();
        let held = slots.borrow(1, 10).unwrap();
        assert!(matches!(
            slots.borrow(1, 10),
            Err(NoSlot::Lent { number: 1 })
        ));
        drop(held);
        assert!(slots.borrow(1, 10).is_ok());
        assert!(matches!(
            slots.borrow(2, 10),
            Err(NoSlot::NoSuch { number: 2, .. })
        ));
        let too_large = slots.borrow(0, PAGE_BYTES * 2 + 1).unwrap_err().to_string();
        assert!(too_large.contains("does not fit"), "{too_large}");
    }

    #[test]
    fn memory_of_another_process_or_of_another_kind_is_refused_with_the_reason() {
        let pictures = SharedPictures::new(2, PICTURE_BYTES).unwrap();
        let offer = pictures.offer();
        let file = tempfile::tempfile().unwrap();
        let wrong = [
            (
                "secret",
                SharedMemory {
                    secret: "0".repeat(32),
                    ..offer.clone()
                },
            ),
            (
                "secret",
                SharedMemory {
                    secret: String::new(),
                    ..offer.clone()
                },
            ),
            (
                "bytes",
                SharedMemory {
                    slots: 3,
                    ..offer.clone()
                },
            ),
            (
                "slots is 0",
                SharedMemory {
                    slots: 0,
                    ..offer.clone()
                },
            ),
            (
                "slot_bytes is 5",
                SharedMemory {
                    slot_bytes: 5,
                    ..offer.clone()
                },
            ),
            (
                "is not sealed memory",
                SharedMemory {
                    descriptor: file.as_raw_fd(),
                    ..offer.clone()
                },
            ),
            (
                "No such file",
                SharedMemory {
                    descriptor: 1_000_000,
                    ..offer.clone()
                },
            ),
        ];
        for (expected, offer) in wrong {
            let error = DrawingSlots::open(&offer).unwrap_err().to_string();
            assert!(error.contains(expected), "{error:?}, expected {expected:?}");
        }
    }

    #[test]
    fn both_sides_live_on_when_the_other_is_gone() {
        let pictures = SharedPictures::new(1, PICTURE_BYTES).unwrap();
        let slots = DrawingSlots::open(pictures.offer()).unwrap();
        let picture = pictures.lend(PICTURE_BYTES).unwrap();
        let mut slot = slots.borrow(0, PICTURE_BYTES).unwrap();
        drop(slots);
        slot.fill(9);
        drop(slot);
        drop(pictures);
        assert!(picture.iter().all(|&byte| byte == 9));
    }
}
