//! `dtd estimate`: distances from camera feeds, while they run.

use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::io;
use std::path::{Path, PathBuf};
use std::thread;

use dataset::files::outside_file::{self, FileKind};
use labeller::tiling::TilingSettings;
use labeller::{DetectOptions, Searcher};
use live::{Options, Source};
use trainer::RunFolder;
use trainer::live::OnlineRun;

use super::Outcome;
use super::detect::refuse_other_models;
use super::output::print_json;
use super::train::failure_of;
use crate::args::estimate::{EstimateArgs, GivenOffset, OfView};
use crate::failure::{Ending, Failure};
use crate::shipped::Detector;
use crate::signals::CleanStop;

/// Runs the verb, until the recordings end or it is stopped.
pub(crate) fn run(args: &EstimateArgs) -> Outcome {
    let stop = CleanStop::begin();
    let is_stopped = || stop.switch().is_cancelled();
    let options = options(args)?;
    if args.check {
        let found = live::check(options, &is_stopped).map_err(failure)?;
        print_json(&found)?;
        let other = found.iter().find(|found| found.is_another_camera());
        if let Some(other) = other {
            let why = other.surroundings.as_ref().and_then(|of| of.why.as_deref());
            return Err(Failure::Failed(anyhow::anyhow!(
                "view {} from {}: {}",
                other.view,
                other.source,
                why.unwrap_or_default()
            )));
        }
        let absent = found.iter().find(|found| found.size_px.is_none());
        return match absent {
            None => Ok(Ending::Done),
            Some(absent) => Err(Failure::Failed(anyhow::anyhow!(
                "view {} from {} shows no images: {}",
                absent.view,
                absent.source,
                absent.why.as_deref().unwrap_or("it is not there")
            ))),
        };
    }
    let ready = |address| {
        if let Some(address) = address {
            eprintln!("estimate: metrics at http://{address}/metrics");
        }
    };
    live::estimate(options, Box::new(io::stdout()), &is_stopped, &ready).map_err(failure)?;
    Ok(Ending::Done)
}

fn options(args: &EstimateArgs) -> Result<Options, Failure> {
    let sources = by_view("--view", &args.views)?;
    let password_files = by_view("--password-file", &args.password_files)?;
    let (mut offsets_s, mut measured) = (BTreeMap::new(), BTreeSet::new());
    for (view, offset) in by_view("--offset", &args.offsets)? {
        match offset {
            GivenOffset::Seconds(seconds) => {
                offsets_s.insert(view, seconds);
            }
            GivenOffset::Auto => {
                measured.insert(view);
            }
        }
    }
    let insecure_tls: BTreeSet<String> = args.insecure_tls.iter().cloned().collect();
    let run = OnlineRun::open(&RunFolder::at(&args.run), args.estimator.as_deref())
        .map_err(failure_of)?;
    let model = Detector::chosen(args.model.as_deref())?;
    refuse_other_models(model.path())?;
    let search = DetectOptions {
        onnx_runtime: args.runtime.library.clone(),
        device: args.runtime.device.unwrap_or_default(),
        settings: TilingSettings {
            rows: args.rows,
            ..TilingSettings::default()
        },
        threads_per_worker: threads(),
        ..DetectOptions::default()
    };
    let searcher = Searcher::load(model.path(), &search).map_err(|error| failure(error.into()))?;
    refuse_another_detector(&run, &searcher)?;
    let passwords = passwords(&password_files, run.views())?;
    let with_password = |(view, source): (String, Source)| {
        let mut source = source.with_password(passwords.get(&view).cloned());
        if insecure_tls.contains(&view) {
            source = source.with_insecure_tls();
        }
        (view, source)
    };
    let options = Options {
        run,
        searcher,
        sources: sources.into_iter().map(with_password).collect(),
        without: args.without.clone(),
        offsets_s,
        measured,
        insecure_tls,
        keep_offsets: args.keep_offsets.clone(),
        as_fast_as_possible: args.as_fast_as_possible,
        metrics: args.metrics,
    };
    options.check().map_err(failure)?;
    Ok(options)
}

