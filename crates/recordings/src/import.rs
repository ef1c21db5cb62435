//! The import of a recording.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use chrono::DateTime;
use dataset::corpus::model_identity::ModelIdentity;
use dataset::corpus::scenario::SourceFile;
use dataset::corpus::seal::hash_file;
use dataset::corpus::workshop::{NEW, Workshop, is_vacant, resolve};
use dataset::numbers::spread::median_of;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::work::watch::Watch;
use generator::tracks::{NamedColumn, arrivals};
use labeller::Searcher;
use serde::Serialize;

use crate::alignment::{Alignment, CameraModel, OF_CAMERA};
use crate::coarse_clocks::{MIN_FITTING, best_start};
use crate::corpus_folder::{self, Parts, Seen};
use crate::description::{CameraDescription, Description, TrackDescription};
use crate::error::{Error, Result};
use crate::flight_path::FlightPath;
use crate::likely_cause::likely_cause;
use crate::matching::{Matched, matched, residual_px};
use crate::sightings::{Sighting, Sightings};
use crate::videos::{self, Searched, name_of};

/// Entry of the workshop for recordings that are being read.
const SCRATCH: &str = "tracks";
/// Entry of the workshop for tables of the boxes in videos.
const SEARCHED: &str = "boxes";
/// Greatest distance at which an approach may begin, metres: the limit of `dtd tracks import`.
const LONGEST_M: f64 = 25.0 * METERS_PER_NAUTICAL_MILE;
/// Maximum number of boxes in the fit; more have little effect, since their errors last.
const MAX_FITTED: usize = 20_000;
/// Rounds of the fit, with the distance within which boxes count in any case, pixels; the last is repeated.
const WITHIN_PX: [f64; 4] = [20.0, 10.0, 5.0, 0.0];
const MAX_ROUNDS: usize = 20;
/// Maximum median distance of matched boxes, pixels: 0.6 to 1.4 in sound recordings (docs/results/recordings.json), 16 and more with a
/// wrong clock, rate or order of the images.
const MAX_RESIDUAL_PX: f64 = 5.0;
/// Corrections are reported from this number of stated deviations on, and a camera is refused beyond the other: of ten corrections with
/// true deviations, one in 1,600 recordings is reported.
const REPORTED: f64 = 4.0;
const IMPLAUSIBLE: f64 = 8.0;
/// Two tracks that are nearer than this are of one aircraft, metres: arrivals follow each other at 3 NM and more.
const SAME_AIRCRAFT_M: f64 = 300.0;
/// Change in prior deviations that ends the fit.
const LAST_CHANGE: f64 = 1e-4;

/// A file, camera or arrival that was not used.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Refused {
    /// Name of the camera, or file and arrival.
    pub what: String,
    /// The reason.
    pub reason: String,
}

/// Results for a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraOutcome {
    /// Name of the camera.
    pub camera: String,
    /// Seconds to add to its times, in the middle of its images, and their standard deviation.
    pub offset_s: f64,
    /// See `offset_s`.
    pub offset_sd_s: f64,
    /// Likely cause of the offset, if it looks like one.
    pub likely_cause: Option<String>,
    /// Seconds that its clock loses in a million, and their standard deviation.
    pub drift_ppm: f64,
    /// See `drift_ppm`.
    pub drift_sd_ppm: f64,
    /// Corrections of pan, tilt and roll, degrees, and of the focal length, percent; 0 of a calibrated camera.
    pub turned: [f64; 4],
    /// Standard deviations of `turned`.
    pub turned_sd: [f64; 4],
    /// Corrections beyond the stated deviations, with likely causes.
    pub doubts: Vec<String>,
    /// Largest correction in stated deviations.
    pub worst_correction: f64,
    /// Median distance of matched boxes from the projected tracks, pixels.
    pub residual_px: f64,
    /// Boxes that show an arrival.
    pub matched: usize,
    /// Boxes that show none.
    pub unmatched: usize,
    /// Boxes that might show several or follow none well; these count as unmatched.
    pub doubtful: usize,
    /// Images of its videos that were left out, because they or earlier ones are damaged.
    pub damaged_images: u64,
}

