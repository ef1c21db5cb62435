//! Density and motion of the air.
//!
//! Input: the weather, the height, the aircraft's heading. Output: density after the International Standard Atmosphere (ISO 2533) and
//! velocity of the air: a mean wind that grows with height by the power law, discrete gusts, and turbulence.

use dataset::conditions::Weather;
use glam::{DMat3, DVec3};

use super::gust::Gusts;
use super::turbulence::Turbulence;

const REPORTED_WIND_HEIGHT_M: f64 = 10.0;
/// Exponent of the power law over open flat ground in neutral air (Davenport 1960); also fits the recorded flights.
const POWER_LAW_EXPONENT: f64 = 1.0 / 7.0;
/// The power law describes the boundary layer; the wind is constant above, metres.
const BOUNDARY_LAYER_M: f64 = 1_000.0;
/// Density at sea level, kilograms per cubic metre.
pub(crate) const SEA_LEVEL_DENSITY_KG_PER_M3: f64 = 1.225;

/// Density of the standard atmosphere (troposphere), kilograms per cubic metre.
pub(crate) fn density_kg_per_m3(altitude_msl_m: f64) -> f64 {
    SEA_LEVEL_DENSITY_KG_PER_M3 * (1.0 - 2.255_77e-5 * altitude_msl_m).powf(4.255_88)
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AirMotion {
    /// Direction that the air moves to, north, east and down, metres per second.
    pub(crate) velocity_ned_mps: DVec3,
    /// Turbulent part of the velocity.
    pub(crate) turbulence_ned_mps: DVec3,
    /// Rotation of the air about the flight path, radians per second, right wing down positive.
    pub(crate) roll_rad_per_s: f64,
}

#[derive(Debug)]
pub(crate) struct Air {
    wind_at_10_m_ned_mps: DVec3,
    gusts: Gusts,
    turbulence: Turbulence,
}

impl Air {
    /// The air of this weather; `seed` decides gusts and turbulence, of which a wing of `span_m` takes the mean.
    pub(crate) fn new(weather: &Weather, seed: u64, span_m: f64) -> Self {
        let from_rad = weather.wind_from_true_deg.to_radians();
        Self {
            wind_at_10_m_ned_mps: -weather.wind_speed_mps
                * DVec3::new(from_rad.cos(), from_rad.sin(), 0.0),
            gusts: Gusts::new(weather.turbulence_ratio, seed),
            turbulence: Turbulence::new(weather.turbulence_ratio, seed, span_m),
        }
    }

    /// Mean wind at a height above ground: velocity of the air, metres per second.
    pub(crate) fn mean_wind_ned_mps(&self, height_m: f64) -> DVec3 {
        // Below a metre the power law ends in roughness elements: no need to follow it down to zero.
        let height_m = height_m.clamp(1.0, BOUNDARY_LAYER_M);
        self.wind_at_10_m_ned_mps * (height_m / REPORTED_WIND_HEIGHT_M).powf(POWER_LAW_EXPONENT)
    }

    /// The air's motion at `time_s`, one step after the last call, for an aircraft at a height above ground.
    pub(crate) fn step(
        &mut self,
        time_s: f64,
        height_m: f64,
        heading_rad: f64,
        airspeed_mps: f64,
    ) -> AirMotion {
        let gust = self.turbulence.step(height_m, airspeed_mps);
        let turbulence_ned_mps = DMat3::from_rotation_z(heading_rad)
            * DVec3::new(gust.along_mps, gust.right_mps, gust.down_mps);
        let wind = self.mean_wind_ned_mps(height_m) * (1.0 + self.gusts.factor_at(time_s));
        AirMotion {
            velocity_ned_mps: wind + turbulence_ned_mps,
            turbulence_ned_mps,
            roll_rad_per_s: gust.roll_rad_per_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn density_meets_the_table_of_the_standard_atmosphere() {
        assert!((density_kg_per_m3(0.0) - 1.225).abs() < 1e-9);
        assert!((density_kg_per_m3(1_000.0) - 1.1117).abs() < 2e-4);
        assert!((density_kg_per_m3(2_000.0) - 1.0066).abs() < 2e-4);
    }

    #[test]
    fn wind_is_the_reported_one_at_10_m_and_grows_with_height() {
        let weather = Weather {
            visibility_m: 40_000.0,
            clouds: vec![],
            rain_ratio: 0.0,
            wind_speed_mps: 8.0,
            wind_from_true_deg: 90.0,
            turbulence_ratio: 0.0,
        };
        let air = Air::new(&weather, 0, 35.8);
        // A wind from the east carries the air west.
        assert!(
            air.mean_wind_ned_mps(10.0)
                .abs_diff_eq(DVec3::new(0.0, -8.0, 0.0), 1e-12)
        );
        let ratio = air.mean_wind_ned_mps(750.0).length() / 8.0;
        assert!((ratio - 1.853).abs() < 0.001, "{ratio}");
    }
}
