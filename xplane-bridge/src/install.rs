//! Installs our plugin into an X-Plane folder: checks the installation first, and rejects what cannot work with the reason.
//!
//! Input: the folder of X-Plane. Output: the files in `Resources/plugins/PythonPlugins`, and the remaining steps for the user. A
//! repeated run writes only what differs; the settings file next to the plugin is the user's and never touched.
//!
//! The plugin is embedded in the program.

mod installation;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use installation::{Installation, Version, XpPython3};

/// A file of `plugin/`: its name and its text.
macro_rules! plugin_file {
    ($name:literal) => {
        ($name, include_str!(concat!("../plugin/", $name)))
    };
}

/// The plugin as embedded in this program: path below `PythonPlugins`, text.
const FILES: [(&str, &str); 33] = [
    plugin_file!("PI_dtd_bridge.py"),
    plugin_file!("dtd_bridge/__init__.py"),
    plugin_file!("dtd_bridge/approach.py"),
    plugin_file!("dtd_bridge/autopilot.py"),
    plugin_file!("dtd_bridge/bridge.py"),
    plugin_file!("dtd_bridge/capture.py"),
    plugin_file!("dtd_bridge/check_pattern.py"),
    plugin_file!("dtd_bridge/coded_frames.py"),
    plugin_file!("dtd_bridge/complaints.py"),
    plugin_file!("dtd_bridge/datarefs.py"),
    plugin_file!("dtd_bridge/flight.py"),
    plugin_file!("dtd_bridge/found.py"),
    plugin_file!("dtd_bridge/frame_code.py"),
    plugin_file!("dtd_bridge/frame_numbers.py"),
    plugin_file!("dtd_bridge/installation.py"),
    plugin_file!("dtd_bridge/local_frame.py"),
    plugin_file!("dtd_bridge/log.py"),
    plugin_file!("dtd_bridge/loops.py"),
    plugin_file!("dtd_bridge/messages.py"),
    plugin_file!("dtd_bridge/opengl.py"),
    plugin_file!("dtd_bridge/pixels.py"),
    plugin_file!("dtd_bridge/profile.py"),
    plugin_file!("dtd_bridge/scenery.py"),
    plugin_file!("dtd_bridge/screen_gdi.py"),
    plugin_file!("dtd_bridge/screen_grab.py"),
    plugin_file!("dtd_bridge/screen_x11.py"),
    plugin_file!("dtd_bridge/server.py"),
    plugin_file!("dtd_bridge/settings.py"),
    plugin_file!("dtd_bridge/stage.py"),
    plugin_file!("dtd_bridge/traffic.py"),
    plugin_file!("dtd_bridge/wire.py"),
    plugin_file!("dtd_bridge/xp_api.py"),
    // For users who open the folder.
    ("dtd_bridge/README.txt", README),
];

const README: &str = "This folder and PI_dtd_bridge.py beside it belong to dtd and are written by `dtd install-plugin`.\n\
    Settings go into dtd_bridge.ini beside PI_dtd_bridge.py; dtd_bridge/settings.py says which there are.\n";

/// Reason why the plugin is not installed.
#[derive(Debug, thiserror::Error)]
pub enum InstallError {
    /// The folder is not X-Plane's, or the plugin cannot run in this X-Plane.
    #[error("{0}")]
    Unsuitable(String),
    /// A file cannot be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// The operation.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Underlying error.
        r#source: io::Error,
    },
}

/// The result for a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FileChange {
    /// New or changed.
    Written,
    /// The file was up to date.
    Unchanged,
    /// The file belonged to an older plugin.
    Removed,
}

/// An installed plugin file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InstalledFile {
    /// Path below X-Plane's folder.
    pub path: String,
    /// Result for this file.
    pub change: FileChange,
}

/// Installation result, with the remaining steps.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InstallReport {
    /// Version of X-Plane.
    pub xplane: String,
    /// Version of XPPython3; `None` if it has never run, or its log lacks it.
    pub xppython3: Option<String>,
    /// Conditions that may prevent the plugin from working.
    pub warnings: Vec<String>,
    /// The plugin's files.
    pub files: Vec<InstalledFile>,
    /// The user's remaining steps, in this order.
    pub next_steps: Vec<String>,
}

/// Installs the plugin into X-Plane's folder.
///
/// # Errors
/// See [`InstallError`]; files are written only if the plugin can work there.
pub fn install_plugin(folder: &Path) -> Result<InstallReport, InstallError> {
    let found = Installation::look(folder)?;
    let python_plugins = folder.join(PYTHON_PLUGINS);
    let mut files = Vec::new();
    for (name, text) in FILES {
        let change = put(&python_plugins.join(name), text)?;
        files.push(InstalledFile {
            path: format!("{PYTHON_PLUGINS}/{name}"),
            change,
        });
    }
    files.extend(remove_stale(&python_plugins)?);
    let changed = files
        .iter()
        .any(|file| file.change != FileChange::Unchanged);
    Ok(InstallReport {
        xplane: found.xplane.to_string(),
        xppython3: found.xppython3.version().map(ToString::to_string),
        warnings: found.warnings(),
        next_steps: found.next_steps(changed),
        files,
    })
}

/// Plugin folder of XPPython3.
const PYTHON_PLUGINS: &str = "Resources/plugins/PythonPlugins";

/// Writes a file atomically, if its content differs.
fn put(path: &Path, text: &str) -> Result<FileChange, InstallError> {
    if fs::read(path).is_ok_and(|bytes| bytes == text.as_bytes()) {
        return Ok(FileChange::Unchanged);
    }
    let fresh = path.with_extension("new");
    let write = || {
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::write(&fresh, text)?;
        fs::rename(&fresh, path)
    };
    write().map_err(|source| InstallError::Io {
        action: "write",
        path: path.to_owned(),
        source,
    })?;
    Ok(FileChange::Written)
}

/// Removes modules left over from an older plugin: they would never be imported, but they would confuse users.
fn remove_stale(python_plugins: &Path) -> Result<Vec<InstalledFile>, InstallError> {
    let folder = python_plugins.join("dtd_bridge");
    let failed = |action, path: &Path| {
        let path = path.to_owned();
        move |source| InstallError::Io {
            action,
            path,
            source,
        }
    };
    let mut removed = Vec::new();
    for entry in fs::read_dir(&folder).map_err(failed("list", &folder))? {
        let path = entry.map_err(failed("list", &folder))?.path();
        let name = format!(
            "dtd_bridge/{}",
            path.file_name().unwrap_or_default().to_string_lossy()
        );
        let is_module = path.extension().is_some_and(|extension| extension == "py");
        if is_module && !FILES.iter().any(|(ours, _)| *ours == name) {
            fs::remove_file(&path).map_err(failed("remove", &path))?;
            removed.push(InstalledFile {
                path: format!("{PYTHON_PLUGINS}/{name}"),
                change: FileChange::Removed,
            });
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_module_of_the_plugin_is_carried() {
        let plugin = Path::new(env!("CARGO_MANIFEST_DIR")).join("plugin");
        let mut modules: Vec<String> = fs::read_dir(plugin.join("dtd_bridge"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .filter(|name| name.ends_with(".py"))
            .map(|name| format!("dtd_bridge/{name}"))
            .collect();
        modules.push("PI_dtd_bridge.py".into());
        modules.sort();
        let mut carried: Vec<&str> = FILES
            .iter()
            .map(|(name, _)| *name)
            .filter(|name| name.ends_with(".py"))
            .collect();
        carried.sort_unstable();
        assert_eq!(carried, modules);
    }
}