/// Outcome of an import.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ImportOutcome {
    /// Identifiers of the scenarios.
    pub scenarios: Vec<String>,
    /// Clocks and cameras.
    pub cameras: Vec<CameraOutcome>,
    /// Unused inputs.
    pub refused: Vec<Refused>,
}

/// Makes a corpus of a recording in a new folder, which appears as a whole. `detector` is loaded if there are videos.
///
/// # Errors
/// The description is wrong, no part of it can be used, the disk fails, or the caller stops it.
pub fn import(
    description: &Path,
    out: &Path,
    detector: impl FnOnce() -> labeller::Result<Searcher>,
    watch: &dyn Watch,
) -> Result<ImportOutcome> {
    let described = Description::read(description)?;
    let out = resolve(out)?;
    // Also beside a corpus: an import that was killed just after it had made it leaves an empty workshop, which goes now.
    let workshop = Workshop::enter(&out, &[SCRATCH, SEARCHED], Duration::ZERO)?;
    if !is_vacant(&out) {
        let fault = "is there already, and an import replaces nothing; name a new folder";
        return Err(dataset::Error::corpus(&out, fault).into());
    }
    let made = make(description, &described, &workshop, detector, watch);
    if made.is_err() {
        workshop.remove(SCRATCH)?;
        workshop.remove(NEW)?;
    }
    made
}

/// Results of searching videos.
#[derive(Default)]
struct Videos<'a> {
    searched: BTreeMap<&'a str, Result<Searched>>,
    detector: Option<ModelIdentity>,
}

impl<'a> Videos<'a> {
    fn search(
        described: &'a Description,
        workshop: &Workshop,
        detector: impl FnOnce() -> labeller::Result<Searcher>,
        watch: &dyn Watch,
    ) -> Result<Self> {
        let cameras: Vec<&CameraDescription> = (described.cameras.iter())
            .filter(|camera| !camera.videos.is_empty())
            .collect();
        if cameras.is_empty() {
            return Ok(Self::default());
        }
        let searcher = detector()?;
        let searched = videos::search(&cameras, &searcher, &workshop.path(SEARCHED), watch)?;
        let names = cameras.iter().map(|camera| &*camera.name);
        // The boxes are a model's if all of them are.
        let is_all = cameras.len() == described.cameras.len();
        Ok(Self {
            searched: names.zip(searched).collect(),
            detector: is_all.then(|| searcher.model().clone()),
        })
    }

    /// A camera's boxes and their source.
    fn seen_by(&mut self, camera: &CameraDescription) -> Result<(Sightings, SourceFile)> {
        let Some(searched) = self.searched.remove(&*camera.name) else {
            return Ok((Sightings::read(camera)?, source(&camera.boxes)?));
        };
        let Searched {
            table,
            source,
            damaged_images,
        } = searched?;
        let with_table = CameraDescription {
            boxes: table,
            ..camera.clone()
        };
        let seen = Sightings {
            damaged_images,
            ..Sightings::read(&with_table)?
        };
        Ok((seen, source))
    }
}

