//! What an estimator saw at its best, a typical and its worst tick: the pictures around the boxes.

use dataset::corpus::Corpus;
use dataset::pixel_box::PixelBox;
use dataset::units::METERS_PER_NAUTICAL_MILE;
use report_page::crop::Crop;
use report_page::{decimal, signed};
use serde::Serialize;

use crate::error::{Error, Result};
use crate::evaluation::metrics::Outcome;
use crate::samples::{Sample, Samples};

/// A tick, and what its views saw.
#[derive(Serialize)]
pub(super) struct Example {
    /// Which of the three it is.
    title: &'static str,
    scenario: String,
    tick: u32,
    true_nm: String,
    predicted_nm: String,
    error_pct: String,
    error_m: String,
    views: Vec<Shown>,
}

/// What one view saw.
#[derive(Serialize)]
struct Shown {
    view: String,
    crop: Option<Crop>,
    /// Left, top, width and height of the box in the crop, pixels.
    box_px: Option<[f64; 4]>,
    /// Why there is no picture.
    absent: Option<String>,
}

/// The ticks with the smallest, the median and the largest percentage error; none if an estimator answered none. A video that is missing or
/// damaged is named in the report and in the log.
///
/// # Errors
/// The disk is broken: the same report can be written once that is mended.
pub(super) fn examples(
    corpus: &Corpus,
    samples: &Samples,
    ticks: &[&Sample],
    outcomes: &[Outcome],
) -> Result<Vec<Example>> {
    let mut answers: Vec<(f64, f64, &Sample)> = (ticks.iter().zip(outcomes))
        .filter_map(|(&sample, outcome)| {
            Some((outcome.signed_error_pct()?, outcome.predicted_m?, sample))
        })
        .collect();
    answers.sort_by(|one, other| one.0.abs().total_cmp(&other.0.abs()));
    let Some(last) = answers.len().checked_sub(1) else {
        return Ok(Vec::new());
    };
    let example = |(title, place): (&'static str, usize)| {
        let (error_pct, predicted_m, sample) = answers[place];
        let nm = |metres: f64| decimal(metres / METERS_PER_NAUTICAL_MILE, 3);
        Ok(Example {
            title,
            scenario: samples.scenarios[sample.scenario].id.clone(),
            tick: sample.tick,
            true_nm: nm(sample.dtd_m),
            predicted_nm: nm(predicted_m),
            error_pct: signed(error_pct, 3),
            error_m: signed(predicted_m - sample.dtd_m, 1),
            views: views(corpus, samples, sample)?,
        })
    };
    [("Best", 0), ("Typical", last / 2), ("Worst", last)]
        .into_iter()
        .map(example)
        .collect()
}

fn views(corpus: &Corpus, samples: &Samples, sample: &Sample) -> Result<Vec<Shown>> {
    let scenario = &samples.scenarios[sample.scenario].id;
    let tick = sample.tick;
    let shown = |(view, seen): (&String, &Option<PixelBox>)| {
        let crop = match seen {
            None => Err("no box".to_owned()),
            Some(seen) => match cropped(corpus, scenario, view, tick, seen) {
                Ok(crop) => Ok(crop),
                Err(Error::Dataset(error)) if error.is_of_disk() => return Err(error.into()),
                Err(error) => {
                    tracing::warn!(scenario, tick, view, %error, "the report lacks a picture");
                    Err(format!("no picture: {error}"))
                }
            },
        };
        let box_px = seen
            .as_ref()
            .and_then(|seen| Some(crop.as_ref().ok()?.place_of(seen)));
        Ok(Shown {
            view: view.clone(),
            box_px,
            absent: crop.as_ref().err().cloned(),
            crop: crop.ok(),
        })
    };
    samples.views.iter().zip(&sample.boxes).map(shown).collect()
}

/// The picture around a box, from the sealed video.
fn cropped(
    corpus: &Corpus,
    scenario: &str,
    view: &str,
    tick: u32,
    seen: &PixelBox,
) -> Result<Crop> {
    let scenario = corpus.scenario(scenario).open()?;
    let pts = scenario.record()?.frame_rate.pts_of_tick(tick);
    let mut video = scenario.open_video(view)?;
    video.seek(pts)?;
    let mut rgb = Vec::new();
    let found = loop {
        match video.skip_frame()? {
            Some(earlier) if earlier < pts => {}
            found => break found,
        }
    };
    if found != Some(pts) {
        return Err(dataset::Error::corpus(
            scenario.folder().root(),
            format!("the video of view {view} has no picture of tick {tick}"),
        )
        .into());
    }
    video.convert(&mut rgb)?;
    Ok(Crop::around(seen, &rgb, [video.width(), video.height()])?)
}
