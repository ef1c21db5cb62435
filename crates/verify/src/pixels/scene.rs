//! The scene of the whole image: all images of a camera that stands still show the same one, whether or not the aircraft is visible.
//!
//! Each image is reduced to the mean brightness of some blocks, without those at the aircraft, and to the difference between neighbouring
//! pixels. An image belongs to a group if it differs by little from the latest one in it, so that light and clouds may change over time.
//! The limit follows the usual change from one image of the view to the next. A few images amid a group of many are wrong; if there are
//! more of them, or if they are at either end, nothing in the view says which group is the right one, so the view is named with both.
//!
//! Noise is recognised without a comparison: its neighbouring pixels differ as much as distant ones.

use std::ops::RangeInclusive;

use super::sight::{BORDER_OF_SIDE, DecodedPicture};
use crate::faults::{Faults, ROWS_LISTED};
use dataset::numbers::spread::median_of;
use dataset::tables::pixel_box::PixelBox;

const COLUMNS: usize = 12;
const ROWS: usize = 8;
const BLOCKS: usize = COLUMNS * ROWS;
/// Large images are read at every third pixel of every third row, small ones more densely.
const MAX_STEP: usize = 3;
const MIN_ROWS_READ: usize = 64;
/// An image is compared if the aircraft leaves this many blocks. Any two images then have a quarter of all blocks in common.
const MIN_BLOCKS: usize = BLOCKS * 5 / 8;

/// Images of the same scene differ by at most this many times the usual change to a neighbour, within bounds in grey levels. In 72 recorded
/// views of 64x64 to 1920x1280 pixels, 1/8 to 30 a second, with drifting clouds, the change never exceeded 1.0.
const TIMES_USUAL: f64 = 5.0;
const MIN_LIMIT: f64 = 3.0;
const MAX_LIMIT: f64 = 15.0;
/// The usual change is that to the most similar of this many images before and after.
const NEIGHBOURS: usize = 2;
/// Maximum number of groups: further images join the nearest.
const MAX_GROUPS: usize = 8;

/// Noise: neighbouring pixels differ by this many grey levels ...
const MIN_NOISE: f64 = 20.0;
/// ... and by this part of the standard deviation of all pixels. It is 1.1 in white noise and 0.01 in rendered scenes.
const NOISE_PART: f64 = 0.5;

/// An image as it is kept for comparison.
#[derive(Debug, Clone)]
pub(super) struct CoarsePicture {
    /// Mean brightness of the blocks in grey levels; NaN where the aircraft is.
    blocks: [f32; BLOCKS],
    /// Mean difference between neighbouring pixels, grey levels.
    roughness: f64,
    /// Standard deviation of all pixels, grey levels.
    spread: f64,
}

impl CoarsePicture {
    /// Reduces an image. `aircraft`: the ground-truth boxes.
    pub(super) fn of(picture: &DecodedPicture, aircraft: &[PixelBox]) -> Self {
        let [width_px, height_px] = picture.size_px().map(|size_px| size_px as usize);
        let (mut sums, mut counts) = ([0.0; BLOCKS], [0.0; BLOCKS]);
        let (mut change, mut squares) = (0.0, 0.0);
        let step = (height_px / MIN_ROWS_READ).clamp(1, MAX_STEP);
        for ([x, y], [left, right]) in picture.neighbours(step) {
            let block = y * ROWS / height_px * COLUMNS + x * COLUMNS / width_px;
            sums[block] += (left + right) / 2.0;
            counts[block] += 1.0;
            change += (left - right).abs();
            squares += (left * left + right * right) / 2.0;
        }
        let count = counts.iter().sum::<f64>().max(1.0);
        let mean = sums.iter().sum::<f64>() / count;
        let mut blocks = [f32::NAN; BLOCKS];
        for (block, value) in blocks.iter_mut().enumerate() {
            let has_aircraft = aircraft
                .iter()
                .any(|place| is_near(block, place, width_px as f64, height_px as f64));
            if !has_aircraft && counts[block] > 0.0 {
                *value = (sums[block] / counts[block]) as f32;
            }
        }
        Self {
            blocks,
            roughness: change / count,
            spread: (squares / count - mean * mean).max(0.0).sqrt(),
        }
    }

    fn is_noise(&self) -> bool {
        self.roughness >= MIN_NOISE && self.roughness >= NOISE_PART * self.spread
    }

    fn is_comparable(&self) -> bool {
        self.blocks.iter().filter(|block| !block.is_nan()).count() >= MIN_BLOCKS
    }

    /// Difference of two comparable images, grey levels.
    fn difference(&self, other: &Self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for (one, other) in self.blocks.iter().zip(&other.blocks) {
            let difference = f64::from((one - other).abs());
            if !difference.is_nan() {
                sum += difference;
                count += 1.0;
            }
        }
        sum / count + (self.roughness - other.roughness).abs()
    }
}