/// The values by view.
fn by_view<T: Clone>(option: &str, given: &[OfView<T>]) -> Result<BTreeMap<String, T>, Failure> {
    let mut all = BTreeMap::new();
    for OfView { view, value } in given {
        if all.insert(view.clone(), value.clone()).is_some() {
            return Err(Failure::bad_input_message(format!(
                "{option} {view} is given twice; a view has one"
            )));
        }
    }
    Ok(all)
}

/// Number of search threads. Searching a whole image delays the next images, so more cores help; small windows need few.
fn threads() -> usize {
    const MAX_COUNT: usize = 4;
    let cores = thread::available_parallelism().map_or(1, usize::from);
    cores.min(MAX_COUNT)
}

/// Rejects detectors other than the run's, whose boxes have other errors.
fn refuse_another_detector(run: &OnlineRun, searcher: &Searcher) -> Result<(), Failure> {
    let (name, trained_on) = run.model();
    let given = searcher.model().name();
    if given == trained_on {
        return Ok(());
    }
    let name = name.unwrap_or("a detector");
    Err(Failure::bad_input_message(format!(
        "the run was trained on boxes of {name} ({trained_on}), and this detector is {given}; give --model with the detector of the training"
    )))
}

/// Passwords by view: from files, else from the environment.
fn passwords(
    files: &BTreeMap<String, PathBuf>,
    views: &[String],
) -> Result<BTreeMap<String, String>, Failure> {
    let mut all = BTreeMap::new();
    for view in views {
        if let Ok(password) = env::var(variable_of(view)) {
            all.insert(view.clone(), password);
        }
    }
    for (view, path) in files {
        check_password_view(view, views)?;
        all.insert(view.clone(), first_line(path)?);
    }
    Ok(all)
}

fn check_password_view(view: &str, views: &[String]) -> Result<(), Failure> {
    if views.iter().any(|known| known == view) {
        return Ok(());
    }
    Err(Failure::bad_input_message(format!(
        "--password-file {view}: the run has no such view; its views are {}",
        views.join(", ")
    )))
}

/// The variable for a view's password: `DTD_PASSWORD_LEFT`.
fn variable_of(view: &str) -> String {
    let plain = |letter: char| {
        if letter.is_ascii_alphanumeric() {
            letter.to_ascii_uppercase()
        } else {
            '_'
        }
    };
    let name: String = view.chars().map(plain).collect();
    format!("DTD_PASSWORD_{name}")
}

fn first_line(path: &Path) -> Result<String, Failure> {
    let text = outside_file::read_text(path, FileKind::SETTINGS).map_err(Failure::bad_input)?;
    Ok(text.lines().next().unwrap_or_default().to_owned())
}

fn failure(error: live::Error) -> Failure {
    Failure::bad_input_if(error.is_bad_input(), error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_of_a_view_has_its_name_in_capitals() {
        assert_eq!(variable_of("left"), "DTD_PASSWORD_LEFT");
        assert_eq!(variable_of("tower-2 north"), "DTD_PASSWORD_TOWER_2_NORTH");
    }

    #[test]
    fn a_password_for_a_view_that_the_run_does_not_have_is_refused() {
        let views = ["left".to_owned(), "right".to_owned()];
        assert!(check_password_view(&views[1], &views).is_ok());
        assert!(check_password_view("rihgt", &views).is_err());
    }

    #[test]
    fn a_view_is_given_once() {
        let of = |value: &str| OfView {
            view: "left".into(),
            value: value.to_owned(),
        };
        assert!(by_view("--view", &[of("a"), of("b")]).is_err());
        assert_eq!(by_view("--view", &[of("a")]).unwrap()["left"], "a");
    }
}
