//! `report.html`: an evaluation in one file that opens offline.

pub(crate) mod example;

use dataset::numbers::spread::Spread;
use minijinja::context;
use report_page::chart::{Axis, LegendEntry, Panel, Stroke, colour, svg};
use report_page::page::{drawn, page as page_of, value};
use report_page::table::{Cell, Table, or_dash};
use report_page::{optional, percent, signed};

use crate::accuracy::{BoxSpreads, DisparityErrors};
use crate::error::Result;
use crate::figures::{ConditionFigures, Evaluation, ModeFigures};
use crate::mode;
use crate::recall::{BIN_NM, Recall, RecallBin};
use example::{Example, Kind};

const TEMPLATE: &str = include_str!("report/report.html");

type Mode<'a> = (labeller::Mode, &'a ModeFigures);

/// The evaluation page.
pub(crate) fn page(
    evaluation: &Evaluation,
    examples: &[(labeller::Mode, Vec<Example>)],
) -> Result<String> {
    let modes = labeller::Mode::ALL.into_iter();
    let modes: Vec<Mode<'_>> = modes
        .filter_map(|mode| Some((mode, evaluation.modes.get(mode::key(mode))?)))
        .collect();
    let lines = |of: &dyn Fn(&ModeFigures) -> Line| -> Vec<Line> {
        modes.iter().map(|(_, figures)| of(figures)).collect()
    };
    let recall = lines(&|figures| Line::of_recall(&figures.recall_by_nm));
    let centres = lines(&centre_line);
    let first = modes.first().map(|(_, figures)| *figures);
    let weathers = first.into_iter().flat_map(|figures| &figures.by_weather);
    let (names, weathers): (Vec<&str>, Vec<Line>) = weathers
        .map(|(name, of)| (&**name, Line::of_recall(&of.recall_by_nm)))
        .unzip();
    let disparities: Vec<Line> = first.map(disparity_lines).unwrap_or_default();
    let titles = modes.iter().map(|(mode, _)| mode::title(*mode));
    let of_modes = |table: &dyn Fn(&ModeFigures) -> Table| {
        let tables = modes.iter();
        let tables = tables.map(|(mode, figures)| {
            let mut table = table(figures);
            table.label = format!("{}: {}", table.label, mode::title(*mode));
            (mode::title(*mode), table)
        });
        value(tables.collect::<Vec<_>>())
    };
    let page = page_of(
        "Aircraft detector: evaluation",
        TEMPLATE,
        context! {
            evaluation => value(evaluation),
            searches => value(searches(evaluation, &modes)),
            accounts => value(accounts(&modes)),
            conditions => of_modes(&conditions),
            by_distance => of_modes(&accuracy_by_distance),
            by_size => of_modes(&accuracy_by_size),
            precision_and_cost => value(precision_and_cost(&modes)),
            bin_nm => BIN_NM,
            first_mode => modes.first().map(|(mode, _)| mode::title(*mode)),
            mode_series => value(legend(titles)),
            weather_series => value(legend(names.into_iter())),
            disparity_series => value(legend(["boxes", "registered"].into_iter())),
            recall_chart => drawn(recall_chart(&recall)),
            weather_chart => drawn(recall_chart(&weathers)),
            centre_chart => drawn(deviations_chart(&centres, "centre, right: SD, px")),
            disparity_chart => drawn(deviations_chart(&disparities, "disparity: SD, px")),
            has_disparity => evaluation.registration.is_some(),
            examples => value(examples.iter().map(gallery).collect::<Vec<_>>()),
        },
    )?;
    Ok(page)
}

fn legend<'a>(titles: impl Iterator<Item = &'a str>) -> Vec<LegendEntry> {
    let titles = titles.enumerate();
    titles
        .map(|(which, title)| LegendEntry::new(which, title))
        .collect()
}

/// A chart line: points, and vertical intervals if it has any.
#[derive(Default)]
struct Line {
    points: Vec<(f64, f64)>,
    intervals: Vec<(f64, [f64; 2])>,
}

impl Line {
    /// Recall over distance, percent.
    fn of_recall(bins: &[RecallBin]) -> Self {
        let mut line = Self::default();
        for bin in bins.iter().filter(|bin| bin.from_nm >= 0.0) {
            let middle_nm = f64::midpoint(bin.from_nm, bin.to_nm);
            let interval = bin.recall.interval.map(|share| 100.0 * share);
            line.intervals.push((middle_nm, interval));
            let recall = bin.recall.recall;
            line.points
                .extend(recall.map(|share| (middle_nm, 100.0 * share)));
        }
        line
    }

