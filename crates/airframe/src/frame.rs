//! Body axes, by positions on the aircraft.

use glam::DVec3;

/// Body axes of an aircraft.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    /// Distance of the centre of gravity behind the nose, metres.
    pub(crate) cg_station_m: f64,
}

impl Frame {
    /// A point in body axes from its station (metres behind the nose), metres right of the plane of symmetry, and metres below the
    /// centre of gravity.
    pub(crate) const fn at(&self, station_m: f64, right_m: f64, down_m: f64) -> DVec3 {
        DVec3::new(self.cg_station_m - station_m, right_m, down_m)
    }
}
