//! Loads and starts ONNX Runtime, once per process.
//!
//! The library is loaded at run time, and it runs with all rights of the user. So it comes only from a stated place: the caller's
//! path, else `ORT_DYLIB_PATH`, else the installation's own, relative to the program: `bin/dtd`, `lib/dtd/libonnxruntime.so`.
//! Nothing is searched for, and world-writable places are rejected.
//!
//! ONNX Runtime's official builds send telemetry, and decide that while they start, before any of their functions can disable it.
//! Only the environment can, so nothing is loaded unless it does.

use std::env::{self, consts};
use std::ffi::OsStr;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use ort::environment::Environment;

use crate::error::{Error, Result};

/// Environment variable that disables ONNX Runtime's telemetry when it is `1`. Set it before loading the library.
pub const NO_TELEMETRY_VARIABLE: &str = "ORT_DISABLE_TELEMETRY";
pub(super) const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";
/// Relative to the program's folder.
const FOLDER_OF_INSTALLATION: &str = "../lib/dtd";

pub(super) struct Runtime {
    pub(super) environment: Environment,
    pub(super) library: PathBuf,
}

/// Loads the library, and starts the environment of all sessions. `chosen` applies to the first call.
pub(super) fn runtime(chosen: Option<&Path>) -> Result<&'static Runtime> {
    static STARTED: OnceLock<Runtime> = OnceLock::new();
    static STARTING: Mutex<()> = Mutex::new(());
    // ONNX Runtime allows one environment per process: two threads must not start it at the same time.
    let _guard = STARTING.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(runtime) = STARTED.get() {
        return Ok(runtime);
    }
    if env::var_os(NO_TELEMETRY_VARIABLE).as_deref() != Some(OsStr::new("1")) {
        return Err(Error::Runtime(format!(
            "refusing to load ONNX Runtime: its telemetry is not disabled; set {NO_TELEMETRY_VARIABLE} to 1"
        )));
    }
    let library = library(chosen)?;
    let broken = |error: &dyn std::fmt::Display| {
        Error::Runtime(format!("cannot load {}: {error}", library.display()))
    };
    let environment = ort::init_from(&library)
        .map_err(|error| broken(&error))?
        .with_name("dtd")
        .with_telemetry(false)
        .build()
        .map_err(|error| broken(&error))?;
    tracing::debug!(library = %library.display(), "ONNX Runtime started");
    Ok(STARTED.get_or_init(|| Runtime {
        environment,
        library,
    }))
}

/// Path of the library, with all links resolved.
fn library(chosen: Option<&Path>) -> Result<PathBuf> {
    if let Some(path) = chosen {
        return checked(path, "--onnx-runtime");
    }
    if let Some(path) = env::var_os(PATH_VARIABLE).filter(|path| !path.is_empty()) {
        return checked(Path::new(&path), PATH_VARIABLE);
    }
    const PLACE: &str = "the installation's own";
    let file = format!("{}onnxruntime{}", consts::DLL_PREFIX, consts::DLL_SUFFIX);
    let program = env::current_exe().map_err(|error| {
        missing(
            &Path::new(FOLDER_OF_INSTALLATION).join(&file),
            PLACE,
            &error,
        )
    })?;
    let folder = program.parent().unwrap_or(Path::new("/"));
    checked(&folder.join(FOLDER_OF_INSTALLATION).join(file), PLACE)
}

fn missing(path: &Path, place: &str, error: &io::Error) -> Error {
    Error::Runtime(format!(
        "no library at {} ({place}): {error}; run `bash scripts/setup-build.sh` in the repository, or name the library with \
         --onnx-runtime or {PATH_VARIABLE}",
        path.display()
    ))
}

/// The file behind a path, if only its owners can have put it there.
fn checked(path: &Path, place: &str) -> Result<PathBuf> {
    if !path.is_absolute() {
        return Err(Error::Runtime(format!(
            "{place} is {}, expected an absolute path",
            path.display()
        )));
    }
    let missing = |error| missing(path, place, &error);
    let found = path.canonicalize().map_err(missing)?;
    if !found.metadata().map_err(missing)?.is_file() {
        return Err(Error::Runtime(format!(
            "{} ({place}) is not a regular file",
            found.display()
        )));
    }
    // The folder of the path as well: a link in it may be replaced.
    let folder = match path.parent() {
        Some(parent) => parent.canonicalize().map_err(missing)?,
        None => found.clone(),
    };
    let writable = found
        .ancestors()
        .chain(folder.ancestors())
        .find(|place| is_writable_by_all(place));
    match writable {
        Some(writable) => Err(Error::Runtime(format!(
            "refusing to load {} ({place}): {} is world-writable; run `chmod o-w` on it, or name another library",
            found.display(),
            writable.display()
        ))),
        None => Ok(found),
    }
}

/// True if every user can change a file, or replace a name in a folder. In a folder with the sticky bit, such as /tmp, only a name's owner
/// can.
#[cfg(unix)]
fn is_writable_by_all(place: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    const OTHERS_WRITE: u32 = 0o002;
    const STICKY: u32 = 0o1000;
    place.metadata().is_ok_and(|metadata| {
        let mode = metadata.permissions().mode();
        let protected = metadata.is_dir() && mode & STICKY != 0;
        mode & OTHERS_WRITE != 0 && !protected
    })
}

/// Other systems have no such bits.
#[cfg(not(unix))]
fn is_writable_by_all(_place: &Path) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_relative_a_missing_and_an_irregular_library_are_refused_with_who_named_it() {
        let said = |path: &Path| checked(path, PATH_VARIABLE).unwrap_err().to_string();
        let root = tempfile::tempdir().unwrap();
        let gone = root.path().join("gone.so");
        for (path, expected) in [
            (
                Path::new("lib/libonnxruntime.so"),
                "expected an absolute path",
            ),
            (&gone, "scripts/setup-build.sh"),
            (root.path(), "is not a regular file"),
        ] {
            let said = said(path);
            for word in [expected, PATH_VARIABLE, &path.display().to_string()] {
                assert!(said.contains(word), "{word} in {said}");
            }
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_library_that_every_user_could_have_put_there_is_refused() {
        use std::os::unix::fs::{PermissionsExt, symlink};

        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("lib");
        fs::create_dir(&folder).unwrap();
        let library = folder.join("libonnxruntime.so");
        fs::write(&library, "").unwrap();
        let set = |path: &Path, mode| {
            fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        };
        set(&library, 0o644);
        set(&folder, 0o755);
        let linked = root.path().join("linked.so");
        symlink(&library, &linked).unwrap();
        let real = library.canonicalize().unwrap();
        assert_eq!(checked(&library, PATH_VARIABLE).unwrap(), real);
        assert_eq!(checked(&linked, PATH_VARIABLE).unwrap(), real);
        for (path, mode) in [(&library, 0o646), (&folder, 0o777)] {
            let before = path.metadata().unwrap().permissions();
            set(path, mode);
            for named in [&library, &linked] {
                let said = checked(named, PATH_VARIABLE).unwrap_err().to_string();
                assert!(said.contains("chmod o-w"), "{said}");
            }
            fs::set_permissions(path, before).unwrap();
        }
        // A folder that contains only the link.
        let open = root.path().join("open");
        fs::create_dir(&open).unwrap();
        set(&open, 0o777);
        let linked = open.join("linked.so");
        symlink(&library, &linked).unwrap();
        assert!(checked(&linked, PATH_VARIABLE).is_err());
        set(&open, 0o1777);
        assert!(checked(&linked, PATH_VARIABLE).is_ok());
    }
}
