//! `dtd export-estimators`: a run's estimators as ONNX models, each checked against ONNX Runtime before anything is written.

use std::path::Path;
use std::time::Instant;

use dataset::corpus::workshop::new_folder;
use labeller::detector::{NumberInput, run_numbers};
use serde::Serialize;
use trainer::{Agreement, ExportedModel, ExportedRun, Probes, RunFolder, TOLERANCE};

use super::Outcome;
use super::output::{Next, finish, print_json};
use super::train::failure_of;
use crate::args::estimator::ExportEstimatorsArgs;
use crate::failure::{Ending, Failure};

const CARD: &str = "MODEL_CARD.md";

/// An exported file, as JSON.
#[derive(Serialize)]
struct Exported<'a> {
    estimator: &'static str,
    file: String,
    takes_registrations: bool,
    /// Number of inputs in the check.
    probes: usize,
    answered: usize,
    /// Largest relative difference from this program's answers.
    largest_difference: f64,
    #[serde(skip)]
    onnx: &'a [u8],
}

/// Runs the verb.
pub(crate) fn run(args: &ExportEstimatorsArgs) -> Outcome {
    let began = Instant::now();
    let ExportedRun {
        models,
        card,
        probes,
    } = trainer::export(&RunFolder::at(&args.run)).map_err(failure_of)?;
    let mut exported = Vec::new();
    for model in &models {
        let file = format!("{}.onnx", model.name);
        let agreement = checked(model, &file, &probes, args.library.as_deref())?;
        exported.push(Exported {
            estimator: model.name,
            file,
            takes_registrations: model.takes_registrations,
            probes: probes.ticks,
            answered: agreement.answered,
            largest_difference: agreement.largest,
            onnx: &model.onnx,
        });
    }
    let card = (CARD, card.as_bytes());
    let files = exported
        .iter()
        .map(|model| (model.file.as_str(), model.onnx));
    let files: Vec<_> = files.chain([card]).collect();
    new_folder::write(&args.out, &files).map_err(Failure::of_corpus)?;
    if args.json {
        print_json(&exported)?;
    } else {
        for model in &exported {
            println!(
                "{}: {} bytes, ONNX Runtime's answers differ by {:.1e} at most, over {} of {} probes",
                args.out.join(&model.file).display(),
                model.onnx.len(),
                model.largest_difference,
                model.answered,
                model.probes
            );
        }
        println!("how to use them: {}", args.out.join(CARD).display());
    }
    finish("export-estimators", began, &Next::default());
    Ok(Ending::Done)
}

/// Agreement of ONNX Runtime with us about a model; an error if they disagree.
fn checked(
    model: &ExportedModel,
    file: &str,
    probes: &Probes,
    library: Option<&Path>,
) -> Result<Agreement, Failure> {
    let input = |name, numbers, length| NumberInput {
        name,
        shape: [probes.ticks, probes.views, length],
        numbers,
    };
    let mut inputs = vec![input("boxes", &probes.boxes[..], 4)];
    if model.takes_registrations {
        let registrations = &probes.registrations[..];
        inputs.push(input("registrations", registrations, 2));
    }
    let answers = run_numbers(Path::new(file), &model.onnx, &inputs, library)
        .map_err(|error| Failure::bad_input_if(error.is_bad_input(), error))?;
    let agreement = model.agreement(&answers);
    if agreement.largest <= TOLERANCE {
        return Ok(agreement);
    }
    let [answer_m, expected_m] = agreement.worst_m;
    Err(Failure::Failed(anyhow::anyhow!(
        "{file}: ONNX Runtime answers {answer_m} m where this program answers {expected_m} m, expected the same to {TOLERANCE:e}; \
         nothing was written. Try another version of ONNX Runtime, with --onnx-runtime"
    )))
}
