//! `RECORDING.toml`: the runway, the cameras and the files of a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use dataset::corpus::calibration::{Calibration, CameraEntry};
use dataset::files::file_name;
use dataset::files::outside_file::{FileKind, read_text};
use dataset::files::toml_file::TomlFile;
use dataset::geometry::camera::CameraPose;
use dataset::geometry::geodesy::LatLon;
use dataset::geometry::pose::Pose;
use dataset::geometry::runway::Runway;
use dataset::numbers::limits::{self, Limits};
use generator::airports::{bundled, in_file};
use generator::tracks::utc_s;
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::likely_cause::GPS_AHEAD_S;

/// Cameras farther from the threshold see no arrival, metres.
const MAX_CAMERA_DISTANCE_M: f64 = 40_000.0;
/// Masts and towers are within this height of the threshold, metres; heights in feet are not, at most airports.
const MAX_CAMERA_HEIGHT_M: f64 = 400.0;
/// Times between 2000 and 2100.
pub(crate) const UTC_S: Limits =
    Limits::new(946_684_800.0, 4_102_444_800.0, "UTC in seconds since 1970");
/// Clocks that are less certain leave too many offsets, whole half hours among them.
const CLOCK_SD_S: Limits = Limits::new(0.0, 600.0, "a standard deviation in seconds");
const DRIFT_SD_PPM: Limits = Limits::new(0.0, 1_000.0, "a standard deviation in ppm");
const POSITION_SD_M: Limits = Limits::new(0.0, 1_000.0, "a standard deviation in metres");
const DIRECTION_SD_DEG: Limits = Limits::new(0.0, 20.0, "a standard deviation in degrees");
const FOCAL_SD_PCT: Limits = Limits::new(0.0, 30.0, "a standard deviation in percent");
const DELAY_SD_S: Limits = Limits::new(0.0, 60.0, "a standard deviation in seconds");
const IMAGES_PER_S: Limits = Limits::new(0.001, 1_000.0, "a number of images per second");
const TICKS_PER_S: Limits = Limits::new(1.0 / 60.0, 240.0, "a number of ticks per second");
/// Positions that are right within this are taken as they are, metres.
const EXACT_M: f64 = 1.0;
/// Delays of ADS-B reports differ by this between aircraft, seconds (standard deviation): -0.2 to +0.4 s in published comparisons.
const USUAL_DELAY_SD_S: f64 = 0.2;

/// The file as its author wrote it.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    /// Name of the rig.
    name: String,
    runway: String,
    airports: Option<PathBuf>,
    /// Geoid of all heights; missing: heights are above the ellipsoid, or are taken as such.
    geoid: Option<String>,
    aircraft: Option<String>,
    ticks_per_s: Option<f64>,
    #[serde(default)]
    split_by: SplitBy,
    camera: Vec<WrittenCamera>,
    track: Vec<WrittenTrack>,
}

/// Unit that stays on one side of the split.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SplitBy {
    #[default]
    Arrival,
    Day,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenCamera {
    name: String,
    width_px: u32,
    height_px: u32,
    boxes: Option<PathBuf>,
    #[serde(default)]
    videos: Vec<WrittenVideo>,
    #[serde(default)]
    format: BoxFormat,
    first_image: Option<String>,
    images_per_s: Option<f64>,
    #[serde(default = "utc")]
    time: String,
    #[serde(default = "default_clock_sd_s")]
    clock_sd_s: f64,
    #[serde(default = "default_drift_sd_ppm")]
    drift_sd_ppm: f64,
    calibration: Option<PathBuf>,
    guess: Option<Guess>,
    #[serde(default)]
    position_sd_m: f64,
    #[serde(default)]
    direction_sd_deg: f64,
    #[serde(default)]
    focal_sd_pct: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenVideo {
    file: PathBuf,
    first_image: Option<String>,
}

/// A camera without a calibration.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Guess {
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
    heading_deg: f64,
    pitch_deg: f64,
    #[serde(default)]
    roll_deg: f64,
    focal_px: f64,
    #[serde(default)]
    distortion: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct WrittenTrack {
    file: PathBuf,
    #[serde(default = "utc")]
    time: String,
    #[serde(default)]
    columns: BTreeMap<String, String>,
    position_sd_m: Option<f64>,
    delay_sd_s: Option<f64>,
}

/// Form of a table of boxes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum BoxFormat {
    /// Named columns.
    #[default]
    Csv,
    /// MOTChallenge: numbers of images, no names.
    Mot,
}

