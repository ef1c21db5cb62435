//! The secret of a capture link that is open to other machines.

use std::{env, fmt};

use crate::LINK_TOKEN_VARIABLE;

/// A secret that a client must know. Never empty, never shown.
#[derive(Clone, PartialEq, Eq)]
pub struct LinkToken(String);

impl LinkToken {
    /// A token from a user's setting; `None` if that is blank, which is no secret.
    pub fn new(text: &str) -> Option<Self> {
        let text = text.trim();
        (!text.is_empty()).then(|| Self(text.to_owned()))
    }

    /// The value in the environment ([`LINK_TOKEN_VARIABLE`]).
    pub fn from_environment() -> Option<Self> {
        Self::new(&env::var(LINK_TOKEN_VARIABLE).ok()?)
    }

    /// True if a client gave this token. Takes equally long for any wrong one.
    pub fn is(&self, given: Option<&str>) -> bool {
        // Comparing hashes in constant time has the same effect for the tokens.
        given.is_some_and(|given| {
            blake3::hash(given.trim().as_bytes()) == blake3::hash(self.0.as_bytes())
        })
    }

    /// The secret, for passing it on.
    pub fn secret(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for LinkToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("LinkToken(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_something_and_is_known_or_not() {
        assert_eq!(LinkToken::new(" \t\n"), None);
        let token = LinkToken::new("open sesame").unwrap();
        assert!(token.is(Some("open sesame")));
        for wrong in [None, Some(""), Some("open"), Some("open sesamf")] {
            assert!(!token.is(wrong), "{wrong:?}");
        }
        assert!(!format!("{token:?}").contains("sesame"));
    }
}
