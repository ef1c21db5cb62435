//! Errors of training a detector.

use std::ops::RangeInclusive;

use dataset::work::watch::Stopped;

/// Training error. Every message says what was expected, what was found and, if the user can act, how.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A corpus cannot be read, or a result not written.
    #[error(transparent)]
    Dataset(#[from] dataset::Error),
    /// The corpus, the destination or the model to start from cannot be used as it is.
    #[error("{0}")]
    Input(String),
    /// An invalid setting.
    #[error("configuration: {setting} is {found}, expected {expected}")]
    Setting {
        /// Name of the setting with its section.
        setting: String,
        /// The value.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// The caller stopped the training.
    #[error(transparent)]
    Stopped(#[from] Stopped),
    /// The network's numbers are no longer finite.
    #[error(
        "training of detector diverged at step {step}: the loss is not finite; lower its learning_rate"
    )]
    Diverged {
        /// Current step.
        step: u64,
    },
}

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

pub(crate) fn in_range(setting: &str, found: f64, allowed: RangeInclusive<f64>) -> Result<()> {
    // NaN is never in range.
    if allowed.contains(&found) {
        return Ok(());
    }
    Err(Error::Setting {
        setting: setting.to_owned(),
        found: format!("{found:?}"),
        expected: format!("a number from {} to {}", allowed.start(), allowed.end()),
    })
}
