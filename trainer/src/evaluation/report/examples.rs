//! Images around the boxes at an estimator's best, a typical and its worst tick.

use dataset::corpus::Corpus;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::pixel_box::PixelBox;
use report_page::crop::Crop;
use report_page::{decimal, signed};
use serde::Serialize;

use crate::error::Result;
use crate::evaluation::metrics::Outcome;
use crate::samples::{Sample, Samples};

/// A tick, and what its views saw.
#[derive(Serialize)]
pub(super) struct Example {
    /// Title: one of the three kinds.
    title: &'static str,
    scenario: String,
    tick: u32,
    true_nm: String,
    predicted_nm: String,
    error_pct: String,
    error_m: String,
    views: Vec<Shown>,
}

/// A view's image.
#[derive(Serialize)]
struct Shown {
    view: String,
    crop: Option<Crop>,
    /// Left, top, width and height of the line around the box in the crop, pixels.
    box_px: Option<[f64; 4]>,
    /// Reason for a missing image.
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
    let opened = unless_of_disk(corpus.scenario(scenario).open())?;
    let shown = |(view, seen): (&String, &Option<PixelBox>)| {
        let Some(seen) = seen else {
            return Ok(Shown::without(view, "no box".to_owned()));
        };
        let picture = match &opened {
            Ok(opened) => unless_of_disk(opened.picture(view, tick))?,
            Err(fault) => Err(fault.clone()),
        };
        let crop = picture.and_then(|picture| {
            Crop::around(seen, &picture.rgb, picture.size_px).map_err(|error| error.to_string())
        });
        match crop {
            Ok(crop) => Ok(Shown {
                view: view.clone(),
                box_px: Some(crop.frame_of(seen)),
                crop: Some(crop),
                absent: None,
            }),
            Err(fault) => {
                tracing::warn!(scenario, tick, view, %fault, "the report lacks an image");
                Ok(Shown::without(view, format!("no image: {fault}")))
            }
        }
    };
    samples.views.iter().zip(&sample.boxes).map(shown).collect()
}

impl Shown {
    fn without(view: &str, absent: String) -> Self {
        Self {
            view: view.to_owned(),
            crop: None,
            box_px: None,
            absent: Some(absent),
        }
    }
}

/// The result, or the fault in words if a file is missing or damaged.
///
/// # Errors
/// The disk is broken.
fn unless_of_disk<T>(found: dataset::Result<T>) -> Result<std::result::Result<T, String>> {
    match found {
        Err(error) if error.is_of_disk() => Err(error.into()),
        found => Ok(found.map_err(|error| error.to_string())),
    }
}
