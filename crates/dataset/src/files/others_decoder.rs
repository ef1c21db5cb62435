//! Third-party decoders that may panic on malformed input. A panic becomes an ordinary error and prints no message.

use std::any::Any;
use std::cell::Cell;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
}

/// A decoder that panicked.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("is damaged: its decoder panicked ({said})")]
pub(crate) struct BrokeDown {
    said: String,
}

/// Runs a decoder. It must not leave shared state half-modified when it panics.
pub(crate) fn guarded<T>(decode: impl FnOnce() -> T) -> Result<T, BrokeDown> {
    static QUIET: Once = Once::new();
    // Panics elsewhere are our own bugs and are reported as usual.
    QUIET.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |about| {
            if !IS_GUARDED.get() {
                usual(about);
            }
        }));
    });
    let before = IS_GUARDED.replace(true);
    let decoded = panic::catch_unwind(AssertUnwindSafe(decode));
    IS_GUARDED.set(before);
    decoded.map_err(|payload| BrokeDown {
        said: words_of(payload.as_ref()),
    })
}

fn words_of(payload: &(dyn Any + Send)) -> String {
    let literal = payload.downcast_ref::<&str>().copied();
    let formatted = payload.downcast_ref::<String>().map(String::as_str);
    literal
        .or(formatted)
        .unwrap_or("no reason given")
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_words_and_what_works_passes_through() {
        assert_eq!(guarded(|| 7), Ok(7));
        let said = |decode: fn()| guarded(decode).unwrap_err().to_string();
        assert!(said(|| panic!("no dictionary")).contains("no dictionary"));
        let number = 3;
        let formatted: Result<(), _> = guarded(|| panic!("page {number}"));
        assert!(formatted.unwrap_err().to_string().contains("page 3"));
        assert!(!IS_GUARDED.get());
    }
}
