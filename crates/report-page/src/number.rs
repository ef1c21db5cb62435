//! Numbers as pages show them: with a minus sign (U+2212), which is as wide as the digits, instead of a hyphen.

/// A number with this many decimals.
pub fn decimal(number: f64, decimals: usize) -> String {
    let text = format!("{number:.decimals$}");
    if is_zero(&text) {
        return text.replace('-', "");
    }
    text.replace('-', "\u{2212}")
}

/// The same with its sign, unless it rounds to zero.
pub fn signed(number: f64, decimals: usize) -> String {
    let text = format!("{number:+.decimals$}");
    if is_zero(&text) {
        return decimal(0.0, decimals);
    }
    text.replace('-', "\u{2212}")
}

/// True for a text of zeros; infinite numbers and NaN are none.
fn is_zero(text: &str) -> bool {
    text.bytes()
        .all(|letter| matches!(letter, b'0' | b'.' | b'+' | b'-'))
}

/// A drawing whose texts begin with minus signs where they began with hyphens.
pub(crate) fn with_minus_signs(svg: &str) -> String {
    svg.replace(">\n-", ">\n\u{2212}")
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
    }
}
