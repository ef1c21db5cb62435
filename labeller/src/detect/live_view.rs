//! One view without an end, image by image.

use dataset::corpus::detections::SearchMode;
use dataset::geometry::camera::Camera;
use dataset::tables::health::HealthState;
use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::NoShift;
use sight::background::Background;

use super::mode::Mode;
use super::pairs::best_box::best_of;
use super::pictures::image::{Image, patch};
use super::sequence::{Sequence, Tracked, TrackedImage};
use crate::detector::Detector;
use crate::error::Result;
use crate::registration::Patch;
use crate::tiling::TilingSettings;
use crate::view_health::{CameraLook, CameraWatch};

/// Search image by image.
pub struct ViewSearch {
    detector: Box<dyn Detector + Send>,
    camera: Camera,
    sequence: Sequence,
    watch: CameraWatch,
    images: u32,
    last_s: Option<f64>,
}

/// Results for one image.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFindings {
    /// Boxes, best first.
    pub boxes: Vec<SeenBox>,
    /// Surroundings of the best box, for the registration with other views.
    pub patch: std::result::Result<Patch, NoShift>,
    /// Search mode.
    pub mode: SearchMode,
    /// Camera condition, by the images up to now.
    pub camera: HealthState,
    /// Background of the camera, with the image that completes it.
    pub background: Option<Background>,
}

/// A box that belongs to a track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenBox {
    /// The box in the image.
    pub pixel_box: PixelBox,
    /// Confidence of the model.
    pub score: f64,
    /// Track number within the view.
    pub track: u32,
    /// True if its track is confirmed at this moment and does not stand still, and the camera is well.
    pub counts: bool,
}

impl ViewSearch {
    pub(super) fn new(
        detector: Box<dyn Detector + Send>,
        tiling: TilingSettings,
        mode: Mode,
        camera: &Camera,
    ) -> Self {
        Self {
            detector,
            camera: *camera,
            sequence: Sequence::new(tiling, mode, None),
            watch: CameraWatch::new(camera),
            images: 0,
            last_s: None,
        }
    }

    /// This search for images that come in real time: searches of whole images are spread over several ones, and take at most a quarter of
    /// the time.
    #[must_use]
    pub fn spread(mut self) -> Self {
        self.sequence = self.sequence.spread();
        self
    }

    /// Forgets all images up to now, as of a camera that may look elsewhere. The detector stays loaded.
    pub fn begin_again(&mut self) {
        self.sequence.begin_again();
        self.watch = CameraWatch::new(&self.camera);
        (self.images, self.last_s) = (0, None);
    }

    /// This search as a new one of this camera. The detector stays loaded.
    pub fn of_camera(&mut self, camera: &Camera) -> &mut Self {
        self.camera = *camera;
        self.begin_again();
        self
    }

    /// Searches the next image. Damaged images and those that are left out are not passed; a time before the last one counts as that one.
    ///
    /// # Errors
    /// The detector or the conversion of the image fails.
    pub fn look(&mut self, image: &mut dyn Image, time_s: f64) -> Result<ImageFindings> {
        let time_s = self.last_s.map_or(time_s, |last_s| time_s.max(last_s));
        self.last_s = Some(time_s);
        let detector = &mut *self.detector;
        let TrackedImage { boxes, mode, .. } = self.sequence.look(detector, image, time_s)?;
        let ranked = |found: &Tracked| (found.confirmed_s.is_some(), found.score, found.pixel_box);
        let best = best_of(boxes.iter().map(ranked));
        let counted = best_of(boxes.iter().filter(|found| found.counts).map(ranked));
        let at = (self.images, time_s);
        self.images = self.images.wrapping_add(1);
        let patch = patch(image, best)?;
        let CameraLook {
            state, background, ..
        } = self.watch.look(at, image.lumas(), best, counted);
        let seen = |found: &Tracked| SeenBox {
            pixel_box: found.pixel_box,
            score: found.score,
            track: found.track,
            counts: found.counts && state.is_well(),
        };
        Ok(ImageFindings {
            boxes: boxes.iter().map(seen).collect(),
            patch,
            mode,
            camera: state,
            background,
        })
    }
}

#[cfg(test)]
mod tests {
    use dataset::corpus::detections::Detection;
    use dataset::corpus::model_identity::ModelIdentity;
    use dataset::numbers::frame_rate::FrameRate;
    use dataset::tables::registrations::Registration;
    use dataset::work::watch::Silent;
    use testkit::short_corpus;

    use super::super::pictures::{Pictures, ViewTicks};
    use super::super::view_search::cpu_time::CpuClock;
    use super::super::{DetectOptions, Model, detect_with};
    use super::*;
    use crate::detect::register_views;
    use crate::label::cameras;
    use crate::tiling::tests::blob_finder::{BlobFinder, paint_blob, paint_grey_blob};

