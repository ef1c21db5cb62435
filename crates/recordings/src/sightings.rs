//! Tables of boxes: the images of a camera with their times, and the boxes in them.
//!
//! CSV has named columns: `time` (UTC as text or seconds since 1970) or `frame` (the number of the image, from 1), and `left, top, width,
//! height`, `cx, cy, width, height` or `left, top, right, bottom` in pixels, with or without `_px`; `score`, `track`, `camera` if there are
//! any. A row without a box is an image without an aircraft. MOT has no names: `frame, id, left, top, width, height, score`, with
//! pixel 1 as the first one.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};

use csv::{ReaderBuilder, StringRecord};
use dataset::files::outside_file::{self, FileKind};
use dataset::numbers::limits;
use dataset::tables::pixel_box::PixelBox;
use generator::tracks::{separator, utc_s};
use glam::DVec2;

use crate::description::{BoxFormat, CameraDescription, UTC_S};
use crate::error::{Error, Result};

/// A table of boxes is read row by row.
const BOXES: FileKind = FileKind::new("table of boxes", 1 << 40);
/// Maximum number of rows: a week of one camera at 10 per second.
const MAX_ROWS: usize = 6_000_000;
/// A box may reach over the edge of the image by this part of the image's side, as detectors extrapolate.
const MAX_OUTSIDE: f64 = 0.1;
/// Coordinates of normalised boxes are up to this, with what detectors extrapolate.
const MAX_NORMALISED: f64 = 1.5;
/// Boxes of images of half the size reach up to this part of the stated one.
const MAX_REACH_OF_SMALLER: f64 = 0.55;
/// After this time without a box, a track of the source goes on as a new one, seconds.
const MAX_TRACK_GAP_S: f64 = 20.0;
/// Edges of MOT count from 1, at the corner of the first pixel, whose centre is 0 here.
const MOT_ORIGIN_PX: f64 = 1.5;

/// A box with what its source says about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sighting {
    /// UTC by the camera's clock, seconds.
    pub(crate) time_s: f64,
    pub(crate) pixel_box: PixelBox,
    pub(crate) score: f64,
    /// Number of the track in the source's order; `None` without tracks.
    pub(crate) track: Option<u32>,
}

impl Sighting {
    pub(crate) fn place_px(&self) -> DVec2 {
        DVec2::new(self.pixel_box.cx_px, self.pixel_box.cy_px)
    }
}

/// A camera's images and boxes, both by time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sightings {
    /// Times of all images, seconds, each once.
    pub(crate) images_s: Vec<f64>,
    pub(crate) boxes: Vec<Sighting>,
    /// Largest coordinates of boxes, pixels.
    pub(crate) reach_px: DVec2,
    /// Images of its videos that are damaged and were left out.
    pub(crate) damaged_images: u64,
}

/// The numbers of a row's columns.
struct Columns {
    time: Option<usize>,
    frame: Option<usize>,
    /// First two numbers: corner, or centre.
    place: [usize; 2],
    /// Last two numbers: size, or the other corner.
    size: [usize; 2],
    is_centre: bool,
    is_corner: bool,
    origin_px: f64,
    score: Option<usize>,
    track: Option<usize>,
    camera: Option<usize>,
}

impl Columns {
    fn mot() -> Self {
        Self {
            time: None,
            frame: Some(0),
            place: [2, 3],
            size: [4, 5],
            is_centre: false,
            is_corner: false,
            origin_px: MOT_ORIGIN_PX,
            score: Some(6),
            track: Some(1),
            camera: None,
        }
    }

    fn of(header: &StringRecord) -> std::result::Result<Self, String> {
        let column = |names: &[&str]| {
            header.iter().position(|found| {
                let found = found.trim().to_lowercase();
                names.contains(&found.trim_end_matches("_px"))
            })
        };
        let pair = |first: &[&str], second: &[&str]| Some([column(first)?, column(second)?]);
        let corner = pair(&["left", "x1", "x"], &["top", "y1", "y"]);
        let centre = pair(&["cx"], &["cy"]);
        let size = pair(&["width", "w"], &["height", "h"]);
        let other_corner = pair(&["right", "x2"], &["bottom", "y2"]);
        let found: Vec<&str> = header.iter().collect();
        let lacks = |what: &str| format!("lacks {what}; its columns are {}", found.join(", "));
        let (place, size, is_corner) = match (centre.or(corner), size, other_corner) {
            (Some(place), Some(size), _) => (place, size, false),
            (Some(place), None, Some(other)) if centre.is_none() => (place, other, true),
            _ => {
                return Err(lacks(
                    "a box: `left, top, width, height`, `cx, cy, width, height` or `left, top, right, bottom`",
                ));
            }
        };
        let time = column(&["time", "time_utc", "utc", "time_s", "timestamp"]);
        let frame = column(&["frame", "image"]);
        if time.is_none() && frame.is_none() {
            return Err(lacks("`time` or `frame`"));
        }
        Ok(Self {
            time,
            frame,
            place,
            size,
            is_centre: centre.is_some(),
            is_corner,
            origin_px: 0.0,
            score: column(&["score", "confidence", "conf"]),
            track: column(&["track", "track_id", "id"]),
            camera: column(&["camera", "view"]),
        })
    }
}

