//! The local side of UDP, for verbs that talk to a simulator.

use std::env;
use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use clap::value_parser;
use xplane_bridge::LocalUdp;

#[derive(Debug, Clone, Copy, ClapArgs)]
pub(crate) struct LocalUdpArgs {
    /// UDP port of this computer that the simulator's answers come to, for firewalls [default: any free one]
    ///
    /// X-Plane answers from port 49001. Several simulators, or clients of `dtd tape`, take the ports that follow.
    #[arg(long, value_name = "PORT", value_parser = value_parser!(u16).range(1..))]
    pub(crate) udp_port: Option<u16>,
}

impl LocalUdpArgs {
    /// The port, and where it is noted for the client after a killed one.
    pub(crate) fn options(self) -> LocalUdp {
        LocalUdp {
            port: self.udp_port,
            notes: state_folder().map(|state| state.join("dtd").join("udp-ports")),
        }
    }
}

/// The folder for the user's state, which survives a restart of the program.
fn state_folder() -> Option<PathBuf> {
    let folder = |name: &str| {
        env::var_os(name)
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
    };
    let in_home = |place: &str| Some(folder("HOME")?.join(Path::new(place)));
    folder("XDG_STATE_HOME").or_else(|| {
        if cfg!(windows) {
            folder("LOCALAPPDATA")
        } else if cfg!(target_os = "macos") {
            in_home("Library/Application Support")
        } else {
            in_home(".local/state")
        }
    })
}
