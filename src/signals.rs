//! Ctrl-C and SIGTERM, from a user, a scheduler or a stopping container.
//!
//! While work runs that can end cleanly ([`CleanStop`]), the first signal sets a switch, and the work stops when it sees it. Otherwise, and
//! at the second signal, the process ends at once with the exit code for "try again": everything that `dtd` writes tolerates being cut off
//! at any moment.

use std::io;
use std::process;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;

use crate::failure::TRY_AGAIN;
use crate::logging::repeats;

/// SIGXFSZ, when a file would exceed `ulimit -f`: unhandled it kills the process; handled, the write fails with an error.
const FILE_TOO_LARGE: i32 = 25;

/// The switch. Once set, it stays set.
static STOP: LazyLock<CancellationToken> = LazyLock::new(CancellationToken::new);

/// True while the first signal sets the switch instead of ending the process.
static IS_CLEAN: AtomicBool = AtomicBool::new(false);

/// Registration of work that ends cleanly once the switch is set.
pub(crate) struct CleanStop(());

impl CleanStop {
    /// Until this is dropped, the first signal sets the switch.
    pub(crate) fn begin() -> Self {
        IS_CLEAN.store(true, Ordering::Relaxed);
        Self(())
    }

    /// The switch.
    pub(crate) fn switch(&self) -> &'static CancellationToken {
        &STOP
    }
}

impl Drop for CleanStop {
    fn drop(&mut self) {
        IS_CLEAN.store(false, Ordering::Relaxed);
    }
}

/// Handles Ctrl-C, SIGTERM and SIGXFSZ for the rest of the process.
pub(crate) fn watch() -> io::Result<()> {
    let runtime = Builder::new_current_thread().enable_io().build()?;
    // Before the thread starts, so that even an immediate signal does not have its default effect.
    let (mut interrupt, mut terminate) = {
        let _inside = runtime.enter();
        (
            signal(SignalKind::interrupt())?,
            signal(SignalKind::terminate())?,
        )
    };
    {
        let _inside = runtime.enter();
        // The signal is ignored, but the handler stays installed.
        let _handled = signal(SignalKind::from_raw(FILE_TOO_LARGE))?;
    }
    thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            runtime.block_on(async {
                loop {
                    tokio::select! {
                        _ = interrupt.recv() => {}
                        _ = terminate.recv() => {}
                    }
                    react();
                }
            });
        })?;
    Ok(())
}

fn react() {
    if IS_CLEAN.load(Ordering::Relaxed) && !STOP.is_cancelled() {
        eprintln!("stopping cleanly; a second signal ends at once");
        STOP.cancel();
    } else {
        eprintln!("interrupted: run the same command again");
        repeats::write_counts();
        process::exit(TRY_AGAIN.into());
    }
}
