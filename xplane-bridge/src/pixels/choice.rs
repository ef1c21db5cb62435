//! Selects the source of pixels among the simulator's offers.

use std::fmt;
use std::str::FromStr;

use super::error::PixelError;
use crate::link::PixelKind;

impl PixelKind {
    /// All kinds, the preferred one first.
    pub const ALL: [Self; 3] = [Self::Link, Self::Gl, Self::Screen];

    /// Name, as typed and recorded.
    pub fn name(self) -> &'static str {
        match self {
            Self::Link => "link",
            Self::Gl => "gl",
            Self::Screen => "screen",
        }
    }
}

impl fmt::Display for PixelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The user's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PixelChoice {
    /// The best that the simulator offers.
    #[default]
    Auto,
    /// This one or none.
    Only(PixelKind),
}

/// A text that names no source of pixels.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is not a source of pixels, expected auto, link, gl or screen")]
pub struct UnknownPixels {
    text: String,
}

impl FromStr for PixelChoice {
    type Err = UnknownPixels;

    fn from_str(text: &str) -> Result<Self, UnknownPixels> {
        let kinds = PixelKind::ALL;
        match kinds.into_iter().find(|kind| kind.name() == text) {
            Some(kind) => Ok(Self::Only(kind)),
            None if text == "auto" => Ok(Self::Auto),
            None => Err(UnknownPixels { text: text.into() }),
        }
    }
}

impl fmt::Display for PixelChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Only(kind) => kind.fmt(f),
        }
    }
}

impl PixelChoice {
    /// The source to use with a simulator that offers these.
    ///
    /// # Errors
    /// [`PixelError::BadInput`] if the simulator does not offer the choice, or no source at all.
    pub fn among(self, offered: &[PixelKind]) -> Result<PixelKind, PixelError> {
        let found = match self {
            Self::Auto => PixelKind::ALL
                .into_iter()
                .find(|kind| offered.contains(kind)),
            Self::Only(kind) => offered.contains(&kind).then_some(kind),
        };
        found.ok_or_else(|| {
            let offer = match offered {
                [] => "no source of pixels: it can neither send nor show images".into(),
                kinds => {
                    let names: Vec<&str> = kinds.iter().map(|kind| kind.name()).collect();
                    format!("only {}", names.join(", "))
                }
            };
            PixelError::BadInput(format!("--pixels {self}: the simulator offers {offer}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use PixelKind::{Gl, Link, Screen};

    #[test]
    fn auto_takes_the_best_that_is_offered_in_whatever_order() {
        for (offered, expected) in [
            (vec![Screen, Gl, Link], Link),
            (vec![Screen, Gl], Gl),
            (vec![Screen], Screen),
        ] {
            assert_eq!(PixelChoice::Auto.among(&offered).unwrap(), expected);
        }
        let message = PixelChoice::Auto.among(&[]).unwrap_err().to_string();
        assert!(message.contains("no source of pixels"), "{message}");
    }

    #[test]
    fn what_is_asked_for_is_used_or_refused_with_what_there_is() {
        let choice: PixelChoice = "screen".parse().unwrap();
        assert_eq!(choice.among(&[Link, Screen]).unwrap(), Screen);
        let message = choice.among(&[Link, Gl]).unwrap_err().to_string();
        assert!(
            message.contains("screen") && message.contains("link, gl"),
            "{message}"
        );
        assert!(
            "scren"
                .parse::<PixelChoice>()
                .unwrap_err()
                .to_string()
                .contains("auto")
        );
    }

    #[test]
    fn names_are_the_same_typed_shown_and_recorded() {
        for kind in PixelKind::ALL {
            assert_eq!(
                kind.to_string().parse(),
                Ok(PixelChoice::Only(kind)),
                "{kind}"
            );
            let json = serde_json::to_string(&kind).unwrap();
            assert_eq!(json, format!("\"{kind}\""));
        }
    }
}
