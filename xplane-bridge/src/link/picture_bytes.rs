//! Image bytes, and the memory that they return to.

use std::fmt;
use std::mem;
use std::ops::Deref;
use std::sync::mpsc::Sender;

/// Red, green, blue, one byte each, row by row from the top left.
pub enum PictureBytes {
    /// Received over the link, or grabbed.
    Own(Vec<u8>),
    /// Grabbed into pool memory.
    Pooled(PooledPicture),
}

/// An image in pool memory, which returns to the pool when the image is dropped.
#[derive(Debug)]
pub struct PooledPicture {
    bytes: Vec<u8>,
    pool: Sender<Vec<u8>>,
}

impl PooledPicture {
    pub(crate) fn new(bytes: Vec<u8>, pool: Sender<Vec<u8>>) -> Self {
        Self { bytes, pool }
    }
}

impl Deref for PooledPicture {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for PooledPicture {
    fn drop(&mut self) {
        // Fails if the grabbing has ended.
        let _ = self.pool.send(mem::take(&mut self.bytes));
    }
}

impl Deref for PictureBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Own(bytes) => bytes,
            Self::Pooled(picture) => picture,
        }
    }
}

impl From<Vec<u8>> for PictureBytes {
    fn from(bytes: Vec<u8>) -> Self {
        Self::Own(bytes)
    }
}

/// A copy is always our own.
impl Clone for PictureBytes {
    fn clone(&self) -> Self {
        Self::Own(self.to_vec())
    }
}

impl PartialEq for PictureBytes {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

/// Printing millions of numbers would be useless.
impl fmt::Debug for PictureBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = match self {
            Self::Own(_) => "own",
            Self::Pooled(_) => "pooled",
        };
        write!(f, "{} bytes, {place}", self.len())
    }
}
