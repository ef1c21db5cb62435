//! Payload of `flown`: flight states as rows of little-endian 64-bit floats.
//!
//! Binary rather than JSON because a flight at the simulator's rate has some 10^4 states, and because a plugin
//! packs it in one line (`struct` or `array`). The columns are named in the header and checked.

use dataset::geometry::pose::{Controls, FlightState, Pose};

/// Names of the columns, in order.
pub const FLIGHT_COLUMNS: [&str; 14] = [
    "time_s",
    "latitude_deg",
    "longitude_deg",
    "altitude_msl_m",
    "heading_true_deg",
    "pitch_deg",
    "roll_deg",
    "velocity_north_mps",
    "velocity_east_mps",
    "velocity_down_mps",
    "true_airspeed_mps",
    "flap_ratio",
    "gear_ratio",
    "on_ground",
];

const ROW_BYTES: usize = 8 * FLIGHT_COLUMNS.len();

/// Encodes flight states as a payload.
pub fn encode_flight(states: &[FlightState]) -> Vec<u8> {
    let mut payload = Vec::with_capacity(states.len() * ROW_BYTES);
    for state in states {
        let FlightState { pose, controls, .. } = state;
        let row: [f64; 14] = [
            state.time_s,
            pose.latitude_deg,
            pose.longitude_deg,
            pose.altitude_msl_m,
            pose.heading_true_deg,
            pose.pitch_deg,
            pose.roll_deg,
            state.velocity_north_mps,
            state.velocity_east_mps,
            state.velocity_down_mps,
            state.true_airspeed_mps,
            controls.flap_ratio,
            controls.gear_ratio,
            f64::from(u8::from(state.on_ground)),
        ];
        payload.extend(row.iter().flat_map(|value| value.to_le_bytes()));
    }
    payload
}

/// Reason why a payload is not a flight.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct BadFlightPayload(String);

/// Decodes a payload's flight states.
pub fn decode_flight(
    columns: &[String],
    rows: usize,
    payload: &[u8],
) -> Result<Vec<FlightState>, BadFlightPayload> {
    if columns != FLIGHT_COLUMNS {
        return Err(BadFlightPayload(format!(
            "columns are {columns:?}, expected {FLIGHT_COLUMNS:?}"
        )));
    }
    if rows.checked_mul(ROW_BYTES) != Some(payload.len()) {
        return Err(BadFlightPayload(format!(
            "{rows} states of {ROW_BYTES} bytes announced, {} bytes found",
            payload.len()
        )));
    }
    let rows = payload.chunks_exact(ROW_BYTES).map(numbers_of);
    rows.enumerate()
        .map(|(row, numbers)| {
            for (column, found) in FLIGHT_COLUMNS.into_iter().zip(numbers) {
                if !found.is_finite() {
                    return Err(BadFlightPayload(format!(
                        "{column} of state {row} is {found}, expected a finite number"
                    )));
                }
            }
            Ok(state_of(numbers))
        })
        .collect()
}

fn numbers_of(row: &[u8]) -> [f64; FLIGHT_COLUMNS.len()] {
    let mut numbers = [0.0; FLIGHT_COLUMNS.len()];
    for (number, bytes) in numbers.iter_mut().zip(row.as_chunks::<8>().0) {
        *number = f64::from_le_bytes(*bytes);
    }
    numbers
}

fn state_of(numbers: [f64; FLIGHT_COLUMNS.len()]) -> FlightState {
    let [
        time_s,
        latitude_deg,
        longitude_deg,
        altitude_msl_m,
        heading_true_deg,
        pitch_deg,
        roll_deg,
        velocity_north_mps,
        velocity_east_mps,
        velocity_down_mps,
        true_airspeed_mps,
        flap_ratio,
        gear_ratio,
        on_ground,
    ] = numbers;
    FlightState {
        time_s,
        pose: Pose {
            latitude_deg,
            longitude_deg,
            altitude_msl_m,
            heading_true_deg,
            pitch_deg,
            roll_deg,
        },
        velocity_north_mps,
        velocity_east_mps,
        velocity_down_mps,
        true_airspeed_mps,
        controls: Controls {
            flap_ratio,
            gear_ratio,
        },
        on_ground: on_ground != 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states() -> Vec<FlightState> {
        let state = |i: i32| {
            let x = f64::from(i) / 3.0;
            let on_ground = f64::from(u8::from(i == 2));
            state_of([
                x,
                1.0 + x,
                103.0 + x,
                700.0 - x,
                23.0 + x,
                x,
                -x,
                70.0 + x,
                30.0 + x,
                4.0 + x,
                77.0 + x,
                x,
                1.0 - x,
                on_ground,
            ])
        };
        (0..3).map(state).collect()
    }

    fn columns() -> Vec<String> {
        FLIGHT_COLUMNS.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_flight_comes_back_to_the_last_bit() {
        let payload = encode_flight(&states());
        assert_eq!(decode_flight(&columns(), 3, &payload), Ok(states()));
    }

    #[test]
    fn other_columns_lengths_and_places_are_refused() {
        let payload = encode_flight(&states());
        assert!(decode_flight(&columns()[1..], 3, &payload).is_err());
        assert!(decode_flight(&columns(), 4, &payload).is_err());
        assert!(decode_flight(&columns(), usize::MAX, &payload).is_err());
        type Change = fn(&mut FlightState);
        let changes: [(Change, &str); 3] = [
            (|state| state.pose.latitude_deg = f64::NAN, "latitude_deg"),
            (|state| state.pose.roll_deg = f64::INFINITY, "roll_deg"),
            (
                |state| state.true_airspeed_mps = f64::NAN,
                "true_airspeed_mps",
            ),
        ];
        for (change, column) in changes {
            let mut strange = states();
            change(&mut strange[1]);
            let error = decode_flight(&columns(), 3, &encode_flight(&strange)).unwrap_err();
            let said = error.to_string();
            assert!(
                said.starts_with(&format!("{column} of state 1 is")),
                "{said}"
            );
        }
    }
}
