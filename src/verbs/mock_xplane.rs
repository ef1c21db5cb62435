//! `dtd mock-xplane`: the stand-in as a process.

use mock_xplane::server::{ServerOptions, serve};

use super::Outcome;
use super::async_runtime::async_runtime;
use crate::args::MockXplaneArgs;
use crate::failure::Ending;

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &MockXplaneArgs) -> Outcome {
    let options = ServerOptions { bind: args.bind, port: args.port, ..ServerOptions::default() };
    async_runtime()?.block_on(async {
        tokio::select! {
            result = serve(options, |addresses| match serde_json::to_string(&addresses) {
                Ok(line) => println!("{line}"),
                Err(error) => tracing::error!("cannot print the addresses: {error}"),
            }) => result?,
            signal = tokio::signal::ctrl_c() => signal?,
        }
        Ok(Ending::Done)
    })
}
