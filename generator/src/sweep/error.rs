//! Reasons why a sweep cannot be used.

use dataset::files::toml_file::TomlError;

/// A sweep that cannot be read, or an invalid one.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The file cannot be read.
    #[error(transparent)]
    Unreadable(dataset::Error),
    /// A mistake in it.
    #[error(transparent)]
    Invalid(#[from] TomlError),
}