fn make(
    file: &Path,
    described: &Description,
    workshop: &Workshop,
    detector: impl FnOnce() -> labeller::Result<Searcher>,
    watch: &dyn Watch,
) -> Result<ImportOutcome> {
    let mut outcome = ImportOutcome::default();
    let scratch = workshop.path(SCRATCH);
    std::fs::create_dir_all(&scratch).map_err(dataset::Error::io("create", &scratch))?;
    let mut paths = Vec::new();
    for track in &described.tracks {
        paths.extend(read_track(
            track,
            described,
            &scratch,
            &mut outcome.refused,
        )?);
    }
    let mut paths = without_doubles(paths, &mut outcome.refused);
    name_apart(&mut paths);
    if paths.is_empty() {
        return Err(unusable(&outcome.refused, "no track is an arrival"));
    }
    let mut videos = Videos::search(described, workshop, detector, watch)?;
    let mut cameras: Vec<(&CameraDescription, Sightings, SourceFile)> = Vec::new();
    for camera in &described.cameras {
        match videos.seen_by(camera) {
            Ok((seen, source)) => cameras.push((camera, seen, source)),
            Err(error) if error.is_of_a_file() => outcome.refused.push(Refused {
                what: format!("camera {}", camera.name),
                reason: error.to_string(),
            }),
            Err(error) => return Err(error),
        }
    }
    if cameras.is_empty() {
        return Err(unusable(&outcome.refused, "no camera has boxes"));
    }
    let mut models = Vec::new();
    cameras.retain(|(camera, seen, _)| {
        match best_start(&model_of(camera, seen, described), &seen.boxes, &paths) {
            Some(model) => {
                models.push(model);
                true
            }
            None => {
                outcome.refused.push(no_start(camera, seen, &paths));
                false
            }
        }
    });
    if models.is_empty() {
        return Err(unusable(
            &outcome.refused,
            "no camera's boxes fit the tracks",
        ));
    }
    let (alignment, found) = loop {
        let alignment = aligned(models.clone(), &cameras, &paths, described)?;
        let found: Vec<Matched> = (cameras.iter().enumerate())
            .map(|(camera, (_, seen, _))| matched(&alignment, camera, &seen.boxes))
            .collect();
        let of_camera =
            |(index, (camera, seen, _)): (usize, &(&CameraDescription, Sightings, _))| {
                camera_outcome(&alignment, index, camera, seen, &found[index])
            };
        let fitted: Vec<CameraOutcome> = cameras.iter().enumerate().map(of_camera).collect();
        let Some(worst) = worst_misfit(&fitted) else {
            outcome.cameras = fitted;
            break (alignment, found);
        };
        let hint = cameras[worst].1.smaller_images(cameras[worst].0);
        outcome.refused.push(misfit(&fitted[worst], hint));
        cameras.remove(worst);
        models.remove(worst);
        if models.is_empty() {
            return Err(unusable(
                &outcome.refused,
                "no camera's boxes fit the tracks",
            ));
        }
    };
    let is_seen = |flight: usize| {
        let shown = found
            .iter()
            .map(|of| of.flights.iter().filter(|of| **of == Some(flight)).count());
        shown.max().unwrap_or(0) >= MIN_FITTING
    };
    let flights: Vec<usize> = (0..paths.len()).filter(|flight| is_seen(*flight)).collect();
    for path in (paths.iter().enumerate()).filter(|(flight, _)| !flights.contains(flight)) {
        outcome.refused.push(Refused {
            what: format!("arrival {}", path.1.id),
            reason: format!(
                "fewer than {MIN_FITTING} boxes of any camera show it; it lasts from {} to {}, the boxes from {}",
                utc(path.1.from_s),
                utc(path.1.to_s),
                times_of(&cameras)
            ),
        });
    }
    if flights.is_empty() {
        return Err(unusable(
            &outcome.refused,
            "no arrival is seen by any camera",
        ));
    }
    let seen = cameras.into_iter().zip(found);
    let seen = seen.map(|((camera, sightings, source), matched)| Seen {
        camera,
        sightings,
        source,
        matched,
    });
    let parts = Parts {
        described,
        alignment: &alignment,
        detector: videos.detector.as_ref(),
        seen: seen.collect(),
        flights: &flights,
    };
    outcome.scenarios = corpus_folder::write(&parts, file, &workshop.path(NEW))?;
    workshop.remove(SCRATCH)?;
    workshop.put_in_place()?;
    // Whoever mends the description and imports again needs no second search.
    if outcome.refused.is_empty()
        && let Err(error) = workshop.remove(SEARCHED)
    {
        watch.warn(&format!(
            "the corpus is complete, but the search's results remain: {error}"
        ));
    }
    Ok(outcome)
}

