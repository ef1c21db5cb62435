//! Model card of exported models: inputs, behaviour with missing views, training data, and figures.

use std::fmt::Write;

use crate::evaluation::metrics::{ErrorFigures, Metrics};
use crate::export::{ExportedModel, TOLERANCE};
use crate::run::estimator::{Description, Estimator};
use crate::run::trained::TrainedRun;

/// The card as Markdown.
pub(super) fn text(
    run: &TrainedRun,
    metrics: Option<&Metrics>,
    exported: &[ExportedModel],
) -> String {
    let mut card = format!(
        "# Distance to touchdown from boxes\n\n\
         Estimators of a run of dtd {}, as ONNX models. Each was compared with this program's own answers when it was exported: \
         relative differences are at most {TOLERANCE:e}.\n\n",
        run.summary.dtd
    );
    models(&mut card, metrics, exported);
    inputs(&mut card, run);
    training(&mut card, run);
    card
}

fn models(card: &mut String, metrics: Option<&Metrics>, exported: &[ExportedModel]) {
    card.push_str(
        "| file | method | MAPE, two views or more | MAPE, at least one view |\n|---|---|---|---|\n",
    );
    for estimator in Estimator::ALL {
        let Description { name, how, .. } = estimator.description();
        let file = if exported.iter().any(|model| model.name == name) {
            format!("`{name}.onnx`")
        } else {
            format!("{name}: not exported, it needs cameras or whole flights")
        };
        let figures = metrics.and_then(|metrics| metrics.estimators.get(name));
        let [dual, combination] = [
            figures.and_then(|of| of.overall.dual.as_ref()),
            figures.and_then(|of| of.overall.combination.as_ref()),
        ]
        .map(percent);
        let _ = writeln!(card, "| {file} | {how} | {dual} | {combination} |");
    }
    card.push_str(match metrics {
        Some(_) => "\nFigures are of trajectories that no training saw, on the corpus of `metrics.json`.\n\n",
        None => "\nThe run was not evaluated when this was written: `dtd evaluate`, then export again.\n\n",
    });
}

fn percent(figures: Option<&ErrorFigures>) -> String {
    match figures {
        Some(ErrorFigures {
            mape_pct: Some(mape_pct),
            samples,
            ..
        }) => format!("{mape_pct:.3} % of {samples}"),
        _ => "–".into(),
    }
}

fn inputs(card: &mut String, run: &TrainedRun) {
    let normalisation = &run.normalisation;
    let views = normalisation.views.len();
    let _ = write!(
        card,
        "## Inputs and output\n\n\
         All numbers are double precision.\n\n\
         - `boxes` `[batch, {views}, 4]`: the aircraft's box in each view, in this order: {}. Centre right, centre down, width, height in \
         pixels of the full image; pixel (0, 0) is the centre of the top-left pixel. A box that the edge of the image cuts off is no \
         measurement: leave it out.\n\
         - `registrations` `[batch, {views}, 2]`, for `inverse_range.onnx` only: `dx_px` and `dy_px` of `registrations/*.parquet`, \
         where the aircraft of a view is, right and down of where it is in the reference view, in pixels. 0, 0 for the reference view \
         itself. Give only registrations of the object in the boxes.\n\
         - `distance_m` `[batch]`: distance to touchdown in metres.\n\n\
         A view that saw nothing has four NaN in `boxes`; a view that is not registered has NaN in `registrations`. A missing view is not \
         guessed: `paper_lstm` leaves it out of its sequence, the monoscopic estimators average over the others, and `inverse_range` \
         answers with the formula of the views that are there. Without a usable box, or without a formula for the views that are there, \
         `distance_m` is NaN.\n\n\
         Boxes unlike those of the training side count as missing, as in `dtd evaluate`, which also compares the views \
         over time and corrects cameras that moved or shook:\n\n\
         | view | image | centre right | centre down | width | height |\n|---|---|---|---|---|---|\n",
        normalisation.views.join(", ")
    );
    for (view, name) in normalisation.views.iter().enumerate() {
        let picture = run.summary.cameras.get(name).map_or("–".into(), |camera| {
            format!("{}x{}", camera.width_px, camera.height_px)
        });
        let ranges = normalisation.believed_px(view).map(|[least, most]| {
            if least > most {
                "none".into()
            } else {
                format!("{least:.1} to {most:.1}")
            }
        });
        let _ = writeln!(card, "| {name} | {picture} | {} |", ranges.join(" | "));
    }
    card.push_str(
        "\nThe cameras of this run were compared by their backgrounds. The models expect boxes and registrations that were moved to the \
         direction of the training in the same way, and do not move them.\n",
    );
}

fn training(card: &mut String, run: &TrainedRun) {
    let (summary, config) = (&run.summary, &run.config);
    let rig = &summary.rig;
    let vary = if summary.cameras_vary {
        ", whose cameras varied between scenarios"
    } else {
        ""
    };
    let moved = "one that was moved, or turned or zoomed further than its background shows, needs `dtd refit`, other cameras a training of their own";
    let farthest = config
        .max_dtd_nm
        .map_or(String::new(), |most| format!(" to {most}"));
    let deviations: Vec<String> = run
        .deviations_from_paper()
        .iter()
        .map(ToString::to_string)
        .collect();
    let method = format!("as in the paper, except for: {}", deviations.join(", "));
    let _ = write!(
        card,
        "\n## Training\n\n\
         - Rig `{rig}`{vary}. The models apply to these cameras only: {moved}.\n\
         - Boxes of the detector {} (`{}`); boxes of another detector need a training of their own.\n\
         - {} ticks of {} trajectories, decisions on {} of {} others; from {}{farthest} NM.\n\
         - `paper_lstm` was trained {method}.\n",
        summary.model.as_deref().unwrap_or("of unknown name"),
        summary.model_hash,
        summary.training_samples,
        summary.training_trajectories.len(),
        summary.validation_samples,
        summary.validation_trajectories.len(),
        config.min_dtd_nm,
    );
}
