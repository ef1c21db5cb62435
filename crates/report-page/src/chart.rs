//! Charts as SVG: panels with axes, grid, lines, dots and rectangles.
//!
//! Colours are attributes, so that a chart is complete without a style sheet; the pages' style sheet replaces them on dark paper. Drawing
//! never fails: numbers beyond an axis stay at its end, and axes are finite whatever they cover.

use std::fmt::Write;
use std::ops::Range;

use serde::Serialize;

use crate::number::{decimal, signed};

/// Colours of series; distinguishable for colour-blind readers (Okabe and Ito).
pub const COLOURS: [&str; 6] = [
    "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#D55E00", "#56B4E9",
];
/// Colour of text and axes.
pub const INK: &str = "#373C43";
const GRID: &str = "#E2E5E9";
const PAPER: &str = "#FFFFFF";

const WIDTH: u32 = 960;
/// Room left, right, above and below the drawing, for titles and numbers, px.
const ROOM: [u32; 4] = [66, 28, 12, 44];
/// Maximum points per series: a screen shows no more, and a page must open.
pub const MAX_POINTS: usize = 2_000;
/// Maximum numbers along the axis below.
const MAX_NUMBERS: usize = 14;
/// Room for a number along the axis at the side, px.
const NUMBER_PX: u32 = 40;
/// Legend line height, px.
const LEGEND_PX: u32 = 19;

/// An axis with its title.
#[derive(Debug, Clone)]
pub struct Axis {
    title: &'static str,
    ends: Range<f64>,
    is_logarithmic: bool,
    is_signed: bool,
}

impl Axis {
    /// A linear axis between these numbers, or around them if they are equal or not finite.
    pub fn linear(title: &'static str, from: f64, to: f64) -> Self {
        let least = 1e-6 * from.abs().max(to.abs());
        let ends = if !(from.is_finite() && to.is_finite() && (to - from).is_finite()) {
            0.0..1.0
        } else if to - from > least {
            from..to
        } else {
            from..from + least.max(1.0)
        };
        Self {
            title,
            ends,
            is_logarithmic: false,
            is_signed: false,
        }
    }

    /// A linear axis of errors up to `reach` on both sides of zero.
    pub fn errors(title: &'static str, reach: f64) -> Self {
        Self {
            is_signed: true,
            ..Self::linear(title, -reach, reach)
        }
    }

    /// A logarithmic axis that covers all positive numbers among these, up to nine powers of ten, with some room.
    pub fn logarithmic(title: &'static str, numbers: impl Iterator<Item = f64>) -> Self {
        let usable = numbers.filter(|number| number.is_normal() && *number > 0.0);
        let ends = usable.fold(None, |ends: Option<(f64, f64)>, number| {
            let (low, high) = ends.unwrap_or((number, number));
            Some((low.min(number), high.max(number)))
        });
        let (low, high) = ends.unwrap_or((0.1, 1.0));
        let high = high.clamp(1e-9, 1e9) * 1.5;
        Self {
            title,
            ends: (low / 1.5).clamp(high / 1e9, high / 4.0)..high,
            is_logarithmic: true,
            is_signed: false,
        }
    }

    /// First number of the axis.
    pub fn start(&self) -> f64 {
        self.ends.start
    }

    /// Last number of the axis.
    pub fn end(&self) -> f64 {
        self.ends.end
    }

    /// Position along the axis, 0 to 1.
    fn share(&self, number: f64) -> f64 {
        let Range { start, end } = self.ends;
        let number = if number.is_nan() { start } else { number };
        let number = number.clamp(start, end);
        if self.is_logarithmic {
            (number / start).ln() / (end / start).ln()
        } else {
            (number - start) / (end - start)
        }
    }

    /// Round numbers along the axis, each with its text.
    fn numbers(&self, most: usize) -> Vec<(f64, String)> {
        if self.is_logarithmic {
            self.powers()
        } else {
            self.steps(most)
        }
    }

    /// Multiples of the smallest round step that gives at most this many.
    fn steps(&self, most: usize) -> Vec<(f64, String)> {
        let Range { start, end } = self.ends;
        let least = (end - start) / most as f64;
        let power = 10_f64.powf(least.log10().floor());
        let factors = [1.0, 2.0, 5.0, 10.0].into_iter();
        let step = factors
            .map(|factor| factor * power)
            .find(|step| *step >= least);
        let step = step.unwrap_or(10.0 * power);
        let decimals = (-(step.log10() + 1e-9).floor()).clamp(0.0, 9.0) as usize;
        let first = (start / step).ceil();
        let numbers = (0..=most).map(|place| (first + place as f64) * step);
        let inside = numbers.take_while(|number| *number <= end + 1e-9 * step);
        let text = |number| {
            if self.is_signed {
                signed(number, decimals)
            } else {
                decimal(number, decimals)
            }
        };
        inside.map(|number| (number, text(number))).collect()
    }

