//! Basis of the estimate of the recording time: the bundled simulator's figures, or a running X-Plane's profile.

use std::net::SocketAddr;

use generator::generate::SimulatorTarget;
use generator::plan::Pacing;
use xplane_bridge::profile::KnownProfile;
use xplane_bridge::udp::discovery::{DISCOVERY_TIMEOUT, the_announced};
use xplane_bridge::{BridgeError, CONNECT_TIMEOUT, ConnectOptions, LocalUdp, Simulator};

use crate::args::recording::PlanArgs;
use crate::failure::Failure;
use crate::verbs::async_runtime::async_runtime;

pub(super) fn pacing(args: &PlanArgs) -> Result<Pacing, Failure> {
    match &args.sim {
        None | Some(SimulatorTarget::StandIn | SimulatorTarget::AwkwardStandIn) => {
            Ok(Pacing::StandIn)
        }
        Some(SimulatorTarget::Tape(_)) => Err(Failure::bad_input_message(
            "--sim tape:FILE: a tape says nothing of how long an X-Plane takes; name an X-Plane, or `mock`",
        )),
        Some(SimulatorTarget::Address(address)) => {
            asked(connected(*address, args.local_udp.options()))
        }
        Some(SimulatorTarget::Announced) => asked(async {
            let local_udp = args.local_udp.options();
            let announced = the_announced(DISCOVERY_TIMEOUT, &local_udp).await?;
            connected(announced.address, local_udp).await
        }),
    }
}

async fn connected(address: SocketAddr, local_udp: LocalUdp) -> Result<Simulator, BridgeError> {
    let options = ConnectOptions {
        local_udp,
        ..ConnectOptions::from_environment(address)?
    };
    Simulator::connect_with(address, CONNECT_TIMEOUT, options).await
}

/// Reads a running simulator's profile; makes no other requests.
fn asked(
    connecting: impl Future<Output = Result<Simulator, BridgeError>>,
) -> Result<Pacing, Failure> {
    async_runtime()?.block_on(async {
        let simulator = connecting.await?;
        let profile = simulator.profile().clone();
        let has_plugin = simulator.description().plugin.is_some();
        simulator.release().await?;
        if !has_plugin {
            return Ok(Pacing::StandIn);
        }
        if !matches!(profile, KnownProfile::Current(_)) {
            eprintln!("plan: the simulator {profile}");
        }
        Ok(Pacing::XPlane(profile.current().cloned().map(Box::new)))
    })
}
