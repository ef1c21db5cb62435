//! Text of a peer in errors, which end in terminals, logs and records: as much of it as a person reads.

/// Characters of a text that are quoted.
const MOST_CHARACTERS: usize = 500;

/// The beginning of a text.
pub(crate) fn beginning(text: &str) -> &str {
    let end = text.char_indices().nth(MOST_CHARACTERS);
    &text[..end.map_or(text.len(), |(at, _)| at)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_quoted_up_to_the_limit_and_between_characters() {
        assert_eq!(beginning(&"é".repeat(500)), "é".repeat(500));
        assert_eq!(beginning(&"é".repeat(60_000)), "é".repeat(500));
    }
}