fn utc() -> String {
    "utc".to_owned()
}

/// Clocks that someone set by hand or by a phone are right within seconds.
fn default_clock_sd_s() -> f64 {
    10.0
}

/// Quartz clocks.
fn default_drift_sd_ppm() -> f64 {
    20.0
}

/// A recording's description, checked.
#[derive(Debug)]
pub(crate) struct Description {
    pub(crate) name: String,
    pub(crate) runway: Runway,
    pub(crate) geoid: Option<String>,
    pub(crate) aircraft: Option<String>,
    pub(crate) ticks_per_s: Option<f64>,
    pub(crate) split_by: SplitBy,
    pub(crate) cameras: Vec<CameraDescription>,
    pub(crate) tracks: Vec<TrackDescription>,
}

#[derive(Debug, Clone)]
pub(crate) struct CameraDescription {
    pub(crate) name: String,
    /// Its table of boxes; empty if it has videos instead.
    pub(crate) boxes: PathBuf,
    pub(crate) videos: Vec<Video>,
    pub(crate) format: BoxFormat,
    /// Time of image 1 and rate of the images, for tables that number images.
    pub(crate) numbered: Option<(f64, f64)>,
    /// Seconds to add to the stated times to get UTC.
    pub(crate) to_utc_s: f64,
    pub(crate) clock_sd_s: f64,
    pub(crate) drift_sd_ppm: f64,
    pub(crate) entry: CameraEntry,
    /// True if the camera is a first guess.
    pub(crate) is_guess: bool,
    pub(crate) position_sd_m: f64,
    pub(crate) direction_sd_deg: f64,
    pub(crate) focal_sd_pct: f64,
}

/// A video of a camera.
#[derive(Debug, Clone)]
pub(crate) struct Video {
    pub(crate) file: PathBuf,
    /// Time of its first image by the camera's clock; missing: as the file states it.
    pub(crate) first_image_s: Option<f64>,
}

#[derive(Debug, Clone)]
pub(crate) struct TrackDescription {
    pub(crate) file: PathBuf,
    pub(crate) to_utc_s: f64,
    pub(crate) columns: Vec<String>,
    /// Stated standard deviation; missing: by the scatter of the positions.
    pub(crate) position_sd_m: Option<f64>,
    pub(crate) is_exact: bool,
    pub(crate) delay_sd_s: f64,
}