    /// 1, 2 and 5 of each power of ten, or the powers alone if there are many.
    fn powers(&self) -> Vec<(f64, String)> {
        let Range { start, end } = self.ends;
        let powers = start.log10().floor() as i32..=end.log10().ceil() as i32;
        let factors: &[f64] = if powers.clone().count() <= 8 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let all = powers.flat_map(|power| {
            factors
                .iter()
                .map(move |factor| factor * 10_f64.powi(power))
        });
        let inside = all.filter(|number| (start..=end).contains(number));
        let decimals = |number: f64| (-(number.log10() + 1e-9).floor()).max(0.0) as usize;
        inside
            .map(|number| (number, decimal(number, decimals(number))))
            .collect()
    }
}

/// A chart panel: marks over two axes.
#[derive(Debug)]
pub struct Panel {
    height: u32,
    x: Axis,
    y: Axis,
    marks: String,
    /// Names of series, each with its sample, which is drawn around the origin.
    names: Vec<(String, String)>,
}

impl Panel {
    /// An empty panel of this height in pixels.
    pub fn new(height: u32, x: Axis, y: Axis) -> Self {
        Self {
            height,
            x,
            y,
            marks: String::new(),
            names: Vec::new(),
        }
    }

    /// Position in the panel, px.
    fn place(&self, (x, y): (f64, f64)) -> [f64; 2] {
        let [left, right, top, bottom] = ROOM.map(f64::from);
        let width = f64::from(WIDTH) - left - right;
        let height = f64::from(self.height) - top - bottom;
        [
            left + width * self.x.share(x),
            top + height * (1.0 - self.y.share(y)),
        ]
    }

    /// Places of the points inside the panel, thinned out evenly if there are too many.
    fn places(&self, points: impl IntoIterator<Item = (f64, f64)>) -> Vec<[f64; 2]> {
        let (x, y) = (&self.x.ends, &self.y.ends);
        let is_inside = |point: &(f64, f64)| {
            (x.start..=x.end).contains(&point.0) && (y.start..=y.end).contains(&point.1)
        };
        let inside: Vec<_> = points.into_iter().filter(is_inside).collect();
        let every = inside.len().div_ceil(MAX_POINTS).max(1);
        let shown = inside.into_iter().step_by(every);
        shown.map(|point| self.place(point)).collect()
    }

