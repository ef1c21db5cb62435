//! Where each camera looks, relative to the training: by the backgrounds that `dtd detect` keeps of each flight.
//!
//! A camera that stands a little off before a flight shows the aircraft elsewhere, and everything that learned image positions is off by
//! that amount. A training keeps backgrounds of different times of day and weathers as references ([`sight::references`]). The boxes and
//! registered shifts of every flight are moved to the direction of the first reference, and what remains uncertain is an error that is
//! common to the flight. Where no background can be compared, as in fog, a camera is expected in its usual direction, to the spread of the
//! training's flights and its stability.
//!
//! Focal length and horizon come from the planned cameras; the actual directions are not read.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt;
use std::mem;
use std::ops::Range;

use dataset::corpus::calibration::CameraEntry;
use dataset::corpus::splits::Side;
use dataset::geometry::camera::Camera;
use dataset::numbers::limits::{self, Check};
use dataset::numbers::spread::{deviation_from_zero, median_of};
use dataset::tables::backgrounds::ViewBackground;
use dataset::work::watch::Watch;
use glam::{DMat3, DVec2};
use serde::{Deserialize, Serialize};
use sight::background::{self, Background};
use sight::ground::{Motion, UNKNOWNS};
use sight::references::{Placed, References};
use sight::sight::{CONTRADICTS_SD, Sight};

use crate::error::Result;
use crate::samples::camera_health::{first_of, measured};
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::{CommonError, Observation, Samples, ScenarioSummary};

/// References per view. Sixteen, of two views of 1920x1280, take at most 10 MB.
const MAX_REFERENCES: usize = 8;
/// Relative change of focal lengths between flights: a lens tube of aluminium, 23 millionths per kelvin, that is nine kelvin warmer.
const ZOOM_SD: f64 = 2e-4;
/// A camera whose standard deviation before the comparison is smaller stands still, pixels.
const MIN_SD_PX: f64 = 1e-3;
/// A camera has moved if it is off by so many pixels, and contradicts the training's flights.
const MOVED_PX: f64 = 2.0;

/// References of all views.
#[derive(Debug, Clone)]
pub(crate) struct Backgrounds {
    views: Vec<View>,
}

#[derive(Debug, Clone)]
struct View {
    /// Its entry in `baselines.json`, without the references.
    learned: StoredView,
    references: References,
}

/// A camera's direction and focal length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Aim {
    ecef_from_camera: DMat3,
    focal_px: f64,
}

/// What a camera shows of its surroundings.
#[derive(Debug, Clone, PartialEq)]
pub enum Shown {
    /// What it showed in the training.
    Usual,
    /// The training's surroundings from another direction: the image's displacement, pixels right and down. Boxes are corrected.
    Moved(DVec2),
    /// What this view showed in the training. Its boxes do not count.
    OtherView(String),
    /// Other surroundings. Its boxes do not count.
    Elsewhere,
    /// Too little to compare, as in fog. The camera is expected in its usual direction.
    Unknown,
}

/// Where all cameras look in a flight; `None` for one whose boxes do not count.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sights(Vec<Option<Sight>>);

/// Result of the comparison.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Alignment {
    /// Number of compared views over all scenarios.
    pub aligned: usize,
    /// Median standard deviation of their directions, pixels; missing without any.
    pub median_sd_px: Option<f64>,
    /// Views that could not be compared, as `scenario view`: they are expected in their usual direction.
    pub unaligned: Vec<String>,
    /// Messages about views that point elsewhere than in the training.
    pub moved: Vec<String>,
    /// Messages about views whose boxes do not count, because they show another view's surroundings, or other ones than the training.
    pub refused: Vec<String>,
    /// Scenarios whose backgrounds were not kept, because an earlier version searched them.
    pub without_backgrounds: Vec<String>,
}

impl Alignment {
    /// The backgrounds of a flight.
    fn rows_of(&mut self, scenario: &ScenarioSummary, model: &str) -> Result<Vec<ViewBackground>> {
        let rows = scenario.folder.open()?.backgrounds(model)?;
        if rows.is_none() {
            self.without_backgrounds.push(scenario.id.clone());
        }
        Ok(rows.unwrap_or_default())
    }

