//! The checkout that the tests run in, and what `scripts/setup.sh` installs there.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Root of the repository.
pub fn repository() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors()
        .nth(2)
        .expect("this crate lies in crates/ of the repository")
}

/// A program of the virtual environment in `.venv`.
pub fn program_of_venv(name: &str) -> PathBuf {
    installed(repository().join(".venv/bin").join(name))
}

/// The Python that has torch, and no package that wants a NumPy newer than torch's.
pub fn python_with_torch() -> PathBuf {
    installed(repository().join(".venv-torch/bin/python"))
}

fn installed(program: PathBuf) -> PathBuf {
    assert!(
        program.exists(),
        "run `bash scripts/setup.sh` first: {} is missing",
        program.display()
    );
    program
}

/// ONNX Runtime.
pub fn onnx_runtime() -> &'static Path {
    static FOUND: LazyLock<PathBuf> = LazyLock::new(|| {
        let python = repository().join(".venv/lib");
        let packages = fs::read_dir(&python).unwrap_or_else(|error| {
            panic!(
                "run `bash scripts/setup.sh` first: {}: {error}",
                python.display()
            )
        });
        packages
            .flatten()
            .find_map(|version| onnx_runtime_in(&version.path().join("site-packages")))
            .expect("ONNX Runtime in .venv")
    });
    &FOUND
}

/// The build of ONNX Runtime that has OpenVINO; `None` where there is none for this kind of machine.
pub fn onnx_runtime_with_openvino() -> Option<PathBuf> {
    onnx_runtime_in(&installed(repository().join(".venv-openvino")))
}

/// ONNX Runtime's library in a folder of Python packages.
fn onnx_runtime_in(packages: &Path) -> Option<PathBuf> {
    fs::read_dir(packages.join("onnxruntime/capi"))
        .ok()?
        .flatten()
        .map(|file| file.path())
        .find(|path| path.to_string_lossy().contains("/libonnxruntime.so"))
}