/// The camera that fits the tracks worst, if it cannot be used: it also spoils the others.
fn worst_misfit(fitted: &[CameraOutcome]) -> Option<usize> {
    let misfit = |camera: &CameraOutcome| {
        if camera.matched == 0 {
            return f64::INFINITY;
        }
        let misfits = [
            camera.residual_px / MAX_RESIDUAL_PX,
            camera.worst_correction / IMPLAUSIBLE,
        ];
        misfits.into_iter().fold(0.0, f64::max)
    };
    let misfits = fitted.iter().map(misfit).enumerate();
    let worst = misfits
        .filter(|(_, misfit)| *misfit > 1.0)
        .max_by(|a, b| a.1.total_cmp(&b.1));
    worst.map(|(index, _)| index)
}

fn misfit(camera: &CameraOutcome, hint: &str) -> Refused {
    let doubts = camera.doubts.join("; ");
    let reason = if camera.worst_correction > IMPLAUSIBLE && camera.residual_px <= MAX_RESIDUAL_PX {
        format!("{doubts}; correct what is stated, or state larger deviations")
    } else {
        format!(
            "the {} boxes that match an arrival best are {:.1} px from it in the median, and {} match none; expected at most \
             {MAX_RESIDUAL_PX} px; check its place, its direction, the size of its images and its times{hint}{}{doubts}",
            camera.matched,
            camera.residual_px,
            camera.unmatched,
            if doubts.is_empty() { "" } else { "; " }
        )
    };
    Refused {
        what: format!("camera {}", camera.camera),
        reason,
    }
}

/// Corrections of a camera beyond its stated deviations, with likely causes, and the largest correction in deviations.
fn doubts(model: &CameraModel) -> (Vec<String>, f64) {
    let [_, drift, pan, tilt, roll, focal, north_m, east_m, up_m] = model.values;
    let turned = "was it turned, or is its direction magnetic?";
    let corrections = [
        (
            "drift",
            drift,
            "ppm",
            1,
            "are the times of its images right?",
        ),
        ("pan", pan, "degrees", 2, turned),
        ("tilt", tilt, "degrees", 3, turned),
        ("roll", roll, "degrees", 4, turned),
        (
            "focal length",
            focal,
            "%",
            5,
            "is it another lens, or are its images of another size?",
        ),
        (
            "place",
            north_m.hypot(east_m),
            "m",
            6,
            "are its coordinates mistyped, or of another datum?",
        ),
        (
            "height",
            up_m,
            "m",
            8,
            "is its altitude in feet, or above another datum?",
        ),
    ];
    let (mut doubts, mut worst) = (Vec::new(), 0.0_f64);
    for (what, by, unit, number, cause) in corrections {
        let sd = model.prior_sd[number];
        if sd > 0.0 {
            let deviations = by.abs() / sd;
            worst = worst.max(deviations);
            if deviations > REPORTED {
                doubts.push(format!(
                    "its {what} was corrected by {by:.3} {unit}, {deviations:.0} times its stated deviation of {sd}: {cause}"
                ));
            }
        }
    }
    (doubts, worst)
}

/// Drops the less exact track of an aircraft that has two.
fn without_doubles(mut paths: Vec<FlightPath>, refused: &mut Vec<Refused>) -> Vec<FlightPath> {
    paths.sort_by(|a, b| a.position_sd_m[0].total_cmp(&b.position_sd_m[0]));
    let mut kept: Vec<FlightPath> = Vec::new();
    for path in paths {
        match kept.iter().find(|other| is_same_aircraft(other, &path)) {
            None => kept.push(path),
            Some(other) => refused.push(Refused {
                what: format!("arrival {} of {}", path.id, path.source.file),
                reason: format!(
                    "is the same flight as {} of {}, which is used; name one file of each flight",
                    other.id, other.source.file
                ),
            }),
        }
    }
    kept
}

fn is_same_aircraft(a: &FlightPath, b: &FlightPath) -> bool {
    let (from_s, to_s) = (a.from_s.max(b.from_s), a.to_s.min(b.to_s));
    let times = (0..=10).map(|part| from_s + f64::from(part) / 10.0 * (to_s - from_s));
    let apart = times.filter_map(|time_s| {
        let (a, b) = (a.at(time_s)?, b.at(time_s)?);
        Some(a.place_m.distance(b.place_m))
    });
    from_s < to_s && median_of(apart).is_some_and(|apart_m| apart_m < SAME_AIRCRAFT_M)
}