    /// Takes what a view shows.
    fn take(&mut self, named: String, shown: Shown) {
        match shown {
            Shown::Usual => {}
            Shown::Moved(DVec2 { x, y }) => self.moved.push(format!(
                "{named} points elsewhere than in the training: its image is displaced by up to {x:.1} px right and {y:.1} px down"
            )),
            Shown::OtherView(other) => self.refused.push(format!(
                "{named} shows what {other} showed in the training: are the cameras exchanged? Its boxes do not count"
            )),
            Shown::Elsewhere => self.refused.push(format!(
                "{named} shows other surroundings than in the training, and its boxes do not count; if the camera was replaced or turned \
                 far, `dtd refit` learns it again"
            )),
            Shown::Unknown => self.unaligned.push(named),
        }
    }

    /// Reports warnings, and then the number of compared views.
    pub(crate) fn report(&self, watch: &dyn Watch) {
        for (lines, effect) in [
            (&self.refused, ""),
            (
                &self.moved,
                "; boxes are corrected, and intervals include what remains uncertain",
            ),
            (
                &self.without_backgrounds,
                " has no backgrounds, because an earlier version searched it; run `dtd detect` again, which adds them without a new search",
            ),
        ] {
            if let Some(first) = first_of(lines) {
                watch.warn(&format!("{first}{effect}"));
            }
        }
        watch.say(&self.to_string());
    }
}

impl fmt::Display for Alignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} views compared with backgrounds", self.aligned)?;
        if let Some(sd_px) = self.median_sd_px {
            write!(f, ", standard deviation {sd_px:.2} px (median)")?;
        }
        match first_of(&self.unaligned) {
            None => Ok(()),
            Some(first) => write!(
                f,
                "; not comparable, and taken to be as in the training: {first}"
            ),
        }
    }
}

/// `backgrounds` in `baselines.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StoredView {
    view: String,
    planned: CameraEntry,
    /// How the camera of the first reference looked by its calibration, if cameras vary between flights.
    #[serde(skip_serializing_if = "Option::is_none")]
    known: Option<Aim>,
    /// The usual motion of the training's flights, pixels ([`Motion::to_px`]), and their standard deviations from it.
    usual_px: [f64; UNKNOWNS],
    spread_px: [f64; UNKNOWNS],
    /// Standard deviations of a flight after the training, by the camera's stability alone.
    stability_px: [f64; UNKNOWNS],
    /// The images in `backgrounds.png`, from top to bottom.
    references: Vec<StoredReference>,
}

