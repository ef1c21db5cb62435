//! Plots six flights recorded from an independent model, and the built-in model's twins.
//!
//! `cargo run --release -p flight-model --example compare_flights -- docs/images` writes flights.svg (height, cross-track, airspeed and
//! sink rate over the distance to touchdown) and flight-spectra.svg (airspeed and sink rate on the final approach by frequency).

use std::path::PathBuf;

use dataset::geometry::pose::FlightState;
use plotters::coord::Shift;
use plotters::prelude::*;
use testkit::approach::{above_path_m, relative};
use testkit_simulator::recorded_flights::{RecordedFlight, recorded_flights, spectrum};

const SEEDS: u64 = 8;
/// Length of the final approach that is averaged into one point, metres.
const BIN_M: f64 = 200.0;
const BINS: usize = 90;
/// Stabilised final approach for the spectra, metres before the target.
const FINAL_M: std::ops::Range<f64> = 740.0..7_840.0;
const RECORDED: RGBColor = RGBColor(20, 22, 26);
const TWINS: RGBColor = RGBColor(0, 114, 178);
const INK: RGBColor = RGBColor(55, 60, 67);

/// Quantity: name with unit, value, axis range.
type Quantity = (&'static str, fn(&FlightState) -> f64, std::ops::Range<f64>);
type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;

const BY_DISTANCE: [Quantity; 4] = [
    ("height over path, m", above_path_m, -200.0..50.0),
    (
        "cross-track, m",
        |state| relative(state).cross_track_m,
        -40.0..40.0,
    ),
    (
        "true airspeed, m/s",
        |state| state.true_airspeed_mps,
        60.0..110.0,
    ),
    ("sink rate, m/s", |state| state.velocity_down_mps, -3.0..9.0),
];
const BY_FREQUENCY: [Quantity; 2] = [
    ("airspeed, m/s", |state| state.true_airspeed_mps, 1e-3..2.0),
    ("sink rate, m/s", |state| state.velocity_down_mps, 1e-3..2.0),
];

struct Compared {
    flight: RecordedFlight,
    twins: Vec<Vec<FlightState>>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = PathBuf::from(
        std::env::args()
            .nth(1)
            .ok_or("usage: compare_flights FOLDER")?,
    );
    std::fs::create_dir_all(&folder)?;
    let flights: Vec<Compared> = recorded_flights()
        .into_iter()
        .map(|flight| Compared {
            twins: (0..SEEDS).map(|seed| flight.twin(seed)).collect(),
            flight,
        })
        .collect();

    let path = folder.join("flights.svg");
    let area = SVGBackend::new(&path, (1_500, 860)).into_drawing_area();
    area.fill(&WHITE)?;
    for (panel, index) in area.split_evenly((4, 6)).iter().zip(0..) {
        let (quantity, flight) = (&BY_DISTANCE[index / 6], &flights[index % 6]);
        by_distance(panel, quantity, flight, index < 6)?;
    }
    area.present()?;

    let path = folder.join("flight-spectra.svg");
    let area = SVGBackend::new(&path, (1_500, 480)).into_drawing_area();
    area.fill(&WHITE)?;
    let moving: Vec<&Compared> = flights.iter().filter(|f| !f.flight.is_calm()).collect();
    for (panel, index) in area.split_evenly((2, 5)).iter().zip(0..) {
        let (quantity, flight) = (&BY_FREQUENCY[index / 5], moving[index % 5]);
        by_frequency(panel, quantity, flight, index < 5)?;
    }
    area.present()?;
    Ok(())
}

/// Means over stretches of the approach: nautical miles to the target and value.
fn profile(states: &[FlightState], of: fn(&FlightState) -> f64) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); BINS];
    for state in states.iter().filter(|state| !state.on_ground) {
        let bin = relative(state).along_track_m / BIN_M;
        if bin >= 0.0 && (bin as usize) < BINS {
            let (sum, count) = &mut sums[bin as usize];
            *sum += of(state);
            *count += 1.0;
        }
    }
    let middle_nm = |bin: f64| (bin + 0.5) * BIN_M / 1_852.0;
    (0..)
        .zip(sums)
        .filter(|(_, (_, count))| *count > 0.0)
        .map(|(bin, (sum, count))| (middle_nm(f64::from(bin)), sum / count))
        .collect()
}

fn by_distance(
    panel: &Panel,
    (name, of, range): &Quantity,
    compared: &Compared,
    first_row: bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let caption = if first_row { compared.flight.name } else { "" };
    let mut chart = ChartBuilder::on(panel)
        .caption(caption, ("sans-serif", 13).into_font().color(&INK))
        .margin(6)
        .x_label_area_size(26)
        .y_label_area_size(44)
        .build_cartesian_2d(10.0..0.0, range.clone())?;
    chart
        .configure_mesh()
        .x_desc("NM to touchdown")
        .y_desc(*name)
        .x_labels(5)
        .y_labels(5)
        .light_line_style(WHITE)
        .label_style(("sans-serif", 11).into_font().color(&INK))
        .draw()?;
    for twin in &compared.twins {
        chart.draw_series(LineSeries::new(profile(twin, *of), TWINS.mix(0.45)))?;
    }
    let recorded = profile(&compared.flight.states, *of);
    chart.draw_series(LineSeries::new(recorded, RECORDED.stroke_width(2)))?;
    Ok(())
}

/// Amplitudes on the final approach, in third-octave bands.
fn bands(states: &[FlightState], of: fn(&FlightState) -> f64) -> Vec<(f64, f64)> {
    let on_final = |state: &&FlightState| FINAL_M.contains(&relative(state).along_track_m);
    let values: Vec<f64> = states.iter().filter(on_final).map(of).collect();
    let lines = spectrum(&values);
    let third_octave = 2.0_f64.powf(1.0 / 3.0);
    (0..20)
        .map(|band| 0.025 * third_octave.powi(band))
        .filter_map(|from_hz| {
            let band = from_hz..from_hz * third_octave;
            let power: f64 = lines
                .iter()
                .filter(|(hz, _)| band.contains(hz))
                .map(|(_, amplitude)| amplitude.powi(2))
                .sum();
            (power > 0.0).then(|| (from_hz * third_octave.sqrt(), power.sqrt()))
        })
        .collect()
}

fn by_frequency(
    panel: &Panel,
    (name, of, range): &Quantity,
    compared: &Compared,
    first_row: bool,
) -> Result<(), Box<dyn std::error::Error>> {
    let caption = if first_row { compared.flight.name } else { "" };
    let mut chart = ChartBuilder::on(panel)
        .caption(caption, ("sans-serif", 13).into_font().color(&INK))
        .margin(6)
        .x_label_area_size(26)
        .y_label_area_size(50)
        .build_cartesian_2d((0.025..2.5).log_scale(), range.clone().log_scale())?;
    chart
        .configure_mesh()
        .x_desc("Hz")
        .y_desc(*name)
        .light_line_style(WHITE)
        .label_style(("sans-serif", 11).into_font().color(&INK))
        .draw()?;
    for twin in &compared.twins {
        chart.draw_series(LineSeries::new(bands(twin, *of), TWINS.mix(0.45)))?;
    }
    let recorded = bands(&compared.flight.states, *of);
    chart.draw_series(LineSeries::new(recorded, RECORDED.stroke_width(2)))?;
    Ok(())
}