/// True if a block touches a box with its margin.
fn is_near(block: usize, place: &PixelBox, width_px: f64, height_px: f64) -> bool {
    let [left, top] = [
        (block % COLUMNS) as f64 * width_px / COLUMNS as f64,
        (block / COLUMNS) as f64 * height_px / ROWS as f64,
    ];
    let (right, bottom) = (
        left + width_px / COLUMNS as f64,
        top + height_px / ROWS as f64,
    );
    let margin_px = BORDER_OF_SIDE * place.width_px.max(place.height_px);
    let grown = PixelBox {
        width_px: place.width_px + 2.0 * margin_px,
        height_px: place.height_px + 2.0 * margin_px,
        ..*place
    };
    PixelBox::from_edges(left, top, right, bottom).intersection(&grown) > 0.0
}

/// Reports noise, and the images that cannot be of the same scene as the others.
pub(super) fn judge(pictures: &[CoarsePicture], file: &str, view: &str, faults: &mut Faults) {
    let mut compared = Vec::new();
    for (row, picture) in pictures.iter().enumerate() {
        if picture.is_noise() {
            let message = format!(
                "neighbouring pixels differ by {:.0} grey levels, expected less than {MIN_NOISE:.0}",
                picture.roughness
            );
            faults.view_row(view, file, row, "noise", message);
        } else if picture.is_comparable() {
            compared.push((row, picture));
        }
    }
    let Some(limit) = limit(&compared) else {
        return;
    };
    let mut groups = groups(&compared, limit);
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let [usual, others @ ..] = groups.as_slice() else {
        return;
    };
    let outsiders: usize = others.iter().map(Vec::len).sum();
    if outsiders == 0 {
        return;
    }
    let amid = |row: &usize| usual.first() < Some(row) && Some(row) < usual.last();
    let is_clear = outsiders <= ROWS_LISTED
        && 2 * outsiders <= usual.len()
        && others.iter().flatten().all(amid);
    if !is_clear {
        faults.view(file, view, in_groups(pictures, usual, others, limit));
        return;
    }
    let mut rows: Vec<usize> = others.iter().flatten().copied().collect();
    rows.sort_unstable();
    for row in rows {
        let difference = between(pictures, usual, row);
        let message = format!(
            "it differs by {difference:.1} grey levels from the others of the view, expected at most {limit:.1}"
        );
        faults.view_row(view, file, row, "another scene", message);
    }
}

/// Maximum difference between images of the same scene; `None` with fewer than two.
fn limit(pictures: &[(usize, &CoarsePicture)]) -> Option<f64> {
    let changes = (0..pictures.len()).filter_map(|at| {
        let near = at.saturating_sub(NEIGHBOURS)..(at + NEIGHBOURS + 1).min(pictures.len());
        near.filter(|other| *other != at)
            .map(|other| pictures[at].1.difference(pictures[other].1))
            .min_by(f64::total_cmp)
    });
    // The lower median: with two wrong images of four it is between the two right ones.
    let usual = -median_of(changes.map(|change| -change))?;
    Some((TIMES_USUAL * usual).clamp(MIN_LIMIT, MAX_LIMIT))
}

/// The rows of images that belong together.
fn groups(pictures: &[(usize, &CoarsePicture)], limit: f64) -> Vec<Vec<usize>> {
    /// The group's latest image and all rows.
    struct Group<'a>(&'a CoarsePicture, Vec<usize>);
    let mut groups: Vec<Group> = Vec::new();
    for &(row, picture) in pictures {
        let is_full = groups.len() == MAX_GROUPS;
        let differences = groups
            .iter_mut()
            .map(|group| (picture.difference(group.0), group));
        match differences.min_by(|(one, _), (other, _)| one.total_cmp(other)) {
            Some((difference, group)) if difference <= limit || is_full => {
                group.0 = picture;
                group.1.push(row);
            }
            _ => groups.push(Group(picture, vec![row])),
        }
    }
    groups.into_iter().map(|Group(_, rows)| rows).collect()
}

/// Difference between an image and the group's nearest one in time.
fn between(pictures: &[CoarsePicture], group: &[usize], row: usize) -> f64 {
    let nearest = group.iter().min_by_key(|other| other.abs_diff(row));
    nearest.map_or(0.0, |other| pictures[row].difference(&pictures[*other]))
}

/// The message about a view whose images are of several scenes.
fn in_groups(
    pictures: &[CoarsePicture],
    usual: &[usize],
    others: &[Vec<usize>],
    limit: f64,
) -> String {
    let rows: Vec<usize> = others.iter().flatten().copied().collect();
    let differences = rows.iter().map(|row| between(pictures, usual, *row));
    let most = differences.fold(0.0, f64::max);
    let another = if others.len() == 1 {
        "another"
    } else {
        "others"
    };
    format!(
        "its images are of different scenes, up to {most:.1} grey levels apart, expected at most {limit:.1}: one in {}, {another} in {}",
        in_words(usual),
        in_words(&rows)
    )
}

