//! Disables ONNX Runtime's telemetry.
//!
//! The library that `dtd detect` loads reads the environment while it starts, creates a device identifier in the user's cache
//! folder, and sends events with the program's path over the network; its own function to disable that comes too late.

#![allow(unsafe_code)]

use labeller::detector::NO_TELEMETRY_VARIABLE;

/// Disables telemetry for this process and its children. Must be the first thing in `main`.
pub(crate) fn switch_off() {
    // SAFETY: changing the environment is sound while no other thread reads it, and at the start of `main` there is no other
    // thread. The safe alternative would be to start the program a second time.
    unsafe { std::env::set_var(NO_TELEMETRY_VARIABLE, "1") };
}
