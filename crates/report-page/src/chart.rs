//! Charts as SVG: size, axes, grid and colours.

use std::ops::Range;

use plotters::chart::MeshStyle;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use crate::error::{DrawingError, Error, Result};
use crate::number::with_minus_signs;

const WIDTH: u32 = 960;
/// Colours of series; distinguishable for colour-blind readers (Okabe and Ito).
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(213, 94, 0),
    RGBColor(86, 180, 233),
];
/// Colour of the grid and of frames.
pub const GRID: RGBColor = RGBColor(226, 229, 233);
/// Colour of text and axes.
pub const INK: RGBColor = RGBColor(55, 60, 67);
/// Font of all text.
pub const FONT: &str = "sans-serif";
/// Maximum points of a line or cloud: a screen shows no more, and a page must open.
pub const MAX_POINTS: usize = 2_000;

/// Drawing area of a chart.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
/// A chart over a linear axis; its other axis is linear unless another one is named.
pub type Chart<'a, 'b, Y = RangedCoordf64> =
    ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, Y>>;
/// Result of drawing.
pub type Drawn = std::result::Result<(), DrawingError>;

/// Runs `draw` on an empty SVG of this height. `what` names the chart in errors, and for readers who do not see it.
pub fn svg(what: &'static str, height: u32, draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present())
            .map_err(|cause| Error::Chart { what, cause })?;
    }
    // A width in the file would prevent the page from scaling the image.
    let text = with_minus_signs(&text);
    let size = format!("width=\"{WIDTH}\" height=\"{height}\" ");
    let name = format!("role=\"img\" aria-label=\"{what}\" ");
    Ok(text.replacen(&size, &name, 1))
}

/// Axes and grid as all charts have them.
pub fn axes<'a, 'b, 'c, Y: Ranged<ValueType = f64> + ValueFormatter<f64>>(
    chart: &'c mut Chart<'a, 'b, Y>,
) -> MeshStyle<'a, 'c, RangedCoordf64, Y, SVGBackend<'b>> {
    let mut style = chart.configure_mesh();
    style
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .axis_style(INK)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .label_style((FONT, 13).into_font().color(&INK))
        .axis_desc_style((FONT, 14).into_font().color(&INK));
    style
}

/// Ends of an axis that covers some numbers. Drawing an axis of zero or infinite length would never end.
pub fn axis(from: f64, to: f64) -> Range<f64> {
    let least = 1e-6 * from.abs().max(to.abs());
    if !(from.is_finite() && to.is_finite()) {
        0.0..1.0
    } else if to - from > least {
        from..to
    } else {
        from..from + least.max(1.0)
    }
}

/// A logarithmic axis with numbers at 1, 2 and 5 of each power of ten, or at the powers alone.
#[derive(Debug, Clone)]
pub struct LogarithmicAxis {
    ends: Range<f64>,
}

impl LogarithmicAxis {
    /// Widest ratio of the ends.
    const MAX_RATIO: f64 = 1e9;

    /// The axis that covers all positive numbers among these, with some room.
    pub fn over(numbers: impl Iterator<Item = f64>) -> Self {
        let usable = numbers.filter(|number| number.is_normal() && *number > 0.0);
        let ends = usable.fold(None, |ends: Option<(f64, f64)>, number| {
            let (low, high) = ends.unwrap_or((number, number));
            Some((low.min(number), high.max(number)))
        });
        let (low, high) = ends.unwrap_or((0.1, 1.0));
        let high = high.clamp(1e-9, 1e9) * 1.5;
        Self {
            ends: (low / 1.5).clamp(high / Self::MAX_RATIO, high / 4.0)..high,
        }
    }

    /// A number of the axis as text.
    pub fn number(number: &f64) -> String {
        let decimals = (-(number.log10() + 1e-9).floor()).max(0.0) as usize;
        format!("{number:.decimals$}")
    }
}

