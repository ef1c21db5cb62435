//! `dtd tape`: records a session with X-Plane on a tape.

use std::env;
use std::net::SocketAddr;
use std::time::Duration;

use generator::generate::stand_in::{StandIn, StandInTask};
use tokio::runtime::Runtime;
use xplane_bridge::link::LinkToken;
use xplane_bridge::udp::discovery::{DISCOVERY_TIMEOUT, the_announced};
use xplane_bridge::{BridgeError, LocalUdp, somebody_answers};
use xplane_tape::{RecordOptions, TapeSummary, record};

use super::Outcome;
use super::address::simulator;
use super::async_runtime::async_runtime;
use super::stdin_ended::stdin_ended;
use crate::args::simulator::TapeArgs;
use crate::failure::{Ending, Failure};
use crate::signals::CleanStop;

/// Timeout for a running simulator to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(2);

/// Runs the verb, until it is stopped.
pub(crate) fn run(args: &TapeArgs) -> Outcome {
    let runtime = async_runtime()?;
    let noting = args.local_udp.options();
    // The recorder's own questions end their subscriptions at once.
    let local_udp = LocalUdp {
        notes: None,
        ..noting.clone()
    };
    let stand_in = own_stand_in(&args.sim, &runtime)?;
    let address = match &stand_in {
        Some(stand_in) => stand_in.address(),
        None => match simulator(&args.sim)? {
            Some(address) => address,
            None => runtime.block_on(announced(&local_udp))?,
        },
    };
    let options = RecordOptions {
        simulator: address,
        bind: args.bind,
        port: args.port,
        out: args.out.clone(),
        token: LinkToken::from_environment(),
        local_udp: noting,
    };
    let clean = CleanStop::begin();
    let recorded = runtime.block_on(async {
        let stop = async {
            tokio::select! {
                () = clean.switch().cancelled() => {}
                () = stdin_ended(), if args.until_stdin_ends => {}
            }
        };
        let ready = |addresses| match serde_json::to_string(&addresses) {
            Ok(line) => println!("{line}"),
            Err(error) => tracing::error!("cannot print the addresses: {error}"),
        };
        let recording = record(options, ready, stop);
        tokio::pin!(recording);
        tokio::select! {
            recorded = &mut recording => return recorded,
            () = look_for(address, &local_udp) => {}
        }
        recording.await
    });
    if let Some(stand_in) = stand_in {
        runtime.block_on(stand_in.stop());
    }
    let summary = recorded.map_err(|error| Failure::bad_input_if(error.is_bad_input(), error))?;
    warn_of_silence(&summary, address);
    eprintln!(
        "recorded {} messages, {:.1} MB: {}",
        summary.messages,
        summary.bytes as f64 / 1e6,
        summary.path.display()
    );
    Ok(Ending::Done)
}

/// A stand-in of our own, if requested: runs as long as the recorder.
fn own_stand_in(sim: &str, runtime: &Runtime) -> Result<Option<StandIn>, Failure> {
    let task = match sim {
        "mock" => StandInTask::Simulate,
        "mock:awkward" => StandInTask::BeAwkward,
        _ => return Ok(None),
    };
    let started = runtime.block_on(StandIn::start(&env::current_exe()?, task));
    Ok(Some(started.map_err(anyhow::Error::from)?))
}

/// Address of the one simulator that announces itself.
async fn announced(local_udp: &LocalUdp) -> Result<SocketAddr, Failure> {
    match the_announced(DISCOVERY_TIMEOUT, local_udp).await {
        Ok(one) => {
            eprintln!("tape: the simulator at {}", one.address);
            Ok(one.address)
        }
        Err(error @ BridgeError::SeveralAnnounced { .. }) => Err(Failure::bad_input(error)),
        Err(error) => Err(error.into()),
    }
}

/// Warns if there is no answer at this address: otherwise a wrong address would show only as an empty tape. Sent outside the recorder, so
/// that the probe is on no tape.
async fn look_for(address: SocketAddr, local_udp: &LocalUdp) {
    if !somebody_answers(address, ANSWER_WITHIN, local_udp).await {
        eprint_warning!(
            "nobody answers at {address} (UDP) yet. What clients send is recorded, and what comes back once X-Plane runs there with \
             Settings > Network > \"Accept incoming connections\" on; is it the right address?"
        );
    }
}

fn warn_of_silence(summary: &TapeSummary, address: SocketAddr) {
    if summary.messages == 0 {
        eprint_warning!(
            "the tape is empty: no client spoke to the recorder. Clients must be given its address, not X-Plane's"
        );
    } else if summary.from_simulator == 0 {
        eprint_warning!(
            "nothing came back from {address}: the tape has only clients' requests, and no answers"
        );
    }
}
