//! Test support that needs the stand-in: one in this process ([`Running`]) or in another ([`SimulatorProcess`]), engines, X servers,
//! relays that alter what it reports, and recorded flights to compare its own with.
//!
//! Only a dev-dependency of integration tests, examples and benches. The unit tests of `mock-xplane` and `xplane-bridge` cannot use
//! it: they would see a second version of their own types. What needs no simulator is in `testkit`.

#![forbid(unsafe_code)]

mod blank;
pub mod client;
mod cover_window;
mod judged_boxes;
pub mod plugin;
pub mod recorded_flights;
mod relay;
mod running;
mod simulator_process;
mod web_flight;
mod xvfb;

pub use blank::Blank;
pub use cover_window::CoverWindow;
pub use judged_boxes::judged_boxes;
pub use relay::{Relay, altered};
pub use running::{Running, quiet, serving, serving_with};
pub use simulator_process::{PATIENCE, SWEEP, SimulatorProcess};
pub use web_flight::web_flight;
pub use xvfb::Xvfb;
