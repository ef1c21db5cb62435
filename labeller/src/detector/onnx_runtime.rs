//! Finds and starts ONNX Runtime, once per process.
//!
//! The library is not linked but loaded: from `ORT_DYLIB_PATH` if that is set, else from the Python environment that
//! `scripts/setup.sh` makes, looked for from the current folder and from the program's own folder upwards.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;

use crate::error::{Error, Result};

const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";
const PYTHON_LIBRARIES: &str = ".venv/lib";
const IN_PYTHON: &str = "site-packages/onnxruntime/capi";
/// Beginning of `libonnxruntime.so.1.31.1` or `libonnxruntime.1.31.1.dylib`, but not of its `_providers_shared`.
const LIBRARY_PREFIX: &str = "libonnxruntime.";

/// The environment in which all sessions run.
pub(super) fn environment() -> Result<&'static Environment> {
    static STARTED: OnceLock<Environment> = OnceLock::new();
    static STARTING: Mutex<()> = Mutex::new(());
    // ONNX Runtime allows one environment per process: two threads must not start it at the same time.
    let _guard = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(environment) = STARTED.get() {
        return Ok(environment);
    }
    let library = find_library(
        env::var_os(PATH_VARIABLE).map(PathBuf::from),
        &places_to_start(),
    )?;
    let environment = ort::init_from(&library)
        .map_err(|e| Error::runtime(format!("cannot load {}: {e}", library.display())))?
        .with_name("dtd")
        .with_telemetry(false)
        .build()
        .map_err(|e| Error::runtime(format!("cannot start {}: {e}", library.display())))?;
    tracing::debug!(library = %library.display(), "ONNX Runtime started");
    Ok(STARTED.get_or_init(|| environment))
}

fn places_to_start() -> Vec<PathBuf> {
    let program_folder = env::current_exe()
        .ok()
        .and_then(|program| program.parent().map(Path::to_owned));
    env::current_dir()
        .ok()
        .into_iter()
        .chain(program_folder)
        .collect()
}

fn find_library(chosen: Option<PathBuf>, starts: &[PathBuf]) -> Result<PathBuf> {
    if let Some(path) = chosen {
        if path.is_file() {
            return Ok(path);
        }
        let message = format!(
            "{PATH_VARIABLE} is {}, expected the path of libonnxruntime.so",
            path.display()
        );
        return Err(Error::runtime(message));
    }
    starts.iter().flat_map(|start| start.ancestors()).find_map(library_in).ok_or_else(|| {
        let looked = starts.iter().map(|start| start.display().to_string()).collect::<Vec<_>>().join(" and ");
        Error::runtime(format!(
            "not found: no {PYTHON_LIBRARIES}/python3*/{IN_PYTHON}/libonnxruntime.so* in {looked} or any folder above; \
             run `bash scripts/setup.sh` in the repository, or set {PATH_VARIABLE} to the library's path"
        ))
    })
}

/// The library in the Python environment of a folder, if there is one.
fn library_in(folder: &Path) -> Option<PathBuf> {
    let pythons = entries(&folder.join(PYTHON_LIBRARIES));
    pythons
        .iter()
        .flat_map(|python| entries(&python.join(IN_PYTHON)))
        .find(|path| {
            path.file_name()
                .is_some_and(|name| name.to_string_lossy().starts_with(LIBRARY_PREFIX))
        })
}

/// Paths in a folder, sorted; none if it is not there.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<_> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_is_found_in_the_environment_of_a_folder_above() {
        let root = tempfile::tempdir().unwrap();
        let capi = root
            .path()
            .join(".venv/lib/python3.11/site-packages/onnxruntime/capi");
        fs::create_dir_all(&capi).unwrap();
        fs::write(capi.join("libonnxruntime_providers_shared.so"), "").unwrap();
        fs::write(capi.join("libonnxruntime.so.1.31.1"), "").unwrap();
        let deep = root.path().join("target/release");
        assert_eq!(
            find_library(None, &[deep]).unwrap(),
            capi.join("libonnxruntime.so.1.31.1")
        );
    }

    #[test]
    fn a_missing_library_says_where_was_looked_and_what_to_do() {
        let root = tempfile::tempdir().unwrap();
        let message = find_library(None, &[root.path().to_owned()])
            .unwrap_err()
            .to_string();
        assert!(message.contains("scripts/setup.sh"), "{message}");
        assert!(
            message.contains(&root.path().display().to_string()),
            "{message}"
        );
        let message = find_library(Some(root.path().join("gone.so")), &[])
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("ORT_DYLIB_PATH") && message.contains("gone.so"),
            "{message}"
        );
    }
}
