//! Figures of the type that is flown.

use airframe::AircraftType;

use super::aerodynamics::WING_AREA_M2;

/// Figures of a type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Form {
    /// Wing area of a 737 that approaches at the type's speed, square metres.
    pub(crate) wing_area_m2: f64,
    /// Equivalent airspeed on final without wind, metres per second.
    pub(crate) approach_speed_mps: f64,
    /// Distance of the extended wheels below the centre of gravity, metres.
    pub(crate) wheel_height_below_cg_m: f64,
    /// Wing span, metres.
    pub(crate) span_m: f64,
}

impl Form {
    pub(crate) fn of(aircraft: &AircraftType) -> Self {
        let slower =
            AircraftType::boeing_737_800().approach_speed_mps / aircraft.approach_speed_mps;
        Self {
            wing_area_m2: WING_AREA_M2 * slower * slower,
            approach_speed_mps: aircraft.approach_speed_mps,
            wheel_height_below_cg_m: aircraft.wheel_height_below_cg_m(),
            span_m: aircraft.published.span_m,
        }
    }
}
