//! How well a detector finds aircraft before texture: a labelled corpus as it is, and the same frames with noise added.
//!
//! `cargo run --release --example detector_texture -- CORPUS MODEL.onnx [FRAMES [SCORE]]`, with `ORT_DISABLE_TELEMETRY=1` and
//! `ORT_DYLIB_PATH=$PWD/target/lib/dtd/libonnxruntime.so` in the environment. CORPUS must be one that the model was not trained on. The
//! search is the one of `dtd detect`. An aircraft that the training counts as hardly visible is neither a hit nor a miss.
//!
//! The noise lies over the whole frame, aircraft included, is equal in the three colours and has a root mean square of 4 grey levels:
//! streaks (white noise smoothed with a Gaussian of 40x3 px, as flat clouds look), smooth noise (2 px) and white noise. The same frame
//! gets the same noise in every run.

use std::error::Error;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::tables::pixel_box::PixelBox;
use detector_training::network::convolution::standard_normal;
use detector_training::samples::training_picture::{TrainingPicture, contrast, is_visible};
use labeller::detector::{Device, ModelFile, OrtDetector, OrtOptions, PictureView};
use labeller::tiling::{TilingSettings, find_aircraft};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const USUAL_FRAMES: usize = 240;
const NOISE_LEVELS: f32 = 4.0;
/// Contrast from which an aircraft is plain to the eye, grey levels.
const PLAIN_CONTRAST: f64 = 10.0;
/// Name, and deviations of the Gaussian that smooths the noise, across and down, pixels.
const NOISES: [(&str, Option<[f32; 2]>); 4] = [
    ("as they are", None),
    ("streaks 40x3 px, rms 4", Some([40.0, 3.0])),
    ("smooth 2 px, rms 4", Some([2.0, 2.0])),
    ("white, rms 4", Some([0.0, 0.0])),
];

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [corpus, model, rest @ ..] = arguments.as_slice() else {
        return Err("expected CORPUS MODEL.onnx [FRAMES [SCORE]]".into());
    };
    let count = rest.first().map_or(Ok(USUAL_FRAMES), |text| text.parse())?;
    let mut settings = TilingSettings::default();
    if let Some(score) = rest.get(1) {
        settings.score = score.parse()?;
    }
    let frames = frames(&Corpus::open(Path::new(corpus))?, count)?;
    println!(
        "| {} frames | recall | recall, contrast of {PLAIN_CONTRAST} levels | false boxes a frame |",
        frames.len()
    );
    println!("|---|---|---|---|");
    for (name, smoothing) in NOISES {
        let found = search_all(&frames, smoothing, Path::new(model), &settings)?;
        let recall = |least_contrast: f64| {
            let all = frames.iter().zip(&found);
            let visible = all.filter(|(frame, _)| frame.contrast >= least_contrast);
            let hits: Vec<bool> = visible
                .map(|(frame, found)| found.iter().any(|found| frame.is_hit(found)))
                .collect();
            let share = hits.iter().filter(|hit| **hit).count() as f64 / hits.len() as f64;
            format!("{:.1} % of {}", 100.0 * share, hits.len())
        };
        let false_boxes: usize = frames
            .iter()
            .zip(&found)
            .map(|(frame, found)| found.iter().filter(|found| !frame.is_hit(found)).count())
            .sum();
        println!(
            "| {name} | {} | {} | {:.3} |",
            recall(f64::MIN_POSITIVE),
            recall(PLAIN_CONTRAST),
            false_boxes as f64 / frames.len() as f64
        );
    }
    Ok(())
}

/// A frame with its aircraft.
struct Frame {
    picture: TrainingPicture,
    aircraft: Option<PixelBox>,
    /// Contrast of a visible aircraft, grey levels; otherwise 0.
    contrast: f64,
}

impl Frame {
    fn is_hit(&self, found: &PixelBox) -> bool {
        self.aircraft.is_some_and(|truth| {
            (found.cx_px - truth.cx_px).abs() < 0.5 * truth.width_px
                && (found.cy_px - truth.cy_px).abs() < 0.5 * truth.height_px.max(8.0)
        })
    }
}

