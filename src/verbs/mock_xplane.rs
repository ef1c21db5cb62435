//! `dtd mock-xplane`: the stand-in as a process.

use std::io::{self, Read};
use std::thread;

use mock_xplane::server::{ServerOptions, serve};
use tokio::sync::oneshot;

use super::Outcome;
use super::async_runtime::async_runtime;
use crate::args::MockXplaneArgs;
use crate::failure::Ending;

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &MockXplaneArgs) -> Outcome {
    let options = ServerOptions {
        bind: args.bind,
        port: args.port,
        ..ServerOptions::default()
    };
    let runtime = async_runtime()?;
    let ending = runtime.block_on(async {
        tokio::select! {
            result = serve(options, |addresses| match serde_json::to_string(&addresses) {
                Ok(line) => println!("{line}"),
                Err(error) => tracing::error!("cannot print the addresses: {error}"),
            }) => result?,
            signal = tokio::signal::ctrl_c() => signal?,
            () = stdin_ended(), if args.until_stdin_ends => {}
        }
        Ok(Ending::Done)
    });
    // A picture that is being drawn for nobody need not be finished.
    runtime.shutdown_background();
    ending
}

/// Waits until standard input ends. A thread of its own: reading it cannot be cancelled, and must not keep the runtime alive.
async fn stdin_ended() {
    let (ended, wait) = oneshot::channel();
    thread::spawn(move || {
        let mut ignored = [0; 64];
        while matches!(io::stdin().read(&mut ignored), Ok(1..)) {}
        // Nobody listens any more if the stand-in was stopped otherwise.
        let _ = ended.send(());
    });
    let _ = wait.await;
}
