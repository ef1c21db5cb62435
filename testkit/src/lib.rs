//! Test support that needs no simulator: one runway, one rig, approaches, and small corpora of them.
//!
//! Only a dev-dependency. It knows nothing but `dataset`, so that the unit tests of every other crate can use it; those of `dataset`
//! itself cannot (they would see a second `dataset`) and share only the file `changi_02l.json`. What runs a stand-in or the command
//! is in `testkit-simulator`.

#![forbid(unsafe_code)]

pub mod approach;
pub mod rig;
pub mod runway;
pub mod scenario;
pub mod short_corpus;
pub mod synthetic;

pub use runway::changi_02l;
