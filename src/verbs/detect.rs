//! `dtd detect`: finds the aircraft in the decoded videos, and registers the views with each other.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::iter;
use std::path::Path;
use std::time::Instant;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{choose, models_of};
use dataset::corpus::splits::Side;
use dataset::plan::Plan;
use dataset::work::watch::Watch;
use generator::plan::shard::Shard;
use labeller::{
    DetectOptions, DetectOutcome, FalseBoxes, FittedCameras, RegistrationCounts, TruthCounts,
    Unhealthy, detect_corpus,
};
use trainer::RunFolder;

use super::Outcome;
use super::open_corpus::{open_filled_corpus, repair};
use super::output::{Next, count, failed, finish, interrupted, print_json};
use super::train::{failure_of, has_scenario_on};
use crate::args::detector::DetectArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;
use crate::shipped::Detector;

/// Runs the verb.
pub(crate) fn run(args: &DetectArgs) -> Outcome {
    let began = Instant::now();
    let corpus = open_filled_corpus(&args.corpus)?;
    let mut only = args.search.scenarios(&corpus)?;
    if let Some(part) = of_shard(&corpus, args.shard.or_of_environment("detect")?)? {
        only = Some(match only {
            Some(only) => &only & &part,
            None => part,
        });
    }
    let model = Detector::chosen(args.model.as_deref())?;
    let outcome = detect(
        &corpus,
        model.path(),
        DetectOptions {
            settings: args.search.settings(&corpus)?,
            mode: args.mode,
            only,
            force: args.force,
            registration_of: args
                .registration_of
                .as_deref()
                .map(fitted_cameras)
                .transpose()?,
            ..args.runtime.options()
        },
    )?;
    if args.json {
        print_json(&outcome)?;
    } else {
        print_summary(&outcome);
    }
    let ending = ending_of(&outcome);
    if ending == Ending::Done {
        // A scenario that cannot be read costs the hint, and not the search.
        let hint = next(&corpus, &outcome).unwrap_or_default();
        finish("detect", began, &hint);
    }
    Ok(ending)
}

/// The cameras that a run has fitted.
fn fitted_cameras(run: &Path) -> Result<FittedCameras, Failure> {
    let (run_blake3, cameras) = trainer::fitted_cameras(&RunFolder::at(run)).map_err(failure_of)?;
    Ok(FittedCameras {
        run_blake3,
        cameras,
    })
}

/// Next step for the corpus.
fn next(corpus: &Corpus, outcome: &DetectOutcome) -> Result<Next, Failure> {
    let folders = corpus.scenarios().map_err(Failure::of_corpus)?;
    let mut is_labelled = true;
    for folder in &folders {
        if !models_of(folder)?.contains(&outcome.model_hash) {
            // Other shards detect these scenarios, or the caller excluded them.
            return Ok(Next::default());
        }
        is_labelled &= folder.open()?.truth_boxes_if_labelled()?.is_some();
    }
    if outcome.counts.confirmed == 0 {
        eprint_warning!("detect: no track was confirmed");
        return Ok(Next::verb("view", corpus.root()));
    }
    if !is_labelled {
        return Ok(Next::verb("label", corpus.root()));
    }
    if ![Side::Train, Side::Validation]
        .iter()
        .all(|side| has_scenario_on(corpus, *side))
    {
        return Ok(Next::verb("view", corpus.root()));
    }
    let train = Next::verb("train", corpus.root())
        .and("--out")
        .and(new_run());
    Ok(match choose(&folders, None)? {
        Ok(_) => train,
        Err(_) => train.and("--detections").and(&outcome.model_hash),
    })
}

/// An unused name for a run.
fn new_run() -> String {
    let names = iter::once("run".to_owned()).chain((2..).map(|number| format!("run{number}")));
    let mut free = names.filter(|name| !Path::new(name).exists());
    free.next().unwrap_or_default()
}

/// The shard's scenarios; `None`: all.
fn of_shard(corpus: &Corpus, shard: Shard) -> Result<Option<BTreeSet<String>>, Failure> {
    if shard.is_whole() {
        return Ok(None);
    }
    let plan = Plan::read(&corpus.plan_path()).map_err(Failure::of_corpus)?;
    let part = shard.part_of(&plan.scenarios);
    Ok(Some(part.map(|scenario| scenario.id.clone()).collect()))
}