    fn of(points: impl Iterator<Item = (f64, f64)>) -> Self {
        Self {
            points: points.collect(),
            intervals: Vec::new(),
        }
    }
}

fn centre_line(figures: &ModeFigures) -> Line {
    let bins = figures.boxes_by_nm.iter();
    Line::of(bins.filter_map(|bin| Some((bin.from_nm + 0.5, bin.errors.cx_px?.deviation))))
}

fn disparity_lines(figures: &ModeFigures) -> Vec<Line> {
    let line = |spread: fn(&DisparityErrors) -> Option<Spread>| {
        let bins = figures.disparity_by_nm.iter();
        Line::of(bins.filter_map(|bin| Some((bin.from_nm + 0.5, spread(bin)?.deviation))))
    };
    vec![line(|bin| bin.boxes_px), line(|bin| bin.registered_px)]
}

fn recall_chart(lines: &[Line]) -> String {
    let found = Axis::linear("found, %", 0.0, 102.0);
    chart("recall by distance", lines, found)
}

fn deviations_chart(lines: &[Line], title: &'static str) -> String {
    let points = lines.iter().flat_map(|line| &line.points);
    let highest = points.map(|point| point.1).fold(0.0, f64::max);
    let deviations = Axis::linear(title, 0.0, 1.1 * highest);
    chart("deviations by distance", lines, deviations)
}

/// Lines over distance; one colour a line, in their order.
fn chart(name: &'static str, lines: &[Line], values: Axis) -> String {
    let points = lines.iter().flat_map(|line| &line.points);
    let farthest = points.map(|point| point.0).fold(1.0, f64::max).ceil();
    let distances = Axis::linear("distance to touchdown, NM", 0.0, farthest);
    let mut panel = Panel::new(300, distances, values);
    for (which, line) in lines.iter().enumerate() {
        let colour = colour(which);
        for (x, [low, high]) in &line.intervals {
            panel.line(
                [(*x, *low), (*x, *high)],
                Stroke::new(colour, 3).faint(0.35),
            );
        }
        let points = || line.points.iter().copied();
        panel.line(points(), Stroke::new(colour, 2));
        panel.dots(points(), 3, colour, false);
    }
    svg(name, &[panel])
}

