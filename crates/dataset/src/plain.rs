//! Text of others, made safe for a terminal and for a log.

use std::borrow::Cow;
use std::path::Path;

/// Text that is safe for a terminal: lines and tabs stay; other control characters, and those that change the writing direction, are shown
/// by their numbers.
pub fn plain(words: &str) -> Cow<'_, str> {
    without(words, |c| is_harmful(c) && c != '\n')
}

/// Like [`shown`], on one line: a line feed is shown as well.
pub fn one_line(words: &str) -> Cow<'_, str> {
    without(words, is_harmful)
}

/// Text that is safe for a terminal, with every line but the first indented, so that text of others cannot begin a line of ours.
pub fn plain_lines(words: &str) -> Cow<'_, str> {
    let words = plain(words);
    if words.contains('\n') {
        Cow::Owned(words.replace('\n', "\n  "))
    } else {
        words
    }
}

/// A path on one line, for messages.
pub fn shown(path: &Path) -> String {
    one_line(&path.to_string_lossy()).into_owned()
}

fn is_harmful(c: char) -> bool {
    (c.is_control() && c != '\t') || matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn without(words: &str, harmful: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !words.contains(&harmful) {
        return Cow::Borrowed(words);
    }
    let mut shown = String::with_capacity(words.len() + 16);
    for c in words.chars() {
        if harmful(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_shown_instead() {
        assert_eq!(plain("two\nlines\tüß"), "two\nlines\tüß");
        assert_eq!(
            plain("\u{1b}]0;owned\u{7}\r\u{9b}2J\u{202e}cod\u{7f}"),
            "\\u{1b}]0;owned\\u{7}\\r\\u{9b}2J\\u{202e}cod\\u{7f}"
        );
        assert_eq!(one_line("two\nlines\tüß"), "two\\nlines\tüß");
        assert_eq!(plain_lines("two\nlines\u{7}"), "two\n  lines\\u{7}");
        assert_eq!(shown(Path::new("cn/a\nb")), "cn/a\\nb");
    }
}
