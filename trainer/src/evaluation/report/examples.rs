//! Images around the boxes at an estimator's best, a typical and its worst tick.

use dataset::corpus::Corpus;
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use minijinja::{Value, context};
use report_page::crop::Crop;
use report_page::page::value;
use report_page::{decimal, signed};

use crate::error::Result;
use crate::evaluation::metrics::Outcome;
use crate::samples::{Sample, Samples};

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
) -> Result<Vec<Value>> {
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
        Ok(context! {
            title,
            scenario => &samples.scenarios[sample.scenario].id,
            tick => sample.tick,
            true_nm => nm(sample.dtd_m),
            predicted_nm => nm(predicted_m),
            error_pct => signed(error_pct, 3),
            error_m => signed(predicted_m - sample.dtd_m, 1),
            views => views(corpus, samples, sample)?,
        })
    };
    [("Best", 0), ("Typical", last / 2), ("Worst", last)]
        .into_iter()
        .map(example)
        .collect()
}

/// The image of each view, or why there is none.
fn views(corpus: &Corpus, samples: &Samples, sample: &Sample) -> Result<Vec<Value>> {
    let scenario = &samples.scenarios[sample.scenario].id;
    let tick = sample.tick;
    let opened = unless_of_disk(corpus.scenario(scenario).open())?;
    let shown = |(index, view): (usize, &String)| {
        let Some(seen) = sample.best(index) else {
            return Ok(context! { view, absent => "no box" });
        };
        let picture = match &opened {
            Ok(opened) => unless_of_disk(opened.picture(view, tick))?,
            Err(fault) => Err(fault.clone()),
        };
        let crop = picture.and_then(|picture| {
            Crop::around(seen, &picture.rgb, picture.size_px).map_err(|error| error.to_string())
        });
        match crop {
            Ok(crop) => {
                let box_px = crop.frame_of(seen);
                Ok(context! { view, box_px, crop => value(crop) })
            }
            Err(fault) => {
                tracing::warn!(scenario, tick, view, %fault, "the report lacks an image");
                Ok(context! { view, absent => format!("no image: {fault}") })
            }
        }
    };
    samples.views.iter().enumerate().map(shown).collect()
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
