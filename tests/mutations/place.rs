//! Mutations of a path: a missing file, or something other than a regular file.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use rand_chacha::ChaCha12Rng;

use super::json::pick;

#[derive(Debug, Clone, Copy)]
enum Kind {
    Gone,
    Folder,
    Fifo,
    LinkToDevice,
    LinkOutside,
    LinkToItself,
    Huge,
    NotUtf8Beside,
}

/// [`mutate`]'s name for an additional file next to the chosen one, which no verb needs to notice.
pub(super) const BESIDE: &str = "NotUtf8Beside";

/// Replaces a file by something else. `outside` is a file that nothing may change. Returns the change.
pub(super) fn mutate(path: &Path, outside: &Path, random: &mut ChaCha12Rng) -> String {
    let kinds = [
        Kind::Gone,
        Kind::Folder,
        Kind::Fifo,
        Kind::LinkToDevice,
        Kind::LinkOutside,
        Kind::LinkToItself,
        Kind::Huge,
        Kind::NotUtf8Beside,
    ];
    let kind = *pick(&kinds, random);
    if !matches!(kind, Kind::NotUtf8Beside) {
        fs::remove_file(path).unwrap();
    }
    match kind {
        Kind::Gone => {}
        Kind::Folder => fs::create_dir(path).unwrap(),
        Kind::Fifo => {
            let made = Command::new("mkfifo").arg(path).status().unwrap();
            assert!(made.success());
        }
        Kind::LinkToDevice => symlink("/dev/zero", path).unwrap(),
        Kind::LinkOutside => symlink(outside, path).unwrap(),
        Kind::LinkToItself => symlink(path, path).unwrap(),
        // Takes no disk space.
        Kind::Huge => File::create(path).unwrap().set_len(1 << 40).unwrap(),
        Kind::NotUtf8Beside => {
            use std::os::unix::ffi::OsStrExt;
            let name = std::ffi::OsStr::from_bytes(b"\xff\xfe.new");
            fs::write(path.with_file_name(name), "").unwrap();
        }
    }
    format!("{kind:?}")
}