/// About `count` frames, evenly spread over the videos.
fn frames(corpus: &Corpus, count: usize) -> Result<Vec<Frame>, Box<dyn Error>> {
    let mut videos = Vec::new();
    for folder in corpus.scenarios()? {
        let scenario = folder.open()?;
        for view in scenario.record()?.views {
            videos.push((folder.open()?, view));
        }
    }
    let per_video = count.div_ceil(videos.len().max(1));
    let mut frames = Vec::new();
    for (scenario, view) in videos {
        let boxes = scenario.truth_boxes()?;
        let step = (scenario.record()?.ticks as usize / per_video).max(1);
        let mut reader = scenario.open_video(&view)?;
        let (mut rgb, mut tick, mut taken) = (Vec::new(), 0, 0);
        while taken < per_video && reader.next_frame(&mut rgb)?.is_some() {
            if tick % step == step / 2 {
                let picture = TrainingPicture {
                    rgb: rgb.clone(),
                    width_px: reader.width() as usize,
                    height_px: reader.height() as usize,
                    aircraft: None,
                    cover: None,
                };
                let mut of_tick = boxes.iter().filter(|truth| truth.tick as usize == tick);
                let truth = of_tick.find(|truth| truth.view == view && truth.is_of_first());
                let visible = truth.filter(|truth| is_visible(&picture, truth));
                frames.push(Frame {
                    aircraft: truth.map(|truth| truth.pixel_box),
                    contrast: visible.map_or(0.0, |truth| contrast(&picture, &truth.pixel_box)),
                    picture,
                });
                taken += 1;
            }
            tick += 1;
        }
    }
    Ok(frames)
}

/// The detector's boxes in every frame, best first.
fn search_all(
    frames: &[Frame],
    smoothing: Option<[f32; 2]>,
    model: &Path,
    settings: &TilingSettings,
) -> Result<Vec<Vec<PixelBox>>, Box<dyn Error>> {
    let options = OrtOptions {
        library: None,
        device: Device::CPU,
        threads: std::thread::available_parallelism().map_or(1, usize::from),
    };
    let mut detector = OrtDetector::of(&ModelFile::read(model)?, &options)?;
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let size = frames.first().map_or([0; 2], |frame| {
        [frame.picture.width_px, frame.picture.height_px]
    });
    let noise = smoothing.map(|deviation_px| noise(size, deviation_px, &mut rng));
    let mut all = Vec::with_capacity(frames.len());
    for frame in frames {
        let picture = &frame.picture;
        let mut rgb = picture.rgb.clone();
        if let Some(noise) = &noise {
            if [picture.width_px, picture.height_px] != size {
                return Err("the frames differ in size, expected views of one size".into());
            }
            // The field has no edges, so it can begin anywhere.
            let start = rng.random_range(0..noise.len());
            for (place, pixel) in rgb.chunks_exact_mut(3).enumerate() {
                let more = NOISE_LEVELS * noise[(start + place) % noise.len()];
                for value in pixel {
                    *value = (f32::from(*value) + more).round().clamp(0.0, 255.0) as u8;
                }
            }
        }
        let view = PictureView {
            rgb: &rgb,
            width_px: picture.width_px as u32,
            height_px: picture.height_px as u32,
        };
        let found = find_aircraft(&mut detector, &view, settings)?;
        all.push(found.iter().map(|seen| seen.found.pixel_box).collect());
    }
    Ok(all)
}

/// Smoothed white noise with a root mean square of 1 that wraps around all edges.
fn noise([width, height]: [usize; 2], deviation_px: [f32; 2], rng: &mut ChaCha8Rng) -> Vec<f32> {
    let mut field: Vec<f32> = (0..width * height).map(|_| standard_normal(rng)).collect();
    let [across, down] = deviation_px;
    for lane in 0..height {
        smooth(&mut field, lane * width, 1, width, across);
    }
    for lane in 0..width {
        smooth(&mut field, lane, width, height, down);
    }
    let square = field.iter().map(|value| value * value).sum::<f32>() / field.len() as f32;
    field.iter().map(|value| value / square.sqrt()).collect()
}

/// Smooths one line of a field with a Gaussian.
fn smooth(field: &mut [f32], start: usize, step: usize, length: usize, deviation_px: f32) {
    if deviation_px == 0.0 {
        return;
    }
    let reach = (3.0 * deviation_px).ceil() as usize;
    let weights: Vec<f32> = (0..=2 * reach)
        .map(|k| (-0.5 * ((k as f32 - reach as f32) / deviation_px).powi(2)).exp())
        .collect();
    let line: Vec<f32> = (0..length + 2 * reach)
        .map(|k| field[start + (k + reach * (length - 1)) % length * step])
        .collect();
    for at in 0..length {
        let sum = weights
            .iter()
            .zip(&line[at..])
            .map(|(weight, value)| weight * value)
            .sum();
        field[start + at * step] = sum;
    }
}