fn unusable(refused: &[Refused], why: &str) -> Error {
    let listed: Vec<String> = refused
        .iter()
        .map(|one| format!("{}: {}", one.what, one.reason))
        .collect();
    Error::Unusable(
        format!("nothing can be used: {why}\n{}", listed.join("\n"))
            .trim_end()
            .to_owned(),
    )
}

fn source(path: &Path) -> Result<SourceFile> {
    Ok(SourceFile {
        file: name_of(path),
        blake3: hash_file(path)?,
    })
}

fn read_track(
    track: &TrackDescription,
    described: &Description,
    scratch: &Path,
    refused: &mut Vec<Refused>,
) -> Result<Vec<FlightPath>> {
    let what = format!("track {}", track.file.display());
    let mut refuse = |reason: String| {
        refused.push(Refused {
            what: what.clone(),
            reason,
        });
    };
    let columns = track
        .columns
        .iter()
        .map(|column| NamedColumn::from_str(column));
    let columns: Vec<NamedColumn> = match columns.collect() {
        Ok(columns) => columns,
        Err(why) => {
            refuse(format!("its `columns`: {why}"));
            return Ok(Vec::new());
        }
    };
    let (found, others) = match arrivals(
        &track.file,
        &columns,
        &described.runway,
        track.is_exact,
        scratch,
    ) {
        Ok(read) => read,
        Err(error) if error.is_of_disk() => return Err(error.into()),
        Err(error) => {
            refuse(error.beside(&track.file));
            return Ok(Vec::new());
        }
    };
    for other in others {
        refuse(match other.aircraft {
            Some(aircraft) => format!("aircraft {aircraft}: {}", other.reason),
            None => other.reason,
        });
    }
    let source = source(&track.file)?;
    let path = |arrival| {
        let arrival: &generator::tracks::Arrival = arrival;
        let origin_s = arrival.start_utc_s + track.to_utc_s;
        let mut path = FlightPath::of(
            arrival,
            &described.runway,
            source.clone(),
            origin_s,
            LONGEST_M,
        )?;
        if let Some(sd_m) = track.position_sd_m {
            path.position_sd_m = [sd_m; 3];
        }
        (path.is_exact, path.delay_sd_s) = (track.is_exact, track.delay_sd_s);
        Some(path)
    };
    Ok(found.iter().filter_map(path).collect())
}

/// Gives each arrival its own name, which may name a folder.
fn name_apart(paths: &mut [FlightPath]) {
    let mut names = BTreeSet::new();
    paths.sort_by(|a, b| a.from_s.total_cmp(&b.from_s));
    for path in paths {
        let legal = |letter: char| {
            if letter.is_ascii_alphanumeric() || "-_".contains(letter) {
                letter
            } else {
                '_'
            }
        };
        let plain: String = path
            .id
            .trim_start_matches('-')
            .chars()
            .map(legal)
            .take(150)
            .collect();
        let mut name = plain.clone();
        for number in 2.. {
            if names.insert(name.clone()) {
                break;
            }
            name = format!("{plain}-{number}");
        }
        path.id = name;
    }
}

fn model_of(camera: &CameraDescription, seen: &Sightings, described: &Description) -> CameraModel {
    let turn = camera.direction_sd_deg;
    let place = camera.position_sd_m;
    let prior_sd: [f64; OF_CAMERA] = [
        camera.clock_sd_s,
        camera.drift_sd_ppm,
        turn,
        turn,
        turn,
        camera.focal_sd_pct,
        place,
        place,
        place,
    ];
    let middle_s = seen.images_s[seen.images_s.len() / 2];
    let used = fitted_step(seen, described.cameras.len());
    CameraModel::new(
        camera.entry.camera(),
        prior_sd,
        middle_s,
        1.0 / (seen.period_s() * used as f64),
    )
}

/// Every how many boxes of a camera one is in the fit.
fn fitted_step(seen: &Sightings, cameras: usize) -> usize {
    (seen.boxes.len() * cameras).div_ceil(MAX_FITTED).max(1)
}

