//! How well a detector finds aircraft before texture: a labelled corpus as it is, and the same frames with noise added.
//!
//! `cargo run --release --example detector_texture -- CORPUS MODEL.onnx [FRAMES [SCORE]]`, with `ORT_DISABLE_TELEMETRY=1` and
//! `ORT_DYLIB_PATH=$PWD/target/lib/dtd/libonnxruntime.so` in the environment. CORPUS must be one that the model was not trained on. The
//! search is that of `dtd detect`; frames, visibility and errors are those of `dtd train-detector`'s report.
//!
//! The noise lies over the whole frame, aircraft included, is equal in the three colours and has a root mean square of 4 grey levels:
//! streaks (white noise smoothed with a Gaussian of 40x3 px, as flat clouds look), smooth noise (2 px) and white noise. The same frame
//! gets the same noise in every run.

use std::error::Error;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::work::watch::Silent;
use detector_training::evaluation::{Evaluation, Spread, judge};
use detector_training::grid::ScoredBox;
use detector_training::network::convolution::standard_normal;
use detector_training::samples::corpus_samples::{JudgedFrame, read_frames, videos};
use detector_training::samples::training_picture::contrast;
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
    let corpus = Corpus::open(Path::new(corpus))?;
    let videos = videos(&corpus, &[Side::Train, Side::Validation, Side::Test])?;
    let frames = read_frames(&videos, count, &Silent)?;
    let plain = |frame: &JudgedFrame| {
        let truth = frame.picture.aircraft.filter(|truth| truth.visible);
        truth.is_some_and(|truth| contrast(&frame.picture, &truth.pixel_box) >= PLAIN_CONTRAST)
    };
    let is_plain: Vec<bool> = frames.iter().map(plain).collect();

    println!(
        "| {} frames | recall | recall, contrast of {PLAIN_CONTRAST} levels | false boxes a frame |",
        frames.len()
    );
    println!("|---|---|---|---|");
    let mut undisturbed = None;
    for (name, smoothing) in NOISES {
        let found = search_all(&frames, smoothing, Path::new(model), &settings)?;
        let all = judge(&frames, &found, settings.score);
        let (plain_frames, plain_found): (Vec<_>, Vec<_>) = frames
            .iter()
            .zip(&found)
            .zip(&is_plain)
            .filter(|&(_, &keep)| keep)
            .map(|((frame, found), _)| (frame.clone(), found.clone()))
            .unzip();
        let plain = judge(&plain_frames, &plain_found, settings.score);
        println!(
            "| {name} | {:.1} % of {} | {:.1} % of {} | {:.3} |",
            100.0 * all.recall,
            all.visible,
            100.0 * plain.recall,
            plain.visible,
            all.false_per_frame
        );
        undisturbed.get_or_insert(all);
    }
    if let Some(evaluation) = undisturbed {
        print_errors(&evaluation);
    }
    Ok(())
}

/// The detector's boxes in every frame, best first.
fn search_all(
    frames: &[JudgedFrame],
    smoothing: Option<[f32; 2]>,
    model: &Path,
    settings: &TilingSettings,
) -> Result<Vec<Vec<ScoredBox>>, Box<dyn Error>> {
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
        all.push(
            found
                .into_iter()
                .map(|sighting| ScoredBox {
                    pixel_box: sighting.found.pixel_box,
                    score: sighting.found.score,
                })
                .collect(),
        );
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

fn print_errors(evaluation: &Evaluation) {
    println!(
        "\n| frames as they are: width, px | visible | recall | centre right | centre down | width | height |"
    );
    println!("|---|---|---|---|---|---|---|");
    let spread = |spread: Option<Spread>| {
        spread.map_or("-".into(), |s| {
            format!("{:+.2} ± {:.2}", s.median, s.deviation)
        })
    };
    for bin in &evaluation.by_width {
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            bin.width_up_to_px
                .map_or("wider".into(), |px| format!("up to {px}")),
            bin.visible,
            bin.recall
                .map_or("-".into(), |recall| format!("{:.1} %", 100.0 * recall)),
            spread(bin.cx_px),
            spread(bin.cy_px),
            spread(bin.width_px),
            spread(bin.height_px)
        );
    }
}
