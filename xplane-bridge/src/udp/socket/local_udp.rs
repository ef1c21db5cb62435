//! Local side of a client's UDP socket: its port, and a note about it in a file.
//!
//! X-Plane keeps sending to a client that was killed, and ends a subscription only for the port that made it. So a client notes its
//! port in a file, which it removes when it has ended its subscriptions. The next client finds the file, takes over the port if no other
//! program has it, and ends what still arrives. Each port has a separate file, named after it: several clients may run at once, and
//! creating or removing one is atomic.

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// The local side of UDP.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LocalUdp {
    /// The port that answers come to; any free one without.
    pub port: Option<u16>,
    /// The folder for notes of ports in use; without, a client that is killed leaves its subscriptions.
    pub notes: Option<PathBuf>,
}

impl LocalUdp {
    /// The notes of clients that ran, or still run, with this simulator.
    pub(super) fn notes(&self, simulator: SocketAddr) -> Vec<PortNote> {
        let Some(folder) = self.folder(simulator) else {
            return Vec::new();
        };
        let Ok(entries) = fs::read_dir(folder) else {
            return Vec::new();
        };
        let mut notes: Vec<PortNote> = entries
            .flatten()
            .filter_map(|entry| PortNote::of(entry.path()))
            .collect();
        notes.sort_by_key(|note| note.port);
        notes
    }

    /// Notes a port. It works without as well, so a failure is only logged.
    pub fn note(&self, simulator: SocketAddr, port: u16) -> Option<PortNote> {
        let folder = self.folder(simulator)?;
        let path = folder.join(port.to_string());
        let noted = make_folders(&folder).and_then(|made| match create(&path) {
            // A fixed port that an earlier, killed client used.
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
            _ => Ok(made),
        });
        match noted {
            Ok(made) => Some(PortNote { path, port, made }),
            Err(error) => {
                tracing::debug!(path = %path.display(), %error, "the local port is not noted");
                None
            }
        }
    }

    fn folder(&self, simulator: SocketAddr) -> Option<PathBuf> {
        // Colons and brackets are not allowed in names everywhere.
        let name = simulator
            .to_string()
            .replace(|c: char| !c.is_ascii_alphanumeric() && c != '.', "_");
        Some(self.notes.as_ref()?.join(name))
    }
}

/// Makes a folder; returns those that were missing, the innermost first.
fn make_folders(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let missing = folder.ancestors().take_while(|folder| !folder.exists());
    let missing = missing.map(Path::to_owned).collect();
    fs::create_dir_all(folder)?;
    Ok(missing)
}

fn create(path: &Path) -> io::Result<()> {
    // Follows no symbolic link.
    let mut file = OpenOptions::new().write(true).create_new(true).open(path)?;
    // For a person who finds the file; only its name is read.
    writeln!(
        file,
        "UDP port of dtd, process {}. It is removed when its subscriptions have been ended.",
        std::process::id()
    )
}

/// A file that is named after a port in use. It stays unless it is removed.
#[derive(Debug)]
pub struct PortNote {
    path: PathBuf,
    port: u16,
    /// Folders that were made for it.
    made: Vec<PathBuf>,
}

impl PortNote {
    fn of(path: PathBuf) -> Option<Self> {
        let port = path.file_name()?.to_str()?.parse().ok()?;
        let made = Vec::new();
        (port != 0).then_some(Self { path, port, made })
    }

    pub(super) fn port(&self) -> u16 {
        self.port
    }

    /// Removes the file, the simulator's folder after the last one, and the folders that were made for it.
    pub fn remove(self) {
        if let Err(error) = fs::remove_file(&self.path) {
            tracing::debug!(path = %self.path.display(), %error, "a note of a port stays");
        }
        // Fails while other clients have files in it.
        let _ = self.path.parent().map(fs::remove_dir);
        for folder in self.made {
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_kept_for_each_simulator_and_nothing_remains_of_them() {
        let state = tempfile::tempdir().unwrap();
        let local = LocalUdp {
            port: None,
            notes: Some(state.path().join("udp-ports")),
        };
        let here: SocketAddr = "127.0.0.1:49000".parse().unwrap();
        let there: SocketAddr = "[fe80::1%3]:49000".parse().unwrap();
        let first = local.note(here, 51_000).unwrap();
        let second = local.note(here, 50_000).unwrap();
        assert!(local.note(here, 51_000).is_some(), "noted twice");
        let other = local.note(there, 50_000).unwrap();
        let ports =
            |simulator| -> Vec<u16> { local.notes(simulator).iter().map(PortNote::port).collect() };
        assert_eq!(ports(here), [50_000, 51_000]);
        assert_eq!(ports(there), [50_000]);
        // The folders of the first one go with the last.
        for note in [second, other, first] {
            note.remove();
        }
        assert!(ports(here).is_empty());
        assert_eq!(fs::read_dir(state.path()).unwrap().count(), 0);
    }

    #[test]
    fn files_of_others_are_no_ports_and_an_unwritable_folder_is_no_error() {
        let state = tempfile::tempdir().unwrap();
        let local = LocalUdp {
            port: None,
            notes: Some(state.path().to_owned()),
        };
        let simulator: SocketAddr = "127.0.0.1:49000".parse().unwrap();
        let folder = local.folder(simulator).unwrap();
        fs::create_dir(&folder).unwrap();
        for name in ["0", "99999", "-1", "port", ".DS_Store"] {
            fs::write(folder.join(name), "").unwrap();
        }
        assert!(local.notes(simulator).is_empty());
        let blocked = LocalUdp {
            port: None,
            notes: Some(folder.join("port")),
        };
        assert!(blocked.note(simulator, 50_000).is_none());
        assert!(LocalUdp::default().note(simulator, 50_000).is_none());
    }
}
