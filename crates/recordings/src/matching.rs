//! Boxes matched with the arrivals that they show.
//!
//! A box near one projected arrival shows it. Near two, or on a track of which less than most is near an arrival, it is doubtful, and shows
//! none: aircraft without a transponder have no track, and a wrong label is worse than a missing one.

use std::collections::BTreeMap;

use dataset::numbers::spread::median_of;

use crate::alignment::Alignment;
use crate::sightings::Sighting;

/// Least share of the boxes of a source's track that must be near the arrival that it shows.
const MOST: f64 = 0.5;
/// Share of those boxes that another arrival must be near for the track to be doubtful.
const ALSO: f64 = 0.5;

/// The arrivals that a camera's boxes show.
#[derive(Debug, Clone, Default)]
pub(crate) struct Matched {
    /// Number of the arrival, box by box.
    pub(crate) flights: Vec<Option<usize>>,
    /// Boxes that may show two arrivals, or are on a track that does not follow one.
    pub(crate) doubtful: usize,
}

/// Matches a camera's boxes.
pub(crate) fn matched(alignment: &Alignment<'_>, camera: usize, seen: &[Sighting]) -> Matched {
    let seen_through = alignment.cameras[camera].camera();
    let near: Vec<Vec<(usize, f64)>> = (seen.iter())
        .map(|seen| alignment.near(camera, &seen_through, seen, 0.0))
        .collect();
    let mut groups: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (index, seen) in seen.iter().enumerate() {
        if let Some(track) = seen.track {
            groups.entry(track).or_default().push(index);
        }
    }
    let of_track: BTreeMap<u32, Option<usize>> = (groups.into_iter())
        .map(|(track, boxes)| (track, followed(&boxes, &near)))
        .collect();
    let mut found = Matched::default();
    for (seen, near) in seen.iter().zip(&near) {
        let flight = match seen.track.map(|track| of_track[&track]) {
            Some(flight) => flight.filter(|flight| near.iter().any(|(other, _)| other == flight)),
            None => near
                .first()
                .map(|(flight, _)| *flight)
                .filter(|_| near.len() == 1),
        };
        found.doubtful += usize::from(flight.is_none() && !near.is_empty());
        found.flights.push(flight);
    }
    keep_nearest(seen, &near, &mut found.flights);
    found
}

/// Median distance of matched boxes from the projected tracks of some arrivals, pixels.
pub(crate) fn residual_px(
    alignment: &Alignment<'_>,
    camera: usize,
    seen: &[Sighting],
    found: &Matched,
    is_meant: impl Fn(usize) -> bool,
) -> Option<f64> {
    let seen_through = alignment.cameras[camera].camera();
    let shown = seen.iter().zip(&found.flights);
    median_of(shown.filter_map(|(seen, flight)| {
        let flight = flight.filter(|flight| is_meant(*flight))?;
        let residual = alignment.residual(camera, &seen_through, flight, seen)?;
        Some(residual.off_px.length())
    }))
}

/// The arrival that most boxes of a track are near, if no other is.
fn followed(boxes: &[usize], near: &[Vec<(usize, f64)>]) -> Option<usize> {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    for (flight, _) in boxes.iter().flat_map(|index| &near[*index]) {
        *counts.entry(*flight).or_default() += 1;
    }
    let mut counts: Vec<(usize, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let (flight, count) = *counts.first()?;
    let is_of_most = count as f64 >= MOST * boxes.len() as f64;
    let is_alone = counts
        .get(1)
        .is_none_or(|(_, also)| (*also as f64) < ALSO * count as f64);
    (is_of_most && is_alone).then_some(flight)
}

/// An arrival has one box in an image: the nearest one.
fn keep_nearest(seen: &[Sighting], near: &[Vec<(usize, f64)>], flights: &mut [Option<usize>]) {
    let mut from = 0;
    while from < seen.len() {
        let to = from + seen[from..].partition_point(|of| of.time_s <= seen[from].time_s);
        let mut best: BTreeMap<usize, (f64, usize)> = BTreeMap::new();
        for index in from..to {
            let Some(flight) = flights[index] else {
                continue;
            };
            let of_flight = near[index].iter().find(|(other, _)| *other == flight);
            let squared = of_flight.map_or(f64::INFINITY, |(_, squared)| *squared);
            let kept = best.entry(flight).or_insert((squared, index));
            if squared < kept.0 {
                flights[kept.1] = None;
                *kept = (squared, index);
            } else if kept.1 != index {
                flights[index] = None;
            }
        }
        from = to;
    }
}
