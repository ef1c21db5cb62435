//! A recorded session instead of a simulator: clients get the recorded simulator's answers.
//!
//! ```text
//! tape --loading--> histories of datarefs, positions          --udp-->  clients
//!               \-> conversation (requests of the link, answers) --link-->
//! ```
//!
//! No answer is invented. A dataref has the recorded values, in their order, and advances past a write or a command when a client sends the
//! same one ([`history`]); the weather at the aircraft is looked up by the same writes ([`shown_weather`]). Capture link requests are
//! answered if the tape has them, under the same written datarefs; otherwise an `error` names the request and what the tape has
//! ([`conversation`]).

mod conversation;
mod history;
mod link;
mod loading;
mod positions;
mod shown_weather;
mod udp;

use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use futures_util::future::BoxFuture;
use tokio::task::{JoinSet, spawn_blocking};
use xplane_bridge::link::LinkToken;
use xplane_bridge::packet::Beacon;
use xplane_tape::TapeReader;

use self::conversation::{Context, Conversation};
use self::history::Histories;
use self::positions::Positions;
use self::shown_weather::ShownWeather;
use super::faults::outages::Outages;
use super::{Addresses, LinkPatience, MockError, Ports, ServerOptions, beacon};

/// Serves a tape until the future is dropped; calls `ready` once it listens. Of the options, only address, beacon and token apply:
/// everything else is as recorded.
///
/// # Errors
/// [`MockError::Tape`] if the tape cannot be read, [`MockError::Bind`] if a port is taken, [`MockError::Socket`] if a socket
/// fails later.
pub fn serve_tape<'a>(
    tape: &'a Path,
    options: &'a ServerOptions,
    ready: impl FnOnce(Addresses) + Send + 'a,
) -> BoxFuture<'a, Result<(), MockError>> {
    Box::pin(run(tape, options, Box::new(ready)))
}

async fn run(
    tape: &Path,
    options: &ServerOptions,
    ready: Box<dyn FnOnce(Addresses) + Send + '_>,
) -> Result<(), MockError> {
    options.check_token()?;
    let path = tape.to_owned();
    let loaded = spawn_blocking(move || loading::load(&path)).await;
    let loaded = loaded.map_err(|panicked| MockError::Stopped(panicked.to_string()))??;
    let ports = Ports::take(options.bind, options.port).await?;
    let addresses = ports.addresses(None);
    let beacon = Beacon {
        version: loaded.version,
        port: addresses.udp.port(),
        name: options.beacon_name.clone(),
        raknet_port: Some(beacon::RAKNET_PORT),
        ..Beacon::default()
    };
    let player = Arc::new(Player {
        playback: Mutex::new(loaded.playback),
        reader: Mutex::new(loaded.reader),
        link_version: loaded.link_version,
        our_link_port: addresses.capture_link.port(),
        token: options.token.clone(),
        patience: options.patience,
    });
    let mut tasks = JoinSet::new();
    tasks.spawn(udp::run(ports.udp, player.clone()));
    tasks.spawn(link::run(ports.capture_link, player));
    if options.beacon {
        let no_outages = Arc::new(Outages::new(Vec::new()));
        tasks.spawn(beacon::run(options.bind, beacon, no_outages));
    }
    ready(addresses);
    match tasks.join_next().await {
        Some(Ok(ended)) => ended,
        Some(Err(panicked)) => Err(MockError::Stopped(panicked.to_string())),
        None => Ok(()),
    }
}

/// Shared state of the tape's server.
struct Player {
    playback: Mutex<Playback>,
    reader: Mutex<TapeReader>,
    link_version: u32,
    our_link_port: u16,
    token: Option<LinkToken>,
    patience: LinkPatience,
}

/// Progress of the replay.
#[derive(Default)]
struct Playback {
    histories: Histories,
    shown_weather: ShownWeather,
    positions: Positions,
    conversation: Conversation,
    /// Writes of clients since the link was opened.
    context: Context,
}

impl Player {
    fn playback(&self) -> MutexGuard<'_, Playback> {
        self.playback.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn reader(&self) -> MutexGuard<'_, TapeReader> {
        self.reader.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
