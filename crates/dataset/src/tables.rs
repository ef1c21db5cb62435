//! The Parquet tables of a scenario.

pub mod columns;
pub mod frames;
pub mod health;
pub mod pixel_box;
pub mod registrations;
