//! Faults of files, collected so that a page can show everything else.

use dataset::error::Error;

/// Messages about files that could not be read.
#[derive(Default)]
pub(crate) struct Problems(pub(crate) Vec<String>);

impl Problems {
    /// The content that was read, or none with a note.
    pub(crate) fn or_none<T: Default>(&mut self, read: Result<T, Error>) -> T {
        read.unwrap_or_else(|error| {
            self.0.push(error.to_string());
            T::default()
        })
    }
}