impl Description {
    /// Reads the file with the calibrations that it names. Paths are relative to its folder.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = read_text(path, FileKind::new("recording's description", 16 << 20))?;
        let toml = TomlFile::new(path, &text);
        let written: Written = toml.parse()?;
        let refused = |key: &str, why: &str| Error::from(toml.rejected(key, why));
        let folder = path.parent().unwrap_or(Path::new(""));
        file_name::check(&written.name).map_err(|bad| refused("name", &bad.to_string()))?;
        let Some((airport, name)) = written.runway.split_once('/') else {
            return Err(refused(
                "runway",
                "expected airport and runway, e.g. WSSS/02L",
            ));
        };
        let runway = match &written.airports {
            Some(file) => in_file(&folder.join(file), airport, name)?,
            None => bundled(airport, name).ok_or_else(|| {
                refused(
                    "runway",
                    "is not built in; make its table with `dtd airport import`, and name the file as `airports`",
                )
            })?,
        };
        let limited = |key: &str, value: Option<f64>, limits: Limits| match value
            .map(|value| limits.check(value))
        {
            Some(Err(found)) => Err(refused(key, &found.to_string())),
            _ => Ok(()),
        };
        limited("ticks_per_s", written.ticks_per_s, TICKS_PER_S)?;
        if let Some(name) = written.geoid.as_deref().filter(|name| !is_geoid(name)) {
            let why = format!(
                "is {name:?}, expected the name of a geoid with its number, such as EGM96 or EGM2008"
            );
            return Err(refused("geoid", &why));
        }
        let mut names = BTreeSet::new();
        let mut cameras = Vec::new();
        for (index, camera) in written.camera.iter().enumerate() {
            let key = |field: &str| format!("camera.{index}.{field}");
            if !names.insert(&camera.name) {
                let why = format!(
                    "{} is named twice; each camera needs its own name",
                    camera.name
                );
                return Err(refused(&key("name"), &why));
            }
            for (field, value, limits) in camera.numbers() {
                limited(&key(field), value, limits)?;
            }
            let at = |field: &str, why: String| refused(&key(field), &why);
            cameras.push(camera.checked(folder, &runway, at)?);
        }
        if cameras.is_empty() || written.track.is_empty() {
            return Err(refused(
                "name",
                "expected at least one [[camera]] and one [[track]]",
            ));
        }
        let mut tracks = Vec::new();
        for (index, track) in written.track.iter().enumerate() {
            let key = |field: &str| format!("track.{index}.{field}");
            limited(&key("position_sd_m"), track.position_sd_m, POSITION_SD_M)?;
            limited(&key("delay_sd_s"), track.delay_sd_s, DELAY_SD_S)?;
            tracks.push(
                track
                    .checked(folder)
                    .map_err(|why| refused(&key("time"), &why))?,
            );
        }
        Ok(Self {
            name: written.name,
            runway,
            geoid: written.geoid,
            aircraft: written.aircraft,
            ticks_per_s: written.ticks_per_s,
            split_by: written.split_by,
            cameras,
            tracks,
        })
    }
}

impl WrittenTrack {
    /// # Errors
    /// The reason why `time` is wrong.
    fn checked(&self, folder: &Path) -> std::result::Result<TrackDescription, String> {
        let is_exact = self.position_sd_m.is_some_and(|sd_m| sd_m <= EXACT_M);
        let usual_delay_sd_s = if is_exact { 0.0 } else { USUAL_DELAY_SD_S };
        let columns = self.columns.iter();
        Ok(TrackDescription {
            file: folder.join(&self.file),
            to_utc_s: to_utc_s(&self.time)?,
            columns: columns
                .map(|(name, column)| format!("{name}={column}"))
                .collect(),
            position_sd_m: self.position_sd_m,
            is_exact,
            delay_sd_s: self.delay_sd_s.unwrap_or(usual_delay_sd_s),
        })
    }
}

/// # Errors
/// A file is named twice, or the camera's clock cannot be one: files state whole seconds.
fn checked_videos(
    written: &[WrittenVideo],
    folder: &Path,
) -> std::result::Result<Vec<Video>, String> {
    let mut files = BTreeSet::new();
    let checked = written.iter().map(|video| {
        let file = video.file.display();
        if !files.insert(&video.file) {
            return Err(format!("{file} is named twice"));
        }
        if written.len() > 1 && video.first_image.is_none() {
            return Err(format!(
                "{file}: several videos of a camera have one clock, so each needs the time of its `first_image`"
            ));
        }
        let first_image_s = video.first_image.as_deref().map(utc_s).transpose();
        Ok(Video {
            file: folder.join(&video.file),
            first_image_s: first_image_s.map_err(|why| format!("{file}: {why}"))?,
        })
    });
    checked.collect()
}

/// True of a name such as EGM2008 or OSGM15: letters, then a number.
fn is_geoid(name: &str) -> bool {
    let number = name.trim_start_matches(|letter: char| letter.is_ascii_alphabetic());
    let is_number = number.chars().all(|digit| digit.is_ascii_digit());
    is_number && !number.is_empty() && name.len() >= number.len() + 3
}

