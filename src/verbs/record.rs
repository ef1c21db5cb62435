//! `dtd record`: a session with X-Plane on a tape.

use generator::generate::Cancel;
use xplane_bridge::tape::{RecordOptions, record};

use super::Outcome;
use super::address::address;
use super::async_runtime::async_runtime;
use super::stdin_ended::stdin_ended;
use crate::args::RecordArgs;
use crate::failure::{Ending, Failure};
use crate::signals;

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &RecordArgs) -> Outcome {
    let options = RecordOptions {
        simulator: address(&args.sim)?,
        bind: args.bind,
        port: args.port,
        out: args.out.clone(),
        frames: args.frames,
    };
    let cancel = Cancel::new();
    let _in_good_order = signals::in_good_order(&cancel);
    let recorded = async_runtime()?.block_on(async {
        let stop = async {
            tokio::select! {
                () = cancel.turned() => {}
                () = stdin_ended(), if args.until_stdin_ends => {}
            }
        };
        let ready = |addresses| match serde_json::to_string(&addresses) {
            Ok(line) => println!("{line}"),
            Err(error) => tracing::error!("cannot print the addresses: {error}"),
        };
        record(options, ready, stop).await
    });
    let summary = recorded.map_err(|error| match error {
        error if error.is_bad_input() => Failure::bad_input(error),
        error => error.into(),
    })?;
    eprintln!(
        "recorded {} messages, {:.1} MB: {}",
        summary.messages,
        summary.bytes as f64 / 1e6,
        summary.path.display()
    );
    Ok(Ending::Done)
}
