//! Options of a run, and the switch that ends it.

use std::path::PathBuf;
use std::sync::Arc;

use xplane_bridge::LocalUdp;
use xplane_bridge::pixels::{FfmpegScreen, PixelChoice, Screen};

use super::remote::Remote;
use super::run::patience::Patience;
use super::session::restart::Restart;
use super::session::simulators::Simulators;
use crate::plan::shard::Shard;

/// A switch that can be set once, from any thread, e.g. by Ctrl-C.
pub use tokio_util::sync::CancellationToken as Cancel;

/// Options of [`super::generate`].
#[derive(Debug, Clone)]
pub struct GenerateOptions {
    /// The simulators; each records one scenario at a time.
    pub simulators: Simulators,
    /// The program that becomes the stand-in when called with `mock-xplane`: the `dtd` command itself.
    pub stand_in_program: PathBuf,
    /// The local side of UDP towards simulators that run already; with several, the port of the first, and the next ones follow.
    pub local_udp: LocalUdp,
    /// Source of the images.
    pub pixels: PixelChoice,
    /// The screen to grab, if the images come from one.
    pub screen: Arc<dyn Screen>,
    /// Identifiers of the scenarios to record; empty for all.
    pub only: Vec<String>,
    /// This run's shard of the plan.
    pub shard: Shard,
    /// Timeouts and retries.
    pub patience: Patience,
    /// Restart command for simulators, if there is one.
    pub restart: Option<Restart>,
    /// The object store of the corpus; its folder is then only the stage.
    pub remote: Option<Remote>,
}

impl GenerateOptions {
    /// All scenarios, by these simulators; a stand-in is started as `dtd`.
    pub fn new(simulators: impl Into<Simulators>) -> Self {
        Self {
            simulators: simulators.into(),
            stand_in_program: "dtd".into(),
            local_udp: LocalUdp::default(),
            pixels: PixelChoice::Auto,
            screen: Arc::new(FfmpegScreen::here()),
            only: Vec::new(),
            shard: Shard::WHOLE,
            patience: Patience::default(),
            restart: None,
            remote: None,
        }
    }
}