impl StoredView {
    /// Checks the planned camera against the limits.
    pub(crate) fn check(&self, check: &mut Check) {
        self.planned.check(check);
        if let Some(known) = &self.known {
            check.number(
                "known focal length",
                known.focal_px,
                limits::FOCAL_LENGTH_PX,
            );
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredReference {
    scenario: String,
    top_px: usize,
    images: u32,
    motion_px: [f64; UNKNOWNS],
    sd_px: f64,
}

impl View {
    /// The direction that is expected of the camera before its images are compared. `trains`: in a flight of the training.
    fn expected(&self, trains: bool) -> Sight {
        let stability = if trains { 0.0 } else { 1.0 };
        let mut expected = Sight::expected(std::array::from_fn(|unknown| {
            let of = &self.learned;
            let sd_px = of.spread_px[unknown].hypot(stability * of.stability_px[unknown]);
            sd_px.max(MIN_SD_PX)
        }));
        expected.motion = Motion::of_px(self.learned.usual_px, self.references.camera());
        expected
    }

    /// The flight's usual direction by its background alone.
    fn compared(&self, row: &ViewBackground, background: &Background) -> Option<Sight> {
        let mut found = self.references.compare(background)?;
        found.motion = measured(&row.usual).turn.after(found.motion);
        Some(found.with_shift_sd(row.usual.shift_sd_px))
    }

    /// Largest displacement of the image by a camera that points elsewhere, pixels, if that is certain: by a turn in its middle, by a roll
    /// or a zoom in its corners.
    fn moved_px(&self, compared: &Sight) -> Option<DVec2> {
        let camera = self.references.camera();
        let usual = Motion::of_px(self.learned.usual_px, camera);
        let [right_px, down_px, ..] = self.learned.spread_px;
        let size_px = DVec2::new(f64::from(camera.width_px), f64::from(camera.height_px));
        let parts = [(0.5, 0.5), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        let displaced = parts.map(|(right, down)| {
            let place_px = DVec2::new(right, down) * size_px;
            let off_px =
                usual.usual_px(camera, place_px) - compared.motion.usual_px(camera, place_px);
            let own_px = compared.errors_px(camera, place_px).map(DVec2::length);
            let sd_px = own_px[0].hypot(own_px[1]);
            (off_px, sd_px.hypot(right_px.max(down_px)))
        });
        let certain = displaced
            .into_iter()
            .filter(|(off_px, sd_px)| off_px.length() > MOVED_PX.max(CONTRADICTS_SD * sd_px));
        let largest = certain.max_by(|a, b| a.0.length().total_cmp(&b.0.length()));
        largest.map(|(off_px, _)| off_px)
    }
}

impl Backgrounds {
    /// Learns references of views from the training side, and the usual direction from all its flights. `stability_arcsec`: standard
    /// deviation of cameras' directions between flights, at least.
    pub(crate) fn learn(
        samples: &Samples,
        views: Range<usize>,
        stability_arcsec: f64,
        watch: &dyn Watch,
    ) -> Result<Self> {
        let rig = &samples.rig;
        let chosen = references(samples)?;
        let views = views.map(|index| {
            let name = &samples.views[index];
            let planned = rig.nominal[name].clone();
            let camera = planned.camera();
            let found = chosen.iter().filter_map(|(scenario, rows)| {
                let (_, background) = background_of(rows, name, &camera)?;
                Some((scenario.id.clone(), background))
            });
            let half_px = f64::from(camera.width_px) / 2.0;
            let angle_rad = (stability_arcsec / 3600.0).to_radians();
            let turn_px = angle_rad * camera.focal_px;
            let zoom_sd = if stability_arcsec > 0.0 { ZOOM_SD } else { 0.0 };
            let references = References::learn(&camera, found.collect(), rig.cameras_vary);
            let first = references.all().first().map(|first| first.name.clone());
            let first = samples
                .scenarios
                .iter()
                .find(|of| Some(&of.id) == first.as_ref());
            let learned = StoredView {
                view: name.clone(),
                known: first.filter(|_| rig.cameras_vary).map(|of| Aim {
                    ecef_from_camera: of.cameras[index].ecef_from_camera,
                    focal_px: of.cameras[index].focal_px,
                }),
                planned,
                references: Vec::new(),
                usual_px: [0.0; UNKNOWNS],
                spread_px: [0.0; UNKNOWNS],
                stability_px: [
                    turn_px,
                    turn_px,
                    angle_rad * half_px,
                    zoom_sd * half_px,
                    0.0,
                ],
            };
            View {
                learned,
                references,
            }
        });
        let mut learned = Self {
            views: views.collect(),
        };
        learned.learn_spread(samples, watch)?;
        Ok(learned)
    }

    /// Learns where the cameras usually look in the training's flights, and how much that differs from flight to flight.
    fn learn_spread(&mut self, samples: &Samples, watch: &dyn Watch) -> Result<()> {
        let mut found: Vec<Vec<Sight>> = vec![Vec::new(); self.views.len()];
        watch.begin("backgrounds", samples.scenario_count(Side::Train) as u64);
        for (done, scenario) in samples.scenarios_of(Side::Train).enumerate() {
            watch.check()?;
            let rows = Alignment::default().rows_of(scenario, &samples.detections.hash)?;
            for (view, found) in self.views.iter().zip(&mut found) {
                let camera = view.references.camera();
                let row = background_of(&rows, &view.learned.view, camera);
                found.extend(row.and_then(|(row, background)| view.compared(row, &background)));
            }
            watch.advance(done as u64 + 1, &scenario.id);
        }
        for (view, found) in self.views.iter_mut().zip(found) {
            let camera = *view.references.camera();
            for unknown in 0..UNKNOWNS {
                let numbers = || found.iter().map(|of| of.motion.to_px(&camera)[unknown]);
                let of_fits = found.iter().map(|of| of.covariance_px2[unknown][unknown]);
                let (Some(usual_px), Some(of_fits)) = (median_of(numbers()), median_of(of_fits))
                else {
                    continue;
                };
                let spread_px = deviation_from_zero(numbers().map(|of| of - usual_px));
                view.learned.usual_px[unknown] = usual_px;
                view.learned.spread_px[unknown] = (spread_px.powi(2) - of_fits).max(0.0).sqrt();
            }
            // A reference in fog shows little of its own direction.
            let expected = view.expected(true);
            let placed = |measured: &Sight| measured.expected_at(&expected, &camera);
            let first = view.references.place(placed);
            view.learned.usual_px = expected.motion.after(first.back()).to_px(&camera);
        }
        Ok(())
    }

    /// Copy with another background of a view.
    pub(crate) fn with_view_of(&self, view: usize, other: Self) -> Self {
        let mut views = self.views.clone();
        views.splice(view..=view, other.views);
        Self { views }
    }

    /// Backgrounds for another airport: the expectations, without references.
    pub(crate) fn elsewhere(mut self) -> Self {
        for view in &mut self.views {
            view.references = References::of(view.references.camera(), Vec::new(), false);
            view.learned.known = None;
        }
        self
    }

    /// Before any image is compared, in a flight after the training.
    pub(crate) fn unseen(&self) -> Sights {
        self.expected(false)
    }

    fn expected(&self, trains: bool) -> Sights {
        let views = self.views.iter();
        Sights(views.map(|view| Some(view.expected(trains))).collect())
    }

    /// Compares a background of a view.
    pub(crate) fn show(&self, sights: &mut Sights, view: usize, background: &Background) -> Shown {
        let compared = self.views[view].references.compare(background);
        let (shown, sight) = self.judge(view, compared, background, false);
        sights.0[view] = sight;
        shown
    }

    /// What a view shows, and where it looks; `None` if its boxes do not count.
    fn judge(
        &self,
        view: usize,
        compared: Option<Sight>,
        background: &Background,
        trains: bool,
    ) -> (Shown, Option<Sight>) {
        let of_view = &self.views[view];
        let expected = of_view.expected(trains);
        if let Some(compared) = compared {
            let shown = match of_view.moved_px(&compared) {
                Some(off_px) => Shown::Moved(off_px),
                None => Shown::Usual,
            };
            let sight = compared.expected_at(&expected, of_view.references.camera());
            return (shown, Some(sight));
        }
        if !of_view.references.is_elsewhere(background) {
            return (Shown::Unknown, Some(expected));
        }
        let others = self.views.iter().enumerate();
        let mut others = others.filter(|(other, _)| *other != view);
        match others.find(|(_, other)| other.references.compare(background).is_some()) {
            Some((_, other)) => (Shown::OtherView(other.learned.view.clone()), None),
            None => (Shown::Elsewhere, None),
        }
    }

    /// A flight with its cameras compared as soon as each background is complete.
    pub(crate) fn seen_live(
        &self,
        samples: &Samples,
        flight: &[Observation],
        alignment: &mut Alignment,
    ) -> Result<Vec<Observation>> {
        let scenario = &samples.scenarios[flight[0].scenario];
        let rows = alignment.rows_of(scenario, &samples.detections.hash)?;
        let views = self.views.iter().enumerate();
        let complete = views.filter_map(|(index, view)| {
            let (row, of) = background_of(&rows, &view.learned.view, view.references.camera())?;
            (row.images >= background::IMAGES).then_some((row.tick, index, of))
        });
        let mut complete: Vec<_> = complete.collect();
        complete.sort_by_key(|(tick, ..)| *tick);
        let mut complete = complete.into_iter().peekable();
        let mut sights = self.unseen();
        let seen = flight.iter().map(|observed| {
            while let Some((_, view, background)) =
                complete.next_if(|(tick, ..)| *tick <= observed.tick)
            {
                let shown = self.show(&mut sights, view, &background);
                alignment.aligned += usize::from(matches!(shown, Shown::Usual | Shown::Moved(_)));
                let named = format!("{} {}", scenario.id, self.views[view].learned.view);
                alignment.take(named, shown);
            }
            self.corrected(observed, &sights)
        });
        Ok(seen.collect())
    }

    /// Compares scenarios on some sides, and corrects their cameras, boxes and shifts. `trains`: these flights have taught where the
    /// cameras usually look.
    pub(crate) fn align(
        &self,
        samples: &mut Samples,
        (sides, trains): (&[Side], bool),
        watch: &dyn Watch,
    ) -> Result<Alignment> {
        let mut observations = mem::take(&mut samples.samples);
        let observed = observations.iter_mut().map(|sample| &mut sample.observed);
        let alignment = self.align_observations(samples, (sides, trains), observed, watch);
        samples.samples = observations;
        alignment
    }

    /// Alignment for observations without ground truth.
    pub(crate) fn align_observations<'a>(
        &self,
        samples: &mut Samples,
        (sides, trains): (&[Side], bool),
        observations: impl Iterator<Item = &'a mut Observation>,
        watch: &dyn Watch,
    ) -> Result<Alignment> {
        let model = &samples.detections.hash;
        let scenarios = &mut samples.scenarios;
        watch.begin("cameras", scenarios.len() as u64);
        let mut alignment = Alignment::default();
        let mut sds_px = Vec::new();
        let mut sights = Vec::new();
        for (done, scenario) in scenarios.iter_mut().enumerate() {
            watch.check()?;
            watch.advance(done as u64 + 1, &scenario.id);
            let mut of_views = self.expected(trains);
            if !sides.contains(&scenario.side) {
                sights.push(of_views);
                continue;
            }
            let rows = alignment.rows_of(scenario, model)?;
            for (index, view) in self.views.iter().enumerate() {
                let named = format!("{} {}", scenario.id, view.learned.view);
                let row = background_of(&rows, &view.learned.view, view.references.camera());
                // Boxes are moved to the direction of the first reference.
                if let Some(known) = &view.learned.known {
                    let camera = &mut scenario.cameras[index];
                    camera.ecef_from_camera = known.ecef_from_camera;
                    camera.focal_px = known.focal_px;
                }
                let Some((row, background)) = row else {
                    continue;
                };
                let compared = view.compared(row, &background);
                sds_px.extend(compared.map(|compared| compared.sd_px()));
                let (shown, sight) = self.judge(index, compared, &background, trains);
                // The camera is expected to look there in the mean of the flight, which is uncertain as well.
                let is_unknown = shown == Shown::Unknown;
                let usual_sd_px = if is_unknown {
                    row.usual.shift_sd_px
                } else {
                    0.0
                };
                of_views.0[index] = sight.map(|sight| sight.with_shift_sd(usual_sd_px));
                alignment.take(named, shown);
            }
            sights.push(of_views);
        }
        for observed in observations {
            *observed = self.corrected(observed, &sights[observed.scenario]);
        }
        alignment.aligned = sds_px.len();
        alignment.median_sd_px = median_of(sds_px);
        Ok(alignment)
    }

    /// Moves an observation to the direction of the first references.
    pub(crate) fn corrected(&self, observed: &Observation, sights: &Sights) -> Observation {
        let camera = |view: usize| self.views[view].references.camera();
        let sight = |view: usize| sights.0[view].as_ref();
        let errors = observed.seen().filter_map(|(view, seen)| {
            let (place_px, _) = centre_and_size(seen);
            let errors_px = sight(view)?.errors_px(camera(view), place_px);
            Some(errors_px.map(|sd_px| CommonError { view, sd_px }))
        });
        let errors: Vec<CommonError> = errors.flatten().collect();
        observed
            .without_images(|view| sight(view).is_none())
            .moved(|view, place_px| Some(sight(view)?.motion.usual_px(camera(view), place_px)))
            .with_common(errors)
    }

    pub(crate) fn views(&self) -> usize {
        self.views.len()
    }

    /// True if there is something to compare flights with.
    pub(crate) fn has_references(&self) -> bool {
        let mut views = self.views.iter();
        views.any(|view| !view.references.all().is_empty())
    }

    /// Entries of the backgrounds in `baselines.json`.
    pub(crate) fn stored(&self) -> Vec<StoredView> {
        let stored = |view: &View| {
            let camera = view.references.camera();
            let all = view.references.all();
            StoredView {
                references: (all.iter())
                    .map(|placed| StoredReference {
                        scenario: placed.name.clone(),
                        top_px: placed.background.top_px,
                        images: placed.background.images,
                        motion_px: placed.motion.to_px(camera),
                        sd_px: placed.sd_px,
                    })
                    .collect(),
                ..view.learned.clone()
            }
        };
        self.views.iter().map(stored).collect()
    }

    /// Reference images, one below the other.
    pub(crate) fn png(&self) -> Vec<u8> {
        let all = self.views.iter().flat_map(|view| view.references.all());
        let levels = all.flat_map(|placed| &placed.background.levels);
        let mut levels: Vec<u8> = levels.copied().collect();
        let width_px = self.views[0].references.camera().width_px as usize;
        // At least a row, and whole ones if views have images of other widths.
        levels.resize(levels.len().max(1).next_multiple_of(width_px), 0);
        background::png_of(levels, width_px)
    }

    /// Restores stored references; `None` if the images do not match.
    pub(crate) fn of(stored: &[StoredView], png: &[u8]) -> Option<Self> {
        let mut levels = background::levels_of_png(png, |_| true)?.into_iter();
        let mut views = Vec::new();
        for view in stored {
            let camera = view.planned.camera();
            let width_px = camera.width_px as usize;
            let mut all = Vec::new();
            for placed in &view.references {
                let rows = (camera.height_px as usize).checked_sub(placed.top_px)?;
                let background = Background {
                    width_px,
                    top_px: placed.top_px,
                    levels: levels.by_ref().take(rows * width_px).collect(),
                    images: placed.images,
                    turn: Motion::default(),
                };
                if background.levels.len() < rows * width_px {
                    return None;
                }
                let at = (Motion::of_px(placed.motion_px, &camera), placed.sd_px);
                all.push(Placed::at(
                    placed.scenario.clone(),
                    background,
                    at,
                    &camera,
                )?);
            }
            views.push(View {
                references: References::of(&camera, all, view.known.is_some()),
                learned: StoredView {
                    references: Vec::new(),
                    ..view.clone()
                },
            });
        }
        Some(Self { views })
    }
}

/// The background of a view, with its row.
fn background_of<'a>(
    rows: &'a [ViewBackground],
    view: &str,
    camera: &Camera,
) -> Option<(&'a ViewBackground, Background)> {
    let row = rows.iter().find(|row| row.view == view)?;
    Some((
        row,
        Background::of_png(&row.png, row.top_px as usize, row.images, camera)?,
    ))
}

/// Training scenarios that differ in weather and time of day, as evenly chosen as possible among those with backgrounds.
fn references(samples: &Samples) -> Result<Vec<(&ScenarioSummary, Vec<ViewBackground>)>> {
    let rows_of = |of: &_| Alignment::default().rows_of(of, &samples.detections.hash);
    let mut conditions = BTreeMap::new();
    for scenario in samples.scenarios_of(Side::Train) {
        let condition = (scenario.time_of_day.as_str(), scenario.weather.as_str());
        if let Entry::Vacant(place) = conditions.entry(condition)
            && !rows_of(scenario)?.is_empty()
        {
            place.insert(scenario);
        }
    }
    let all: Vec<&ScenarioSummary> = conditions.into_values().collect();
    let count = all.len().min(MAX_REFERENCES);
    let chosen = (0..count).map(|i| all[i * all.len() / count]);
    chosen
        .map(|scenario| Ok((scenario, rows_of(scenario)?)))
        .collect()
}

#[cfg(test)]
mod tests;
