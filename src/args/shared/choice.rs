//! Parsers of words from a list, whole numbers and sizes.

use std::num::NonZeroU32;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// Option values by word, each with its help.
pub(crate) type Choices<T, const N: usize> = [(&'static str, &'static str, T); N];

/// Parser of a word from a list, which help and completions show.
pub(crate) fn choice<T: Copy + Send + Sync + 'static, const N: usize>(
    choices: Choices<T, N>,
) -> impl TypedValueParser<Value = T> {
    let words = choices.map(|(word, help, _)| match help {
        "" => PossibleValue::new(word),
        help => PossibleValue::new(word).help(help),
    });
    PossibleValuesParser::new(words).try_map(move |found| {
        let mut choices = choices.into_iter();
        let chosen = choices.find(|(word, ..)| *word == found);
        chosen.map(|(.., value)| value).ok_or("unknown value")
    })
}

/// A whole number from 1.
pub(crate) fn from_one(text: &str) -> Result<NonZeroU32, String> {
    let number = text.parse();
    number.map_err(|_| format!("expected a whole number from 1 to {}", u32::MAX))
}

/// Width and height, pixels.
pub(crate) fn size(text: &str) -> Result<[u32; 2], String> {
    let side = |text: &str| text.parse::<u32>().ok().filter(|px| *px > 0);
    let sides = text.split_once('x');
    let sides = sides.and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| format!("{text:?} is not a size, expected e.g. 1920x1280"))
}
