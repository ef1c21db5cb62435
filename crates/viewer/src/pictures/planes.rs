//! Reduced planes of an image for the screen: the whole image with fewer columns, or a part of it. A page has a few hundred columns for
//! 1920.
//!
//! An image is three planes, one after the other without gaps: brightness, then two of colour with half the columns and rows.

/// Largest number of columns that become one.
pub(crate) const MAX_EVERY: u32 = 16;

/// An image part; all four numbers are even: two by two pixels share their colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) left: u32,
    pub(crate) top: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl Part {
    /// Parses four numbers separated by commas; `None` if the part is not inside an image with this size.
    pub(crate) fn parse(text: &str, [picture_width, picture_height]: [u32; 2]) -> Option<Self> {
        let numbers: Option<Vec<u32>> = text.split(',').map(|word| word.parse().ok()).collect();
        let [left, top, width, height] = numbers?.try_into().ok()?;
        let is_inside = |from: u32, length: u32, side: u32| {
            length > 0 && from.checked_add(length).is_some_and(|end| end <= side)
        };
        let is_even = [left, top, width, height]
            .iter()
            .all(|number| number % 2 == 0);
        let is_part = is_even
            && is_inside(left, width, picture_width)
            && is_inside(top, height, picture_height);
        is_part.then_some(Self {
            left,
            top,
            width,
            height,
        })
    }
}

/// Calls `f` with each plane and the divisor of its sides.
fn each(planes: &[u8], size: [u32; 2], mut f: impl FnMut(&[u8], usize, usize)) {
    let mut rest = planes;
    for shared in [1, 2, 2] {
        let columns = size[0] as usize / shared;
        let (plane, others) = rest.split_at(columns * (size[1] as usize / shared));
        f(plane, columns, shared);
        rest = others;
    }
}

pub(crate) fn cut(planes: &[u8], size: [u32; 2], part: Part, to: &mut Vec<u8>) {
    each(planes, size, |plane, columns, shared| {
        let [left, top, width, height] =
            [part.left, part.top, part.width, part.height].map(|side| side as usize / shared);
        for row in plane.chunks_exact(columns).skip(top).take(height) {
            to.extend_from_slice(&row[left..left + width]);
        }
    });
}

/// Appends the means of squares of this many columns and rows, and returns how many there are: even numbers, for which the last ones are
/// repeated.
pub(crate) fn reduce(planes: &[u8], size: [u32; 2], every: u32, to: &mut Vec<u8>) -> [u32; 2] {
    if every == 1 {
        to.extend_from_slice(planes);
        return size;
    }
    let reduced = size.map(|side| side.div_ceil(every).next_multiple_of(2));
    let every = every as usize;
    each(planes, size, |plane, columns, shared| {
        let rows = plane.len() / columns;
        let [to_columns, to_rows] = reduced.map(|side| side as usize / shared);
        let mut sums = vec![0_u32; columns];
        for row in 0..to_rows {
            let from = (row * every).min(rows - 1);
            let until = (from + every).min(rows);
            sums.fill(0);
            for row in plane[from * columns..until * columns].chunks_exact(columns) {
                for (sum, &value) in sums.iter_mut().zip(row) {
                    *sum += u32::from(value);
                }
            }
            let begun = to.len();
            for square in sums.chunks(every) {
                let count = (square.len() * (until - from)) as u32;
                to.push(((square.iter().sum::<u32>() + count / 2) / count) as u8);
            }
            to.truncate(begun + to_columns);
            while to.len() < begun + to_columns {
                to.push(to[to.len() - 1]);
            }
        }
    });
    reduced
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight columns and four rows: brightness that grows to the right, and one colour.
    fn picture() -> Vec<u8> {
        let brightness = (0..4).flat_map(|_| (0..8).map(|column| column * 10));
        brightness.chain([100; 8]).chain([200; 8]).collect()
    }

    #[test]
    fn a_part_is_cut_out_of_all_planes() {
        let mut cut_out = Vec::new();
        let part = Part::parse("2,2,4,2", [8, 4]).unwrap();
        cut(&picture(), [8, 4], part, &mut cut_out);
        let row = [20, 30, 40, 50];
        assert_eq!(cut_out, [&row[..], &row, &[100, 100], &[200, 200]].concat());
    }

    #[test]
    fn parts_that_are_odd_empty_or_outside_are_none() {
        for text in [
            "1,2,4,2",
            "2,2,0,2",
            "6,2,4,2",
            "2,2,4",
            "2,2,4,4294967294",
            "a,2,4,2",
        ] {
            assert_eq!(Part::parse(text, [8, 4]), None, "{text}");
        }
    }

    #[test]
    fn a_reduced_picture_has_means_and_even_sides() {
        let mut reduced = Vec::new();
        assert_eq!(reduce(&picture(), [8, 4], 3, &mut reduced), [4, 2]);
        // Columns 0 to 2, 3 to 5, 6 and 7, and once more.
        let row = [10, 40, 65, 65];
        assert_eq!(reduced, [&row[..], &row, &[100, 100], &[200, 200]].concat());
        let mut same = Vec::new();
        assert_eq!(reduce(&picture(), [8, 4], 1, &mut same), [8, 4]);
        assert_eq!(same, picture());
    }
}