impl Ranged for LogarithmicAxis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    /// Numbers beyond the ends are at the ends.
    fn map(&self, number: &f64, (first, last): (i32, i32)) -> i32 {
        let Range { start, end } = self.ends;
        let share = (number.clamp(start, end) / start).ln() / (end / start).ln();
        first + (share * f64::from(last - first)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        let Range { start, end } = self.ends;
        let powers = start.log10().floor() as i32..=end.log10().ceil() as i32;
        let has_room = 3 * powers.clone().count() <= hint.max_num_points();
        let factors: &[f64] = if has_room { &[1.0, 2.0, 5.0] } else { &[1.0] };
        powers
            .flat_map(|power| {
                factors
                    .iter()
                    .map(move |factor| factor * 10_f64.powi(power))
            })
            .filter(|number| (start..=end).contains(number))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.ends.clone()
    }
}

/// The points inside a chart, thinned out evenly if there are too many.
pub fn shown_points(
    points: impl Iterator<Item = (f64, f64)>,
    x: &Range<f64>,
    y: &Range<f64>,
) -> Vec<(f64, f64)> {
    let inside: Vec<_> = points
        .filter(|point| {
            (x.start..=x.end).contains(&point.0) && (y.start..=y.end).contains(&point.1)
        })
        .collect();
    let every = inside.len().div_ceil(MAX_POINTS).max(1);
    inside.into_iter().step_by(every).collect()
}

/// The colour of a series as CSS, for legends outside the charts: the style sheet has it, and another one for dark paper.
pub fn css_colour(which: usize) -> String {
    format!("var(--series-{})", which % COLOURS.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::STYLE;

    #[test]
    fn the_style_sheet_has_the_colours_of_the_charts_and_replaces_them_on_dark_paper() {
        for (which, RGBColor(red, green, blue)) in COLOURS.iter().enumerate() {
            let light = format!("--series-{which}: rgb({red},{green},{blue})");
            assert!(STYLE.contains(&light), "{light}");
            for attribute in ["fill", "stroke"] {
                let dark = format!(
                    "svg [{attribute}=\"#{red:02X}{green:02X}{blue:02X}\"] {{ {attribute}: {}; }}",
                    css_colour(which)
                );
                assert!(STYLE.contains(&dark), "{dark}");
            }
        }
    }

    #[test]
    fn a_logarithmic_axis_has_room_around_its_numbers_and_round_ones_along_it() {
        let axis = LogarithmicAxis::over([0.012, 0.3].into_iter());
        let numbers: Vec<_> = axis
            .key_points(20)
            .iter()
            .map(LogarithmicAxis::number)
            .collect();
        assert_eq!(numbers, ["0.01", "0.02", "0.05", "0.1", "0.2"]);
        assert_eq!(axis.key_points(3), [0.01, 0.1]);
        let place = |number: f64| axis.map(&number, (400, 0));
        assert!(place(0.012) < 400 && place(0.3) > 0);
        // As far from 0.02 to 0.04 as from 0.1 to 0.2.
        assert!((place(0.02) - place(0.04)).abs_diff(place(0.1) - place(0.2)) <= 1);
    }

    #[test]
    fn a_logarithmic_axis_of_absurd_numbers_is_finite() {
        for numbers in [
            &[][..],
            &[0.0],
            &[-1.0, f64::NAN],
            &[1e-308, f64::INFINITY],
            &[1e308],
            &[1e-300, 1e300],
        ] {
            let axis = LogarithmicAxis::over(numbers.iter().copied());
            let Range { start, end } = axis.range();
            assert!(0.0 < start && start < end && end.is_finite(), "{numbers:?}");
            for number in numbers.iter().filter(|number| !number.is_nan()) {
                assert!((0..=400).contains(&axis.map(number, (400, 0))), "{number}");
            }
            assert!(axis.key_points(20).len() <= 20);
        }
    }
}