impl WrittenCamera {
    /// Numbers with their limits.
    fn numbers(&self) -> [(&'static str, Option<f64>, Limits); 8] {
        [
            (
                "width_px",
                Some(self.width_px.into()),
                limits::PICTURE_SIDE_PX,
            ),
            (
                "height_px",
                Some(self.height_px.into()),
                limits::PICTURE_SIDE_PX,
            ),
            ("images_per_s", self.images_per_s, IMAGES_PER_S),
            ("clock_sd_s", Some(self.clock_sd_s), CLOCK_SD_S),
            ("drift_sd_ppm", Some(self.drift_sd_ppm), DRIFT_SD_PPM),
            ("position_sd_m", Some(self.position_sd_m), POSITION_SD_M),
            (
                "direction_sd_deg",
                Some(self.direction_sd_deg),
                DIRECTION_SD_DEG,
            ),
            ("focal_sd_pct", Some(self.focal_sd_pct), FOCAL_SD_PCT),
        ]
    }

    fn checked(
        &self,
        folder: &Path,
        runway: &Runway,
        refused: impl Fn(&str, String) -> Error,
    ) -> Result<CameraDescription> {
        file_name::check(&self.name).map_err(|bad| refused("name", bad.to_string()))?;
        let to_utc_s = to_utc_s(&self.time).map_err(|why| refused("time", why))?;
        let numbered = match (self.format, &self.first_image, self.images_per_s) {
            (_, Some(first), Some(rate)) => {
                let first_s = utc_s(first).map_err(|why| refused("first_image", why))?;
                let found = UTC_S.check(first_s);
                found.map_err(|found| refused("first_image", found.to_string()))?;
                Some((first_s, rate))
            }
            (BoxFormat::Csv, None, None) => None,
            _ => {
                let why = "tables that number their images need `first_image` (UTC of image 1) and `images_per_s`";
                return Err(refused("boxes", why.to_owned()));
            }
        };
        let is_numbered = self.format != BoxFormat::Csv || numbered.is_some();
        let (boxes, videos) = match (&self.boxes, &*self.videos) {
            (Some(boxes), []) => (folder.join(boxes), Vec::new()),
            (None, videos @ [_, ..]) if !is_numbered => {
                let checked = checked_videos(videos, folder);
                (
                    PathBuf::new(),
                    checked.map_err(|why| refused("videos", why))?,
                )
            }
            (found, [_, ..]) => {
                let why = match found {
                    Some(_) => {
                        "are searched for boxes, and `boxes` is a table of them; name one of both"
                    }
                    None => {
                        "are searched for boxes: `format`, `first_image` and `images_per_s` belong to tables of `boxes`"
                    }
                };
                return Err(refused("videos", why.to_owned()));
            }
            (None, []) => {
                let why = "expected `boxes`, a table, or `videos`, which are searched";
                return Err(refused("name", why.to_owned()));
            }
        };
        let entry = match (&self.calibration, &self.guess) {
            (Some(file), None) => self.calibrated(&folder.join(file))?,
            (None, Some(guess)) => {
                if self.direction_sd_deg == 0.0 || self.focal_sd_pct == 0.0 {
                    let why = "a guess needs `position_sd_m`, `direction_sd_deg` and `focal_sd_pct`, its standard deviations";
                    return Err(refused("guess", why.to_owned()));
                }
                let entry = self.guessed(guess);
                if let Some(fault) = entry.fault() {
                    return Err(refused("guess", fault));
                }
                entry
            }
            _ => {
                return Err(refused(
                    "name",
                    "expected either `calibration` or [camera.guess]".to_owned(),
                ));
            }
        };
        let at = entry.placed.pose;
        let place = |latitude_deg, longitude_deg| LatLon {
            latitude_deg,
            longitude_deg,
        };
        let threshold = runway.threshold.lat_lon();
        let away_m = place(at.latitude_deg, at.longitude_deg).distance_m(threshold);
        // A latitude beyond the pole has no distance.
        if away_m.is_nan() || away_m > MAX_CAMERA_DISTANCE_M {
            let swapped_m =
                place(at.longitude_deg.clamp(-90.0, 90.0), at.latitude_deg).distance_m(threshold);
            let hint = if swapped_m < MAX_CAMERA_DISTANCE_M {
                "; latitude and longitude are swapped"
            } else {
                ""
            };
            return Err(refused(
                "name",
                format!(
                    "is {:.0} km from the threshold of {}/{}, expected at most {:.0} km{hint}",
                    away_m / 1e3,
                    runway.airport,
                    runway.name,
                    MAX_CAMERA_DISTANCE_M / 1e3
                ),
            ));
        }
        let above_m = at.altitude_msl_m - runway.threshold.altitude_msl_m;
        if above_m.is_nan() || above_m.abs() > MAX_CAMERA_HEIGHT_M {
            return Err(refused(
                "name",
                format!(
                    "is {above_m:.0} m above the threshold, expected at most {MAX_CAMERA_HEIGHT_M} m: are heights in feet, or above another datum?"
                ),
            ));
        }
        Ok(CameraDescription {
            name: self.name.clone(),
            boxes,
            videos,
            format: self.format,
            numbered,
            to_utc_s,
            clock_sd_s: self.clock_sd_s,
            drift_sd_ppm: self.drift_sd_ppm,
            entry,
            is_guess: self.guess.is_some(),
            position_sd_m: self.position_sd_m,
            direction_sd_deg: self.direction_sd_deg,
            focal_sd_pct: self.focal_sd_pct,
        })
    }

    fn calibrated(&self, file: &Path) -> Result<CameraEntry> {
        let calibration = Calibration::read(file)?;
        let fault = |message: String| dataset::Error::corpus(file, message);
        let entry = calibration.cameras.get(&self.name).ok_or_else(|| {
            let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
            fault(format!(
                "has no camera {}; it has {}",
                self.name,
                known.join(", ")
            ))
        })?;
        if let Some(found) = entry.fault() {
            return Err(fault(format!("camera {} {found}", self.name)).into());
        }
        let (found, expected) = (
            [entry.width_px, entry.height_px],
            [self.width_px, self.height_px],
        );
        if found != expected {
            return Err(fault(format!(
                "camera {} is calibrated for images of {} x {} px, expected {} x {} px as the recording states; calibrate this resolution",
                self.name, found[0], found[1], expected[0], expected[1]
            ))
            .into());
        }
        Ok(entry.clone())
    }

    fn guessed(&self, guess: &Guess) -> CameraEntry {
        let half_width = f64::from(self.width_px) / 2.0;
        let placed = CameraPose {
            pose: Pose {
                latitude_deg: guess.latitude_deg,
                longitude_deg: guess.longitude_deg,
                altitude_msl_m: guess.altitude_m,
                heading_true_deg: guess.heading_deg,
                pitch_deg: guess.pitch_deg,
                roll_deg: guess.roll_deg,
            },
            hfov_deg: 2.0 * (half_width / guess.focal_px).atan().to_degrees(),
        };
        CameraEntry {
            distortion: guess.distortion.clone(),
            ..CameraEntry::from_pose(placed, self.width_px, self.height_px)
        }
    }
}

/// Seconds to add to times of this scale: `utc`, `gps`, or local time as its difference from UTC, such as `+08:00`.
fn to_utc_s(scale: &str) -> std::result::Result<f64, String> {
    match scale {
        "utc" => return Ok(0.0),
        "gps" => return Ok(-GPS_AHEAD_S),
        _ => {}
    }
    let parsed = || {
        let (sign, rest) = match scale.split_at_checked(1)? {
            ("+", rest) => (-1.0, rest),
            ("-", rest) => (1.0, rest),
            _ => return None,
        };
        let (hours, minutes) = rest.split_once(':')?;
        let [hours, minutes] = [hours, minutes].map(|part| part.parse::<u32>().ok());
        let (hours, minutes) = (hours.filter(|h| *h <= 14)?, minutes.filter(|m| *m < 60)?);
        Some(sign * f64::from(hours * 3_600 + minutes * 60))
    };
    parsed().ok_or_else(|| {
        format!("is {scale:?}, expected \"utc\", \"gps\" or local time as \"+08:00\"")
    })
}
