//! Other aircraft of a scenario, beside the flight that is recorded: what the simulator draws, and what the table says.

use airframe::AircraftType;
use dataset::geometry::pose::FlightState;
use dataset::plan::{Common, Parameters};
use dataset::tables::aircraft::AircraftRow;
use xplane_bridge::TrafficPath;
use xplane_bridge::link::TrafficState;

use crate::generate::error::ScenarioError;
use crate::trajectory::{Approach, Placed, TrafficFault, Trajectory, Window};

/// The other aircraft, by number, at every tick.
#[derive(Debug, Default)]
pub(crate) struct OthersFlown {
    /// As the simulator draws them.
    pub(crate) paths: Vec<TrafficPath>,
    places: Vec<Vec<Placed>>,
}

impl OthersFlown {
    /// Flies the planned ones beside the first aircraft for this number of ticks.
    pub(crate) fn beside(
        trajectory: &Trajectory,
        window: Window,
        common: &Common,
        parameters: &Parameters,
        ticks: usize,
    ) -> Result<Self, ScenarioError> {
        let others = &parameters.traffic;
        if others.is_empty() {
            return Ok(Self::default());
        }
        let first = AircraftType::named(parameters.aircraft(common))
            .map_err(|unknown| TrafficFault::of(0, unknown))?;
        let rate = common.picture.frame_rate;
        let times: Vec<_> = (0..ticks as u32)
            .map(|tick| rate.time_of_tick(tick))
            .collect();
        let times_s: Vec<f64> = times.iter().map(|time| time.seconds()).collect();
        let approach = Approach::new(trajectory, window, &common.runway, first)?;
        let places = approach.fly(others, &times_s)?;
        let paths = others
            .iter()
            .zip(&places)
            .map(|(other, places)| TrafficPath {
                aircraft: other.aircraft.clone(),
                states: times
                    .iter()
                    .zip(places)
                    .map(|(time, placed)| TrafficState {
                        time_ns: time.0,
                        pose: placed.pose,
                        controls: placed.controls,
                    })
                    .collect(),
            })
            .collect();
        Ok(Self { paths, places })
    }
}

/// The rows of `aircraft.parquet`: at each tick the first aircraft, in these states, and the others.
pub(crate) fn aircraft_rows(states: &[FlightState], others: &OthersFlown) -> Vec<AircraftRow> {
    let mut rows = Vec::with_capacity(states.len() * (1 + others.places.len()));
    for (tick, state) in states.iter().enumerate() {
        let others = others.places.iter().map(|places| places[tick]);
        let all = std::iter::once(Placed::of(state)).chain(others);
        rows.extend((0..).zip(all).map(|(aircraft_number, placed)| AircraftRow {
            tick: tick as u32,
            aircraft_number,
            pose: placed.pose,
            controls: placed.controls,
            on_ground: placed.on_ground,
            dtd_m: None,
        }));
    }
    rows
}
