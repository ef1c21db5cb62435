//! Division of the rows of a batch into parts that cores share.
//!
//! It depends on the batch alone, so that the same seed gives the same weights on any number of cores.

use std::ops::Range;

/// Rows that are worked on together: what they need stays in a core's cache.
const MAX_ROWS: usize = 256;
/// Parts at least, for two cores.
const MIN_PARTS: usize = 2;

/// The parts of a batch, in their order: two, and more if it has more than 512 rows.
pub(crate) fn row_parts(rows: usize) -> Vec<Range<usize>> {
    let parts = rows.div_ceil(MAX_ROWS).max(MIN_PARTS).min(rows);
    let starts = (0..parts).map(|part| rows * part / parts);
    starts
        .enumerate()
        .map(|(part, start)| start..rows * (part + 1) / parts)
        .collect()
}
