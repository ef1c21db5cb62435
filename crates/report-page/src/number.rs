//! Numbers as pages show them: with a minus sign (U+2212), which is as wide as the digits, instead of a hyphen.

/// Shown for a missing number.
pub(crate) const NONE: &str = "–";

/// A number with this many decimals.
pub fn decimal(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    if is_zero(&text) {
        return text.replace('-', "");
    }
    text.replace('-', "\u{2212}")
}

/// A number with its sign, unless it rounds to zero.
pub fn signed(number: f64, decimals: usize) -> String {
    let text = format!("{number:+.decimals$}");
    if is_zero(&text) {
        return decimal(0.0, decimals);
    }
    text.replace('-', "\u{2212}")
}

/// A number, or a dash without one.
pub fn optional(number: Option<f64>, decimals: usize) -> String {
    number.map_or_else(|| NONE.to_owned(), |number| decimal(number, decimals))
}

/// A share in percent, or a dash without one.
pub fn percent(share: Option<f64>, decimals: usize) -> String {
    optional(share.map(|share| 100.0 * share), decimals)
}

/// True for zeros; false for infinite numbers and NaN.
fn is_zero(text: &str) -> bool {
    text.bytes()
        .all(|letter| matches!(letter, b'0' | b'.' | b'+' | b'-'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_numbers_have_a_minus_sign_and_zero_has_none() {
        assert_eq!(decimal(-1.25, 1), "−1.2");
        assert_eq!(decimal(-0.04, 1), "0.0");
        assert_eq!(
            [-1.5, 1.5, -0.04].map(|number| signed(number, 1)),
            ["−1.5", "+1.5", "0.0"]
        );
        assert_eq!([optional(None, 2), percent(Some(0.126), 1)], ["–", "12.6"]);
    }
}