/// The ending of a run; prints how much is left if it was stopped.
pub(crate) fn ending_of(outcome: &DetectOutcome) -> Ending {
    if outcome.stopped && !outcome.left.is_empty() {
        let searched = outcome.detected.len() + outcome.registered.len();
        interrupted(searched, "searched", outcome.left.len())
    } else {
        Ending::with_losses(&outcome.failed)
    }
}

/// Detects in a corpus with a progress bar. Ctrl-C or SIGTERM ends it after the current images; scenarios that are done stay.
pub(crate) fn detect(
    corpus: &Corpus,
    model: &Path,
    options: DetectOptions,
) -> Result<DetectOutcome, Failure> {
    refuse_other_models(model)?;
    let watch = VerbWatch::new("detect", "images");
    let outcome = detect_corpus(corpus, model, &options, &watch).map_err(search_failure)?;
    for failure in &outcome.failed {
        watch.warn(&format!(
            "scenario {} was not searched: {}",
            failure.id, failure.reason
        ));
    }
    if !outcome.failed.is_empty() {
        watch.warn(&repair(corpus.root()));
    }
    for line in false_boxes_warning(corpus.root(), &outcome.false_boxes) {
        watch.warn(&line);
    }
    Ok(outcome)
}

/// The failure of a search or of labelling.
pub(crate) fn search_failure(error: labeller::Error) -> Failure {
    match error {
        labeller::Error::Dataset(error) => Failure::of_corpus(error),
        error => Failure::bad_input_if(error.is_bad_input(), error),
    }
}

/// Rejects a path that is not a file and so not a detector.
pub(crate) fn refuse_other_models(model: &Path) -> Result<(), Failure> {
    if model.is_file() {
        return Ok(());
    }
    Err(Failure::bad_input_message(format!(
        "{} is not there: --model expects an ONNX file; without it, the bundled detector is used",
        model.display()
    )))
}

/// Views that a line names.
const MAX_NAMED: usize = 5;

fn print_summary(outcome: &DetectOutcome) {
    let registered = match outcome.registered.len() {
        0 => String::new(),
        registered => format!(", {registered} searched before and measured now"),
    };
    println!(
        "{} searched{registered}, {} unchanged{}",
        count(outcome.detected.len(), "scenario"),
        outcome.unchanged.len(),
        failed(outcome.failed.len()),
    );
    if outcome.counts.pictures == 0 {
        return;
    }
    println!(
        "{} on {}: detections/{}.parquet",
        outcome.model, outcome.device, outcome.model_hash
    );
    println!(
        "{} detections in {} images, {} of them in confirmed tracks",
        outcome.counts.detections, outcome.counts.pictures, outcome.counts.confirmed
    );
    if let Some(truth) = &outcome.counts.against_truth {
        println!("{}", in_sight(truth));
        if let Some(error_px) = truth.mean_center_error_px() {
            println!("mean distance of box centres from the truth {error_px:.2} px");
        }
        println!("{} false detections", truth.false_detections);
    }
    print_registrations(&outcome.registrations);
    print_without_background(&outcome.without_background);
    warn_of_cameras(&outcome.unhealthy);
}

/// Says where too little background is visible to notice that a camera is turned.
fn print_without_background(views: &[String]) {
    if views.is_empty() {
        return;
    }
    let named = views.iter().take(MAX_NAMED).map(String::as_str);
    println!(
        "most images of {} show too little background to notice that a camera is turned: {}{}",
        count(views.len(), "view"),
        named.collect::<Vec<_>>().join(", "),
        more(views.len())
    );
}

/// Views beyond those that are named.
fn more(views: usize) -> String {
    match views.saturating_sub(MAX_NAMED) {
        0 => String::new(),
        more => format!("; and {more} more"),
    }
}

/// Warns of cameras that moved, shook or repeated images, the worst views first.
fn warn_of_cameras(unhealthy: &[Unhealthy]) {
    let mut views: Vec<&Unhealthy> = unhealthy.iter().collect();
    views.sort_by_key(|view| Reverse(view.ill_ticks()));
    let named: Vec<String> = (views.iter().take(MAX_NAMED))
        .map(|view| {
            let counts = [
                (view.frozen, "frozen"),
                (view.moved, "moved"),
                (view.shaking, "shaking"),
            ];
            let counts = counts.iter().filter(|(ticks, _)| *ticks > 0);
            let counts = counts.map(|(ticks, what)| format!("{ticks} {what}"));
            let faults: Vec<_> = counts.collect();
            format!("{} {}: {}", view.scenario, view.view, faults.join(", "))
        })
        .collect();
    if named.is_empty() {
        return;
    }
    let more = more(views.len());
    eprint_warning!(
        "detect: cameras of {} moved, shook or repeated images (ticks): {}{more}; health/ says when",
        count(views.len(), "view"),
        named.join("; ")
    );
}

