//! Numbers with as many digits as a screen can show: a table of 7,700 ticks has a third of the size.

/// The number, rounded to thousandths.
pub(crate) fn thousandths(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// A column of such numbers.
pub(crate) fn column(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    values.into_iter().map(thousandths).collect()
}
