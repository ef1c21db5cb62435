//! Shared by the fuzz targets: the generator's pure modules, from their sources, and files in memory.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// The expansion of a sweep, without recording: the whole crate would bring the object store's clients along.
#[path = "../../generator/src"]
mod generator {
    pub mod airports;
    pub mod plan;
    pub mod recording;
    pub mod seed;
    pub mod spread;
    pub mod sweep;
    pub mod time_of_day;
    pub mod trajectory;
}

pub use generator::*;

/// Writes bytes to a file that only this process uses, in memory if possible, and passes its path on.
pub fn as_file<T>(bytes: &[u8], name: &str, read: impl FnOnce(&Path) -> T) -> T {
    let path = place(name);
    fs::write(&path, bytes).unwrap();
    read(&path)
}

/// A path that only this process uses.
pub fn place(name: &str) -> PathBuf {
    static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
        let memory = Path::new("/dev/shm");
        let parent = match memory.is_dir() {
            true => memory.to_owned(),
            false => std::env::temp_dir(),
        };
        let folder = parent.join(format!("dtd-fuzz-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    });
    FOLDER.join(name)
}
