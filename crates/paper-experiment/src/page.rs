//! `paper.md`: each table and figure of the paper beside ours, or the reason why there is none.

mod estimators;
mod table;

use crate::published::{SCALED_NM, SINGLE_VIEW_SHARE, TILES_NM};
use crate::results::{Range, Results, Search};
use crate::single_views::Share;
use table::{Table, number};

/// Folder of the figures, beside the page.
pub(crate) const IMAGES: &str = "images/paper";
pub(crate) const CONCEPT: &str = "concept.svg";
pub(crate) const FRAME: &str = "at-6-nm.jpg";
pub(crate) const PROFILE: &str = "profile.svg";
pub(crate) const SEGMENTATION: &str = "segmentation.jpg";
pub(crate) const CONVERGENCE: &str = "convergence.svg";
pub(crate) const ERRORS: &str = "errors-by-distance.svg";

/// What is not done, and why.
const NOT_DONE: [[&str; 2]; 8] = [
    [
        "100 recorded landings, MAPE 0.33 % (figures 6 and 7)",
        "no recordings of an airport are at hand",
    ],
    [
        "views merged from several cameras, false boxes at their seams",
        "these need such recordings",
    ],
    [
        "surveillance tracks as ground truth",
        "these need such recordings; here labels follow from poses",
    ],
    ["use at a tower", "no tower is at hand"],
    [
        "several aircraft in one picture",
        "the search handles them, but no scenario has more than one",
    ],
    [
        "a new camera by its calibration network alone; other sizes of the networks",
        "docs/results.md has both with other cameras (`dtd refit`, `dtd train --search`)",
    ],
    [
        "YOLOv7 with TensorRT, 28 ms on a GPU",
        "the licence of YOLOv7 is the GPL; times here are of a CPU",
    ],
    [
        "future work: re-aimed view, more weather and light, transfer from simulated to real video",
        "the transfer needs such recordings; sweeps have the rest",
    ],
];

/// The page.
pub fn markdown(results: &Results) -> String {
    let parts = [
        introduction(results),
        data(results),
        ranges(results),
        estimators::by_condition(results),
        estimators::by_cell(results),
        estimators::by_distance(results),
        estimators::all(results),
        estimators::single_views(results),
        estimators::training(results),
        figures(),
        times(results),
        not_done(),
    ];
    parts.join("\n\n") + "\n"
}

fn introduction(results: &Results) -> String {
    let Results {
        dtd,
        corpus,
        recommended,
        ..
    } = results;
    format!(
        "# The paper's experiment\n\n\
         Made by `dtd paper --scale {}` (version {dtd}); [paper.json](results/paper.json) has the figures. The pictures are from {},\n\
         not from X-Plane. `paper_lstm` has the paper's networks, losses and rules; `{recommended}` is the estimator that its run\n\
         recommends. Errors are from 1 to 10 NM, in percent. Percentages of the paper are for its own pictures and flights.",
        corpus.scale, corpus.simulator
    )
}

fn data(results: &Results) -> String {
    let corpus = &results.corpus;
    let weaker = &results.weaker;
    let by_trajectory = &results.by_trajectory.split;
    let by_scenario = &results.by_scenario.split;
    let mut table = Table::new(&["data (table 1)", "paper", "here"]);
    let mut row =
        |what: &str, paper: &str, here: String| table.row([what.into(), paper.into(), here]);
    row("scenarios", "100", corpus.scenarios.to_string());
    row(
        "different flights",
        "not stated",
        corpus.flights.to_string(),
    );
    row(
        "pictures",
        "1920x1280, 30 per second",
        format!(
            "{}x{}, {} per second, {} in all",
            corpus.width_px, corpus.height_px, corpus.frame_rate, corpus.pictures
        ),
    );
    row(
        "scenarios that train, validate, judge",
        "70, 0, 30",
        format!(
            "{}, {}, {} with other flights; {}, {}, {} drawn, as in the paper",
            by_trajectory.train.scenarios,
            by_trajectory.validation.scenarios,
            by_trajectory.test.scenarios,
            by_scenario.train.scenarios,
            by_scenario.validation.scenarios,
            by_scenario.test.scenarios
        ),
    );
    row(
        "training samples",
        "496,000",
        format!(
            "{}; {}",
            by_trajectory.train.samples, by_scenario.train.samples
        ),
    );
    row(
        "ticks that one view alone sees",
        &format!("{:.0} %", 100.0 * SINGLE_VIEW_SHARE),
        format!("{} %", percent(weaker.single_views.all)),
    );
    let far = |share: &[(u32, Share)]| {
        let cells = share
            .iter()
            .map(|(nm, share)| format!("{nm}: {}", percent(*share)));
        cells.collect::<Vec<_>>().join(", ")
    };
    let by_nm: Vec<_> = weaker
        .single_views
        .by_nm
        .iter()
        .map(|(nm, share)| (*nm, *share))
        .collect();
    let by_weather = weaker.single_views.by_weather.iter();
    let by_weather = by_weather.map(|(name, share)| format!("{name} {}", percent(*share)));
    format!(
        "## Data\n\n{}\n\n\
         The weaker detector, whose boxes train and judge, shrinks pictures to 1/{} for its first pass and drops boxes with scores below\n\
         {} (`first_pass_shrink`, `least_score`); with the detector itself, one view alone sees {} % of the ticks. By distance, percent of\n\
         the ticks from each nautical mile on: {}.\n\
         By weather: {}.",
        table.markdown(),
        weaker.first_pass_shrink,
        weaker.least_score,
        percent(weaker.of_detector.all),
        far(&by_nm),
        by_weather.collect::<Vec<_>>().join(", ")
    )
}

