//! Our plugin, as it is in the repository and changed.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use mock_xplane::server::{LinkServer, PluginOptions};
use testkit::repository;

/// Folder of the plugin.
pub fn folder() -> PathBuf {
    repository().join("xplane-bridge/plugin")
}

/// A link that it serves, with a window of this size.
pub fn link(window_px: (u32, u32)) -> LinkServer {
    LinkServer::Plugin(options(window_px))
}

/// Default plugin options, to be changed.
pub fn options(window_px: (u32, u32)) -> PluginOptions {
    PluginOptions {
        window_px,
        ..PluginOptions::new(folder())
    }
}

/// A copy of the plugin with changes: in a file, a text is replaced.
pub fn with(target: &Path, changes: &[(&str, &str, &str)]) -> PathBuf {
    let copy = target.join("plugin");
    let package = copy.join("dtd_bridge");
    fs::create_dir_all(&package).unwrap();
    fs::copy(
        folder().join("PI_dtd_bridge.py"),
        copy.join("PI_dtd_bridge.py"),
    )
    .unwrap();
    for entry in fs::read_dir(folder().join("dtd_bridge")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension() == Some(OsStr::new("py")) {
            fs::copy(&path, package.join(path.file_name().unwrap())).unwrap();
        }
    }
    for (file, from, to) in changes {
        let path = package.join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{file} has no {from:?}");
        fs::write(path, text.replace(from, to)).unwrap();
    }
    copy
}
