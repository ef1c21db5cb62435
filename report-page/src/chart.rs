//! Charts as SVG: size, axes, grid and colours.

use std::ops::Range;

use plotters::chart::MeshStyle;
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
pub const MOST_POINTS: usize = 2_000;

/// Where a chart is drawn.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;
/// A chart with two linear axes.
pub type Chart<'a, 'b> =
    ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
/// Result of drawing.
pub type Drawn = std::result::Result<(), DrawingError>;

/// Runs `draw` on an empty SVG of this height. `what` names the chart in errors.
pub fn svg(what: &'static str, height: u32, draw: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
        draw(&area)
            .and_then(|()| area.present())
            .map_err(|cause| Error::Chart { what, cause })?;
    }
    // A width in the file would prevent the page from scaling the picture.
    let text = with_minus_signs(&text);
    Ok(text.replacen(&format!("width=\"{WIDTH}\" height=\"{height}\" "), "", 1))
}

/// Axes and grid as all charts have them.
pub fn axes<'a, 'b, 'c>(
    chart: &'c mut Chart<'a, 'b>,
) -> MeshStyle<'a, 'c, RangedCoordf64, RangedCoordf64, SVGBackend<'b>> {
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
    match from.is_finite() && to.is_finite() {
        true if to - from > least => from..to,
        true => from..from + least.max(1.0),
        false => 0.0..1.0,
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
    let every = inside.len().div_ceil(MOST_POINTS).max(1);
    inside.into_iter().step_by(every).collect()
}

/// The colour of a series as CSS, for legends outside the charts.
pub fn css_colour(which: usize) -> String {
    let RGBColor(red, green, blue) = COLOURS[which % COLOURS.len()];
    format!("rgb({red},{green},{blue})")
}
