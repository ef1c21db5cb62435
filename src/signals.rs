//! Ctrl-C and SIGTERM, from a user, a scheduler or a stopping container.
//!
//! A verb that supports a clean stop registers its switch with [`in_good_order`]; the first signal sets it. Without a switch, and
//! at the second signal, the process ends at once with the exit code for "try again": everything that `dtd` writes tolerates being
//! cut off at any moment.

use std::io;
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use generator::generate::Cancel;
use tokio::runtime::Builder;
use tokio::signal::unix::{SignalKind, signal};

use crate::failure::TRY_AGAIN;
use crate::repeats;

/// SIGXFSZ, when a file would exceed `ulimit -f`: unhandled it kills the process; handled, the write fails with an error.
const FILE_TOO_LARGE: i32 = 25;

/// The switch of the running verb, if it has one.
static SWITCH: Mutex<Option<Cancel>> = Mutex::new(None);

fn switch() -> MutexGuard<'static, Option<Cancel>> {
    SWITCH.lock().unwrap_or_else(PoisonError::into_inner)
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
    match switch().take() {
        Some(cancel) => {
            eprintln!("stopping cleanly; a second signal ends at once");
            cancel.cancel();
        }
        None => {
            eprintln!("interrupted: run the same command again");
            repeats::write_counts();
            process::exit(TRY_AGAIN.into());
        }
    }
}

/// While the returned value exists, the first signal sets `cancel`.
pub(crate) fn in_good_order(cancel: &Cancel) -> impl Drop {
    struct Lent;
    impl Drop for Lent {
        fn drop(&mut self) {
            switch().take();
        }
    }
    *switch() = Some(cancel.clone());
    Lent
}