/// Share of the images that show the aircraft where it was found, and the number of images that hide it.
pub(crate) fn in_sight(truth: &TruthCounts) -> String {
    let hidden = [
        (truth.hidden_by_haze, "beyond the visibility"),
        (truth.maybe_hidden_by_cloud, "in or above clouds"),
    ];
    let hidden: String = hidden
        .into_iter()
        .filter(|(images, _)| *images > 0)
        .map(|(images, place)| format!(", {images} with the aircraft {place}"))
        .collect();
    match truth.detection_rate() {
        Some(rate) => format!(
            "found in {:.2} % of the {} images with the aircraft in sight{hidden}",
            100.0 * rate,
            truth.expected
        ),
        None => format!("no image with the aircraft in sight{hidden}"),
    }
}

/// The lines of the warning that confirmed boxes are not the aircraft; none if all are.
fn false_boxes_warning(corpus: &Path, false_boxes: &[FalseBoxes]) -> Vec<String> {
    if false_boxes.is_empty() {
        return Vec::new();
    }
    let boxes: u64 = false_boxes.iter().map(|of| of.boxes).sum();
    let named = false_boxes.iter().take(MAX_NAMED).map(|of| {
        format!(
            "  {} {}: {} of {} near ({:.0}, {:.0}) px from tick {}",
            of.scenario,
            of.view,
            count(of.boxes as usize, "detection"),
            count(of.tracks, "track"),
            of.cx_px,
            of.cy_px,
            of.tick
        )
    });
    let first = format!(
        "{} of confirmed tracks, none of which touches the aircraft; look at them with `dtd view {}`:",
        count(boxes as usize, "false detection"),
        corpus.display()
    );
    let others = false_boxes.len().saturating_sub(MAX_NAMED);
    let last = (others > 0).then(|| format!("  and {}", count(others, "other view")));
    iter::once(first).chain(named).chain(last).collect()
}

/// Prints the number of pairs of views that were registered, and the reasons why others were not.
fn print_registrations(counts: &RegistrationCounts) {
    if counts.pairs == 0 {
        return;
    }
    let reasons = counts.unanswered.iter();
    let reasons: Vec<_> = reasons
        .map(|(reason, pairs)| format!("{pairs} {reason}"))
        .collect();
    let others = match reasons.as_slice() {
        [] => String::new(),
        reasons => format!(" (others: {})", reasons.join(", ")),
    };
    println!(
        "{} of {} pairs of views registered{others}",
        counts.answered, counts.pairs
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_whose_aircraft_is_hidden_are_counted_apart() {
        let mut truth = TruthCounts {
            expected: 200,
            found: 199,
            hidden_by_haze: 30,
            ..Default::default()
        };
        assert_eq!(
            in_sight(&truth),
            "found in 99.50 % of the 200 images with the aircraft in sight, 30 with the aircraft beyond the visibility"
        );
        truth.expected = 0;
        truth.maybe_hidden_by_cloud = 7;
        assert_eq!(
            in_sight(&truth),
            "no image with the aircraft in sight, 30 with the aircraft beyond the visibility, 7 with the aircraft in or above clouds"
        );
    }

    #[test]
    fn the_warning_about_false_detections_names_the_worst_views_and_counts_the_others() {
        let of = |boxes: u64| FalseBoxes {
            scenario: "1900-rain-r1".into(),
            view: "left".into(),
            boxes,
            tracks: 1,
            tick: 12,
            cx_px: 351.6,
            cy_px: 961.2,
        };
        let all: Vec<_> = [9, 8, 7, 6, 5, 4, 3].map(of).into();
        let said = false_boxes_warning(Path::new("corpus"), &all);
        assert_eq!(said.len(), 7);
        let said = said.join("\n");
        assert!(
            said.starts_with("42 false detections of confirmed tracks"),
            "{said}"
        );
        assert!(said.contains("`dtd view corpus`"), "{said}");
        assert!(
            said.contains(
                "1900-rain-r1 left: 9 detections of 1 track near (352, 961) px from tick 12"
            ),
            "{said}"
        );
        assert!(said.ends_with("\n  and 2 other views"), "{said}");
        assert!(false_boxes_warning(Path::new("corpus"), &[]).is_empty());
    }
}