fn percent(share: Share) -> String {
    number(share.of_seen().map(|share| 100.0 * share), 1)
}

fn ranges(results: &Results) -> String {
    let mut table = Table::new(&[
        "detector, search (table 2)",
        "maximum, NM",
        "effective, NM",
        "found, 1 to 10 NM, %",
        "CPU ms per picture",
    ]);
    let published = |name: &str, [most, effective]: [f64; 2], ms: &str| {
        [
            name.into(),
            format!("{most:.2}"),
            format!("{effective:.2}"),
            String::new(),
            ms.into(),
        ]
    };
    table.row(published(
        "paper: Auto Segmentation",
        TILES_NM,
        "28 (GPU); 44.9 with all else",
    ));
    table.row(published("paper: conventional scaling", SCALED_NM, ""));
    for range in &results.ranges {
        table.row([
            format!("`{}`{}: {}", range.model, kind(range), search(range.search)),
            number(range.max_range_nm, 2),
            number(range.effective_range_nm, 2),
            number(range.recall.map(|share| 100.0 * share), 1),
            number(range.cpu_ms_per_picture, 1),
        ]);
    }
    let farthest = results
        .ranges
        .iter()
        .filter_map(|range| range.farthest_expected_nm);
    let farthest = farthest.reduce(f64::max);
    let missing = if results.ranges.iter().any(|range| range.is_pretrained) {
        ""
    } else {
        " No other detector was judged: `--pretrained-detector FILE` names one."
    };
    format!(
        "## Detection range\n\n{}\n\n\
         From flights in clear weather that begin at {} NM, where ranges are cut off; the paper's begin at 10 NM.{missing}",
        table.markdown(),
        number(farthest, 1)
    )
}

fn kind(range: &Range) -> &'static str {
    if range.is_pretrained {
        ", pretrained on photographs, as it is"
    } else {
        ""
    }
}

fn search(search: Search) -> &'static str {
    match search {
        Search::Tiles => "tiles",
        Search::Scaled => "scaled",
        Search::Tracked => "tracked",
    }
}

fn figures() -> String {
    let figure = |name: &str, file: &str| format!("![{name}]({IMAGES}/{file})");
    [
        "## Figures".to_owned(),
        figure("Figure 1: the concept", CONCEPT),
        figure("Figure 2: an aircraft at 6 NM with its trajectory", FRAME),
        figure(
            "Figure 2: the vertical profile of this flight, with the fixes of the chart",
            PROFILE,
        ),
        figure(
            "Figure 3: tiles, and the window of the second pass with its box",
            SEGMENTATION,
        ),
        figure("Figure 4: errors during the training", CONVERGENCE),
        figure("Figure 5: errors by distance", ERRORS),
    ]
    .join("\n\n")
}

fn times(results: &Results) -> String {
    let mut table = Table::new(&["stage", "minutes"]);
    for time in &results.stages {
        table.row([time.stage.clone(), format!("{:.1}", time.seconds / 60.0)]);
    }
    let total: f64 = results.stages.iter().map(|time| time.seconds).sum();
    table.row(["all".into(), format!("{:.1}", total / 60.0)]);
    format!("## Time\n\n{}", table.markdown())
}

fn not_done() -> String {
    let mut table = Table::new(&["of the paper", "not done, because"]);
    for [what, why] in NOT_DONE {
        table.row([what.into(), why.into()]);
    }
    format!("## What is missing\n\n{}", table.markdown())
}
