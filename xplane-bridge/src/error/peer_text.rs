//! Text from a peer in errors and records, which end in terminals and logs: shortened, on one line, without control characters.

/// Maximum quoted characters.
const MAX_CHARACTERS: usize = 500;

/// The beginning of the text, safe to print.
pub(crate) fn quoted(text: &str) -> String {
    let mut quoted = String::with_capacity(text.len().min(MAX_CHARACTERS));
    for c in text.chars().take(MAX_CHARACTERS) {
        if c.is_control() {
            quoted.extend(c.escape_default());
        } else {
            quoted.push(c);
        }
    }
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_quoted_up_to_the_limit_on_one_line_and_without_control_characters() {
        assert_eq!(quoted(&"é".repeat(500)), "é".repeat(500));
        assert_eq!(quoted(&"é".repeat(60_000)), "é".repeat(500));
        assert_eq!(
            quoted("no\n2026-11-26T00:00:05Z error: \u{1b}[2J"),
            "no\\n2026-11-26T00:00:05Z error: \\u{1b}[2J"
        );
    }
}
