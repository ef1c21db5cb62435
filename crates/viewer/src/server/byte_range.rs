//! Range requests (RFC 9110, section 14).

use std::ops::Range;

/// A parsed `Range` header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Asked {
    /// The whole file: also the answer to several ranges and to unknown units.
    Whole,
    /// These bytes, at least one.
    Part(Range<u64>),
    /// A range outside the file.
    Outside,
}

impl Asked {
    pub(crate) fn of(header: &str, bytes: u64) -> Self {
        let Some(range) = header.trim().strip_prefix("bytes=") else {
            return Self::Whole;
        };
        let Some((from, to)) = range.split_once('-') else {
            return Self::Whole;
        };
        let number = |text: &str| match text.trim() {
            "" => Some(None),
            digits if digits.bytes().all(|byte| byte.is_ascii_digit()) => {
                Some(Some(digits.parse().unwrap_or(u64::MAX)))
            }
            _ => None,
        };
        let part = match (number(from), number(to)) {
            (Some(Some(from)), Some(to)) => {
                let end = to.map_or(bytes, |to| to.saturating_add(1).min(bytes));
                if to.is_some_and(|to| to < from) {
                    return Self::Whole;
                }
                from..end
            }
            (Some(None), Some(Some(last))) => bytes.saturating_sub(last)..bytes,
            _ => return Self::Whole,
        };
        if part.is_empty() {
            Self::Outside
        } else {
            Self::Part(part)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_the_part_of_the_file_that_it_names() {
        for (header, expected) in [
            ("bytes=0-", Asked::Part(0..100)),
            ("bytes=10-19", Asked::Part(10..20)),
            ("bytes=90-900", Asked::Part(90..100)),
            ("bytes=-7", Asked::Part(93..100)),
            ("bytes=-700", Asked::Part(0..100)),
            ("bytes=99-99999999999999999999", Asked::Part(99..100)),
            ("bytes=100-", Asked::Outside),
            ("bytes=-0", Asked::Outside),
            ("bytes=99999999999999999999-", Asked::Outside),
            ("bytes=5-4", Asked::Whole),
            ("bytes=0-1,5-6", Asked::Whole),
            ("bytes=-", Asked::Whole),
            ("bytes=+1-2", Asked::Whole),
            ("lines=1-2", Asked::Whole),
        ] {
            assert_eq!(Asked::of(header, 100), expected, "{header}");
        }
        assert_eq!(Asked::of("bytes=0-", 0), Asked::Outside);
    }
}
