//! Keeps ONNX Runtime from reporting to its maker.
//!
//! The library that `dtd detect` loads reads the environment while it starts, makes a device identifier in the user's cache folder, and
//! sends events with the program's path over the network; its own function against that comes too late.

#![allow(unsafe_code)]

use labeller::detector::NO_TELEMETRY_VARIABLE;

/// Switches reporting off, for this process and those that it starts. Only as the first thing in `main`.
pub(crate) fn switch_off() {
    // SAFETY: changing the environment is sound while no other thread reads it, and before `main` does anything there is no other
    // thread. The safe way would be to start the program a second time.
    unsafe { std::env::set_var(NO_TELEMETRY_VARIABLE, "1") };
}