    /// A line through points.
    pub fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, stroke: Stroke) {
        let places = self.places(points);
        let places: Vec<String> = places
            .iter()
            .map(|[x, y]| format!("{x:.1},{y:.1}"))
            .collect();
        if !places.is_empty() {
            let points = places.join(" ");
            let _ = writeln!(
                self.marks,
                "<polyline points=\"{points}\" fill=\"none\" {stroke}/>"
            );
        }
    }

    /// Dots of this radius in pixels, with the colour inside or around them.
    pub fn dots(
        &mut self,
        points: impl IntoIterator<Item = (f64, f64)>,
        radius: u32,
        colour: &'static str,
        is_hollow: bool,
    ) {
        for place in self.places(points) {
            self.marks.push_str(&dot(place, radius, colour, is_hollow));
        }
    }

    /// A rectangle with this opacity inside.
    pub fn rectangle(&mut self, corners: [(f64, f64); 2], colour: &'static str, filled: f64) {
        let [[left, bottom], [right, top]] = corners.map(|corner| self.place(corner));
        let (width, height) = (right - left, bottom - top);
        let _ = writeln!(
            self.marks,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{colour}\" fill-opacity=\"{filled}\" \
             stroke=\"{colour}\"/>"
        );
    }

    /// Text on the right side of the point.
    pub fn text(&mut self, point: (f64, f64), words: &str) {
        let [x, y] = self.place(point);
        self.marks
            .push_str(&text([x + 4.0, y + 12.0], "start", words));
    }

    /// Names a series in the legend by its line.
    pub fn name_line(&mut self, name: &str, stroke: Stroke) {
        let sample = format!("<path d=\"M-9 0H9\" {stroke}/>\n");
        self.names.push((name.to_owned(), sample));
    }

    /// Names a series in the legend by its dots.
    pub fn name_dots(&mut self, name: &str, colour: &'static str) {
        self.names
            .push((name.to_owned(), dot([0.0, 0.0], 3, colour, false)));
    }

    fn drawn(&self) -> String {
        let mut drawn = String::new();
        let [left, top] = self.place((self.x.ends.start, self.y.ends.end));
        let [right, bottom] = self.place((self.x.ends.end, self.y.ends.start));
        let (grid, edge) = (Stroke::new(GRID, 1), Stroke::new(INK, 1));
        for (number, label) in self.x.numbers(MAX_NUMBERS) {
            let [x, _] = self.place((number, self.y.ends.start));
            let _ = writeln!(drawn, "<path d=\"M{x:.1} {top:.1}V{bottom:.1}\" {grid}/>");
            drawn.push_str(&text([x, bottom + 18.0], "middle", &label));
        }
        for (number, label) in self.y.numbers((self.height / NUMBER_PX) as usize) {
            let [_, y] = self.place((self.x.ends.start, number));
            let _ = writeln!(drawn, "<path d=\"M{left:.1} {y:.1}H{right:.1}\" {grid}/>");
            drawn.push_str(&text([left - 6.0, y + 4.5], "end", &label));
        }
        let axes = format!("M{left:.1} {top:.1}V{bottom:.1}H{right:.1}");
        let _ = writeln!(drawn, "<path d=\"{axes}\" fill=\"none\" {edge}/>");
        drawn.push_str(&self.marks);
        let middle = f64::midpoint(left, right);
        drawn.push_str(&text([middle, bottom + 37.0], "middle", self.x.title));
        let title = text([-f64::midpoint(top, bottom), 15.0], "middle", self.y.title);
        let _ = writeln!(drawn, "<g transform=\"rotate(-90)\">{title}</g>");
        self.draw_legend(&mut drawn, [right, top]);
        drawn
    }

    fn draw_legend(&self, drawn: &mut String, [right, top]: [f64; 2]) {
        let longest = self
            .names
            .iter()
            .map(|(name, _)| name.chars().count())
            .max();
        let Some(longest) = longest else { return };
        let width = 40.0 + 7.0 * longest as f64;
        let height = LEGEND_PX * self.names.len() as u32 + 8;
        let (left, top) = (right - width - 12.0, top + 12.0);
        let edge = Stroke::new(GRID, 1);
        let _ = writeln!(
            drawn,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height}\" fill=\"{PAPER}\" fill-opacity=\"0.85\" {edge}/>"
        );
        for (place, (name, sample)) in self.names.iter().enumerate() {
            let y = top + 4.0 + f64::from(LEGEND_PX) * (place as f64 + 0.5);
            let x = left + 18.0;
            let at = format!("translate({x:.1} {y:.1})");
            let _ = writeln!(drawn, "<g transform=\"{at}\">{sample}</g>");
            drawn.push_str(&text([x + 16.0, y + 4.5], "start", name));
        }
    }
}

/// Line style.
#[derive(Debug, Clone, Copy)]
pub struct Stroke {
    colour: &'static str,
    opacity: f64,
    width: u32,
}

impl Stroke {
    /// An opaque line of this width in pixels.
    pub fn new(colour: &'static str, width: u32) -> Self {
        Self {
            colour,
            opacity: 1.0,
            width,
        }
    }

    /// Changes the opacity.
    #[must_use]
    pub fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }
}

impl std::fmt::Display for Stroke {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            colour,
            opacity,
            width,
        } = self;
        write!(
            f,
            "stroke=\"{colour}\" stroke-width=\"{width}\" stroke-opacity=\"{opacity}\""
        )
    }
}

fn text([x, y]: [f64; 2], anchor: &str, text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-family=\"sans-serif\" font-size=\"13\" fill=\"{INK}\">{text}</text>\n"
    )
}

fn dot([x, y]: [f64; 2], radius: u32, colour: &str, is_hollow: bool) -> String {
    let fill = if is_hollow { PAPER } else { colour };
    let width = if is_hollow { 2 } else { 0 };
    format!(
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"{width}\"/>\n"
    )
}

