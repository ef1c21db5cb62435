//! A scenario's Parquet tables.

pub mod aircraft;
pub mod backgrounds;
pub mod columns;
pub mod frames;
pub mod health;
pub mod image_rows;
pub mod pixel_box;
pub mod registrations;
pub(crate) mod row_parts;
