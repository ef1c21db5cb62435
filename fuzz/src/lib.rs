//! Shared by the fuzz targets: files in memory.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

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