impl Sightings {
    /// Reads a camera's table.
    ///
    /// # Errors
    /// Name the file, the line, what was found and what was expected.
    pub(crate) fn read(camera: &CameraDescription) -> Result<Self> {
        let path = &camera.boxes;
        let mut file = BufReader::new(outside_file::open(path, BOXES)?);
        let head = file.fill_buf().map_err(dataset::Error::io("read", path))?;
        let separator = separator(head);
        let is_csv = camera.format == BoxFormat::Csv;
        let mut reader = ReaderBuilder::new()
            .has_headers(is_csv)
            .flexible(!is_csv)
            .delimiter(separator)
            .from_reader(file);
        let columns = if is_csv {
            let header = reader
                .headers()
                .map_err(|error| Error::line(path, 1, error))?;
            Columns::of(header).map_err(|why| Error::line(path, 1, why))?
        } else {
            Columns::mot()
        };
        let mut found = Self::default();
        let mut tracks: BTreeMap<String, u32> = BTreeMap::new();
        let mut row = StringRecord::new();
        let mut rows = 0;
        loop {
            let line = reader.position().line();
            let is_row = reader
                .read_record(&mut row)
                .map_err(|error| Error::line(path, line, error))?;
            if !is_row {
                break;
            }
            rows += 1;
            if rows > MAX_ROWS {
                let why =
                    format!("is row {rows}, expected at most {MAX_ROWS}; divide the recording");
                return Err(Error::line(path, line, why));
            }
            let line = row.position().map_or(line, csv::Position::line);
            found
                .add(camera, &columns, &row, &mut tracks)
                .map_err(|why| Error::line(path, line, why))?;
        }
        if found.boxes.is_empty() {
            return Err(dataset::Error::corpus(path, "has no box of this camera").into());
        }
        if found.reach_px.max_element() <= MAX_NORMALISED {
            let fault = "has all boxes within a pixel of the corner: they seem to be parts of the image; multiply them by its width and height";
            return Err(dataset::Error::corpus(path, fault).into());
        }
        found.boxes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        found.separate_tracks();
        found.images_s.sort_by(f64::total_cmp);
        found.images_s.dedup();
        Ok(found)
    }

