//! Numbers: units, exact frame rates, the limits of outside values, fits and distributions.

pub mod frame_rate;
pub mod least_squares;
pub mod limits;
pub mod motion;
pub mod noise_hash;
pub mod spread;
pub mod units;
