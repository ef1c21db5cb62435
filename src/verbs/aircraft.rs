//! `dtd aircraft`: the types that sweeps may name.

use airframe::{AircraftType, Configuration, Drawing, Published, three_views};
use serde::Serialize;

use super::Outcome;
use super::output::{print_json, print_table};
use crate::args::imports::{AircraftArgs, AircraftCommand, AircraftShowArgs};
use crate::failure::{Ending, Failure};

/// Scale of the drawings.
const PX_PER_M: f64 = 8.0;
/// Flaps and gear of an aircraft that is about to land.
const LANDING: Configuration = Configuration {
    flap_ratio: 0.75,
    gear_ratio: 1.0,
};

/// Runs the verb.
pub(crate) fn run(args: &AircraftArgs) -> Outcome {
    if let Some(AircraftCommand::Show(show)) = &args.command {
        return draw(show);
    }
    let listed: Vec<Listed> = AircraftType::all().iter().map(Listed::of).collect();
    if args.json {
        print_json(&listed)?;
        return Ok(Ending::Done);
    }
    let rows: Vec<Vec<String>> = listed
        .iter()
        .map(|of| {
            vec![
                of.name.to_owned(),
                of.designator.to_owned(),
                format!("{:.2}", of.span_m),
                format!("{:.2}", of.length_m),
                format!("{:.2}", of.height_m),
                format!("{:.1}", of.approach_speed_mps),
                if of.in_x_plane { "yes" } else { "no" }.to_owned(),
            ]
        })
        .collect();
    let heading = [
        "aircraft",
        "ICAO",
        "span m",
        "length m",
        "height m",
        "final m/s",
        "X-Plane 12",
    ];
    print_table(&heading, &rows);
    Ok(Ending::Done)
}

fn draw(args: &AircraftShowArgs) -> Outcome {
    let types: Result<Vec<&AircraftType>, _> = args
        .types
        .iter()
        .map(|name| AircraftType::named(name))
        .collect();
    let types = types.map_err(Failure::bad_input)?;
    let Drawing {
        width_px,
        height_px,
        rgb,
    } = three_views(&types, LANDING, PX_PER_M);
    let image = image::RgbImage::from_raw(width_px as u32, height_px as u32, rgb)
        .unwrap_or_else(|| unreachable!("a drawing has three bytes per pixel"));
    image
        .save_with_format(&args.png, image::ImageFormat::Png)
        .map_err(|error| {
            Failure::bad_input_message(format!("cannot write {}: {error}", args.png.display()))
        })?;
    println!("{}: {width_px} x {height_px} pixels", args.png.display());
    Ok(Ending::Done)
}

/// A type in the list.
#[derive(Serialize)]
struct Listed {
    name: &'static str,
    designator: &'static str,
    title: &'static str,
    span_m: f64,
    length_m: f64,
    height_m: f64,
    fuselage_width_m: f64,
    approach_speed_mps: f64,
    /// True if X-Plane 12 brings one along.
    in_x_plane: bool,
    sources: &'static [String],
}

impl Listed {
    fn of(of: &'static AircraftType) -> Self {
        let Published {
            span_m,
            length_m,
            height_m,
            fuselage_width_m,
        } = of.published;
        Self {
            name: &of.name,
            designator: &of.designator,
            title: &of.title,
            span_m,
            length_m,
            height_m,
            fuselage_width_m,
            approach_speed_mps: of.approach_speed_mps,
            in_x_plane: of.x_plane.in_12.is_some(),
            sources: &of.sources,
        }
    }
}