/// Rows as ranges, shortened to the first few.
fn in_words(rows: &[usize]) -> String {
    let mut sorted = rows.to_vec();
    sorted.sort_unstable();
    let mut ranges: Vec<RangeInclusive<usize>> = Vec::new();
    for row in sorted {
        match ranges.last_mut() {
            Some(range) if range.end() + 1 == row => *range = *range.start()..=row,
            _ => ranges.push(row..=row),
        }
    }
    let listed = ranges.iter().take(ROWS_LISTED).map(|range| {
        if range.start() == range.end() {
            range.start().to_string()
        } else {
            format!("{} to {}", range.start(), range.end())
        }
    });
    let listed = listed.collect::<Vec<_>>().join(", ");
    let more = ranges.iter().skip(ROWS_LISTED);
    let rows = if rows.len() == 1 { "row" } else { "rows" };
    match more.map(|range| range.clone().count()).sum::<usize>() {
        0 => format!("{rows} {listed}"),
        more => format!("{rows} {listed} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An evenly bright image with a roughness, grey levels.
    fn even(grey: f32, roughness: f64) -> CoarsePicture {
        CoarsePicture {
            blocks: [grey; BLOCKS],
            roughness,
            spread: 20.0,
        }
    }

    fn found(pictures: &[CoarsePicture]) -> Vec<String> {
        let mut faults = Faults::of_scenario("0001");
        judge(pictures, "views/left.mp4", "left", &mut faults);
        let findings = faults.into_findings().into_iter();
        findings.map(|finding| finding.to_string()).collect()
    }

    /// A view with images whose brightness differs.
    fn view(count: usize, grey_of: impl Fn(usize) -> f32) -> Vec<CoarsePicture> {
        (0..count).map(|row| even(grey_of(row), 0.1)).collect()
    }

    #[test]
    fn a_picture_of_another_scene_is_named_and_changing_light_is_no_fault() {
        let one = found(&view(9, |row| if row == 4 { 0.0 } else { 120.0 }));
        assert_eq!(one.len(), 1, "{one:?}");
        assert!(one[0].contains("row 4 view left: another scene"), "{one:?}");
        assert_eq!(found(&view(40, |row| 60.0 + 3.0 * row as f32)), [""; 0]);
        // A cloud that passes.
        assert_eq!(found(&view(40, |row| 100.0 + (row as f32).sin())), [""; 0]);
    }

    #[test]
    fn noise_is_named_in_every_picture_and_the_others_are_not() {
        let noise = || even(127.0, 62.0);
        let all = found(&[(); 5].map(|()| noise()));
        assert!(all[0].contains("row 0 view left: noise"), "{all:?}");
        assert!(all.iter().any(|one| one.contains("2 more rows")), "{all:?}");
        let mut mostly = [(); 5].map(|()| noise());
        mostly[2] = even(127.0, 0.1);
        let mostly = found(&mostly);
        assert!(
            !mostly.iter().any(|one| one.contains("row 2")),
            "{mostly:?}"
        );
    }

    #[test]
    fn where_neither_group_is_proven_the_view_is_named_with_both() {
        for (grey_of, rows) in [
            (
                (|row| if row < 60 { 0.0 } else { 90.0 }) as fn(usize) -> f32,
                "one in rows 0 to 59, another in rows 60 to 99",
            ),
            (
                |row| if row == 0 { 101.0 } else { 90.0 },
                "one in rows 1 to 99, another in row 0",
            ),
            (
                |row| if row % 3 == 0 { 90.0 } else { 101.0 },
                "one in rows 1 to 2, 4 to 5, 7 to 8 and 60 more, another in rows 0, 3, 6 and 31 more",
            ),
        ] {
            let found = found(&view(100, grey_of));
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(
                found[0].contains("left.mp4 view left: its images"),
                "{found:?}"
            );
            assert!(found[0].contains(rows), "{found:?}");
        }
        let half = found(&view(4, |row| if row < 2 { 0.0 } else { 90.0 }));
        assert_eq!(half.len(), 1, "{half:?}");
    }

    #[test]
    fn blocks_at_the_aircraft_are_not_compared() {
        let mut approaching = view(9, |row| if row == 4 { 20.0 } else { 120.0 });
        approaching[4].blocks[BLOCKS / 2..].fill(f32::NAN);
        assert_eq!(found(&approaching), [""; 0]);
        let place = PixelBox {
            cx_px: 50.0,
            cy_px: 50.0,
            width_px: 20.0,
            height_px: 8.0,
        };
        let dark = [0; 3 * 120 * 80];
        let picture = DecodedPicture::new(&dark, 120, 80);
        let coarse = CoarsePicture::of(&picture, &[place]);
        let hidden = coarse.blocks.iter().filter(|block| block.is_nan());
        assert_eq!(hidden.count(), 4 * 4);
    }
}