    const MODEL: &str = "0123456789abcdef";
    const SIZE_PX: [u32; 2] = [1280, 768];

    fn blob(left: f64, top: f64) -> PixelBox {
        PixelBox::from_edges(left - 0.5, top - 0.5, left + 15.5, top + 7.5)
    }

    /// An aircraft in all images, a lamp, and something faint that passes.
    fn paint(view: &str, tick: u32, rgb: &mut [u8]) {
        rgb.fill(20);
        let from = if view == "left" { 100.0 } else { 630.0 };
        paint_blob(rgb, SIZE_PX[0], &blob(from + 4.0 * f64::from(tick), 200.0));
        paint_blob(rgb, SIZE_PX[0], &blob(900.0, 600.0));
        if tick > 20 {
            paint_grey_blob(
                rgb,
                SIZE_PX[0],
                &blob(60.0 + 3.0 * f64::from(tick), 400.0),
                200,
            );
        }
    }

    #[test]
    fn a_view_without_an_end_finds_image_by_image_what_detect_writes_as_counting_live() {
        let folder = tempfile::tempdir().unwrap();
        let rate = FrameRate {
            numerator: 4,
            denominator: 1,
        };
        let corpus = short_corpus::write_flight(folder.path(), "0001-a", SIZE_PX, rate, 60, &paint);
        let model = Model {
            identity: ModelIdentity {
                model: Some("blobs.onnx".into()),
                model_blake3: MODEL.repeat(4),
                profile_blake3: None,
            },
            profile: None,
        };
        let options = DetectOptions::default();
        let make = || Ok(Box::new(BlobFinder::default()) as Box<dyn Detector>);
        detect_with(&corpus, &model, &make, &options, &Silent).unwrap();

        let scenario = corpus.scenario("0001-a").open().unwrap();
        let cameras = cameras(&scenario, &scenario.record().unwrap()).unwrap();
        let (mut boxes, mut states, mut patches) = (Vec::new(), Vec::new(), Vec::new());
        for (view, camera) in ViewTicks::of(&scenario.frames().unwrap())
            .iter()
            .zip(&cameras)
        {
            let clock = CpuClock::start();
            let mut pictures = Pictures::open(&scenario, &view.id, &clock).unwrap();
            let detector = Box::new(BlobFinder::default());
            let mut live = ViewSearch::new(detector, options.settings, options.mode, camera);
            for tick in &view.ticks[..20] {
                pictures.next(tick).unwrap();
                live.look(&mut pictures, tick.time_s).unwrap();
            }
            live.begin_again();
            let mut pictures = Pictures::open(&scenario, &view.id, &clock).unwrap();
            let mut of_view = Vec::new();
            for tick in &view.ticks {
                pictures.next(tick).unwrap();
                let looked = live.look(&mut pictures, tick.time_s).unwrap();
                let seen =
                    |b: &SeenBox| (tick.tick, view.id.clone(), b.pixel_box, b.track, b.counts);
                boxes.extend(looked.boxes.iter().filter(|b| b.counts).map(seen));
                states.push((tick.tick, view.id.clone(), looked.camera));
                of_view.push(looked.patch);
            }
            patches.push(of_view);
        }

        let written = scenario.detections(MODEL).unwrap().boxes;
        let counts = |found: &&Detection| found.counts_live == Some(true);
        let mut counting: Vec<_> = (written.iter().filter(counts))
            .map(|b| (b.tick, b.view.clone(), b.pixel_box, b.track.unwrap(), true))
            .collect();
        counting.sort_by(|a, b| a.1.cmp(&b.1).then(a.0.cmp(&b.0)));
        assert!(counting.len() > 100, "{}", counting.len());
        assert_eq!(boxes, counting);
        let late = |found: &Detection| found.confirmed && found.counts_live == Some(false);
        assert!(written.iter().any(late), "confirmed before it counted");
        let mut health = scenario.health(MODEL).unwrap().unwrap();
        health.sort_by(|a, b| a.view.cmp(&b.view).then(a.tick.cmp(&b.tick)));
        let written: Vec<_> = (health.into_iter())
            .map(|row| (row.tick, row.view, row.state_live))
            .collect();
        assert_eq!(states, written);
        let registered: Vec<Registration> = scenario.registrations(MODEL).unwrap().unwrap();
        for row in registered {
            let tick = row.tick as usize;
            let patches = [0, 1].map(|view| &patches[view][tick]);
            let found = register_views([&cameras[0], &cameras[1]], patches);
            assert_eq!(found, row.result, "tick {tick}");
        }
    }
}
