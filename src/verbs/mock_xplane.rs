//! `dtd mock-xplane`: the stand-in as a process.

use std::sync::Arc;

use mock_xplane::server::{
    Addresses, LinkServer, MockError, PluginOptions, ServerOptions, serve, serve_tape,
};
use mock_xplane::window::{DisplayWindow, X11Window};
use xplane_bridge::link::LinkToken;

use super::Outcome;
use super::async_runtime::async_runtime;
use super::stdin_ended::stdin_ended;
use crate::args::simulator::{MockState, MockXplaneArgs};
use crate::failure::{Ending, Failure};
use crate::signals::CleanStop;

/// A faster clock makes frames longer. Above this length, a flight cannot be followed from frame to frame.
const MAX_FRAME_S: f64 = 0.1;

/// The module that XPPython3 starts.
const PLUGIN: &str = "PI_dtd_bridge.py";

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &MockXplaneArgs) -> Outcome {
    let stage = args.window.map(open_window).transpose()?;
    let is = |state| args.state.contains(&state);
    let mut options = ServerOptions {
        bind: args.bind,
        port: args.port,
        beacon: !args.no_beacon,
        generation: args.xplane,
        web_port: args.web_port,
        flight_loaded: !is(MockState::MainMenu),
        incoming: !is(MockState::IncomingOff),
        faults: args.faults.clone(),
        quirks: args.quirks,
        clock_rate: args.clock_rate,
        token: LinkToken::from_environment(),
        stage,
        link: link(args)?,
        ..ServerOptions::default()
    };
    if is(MockState::NamelessBeacon) {
        options.beacon_name = None;
    }
    let stop = CleanStop::begin();
    let runtime = async_runtime()?;
    let ending = runtime.block_on(async {
        let ready = |addresses: Addresses| match serde_json::to_string(&addresses) {
            Ok(line) => println!("{line}"),
            Err(error) => tracing::error!("cannot print the addresses: {error}"),
        };
        let serving = async {
            match &args.tape {
                Some(tape) => serve_tape(tape, &options, ready).await,
                None => serve(options, ready).await,
            }
        };
        tokio::pin!(serving);
        tokio::select! {
            result = &mut serving => result.map_err(|error| match error {
                MockError::Tape(error) if error.is_bad_input() => Failure::bad_input(error),
                error @ MockError::NoToken { .. } => Failure::bad_input(error),
                error => error.into(),
            })?,
            () = stop.switch().cancelled() => {
                // Answers nothing any more, and keeps its ports.
                tokio::time::sleep(args.faults.life.held).await;
            }
            () = stdin_ended(), if args.until_stdin_ends => {}
        }
        Ok(Ending::Done)
    });
    // An image without a waiting client need not be finished.
    runtime.shutdown_background();
    ending
}

fn link(args: &MockXplaneArgs) -> Result<LinkServer, Failure> {
    let has_no_plugin = args.state.contains(&MockState::NoPlugin);
    if has_no_plugin && (args.plugin.is_some() || args.window.is_some()) {
        return Err(Failure::bad_input_message(
            "--state no-plugin has no plugin and no images; leave out --plugin and --window",
        ));
    }
    if (has_no_plugin || args.plugin.is_some()) && !args.faults.cameras.is_empty() {
        return Err(Failure::bad_input_message(format!(
            "--faults {}: only the built-in capture link has faults of cameras; leave out --plugin and --state no-plugin",
            args.faults
        )));
    }
    if args.plugin.is_none() && args.faults.are_of_a_window() {
        return Err(Failure::bad_input_message(format!(
            "--faults {}: only a hosted plugin numbers its frames, and only its images have things that swing; add --plugin and --window",
            args.faults
        )));
    }
    if has_no_plugin {
        return Ok(LinkServer::Nobody);
    }
    let Some(folder) = &args.plugin else {
        return Ok(LinkServer::BuiltIn);
    };
    if !folder.join(PLUGIN).is_file() {
        return Err(Failure::bad_input_message(format!(
            "--plugin {}: it has no {PLUGIN}; expected the repository's folder xplane-bridge/plugin",
            folder.display()
        )));
    }
    Ok(LinkServer::Plugin(PluginOptions {
        window_px: args.window.unwrap_or(args.plugin_window).into(),
        frame_period_s: (PluginOptions::FRAME_PERIOD_S * args.clock_rate).min(MAX_FRAME_S),
        ..PluginOptions::new(folder)
    }))
}

fn open_window(size_px: [u32; 2]) -> Result<Arc<dyn DisplayWindow>, Failure> {
    Ok(Arc::new(X11Window::open(None, size_px.into())?))
}