    fn add(
        &mut self,
        camera: &CameraDescription,
        columns: &Columns,
        row: &StringRecord,
        tracks: &mut BTreeMap<String, u32>,
    ) -> std::result::Result<(), String> {
        let text = |column: usize| row.get(column).unwrap_or_default().trim();
        if columns
            .camera
            .is_some_and(|column| text(column) != camera.name)
        {
            return Ok(());
        }
        let number = |column: usize| -> std::result::Result<f64, String> {
            let text = text(column);
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.ok_or_else(|| format!("{text:?} is not a number"))
        };
        let time_s = match (columns.time, columns.frame, camera.numbered) {
            (Some(column), _, _) => utc_s(text(column))?,
            (None, Some(column), Some((first_s, rate))) => first_s + (number(column)? - 1.0) / rate,
            _ => {
                return Err(
                    "numbers its image; name `first_image` and `images_per_s` of the camera".into(),
                );
            }
        };
        if let Err(found) = UTC_S.check(time_s) {
            return Err(format!(
                "its time {found}; for times since the start of the recording, number the images as `frame`"
            ));
        }
        let time_s = time_s + camera.to_utc_s;
        self.images_s.push(time_s);
        if columns
            .place
            .iter()
            .chain(&columns.size)
            .all(|column| text(*column).is_empty())
        {
            return Ok(());
        }
        let [x, y] = [number(columns.place[0])?, number(columns.place[1])?];
        let [a, b] = [number(columns.size[0])?, number(columns.size[1])?];
        let [x, y] = [x - columns.origin_px, y - columns.origin_px];
        let [width_px, height_px] = if columns.is_corner {
            [a - x, b - y]
        } else {
            [a, b]
        };
        let pixel_box = if columns.is_centre {
            PixelBox {
                cx_px: x,
                cy_px: y,
                width_px,
                height_px,
            }
        } else {
            PixelBox::from_edges(x, y, x + width_px, y + height_px)
        };
        if !(width_px > 0.0 && height_px > 0.0) {
            return Err(format!(
                "its box is {width_px} x {height_px} px, expected more than 0"
            ));
        }
        let [left, top, right, bottom] = pixel_box.edges();
        let [image_width, image_height] =
            [camera.entry.width_px, camera.entry.height_px].map(f64::from);
        let (slack_x, slack_y) = (MAX_OUTSIDE * image_width, MAX_OUTSIDE * image_height);
        if left < -slack_x
            || top < -slack_y
            || right > image_width + slack_x
            || bottom > image_height + slack_y
        {
            return Err(format!(
                "its box from ({left:.0}, {top:.0}) to ({right:.0}, {bottom:.0}) is not in an image of {image_width} x {image_height} px; are \
                 the boxes of images of another resolution?"
            ));
        }
        let score = match columns.score {
            Some(column) if !text(column).is_empty() => number(column)?,
            _ => 1.0,
        };
        if let Err(found) = limits::RATIO.check(score) {
            return Err(format!("its score {found}; are the scores percentages?"));
        }
        let track = columns
            .track
            .map(text)
            .filter(|name| !name.is_empty() && *name != "-1");
        let track = track.map(|name| {
            let next = tracks.len() as u32;
            *tracks.entry(name.to_owned()).or_insert(next)
        });
        self.reach_px = self.reach_px.max(DVec2::new(right, bottom));
        self.boxes.push(Sighting {
            time_s,
            pixel_box,
            score,
            track,
        });
        Ok(())
    }

    /// Separates the source's tracks where one number stands for several aircraft: two boxes of an image are not one aircraft, and after a
    /// gap it may be another one.
    fn separate_tracks(&mut self) {
        let pairs = self
            .boxes
            .iter()
            .map(|seen| (seen.time_s.to_bits(), seen.track));
        let mut images = BTreeSet::new();
        let mixed: BTreeSet<Option<u32>> = pairs
            .filter(|pair| !images.insert(*pair))
            .map(|(_, track)| track)
            .collect();
        // Last time and new number of each track.
        let mut known: BTreeMap<u32, (f64, u32)> = BTreeMap::new();
        let mut next = 0..;
        for seen in &mut self.boxes {
            let Some(track) = seen.track.filter(|track| !mixed.contains(&Some(*track))) else {
                seen.track = None;
                continue;
            };
            let before = known.get(&track).copied();
            let same = before.filter(|(last_s, _)| seen.time_s - last_s <= MAX_TRACK_GAP_S);
            let number = same.map(|(_, number)| number).or_else(|| next.next());
            seen.track = number;
            known.extend(number.map(|number| (track, (seen.time_s, number))));
        }
    }

    /// A hint, if the boxes seem to be of smaller images than stated.
    pub(crate) fn smaller_images(&self, camera: &CameraDescription) -> &'static str {
        let stated = DVec2::new(camera.entry.width_px.into(), camera.entry.height_px.into());
        if (self.reach_px / stated).max_element() < MAX_REACH_OF_SMALLER {
            "; its boxes are all in the upper left part of its images: are they of images of another resolution?"
        } else {
            ""
        }
    }

    /// Median time between images, seconds; 1 of a single image.
    pub(crate) fn period_s(&self) -> f64 {
        let steps = self.images_s.windows(2).map(|pair| pair[1] - pair[0]);
        dataset::numbers::spread::median_of(steps).unwrap_or(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_two_boxes_in_an_image_is_no_track_and_after_a_gap_another_one() {
        let seen = |time_s: f64, track| Sighting {
            time_s,
            pixel_box: PixelBox::from_edges(0.0, 0.0, 4.0, 2.0),
            score: 1.0,
            track: Some(track),
        };
        let mut found = Sightings {
            boxes: vec![
                seen(0.0, 5),
                seen(0.0, 6),
                seen(1.0, 5),
                seen(1.0, 6),
                seen(2.0, 6),
                seen(2.0, 6),
                seen(60.0, 5),
            ],
            ..Sightings::default()
        };
        found.separate_tracks();
        let tracks: Vec<Option<u32>> = found.boxes.iter().map(|seen| seen.track).collect();
        assert_eq!(
            tracks,
            [Some(0), None, Some(0), None, None, None, Some(1)],
            "6 shows two aircraft at 2 s"
        );
    }
}