fn no_start(camera: &CameraDescription, seen: &Sightings, paths: &[FlightPath]) -> Refused {
    let first_s = paths
        .iter()
        .map(|path| path.from_s)
        .fold(f64::INFINITY, f64::min);
    let last_s = paths
        .iter()
        .map(|path| path.to_s)
        .fold(f64::NEG_INFINITY, f64::max);
    Refused {
        what: format!("camera {}", camera.name),
        reason: format!(
            "its boxes (from {} to {}) fit none of the arrivals (from {} to {}) with a clock within {:.0} s of UTC or of a whole half hour: a \
             track of another day, a camera that looks elsewhere than stated, or a larger `clock_sd_s`?{}",
            utc(seen.images_s[0]),
            utc(seen.images_s[seen.images_s.len() - 1]),
            utc(first_s),
            utc(last_s),
            3.0 * camera.clock_sd_s,
            seen.smaller_images(camera)
        ),
    }
}

fn aligned<'a>(
    models: Vec<CameraModel>,
    cameras: &[(&CameraDescription, Sightings, SourceFile)],
    paths: &'a [FlightPath],
    described: &Description,
) -> Result<Alignment<'a>> {
    let used: Vec<Vec<Sighting>> = (cameras.iter())
        .map(|(_, seen, _)| {
            let step = fitted_step(seen, described.cameras.len());
            seen.boxes.iter().step_by(step).copied().collect()
        })
        .collect();
    let mut alignment = Alignment::new(models, paths, true);
    for round in 0..MAX_ROUNDS {
        let within_px = WITHIN_PX[round.min(WITHIN_PX.len() - 1)];
        let assigned = alignment.assigned(&used, within_px);
        let change = alignment.step(&assigned).ok_or_else(|| {
            Error::Unusable(
                "clocks and cameras cannot be determined from these boxes and tracks".into(),
            )
        })?;
        if round >= WITHIN_PX.len() && change < LAST_CHANGE {
            break;
        }
    }
    Ok(alignment)
}

fn camera_outcome(
    alignment: &Alignment<'_>,
    camera: usize,
    description: &CameraDescription,
    seen: &Sightings,
    found: &Matched,
) -> CameraOutcome {
    let model = &alignment.cameras[camera];
    let sds = alignment.camera_sds(camera);
    let offset_s = model.coarse_s + model.values[0];
    let matched = found.flights.iter().flatten().count();
    let (doubts, worst_correction) = doubts(model);
    let longitude_deg = description.entry.placed.pose.longitude_deg;
    CameraOutcome {
        camera: description.name.clone(),
        offset_s,
        offset_sd_s: sds[0],
        likely_cause: likely_cause(offset_s, sds[0], description.clock_sd_s, longitude_deg),
        doubts,
        worst_correction,
        drift_ppm: model.values[1],
        drift_sd_ppm: sds[1],
        turned: std::array::from_fn(|i| model.values[2 + i]),
        turned_sd: std::array::from_fn(|i| sds[2 + i]),
        residual_px: residual_px(alignment, camera, &seen.boxes, found, |_| true)
            .unwrap_or(f64::NAN),
        matched,
        unmatched: found.flights.len() - matched,
        doubtful: found.doubtful,
        damaged_images: seen.damaged_images,
    }
}

fn times_of(cameras: &[(&CameraDescription, Sightings, SourceFile)]) -> String {
    let times = || cameras.iter().flat_map(|(_, seen, _)| &seen.images_s);
    let first_s = times().copied().fold(f64::INFINITY, f64::min);
    let last_s = times().copied().fold(f64::NEG_INFINITY, f64::max);
    format!("{} to {}", utc(first_s), utc(last_s))
}

/// A time in words.
fn utc(utc_s: f64) -> String {
    let at = DateTime::from_timestamp_millis((utc_s * 1e3) as i64);
    at.map_or_else(
        || format!("{utc_s} s"),
        |at| at.format("%Y-%m-%dT%H:%M:%SZ").to_string(),
    )
}
