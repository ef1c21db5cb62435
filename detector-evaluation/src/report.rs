//! `report.html`: an evaluation in one file that opens offline.

mod charts;
pub(crate) mod example;

use dataset::numbers::spread::Spread;
use minijinja::context;
use report_page::chart::css_colour;
use report_page::crop::Crop;
use report_page::page::{drawn, render, value};
use report_page::signed;
use serde::Serialize;

use crate::error::Result;
use crate::figures::{Evaluation, ModeFigures, SightCounts};
use crate::mode::EvaluatedMode;
use crate::recall::{BIN_NM, Counts, Recall};
use charts::Line;
use example::{Example, Kind};

const TEMPLATE: &str = include_str!("report/report.html");

/// The page of an evaluation with its examples.
pub(crate) fn page(
    evaluation: &Evaluation,
    examples: &[(EvaluatedMode, Vec<Example>)],
) -> Result<String> {
    let modes: Vec<(EvaluatedMode, &ModeFigures)> = EvaluatedMode::ALL
        .into_iter()
        .filter_map(|mode| Some((mode, evaluation.modes.get(mode.key())?)))
        .collect();
    let recall: Vec<Line> = modes
        .iter()
        .map(|(_, figures)| Line::of_recall(&figures.recall_by_nm))
        .collect();
    let first = modes.first().map(|(_, figures)| *figures);
    let weathers: Vec<Line> = first
        .into_iter()
        .flat_map(|figures| figures.by_weather.values())
        .map(|figures| Line::of_recall(&figures.recall_by_nm))
        .collect();
    let weather_names: Vec<String> = first
        .map(|figures| figures.by_weather.keys().cloned().collect())
        .unwrap_or_default();
    let centres: Vec<Line> = modes
        .iter()
        .map(|(_, figures)| centre_line(figures))
        .collect();
    let disparities: Vec<Line> = first.map(disparity_lines).unwrap_or_default();
    let page = render(
        TEMPLATE,
        context! {
            evaluation => value(evaluation),
            headline => value(modes.iter().map(headline).collect::<Vec<_>>()),
            accounts => value(modes.iter().map(account).collect::<Vec<_>>()),
            conditions => value(modes.iter().map(conditions).collect::<Vec<_>>()),
            accuracy => value(modes.iter().map(accuracy).collect::<Vec<_>>()),
            bin_nm => BIN_NM,
            modes_legend => value(legend(modes.iter().map(|(mode, _)| mode.title().to_owned()))),
            weathers_legend => value(legend(weather_names.into_iter())),
            disparity_legend => value(legend(["boxes", "registered"].map(str::to_owned).into_iter())),
            recall_chart => drawn(charts::recall(&recall)?),
            weather_chart => drawn(charts::recall(&weathers)?),
            centre_chart => drawn(charts::deviations(&centres, "centre, right: SD, px")?),
            disparity_chart => drawn(charts::deviations(&disparities, "disparity: SD, px")?),
            has_disparity => evaluation.registration.is_some(),
            examples => value(examples.iter().map(gallery).collect::<Vec<_>>()),
        },
    )?;
    Ok(page)
}

/// An entry of a legend.
#[derive(Serialize)]
struct LegendEntry {
    colour: String,
    title: String,
}

fn legend(titles: impl Iterator<Item = String>) -> Vec<LegendEntry> {
    let entry = |(which, title): (usize, String)| LegendEntry {
        colour: css_colour(which),
        title,
    };
    titles.enumerate().map(entry).collect()
}

fn centre_line(figures: &ModeFigures) -> Line {
    let bins = figures.boxes_by_nm.iter();
    Line::of(bins.filter_map(|bin| Some((bin.from_nm + 0.5, bin.cx_px?.deviation))))
}

fn disparity_lines(figures: &ModeFigures) -> Vec<Line> {
    let line = |spread: fn(&crate::accuracy::DisparityErrors) -> Option<Spread>| {
        let bins = figures.disparity_by_nm.iter();
        Line::of(bins.filter_map(|bin| Some((bin.from_nm + 0.5, spread(bin)?.deviation))))
    };
    vec![line(|bin| bin.boxes_px), line(|bin| bin.registered_px)]
}