/// Ranges, recall and false alarms of each search, with the paper's ranges.
fn searches(evaluation: &Evaluation, modes: &[Mode<'_>]) -> Table {
    let range = match &evaluation.range_weather {
        Some(weather) => format!("Range, {weather}, NM"),
        None => "Range, NM".to_owned(),
    };
    let mut table = Table::new("Searches")
        .words(["Search"])
        .numbers(&range, ["maximum", "effective", "95 %"])
        .numbers("Recall 1–10 NM, %", ["boxes", "confirmed"])
        .numbers("False alarms per hour", ["boxes", "confirmed tracks"])
        .numbers("CPU", ["ms per image"]);
    for (mode, figures) in modes {
        let range = &figures.range;
        let [low, high] = range.effective_range_interval_nm;
        let [paper_max, paper_effective] = mode::paper(*mode).unwrap_or_default();
        table.row([
            Cell::strong(mode::title(*mode)).with_note(mode::how(*mode)),
            Cell::from(optional(range.max_range_nm, 2)).with_note(paper_max),
            Cell::from(optional(range.effective_range_nm, 1)).with_note(paper_effective),
            format!("{} to {}", optional(low, 1), optional(high, 1)).into(),
            percent(figures.recall.recall, 2).into(),
            percent(figures.recall.confirmed_recall, 2).into(),
            optional(figures.false_alarms.boxes_per_hour, 0).into(),
            optional(figures.false_alarms_per_hour, 1).into(),
            optional(figures.cpu_ms_per_picture, 1).into(),
        ]);
    }
    table
}

/// Account of all images of each search.
fn accounts(modes: &[Mode<'_>]) -> Table {
    let mut table = Table::new("Where every image went")
        .words(["Search", "Aircraft"])
        .numbers("", ["images", "found", "missed"])
        .words(["why"]);
    for (mode, figures) in modes {
        let pictures = &figures.pictures;
        let expected = &pictures.expected;
        let mut title = mode::title(*mode);
        for (name, counts) in [
            ("in sight", &expected.in_sight),
            ("beyond the visibility", &expected.hidden_by_haze),
            ("in or above clouds", &expected.maybe_hidden_by_cloud),
        ] {
            let reasons = counts.missed.iter();
            let reasons = reasons.map(|(reason, pictures)| format!("{reason} {pictures}"));
            table.row([
                Cell::from(std::mem::take(&mut title)),
                name.into(),
                counts.expected.into(),
                counts.found.into(),
                (counts.expected - counts.found).into(),
                reasons.collect::<Vec<_>>().join(", ").into(),
            ]);
        }
        let not_expected = &pictures.not_expected;
        for (name, count) in [
            ("half of it or less visible", not_expected.barely_visible),
            ("not in the image", not_expected.absent),
        ] {
            table.row(
                [Cell::default(), name.into(), count.into()]
                    .into_iter()
                    .chain(blank(3)),
            );
        }
        let total = Cell::strong(pictures.total.to_string());
        table.row(
            [Cell::default(), Cell::strong("all"), total]
                .into_iter()
                .chain(blank(3)),
        );
    }
    table
}

fn blank(cells: usize) -> impl Iterator<Item = Cell> {
    std::iter::repeat_n(Cell::default(), cells)
}

/// A search by weather and time.
fn conditions(figures: &ModeFigures) -> Table {
    let mut table = Table::new("By weather and time of day")
        .words(["By", "Condition"])
        .numbers("In sight, 1–10 NM", ["images", "recall %", "95 %"])
        .numbers("Range, NM", ["maximum", "effective"])
        .numbers("Hidden", ["found"])
        .numbers("False alarms per hour", ["boxes", "confirmed tracks"]);
    let weathers = figures.by_weather.iter().map(|of| ("Weather", of));
    let times = figures.by_time.iter().map(|of| ("Time", of));
    for (kind, (name, of)) in weathers.chain(times) {
        let ConditionFigures {
            range,
            false_alarms,
            expected,
            recall,
            ..
        } = of;
        let (range, alarms) = (range.as_ref(), false_alarms.as_ref());
        let [haze, cloud] = [&expected.hidden_by_haze, &expected.maybe_hidden_by_cloud];
        let hidden = haze.expected + cloud.expected;
        let hidden = (hidden > 0).then(|| format!("{} of {hidden}", haze.found + cloud.found));
        table.row([
            kind.to_owned(),
            name.clone(),
            recall.counts.expected.to_string(),
            percent(recall.recall, 2),
            interval(recall),
            optional(range.and_then(|range| range.max_range_nm), 2),
            optional(range.and_then(|range| range.effective_range_nm), 1),
            or_dash(hidden),
            optional(alarms.and_then(|alarms| alarms.boxes_per_hour), 0),
            optional(
                alarms.and_then(|alarms| alarms.confirmed_tracks_per_hour),
                1,
            ),
        ]);
    }
    table
}

/// Errors by distance, first those over all distances.
fn accuracy_by_distance(figures: &ModeFigures) -> Table {
    let errors = ["boxes", "centre, right", "centre, down", "width", "height"];
    let disparity = ["boxes", "registered", "registered pairs"];
    let mut table = Table::new("Accuracy by distance")
        .words(["NM"])
        .numbers("Boxes: bias ± robust SD, px", errors)
        .numbers("Disparity: bias ± robust SD, px", disparity);
    let overall = [(&figures.boxes, Some(&figures.disparity))];
    let bins = figures.boxes_by_nm.iter().map(|bin| {
        let mut disparities = figures.disparity_by_nm.iter();
        let disparity = disparities.find(|other| other.from_nm == bin.from_nm);
        (bin, disparity)
    });
    for (place, (bin, disparity)) in overall.into_iter().chain(bins).enumerate() {
        let pairs = disparity.map(|bin| format!("{} of {}", bin.registered, bin.pairs));
        let bin_nm = format!("{:.0} to {:.0}", bin.from_nm, bin.to_nm);
        let disparity = [
            spread(disparity.and_then(|bin| bin.boxes_px)),
            spread(disparity.and_then(|bin| bin.registered_px)),
            or_dash(pairs),
        ];
        let cells = [bin_nm, bin.boxes.to_string()].into_iter();
        let row = table.row(cells.chain(spreads(&bin.errors)).chain(disparity));
        if place == 0 {
            row.class = "best";
        }
    }
    table
}

/// Errors by the aircraft's width.
fn accuracy_by_size(figures: &ModeFigures) -> Table {
    let mut table = Table::new("Accuracy by size")
        .words(["Aircraft"])
        .numbers("", ["images", "recall %"])
        .numbers(
            "Bias ± robust SD, px",
            ["centre, right", "centre, down", "width", "height"],
        );
    let mut from_px = 0.0;
    for bin in &figures.by_width {
        let width = match bin.width_up_to_px {
            Some(to_px) => format!("{from_px:.0} to {to_px:.0} px wide"),
            None => format!("above {from_px:.0} px wide"),
        };
        from_px = bin.width_up_to_px.unwrap_or(from_px);
        let share = (bin.expected > 0).then(|| bin.found as f64 / bin.expected as f64);
        let cells = [width, bin.expected.to_string(), percent(share, 2)];
        table.row(cells.into_iter().chain(spreads(&bin.errors)));
    }
    table
}

/// COCO's average precision and processor time of each search.
fn precision_and_cost(modes: &[Mode<'_>]) -> Table {
    let precision = ["AP", "AP50", "small", "medium", "large"];
    let stages = ["decode", "convert", "infer", "rest"];
    let mut table = Table::new("Average precision and cost")
        .words(["Search"])
        .numbers("COCO average precision", precision)
        .numbers("CPU, ms per image", stages);
    for (mode, figures) in modes {
        let ap = &figures.average_precision;
        let stages = figures.cpu_ms_by_stage.unwrap_or_default();
        let precision = [ap.ap, ap.ap50, ap.ap_small, ap.ap_medium, ap.ap_large];
        let stages = [stages.decode, stages.convert, stages.infer, stages.rest];
        let cells = [mode::title(*mode).to_owned()]
            .into_iter()
            .chain(precision.map(|ap| optional(ap, 3)))
            .chain(stages.map(|stage| optional(Some(stage), 1)));
        table.row(cells);
    }
    table
}

/// A mode's title, and its examples by the name of their kind.
type Gallery<'a> = (&'static str, Vec<(&'static str, Vec<&'a Example>)>);

fn gallery((mode, examples): &(labeller::Mode, Vec<Example>)) -> Gallery<'_> {
    let kinds = [
        (Kind::Hit, "The farthest that were found"),
        (Kind::Miss, "The nearest that were missed in sight"),
        (Kind::FalseAlarm, "The surest boxes that are no aircraft"),
    ];
    let of_kind = |(kind, name)| {
        let examples = examples.iter();
        (name, examples.filter(|of| of.kind == kind).collect())
    };
    (mode::title(*mode), kinds.into_iter().map(of_kind).collect())
}

fn interval(recall: &Recall) -> String {
    or_dash(recall.recall.map(|_| {
        let [low, high] = recall.interval.map(|share| 100.0 * share);
        format!("{low:.2} to {high:.2}")
    }))
}

fn spreads(errors: &BoxSpreads) -> [String; 4] {
    [
        errors.cx_px,
        errors.cy_px,
        errors.width_px,
        errors.height_px,
    ]
    .map(spread)
}

fn spread(spread: Option<Spread>) -> String {
    or_dash(spread.map(|of| format!("{} ± {:.2}", signed(of.median, 2), of.deviation)))
}

#[cfg(test)]
mod tests {
    use dataset::corpus::model_identity::ModelIdentity;

    use super::*;
    use crate::figures::{EvaluatedModel, Tally};

    #[test]
    fn the_page_of_an_evaluation_without_images_has_all_tables() {
        let figures = Tally::default().figures(None, &[]);
        let modes = labeller::Mode::ALL.into_iter();
        let evaluation = Evaluation {
            dtd: "0".into(),
            model: EvaluatedModel {
                identity: ModelIdentity {
                    model: Some("net.onnx".into()),
                    model_blake3: "0".repeat(64),
                    profile_blake3: None,
                },
                device: "cpu".into(),
            },
            scenarios: Vec::new(),
            failed: Vec::new(),
            range_weather: None,
            recall_weathers: Vec::new(),
            modes: modes
                .map(|mode| (mode::key(mode).to_owned(), figures.clone()))
                .collect(),
            registration: None,
        };
        let page = page(&evaluation, &[]).unwrap();
        // Two per mode by distance and size, one per mode by conditions, and three over all modes.
        let tables = 3 * labeller::Mode::ALL.len() + 3;
        assert_eq!(page.matches("<table>").count(), tables);
        assert_eq!(page.matches("<svg").count(), 3, "no chart of disparities");
    }

    #[test]
    fn charts_of_nothing_and_of_absurd_values_end() {
        let lines = |points: &[(f64, f64)]| vec![Line::of(points.iter().copied())];
        for points in [&[][..], &[(0.5, 0.0)], &[(0.5, 1e300), (12.5, 1e-300)]] {
            for svg in [
                recall_chart(&lines(points)),
                deviations_chart(&lines(points), "px"),
            ] {
                assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{svg}");
            }
        }
    }
}