/// The chart of some panels, one below the other. `what` names the chart for readers who do not see it.
pub fn svg(what: &str, panels: &[Panel]) -> String {
    let height: u32 = panels.iter().map(|panel| panel.height).sum();
    // A width in the file would prevent the page from scaling the image.
    let mut text = format!(
        "<svg role=\"img\" aria-label=\"{what}\" viewBox=\"0 0 {WIDTH} {height}\" xmlns=\"http://www.w3.org/2000/svg\">\n"
    );
    let mut top = 0;
    for panel in panels {
        let drawn = panel.drawn();
        let _ = writeln!(text, "<g transform=\"translate(0 {top})\">\n{drawn}</g>");
        top += panel.height;
    }
    text.push_str("</svg>\n");
    text
}

/// Series colour.
pub fn colour(series: usize) -> &'static str {
    COLOURS[series % COLOURS.len()]
}

/// A series in a legend outside the charts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LegendEntry {
    /// CSS colour: the style sheet has different colours for dark paper.
    colour: String,
    is_hollow: bool,
    name: String,
}

impl LegendEntry {
    /// The series of this number.
    pub fn new(series: usize, name: impl Into<String>) -> Self {
        Self {
            colour: css_colour(series),
            is_hollow: is_hollow(series),
            name: name.into(),
        }
    }
}

/// True if a series has hollow marks: there are more series than colours that everybody can distinguish.
pub fn is_hollow(series: usize) -> bool {
    series >= COLOURS.len()
}

fn css_colour(series: usize) -> String {
    format!("var(--series-{})", series % COLOURS.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::STYLE;

    #[test]
    fn the_style_sheet_has_the_colours_of_the_charts_and_replaces_them_on_dark_paper() {
        for (which, colour) in COLOURS.iter().enumerate() {
            let light = format!("--series-{which}: {colour}");
            assert!(STYLE.contains(&light), "{light}");
            for attribute in ["fill", "stroke"] {
                let css = css_colour(which);
                let dark = format!("svg [{attribute}=\"{colour}\"] {{ {attribute}: {css}; }}");
                assert!(STYLE.contains(&dark), "{dark}");
            }
        }
        for colour in [GRID, PAPER, INK] {
            assert!(STYLE.contains(&format!("=\"{colour}\"]")), "{colour}");
        }
    }

    fn texts(numbers: Vec<(f64, String)>) -> Vec<String> {
        numbers.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn axes_have_round_numbers_inside_their_ends() {
        let axis = Axis::linear("NM", 0.0, 12.0);
        assert_eq!(
            texts(axis.numbers(14)).join(" "),
            "0 1 2 3 4 5 6 7 8 9 10 11 12"
        );
        let errors = Axis::errors("%", 0.45);
        assert_eq!(
            texts(errors.numbers(7)),
            ["−0.4", "−0.2", "0.0", "+0.2", "+0.4"]
        );
        let axis = Axis::logarithmic("%", [0.012, 0.3].into_iter());
        assert_eq!(
            texts(axis.numbers(9)),
            ["0.01", "0.02", "0.05", "0.1", "0.2"]
        );
        let share = |number| axis.share(number);
        assert!(share(0.012) > 0.0 && share(0.3) < 1.0);
        assert!((share(0.04) - share(0.02) - share(0.2) + share(0.1)).abs() < 1e-9);
    }

    #[test]
    fn axes_and_marks_of_absurd_numbers_are_finite() {
        let absurd = [
            0.0,
            -1.0,
            f64::NAN,
            1e-308,
            f64::INFINITY,
            1e308,
            1e-300,
            -1e308,
        ];
        for (from, to) in absurd
            .into_iter()
            .flat_map(|from| absurd.map(|to| (from, to)))
        {
            let x = Axis::linear("x", from, to);
            let y = Axis::logarithmic("y", [from, to].into_iter());
            for axis in [&x, &y] {
                let Range { start, end } = axis.ends;
                assert!(start < end && (end - start).is_finite(), "{from} to {to}");
                assert!(axis.numbers(10).len() <= 30);
            }
            let mut panel = Panel::new(300, x, y);
            let points = || absurd.into_iter().zip(absurd);
            panel.line(points(), Stroke::new(INK, 1));
            panel.dots(points(), 3, COLOURS[0], true);
            panel.rectangle([(from, to), (to, from)], COLOURS[1], 0.5);
            let svg = svg("absurd numbers", &[panel]);
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        }
    }

    #[test]
    fn a_long_line_is_thinned_out() {
        let axis = || Axis::linear("x", 0.0, 1e6);
        let mut panel = Panel::new(300, axis(), axis());
        panel.line(
            (0..1_000_000).map(|x| (f64::from(x), 5.0)),
            Stroke::new(INK, 1),
        );
        assert_eq!(svg("a line", &[panel]).matches(",2").count(), MAX_POINTS);
    }
}