/// A mode in the first table.
#[derive(Serialize)]
struct HeadlineRow {
    title: &'static str,
    how: &'static str,
    /// Maximum and effective range of the paper's table 2.
    paper: Option<[&'static str; 2]>,
    max_range: String,
    effective_range: String,
    interval: String,
    recall: String,
    confirmed_recall: String,
    alarms: String,
    boxes: String,
    cpu: String,
    stages: [String; 4],
    ap: [String; 5],
}

fn headline((mode, figures): &(EvaluatedMode, &ModeFigures)) -> HeadlineRow {
    let range = &figures.range;
    let [low, high] = range.effective_range_interval_nm;
    let stages = figures.cpu_ms_by_stage.unwrap_or_default();
    let precision = &figures.average_precision;
    HeadlineRow {
        title: mode.title(),
        how: mode.how(),
        paper: mode.paper(),
        max_range: number(range.max_range_nm, 2),
        effective_range: number(range.effective_range_nm, 1),
        interval: format!("{} to {}", number(low, 1), number(high, 1)),
        recall: percent(figures.recall.recall),
        confirmed_recall: percent(figures.recall.confirmed_recall),
        alarms: number(figures.false_alarms_per_hour, 1),
        boxes: number(figures.false_alarms.boxes_per_hour, 0),
        cpu: number(figures.cpu_ms_per_picture, 1),
        stages: [stages.decode, stages.convert, stages.infer, stages.rest]
            .map(|stage| format!("{stage:.1}")),
        ap: [
            precision.ap,
            precision.ap50,
            precision.ap_small,
            precision.ap_medium,
            precision.ap_large,
        ]
        .map(|ap| number(ap, 3)),
    }
}

/// Account of all images of a mode.
#[derive(Serialize)]
struct Account {
    title: &'static str,
    total: u64,
    absent: u64,
    barely_visible: u64,
    parts: Vec<Part>,
}

#[derive(Serialize)]
struct Part {
    name: &'static str,
    expected: u64,
    found: u64,
    missed: u64,
    reasons: String,
}

fn account((mode, figures): &(EvaluatedMode, &ModeFigures)) -> Account {
    let pictures = &figures.pictures;
    Account {
        title: mode.title(),
        total: pictures.total,
        absent: pictures.not_expected.absent,
        barely_visible: pictures.not_expected.barely_visible,
        parts: parts(&pictures.expected),
    }
}

fn parts(counts: &SightCounts) -> Vec<Part> {
    let part = |name, counts: &Counts| Part {
        name,
        expected: counts.expected,
        found: counts.found,
        missed: counts.expected - counts.found,
        reasons: counts
            .missed
            .iter()
            .map(|(reason, pictures)| format!("{reason} {pictures}"))
            .collect::<Vec<_>>()
            .join(", "),
    };
    vec![
        part("in sight", &counts.in_sight),
        part("beyond the visibility", &counts.hidden_by_haze),
        part("in or above clouds", &counts.maybe_hidden_by_cloud),
    ]
}

/// A mode by weather and time.
#[derive(Serialize)]
struct Conditions {
    title: &'static str,
    rows: Vec<ConditionRow>,
}

#[derive(Serialize)]
struct ConditionRow {
    kind: &'static str,
    name: String,
    recall: String,
    interval: String,
    expected: u64,
    max_range: String,
    effective_range: String,
    hidden: String,
    alarms: String,
    boxes: String,
}

fn conditions((mode, figures): &(EvaluatedMode, &ModeFigures)) -> Conditions {
    let row = |kind, name: &String, of: &crate::figures::ConditionFigures| {
        let range = of.range.as_ref();
        let alarms = of.false_alarms.as_ref();
        let [haze, cloud] = [
            &of.expected.hidden_by_haze,
            &of.expected.maybe_hidden_by_cloud,
        ];
        ConditionRow {
            kind,
            name: name.clone(),
            recall: percent(of.recall.recall),
            interval: interval(&of.recall),
            expected: of.recall.counts.expected,
            max_range: number(range.and_then(|range| range.max_range_nm), 2),
            effective_range: number(range.and_then(|range| range.effective_range_nm), 1),
            hidden: match haze.expected + cloud.expected {
                0 => "–".into(),
                hidden => format!("{} of {hidden}", haze.found + cloud.found),
            },
            alarms: number(
                alarms.and_then(|alarms| alarms.confirmed_tracks_per_hour),
                1,
            ),
            boxes: number(alarms.and_then(|alarms| alarms.boxes_per_hour), 0),
        }
    };
    let weathers = figures.by_weather.iter();
    let times = figures.by_time.iter();
    Conditions {
        title: mode.title(),
        rows: weathers
            .map(|(name, of)| row("Weather", name, of))
            .chain(times.map(|(name, of)| row("Time", name, of)))
            .collect(),
    }
}

/// Errors of a mode by distance.
#[derive(Serialize)]
struct Accuracy {
    title: &'static str,
    rows: Vec<AccuracyRow>,
    widths: Vec<WidthRow>,
}

#[derive(Serialize)]
struct WidthRow {
    width: String,
    expected: u64,
    recall: String,
    errors: [String; 4],
}

#[derive(Serialize)]
struct AccuracyRow {
    distance: String,
    boxes: u64,
    /// Bias and deviation of centre right, centre down, width, height.
    errors: [String; 4],
    pairs: String,
    /// Of the disparity from boxes, and as registered.
    disparity: [String; 2],
}

fn accuracy((mode, figures): &(EvaluatedMode, &ModeFigures)) -> Accuracy {
    let overall = std::iter::once((&figures.boxes, Some(&figures.disparity)));
    let bins = figures.boxes_by_nm.iter().map(|bin| {
        let disparity = figures
            .disparity_by_nm
            .iter()
            .find(|other| other.from_nm == bin.from_nm);
        (bin, disparity)
    });
    let rows = overall.chain(bins).map(|(bin, disparity)| AccuracyRow {
        distance: format!("{:.0} to {:.0}", bin.from_nm, bin.to_nm),
        boxes: bin.boxes,
        errors: [bin.cx_px, bin.cy_px, bin.width_px, bin.height_px].map(spread),
        pairs: disparity.map_or("–".into(), |bin| {
            format!("{} of {}", bin.registered, bin.pairs)
        }),
        disparity: [
            spread(disparity.and_then(|bin| bin.boxes_px)),
            spread(disparity.and_then(|bin| bin.registered_px)),
        ],
    });
    let mut from_px = 0.0;
    let widths = figures.by_width.iter().map(|bin| {
        let width = match bin.width_up_to_px {
            Some(to_px) => format!("{from_px:.0} to {to_px:.0} px wide"),
            None => format!("above {from_px:.0} px wide"),
        };
        from_px = bin.width_up_to_px.unwrap_or(from_px);
        let share = (bin.expected > 0).then(|| bin.found as f64 / bin.expected as f64);
        WidthRow {
            width,
            expected: bin.expected,
            recall: percent(share),
            errors: [bin.cx_px, bin.cy_px, bin.width_px, bin.height_px].map(spread),
        }
    });
    Accuracy {
        title: mode.title(),
        rows: rows.collect(),
        widths: widths.collect(),
    }
}

/// The examples of a mode.
#[derive(Serialize)]
struct Gallery {
    title: &'static str,
    kinds: Vec<KindOfExample>,
}

#[derive(Serialize)]
struct KindOfExample {
    name: &'static str,
    examples: Vec<Shown>,
}

#[derive(Serialize)]
struct Shown {
    crop: Crop,
    truth: Option<[f64; 4]>,
    found: Option<[f64; 4]>,
    place: String,
    note: String,
}

fn gallery((mode, examples): &(EvaluatedMode, Vec<Example>)) -> Gallery {
    let shown = |example: &Example| {
        let [truth, found] = example.boxes();
        Shown {
            crop: example.crop.clone(),
            truth,
            found,
            place: example.candidate.place(),
            note: example.candidate.note.clone(),
        }
    };
    let kinds = [
        (Kind::Hit, "The farthest that were found"),
        (Kind::Miss, "The nearest that were missed in sight"),
        (Kind::FalseAlarm, "The surest boxes that are no aircraft"),
    ];
    Gallery {
        title: mode.title(),
        kinds: kinds
            .into_iter()
            .map(|(kind, name)| KindOfExample {
                name,
                examples: examples
                    .iter()
                    .filter(|e| e.candidate.kind == kind)
                    .map(shown)
                    .collect(),
            })
            .collect(),
    }
}

fn interval(recall: &Recall) -> String {
    match recall.recall {
        None => "–".into(),
        Some(_) => {
            let [low, high] = recall.interval.map(|share| 100.0 * share);
            format!("{low:.2} to {high:.2}")
        }
    }
}

fn percent(share: Option<f64>) -> String {
    number(share.map(|share| 100.0 * share), 2)
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".into(), |value| format!("{value:.decimals$}"))
}

fn spread(spread: Option<Spread>) -> String {
    let words = |spread: Spread| format!("{} ± {:.2}", signed(spread.median, 2), spread.deviation);
    spread.map_or_else(|| "–".into(), words)
}
