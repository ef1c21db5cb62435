//! The bytes of a picture, wherever they are stored.

use std::fmt;
use std::ops::Deref;

use super::SharedPicture;

/// Red, green, blue, one byte each, row by row from the top left: in our own memory, or in memory shared with the simulator.
pub enum PictureBytes {
    /// Received over the link, or grabbed.
    Own(Vec<u8>),
    /// Where the simulator drew them.
    Shared(SharedPicture),
}

impl Deref for PictureBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Own(bytes) => bytes,
            Self::Shared(picture) => picture,
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
            Self::Shared(_) => "shared",
        };
        write!(f, "{} bytes, {place}", self.len())
    }
}
