//! How a scenario folder becomes whole, stays whole, and is changed without ever being half changed.
//!
//! A folder is filled under another name (`<id>.partial`), sealed (`MANIFEST.b3` with a BLAKE3 hash per file, in the format of
//! `b3sum`, and `DONE.json` with the manifest's hash), and then renamed. Later steps replace sealed files through
//! [`replace_files`]: new files are written beside the old ones, a new seal last; once that seal is there the change is
//! decided, and any later reader rolls it forward.

use std::fs::{self, File};
use std::io;
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::json_file::{read_json, sync, write_atomically, write_json};

/// Hashes of all files of a folder.
pub const MANIFEST: &str = "MANIFEST.b3";
/// The seal itself.
pub const DONE: &str = "DONE.json";
const NEW_SUFFIX: &str = ".new";
/// Written by later steps, versioned by themselves and not part of the seal.
const UNSEALED_FOLDER: &str = "detections";

/// Content of `DONE.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seal {
    /// Hash of the scenario's parameters, as in `scenario.json`.
    pub config_hash: String,
    /// BLAKE3 hash of `MANIFEST.b3`.
    pub manifest_blake3: String,
}

/// A file that a manifest lists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SealedFile {
    /// Name relative to the folder, with forward slashes.
    pub name: String,
    /// BLAKE3 hash in hexadecimal digits.
    pub blake3: String,
}

/// The files that a manifest lists, if it is the one that `seal` seals; else what is wrong with it, in words.
pub fn sealed_files(manifest: &str, seal: &Seal) -> std::result::Result<Vec<SealedFile>, String> {
    if blake3::hash(manifest.as_bytes()).to_string() != seal.manifest_blake3 {
        return Err(format!("{MANIFEST} does not match the hash in {DONE}"));
    }
    let file = |line: &str| match line.split_once("  ") {
        // It becomes a path under the folder, whoever wrote it.
        Some((blake3, name)) if is_within(Path::new(name)) => Ok(SealedFile {
            name: name.into(),
            blake3: blake3.into(),
        }),
        Some((_, name)) => Err(format!(
            "{MANIFEST} names a file outside of the folder: {name}"
        )),
        None => Err(format!(
            "{MANIFEST} has a line that is not `hash  name`: {line}"
        )),
    };
    manifest.lines().map(file).collect()
}

/// Whether a relative name stays within the folder that it is relative to.
pub fn is_within(name: &Path) -> bool {
    let mut parts = name.components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// BLAKE3 hash of a file, in hexadecimal digits.
pub fn hash_file(path: &Path) -> Result<String> {
    let mut hasher = blake3::Hasher::new();
    let mut file = File::open(path).map_err(Error::io("read", path))?;
    io::copy(&mut file, &mut hasher).map_err(Error::io("read", path))?;
    Ok(hasher.finalize().to_hex().to_string())
}

/// Seals a folder whose files are all written.
pub fn seal_folder(folder: &Path, config_hash: &str) -> Result<Seal> {
    // Nothing may be sealed that a failing power could still take back.
    for name in files_of(folder)? {
        let path = folder.join(name);
        sync(&path)?;
        if let Some(parent) = path.parent().filter(|parent| *parent != folder) {
            sync(parent)?;
        }
    }
    let manifest = manifest_of(folder)?;
    write_atomically(&folder.join(MANIFEST), manifest.as_bytes())?;
    let seal = Seal {
        config_hash: config_hash.into(),
        manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
    };
    write_json(&folder.join(DONE), &seal)?;
    Ok(seal)
}

/// Renames a sealed folder to its final name and makes the renaming durable.
pub fn commit_folder(partial: &Path, committed: &Path) -> Result<()> {
    fs::rename(partial, committed).map_err(Error::io("rename into place", committed))?;
    sync(committed.parent().unwrap_or(committed))
}

/// The seal of a folder, if it has one. Finishes a change that was decided but not completed.
pub fn read_seal(folder: &Path) -> Result<Option<Seal>> {
    settle(folder)?;
    let path = folder.join(DONE);
    if path.exists() {
        read_json(&path, "seal").map(Some)
    } else {
        Ok(None)
    }
}

/// Everything in a sealed folder that does not match its seal, in words; empty if all is well.
pub fn faults(folder: &Path) -> Result<Vec<String>> {
    let (mut faults, listed) = faults_of_listed(folder, |_| true)?;
    if let Some(listed) = listed {
        for name in files_of(folder)? {
            if !listed.contains(&name) {
                faults.push(format!("{name} is not listed in {MANIFEST}"));
            }
        }
    }
    Ok(faults)
}

/// What is missing or changed, without reading the videos, which only have to be there: quick enough to ask before every run.
pub fn faults_besides_videos(folder: &Path) -> Result<Vec<String>> {
    Ok(faults_of_listed(folder, |name| !name.starts_with("views/"))?.0)
}

/// Faults of the files that the manifest lists, and their names, if there is a manifest to rely on.
fn faults_of_listed(
    folder: &Path,
    is_hashed: impl Fn(&str) -> bool,
) -> Result<(Vec<String>, Option<Vec<String>>)> {
    let only = |fault: String| Ok((vec![fault], None));
    let Some(seal) = read_seal(folder)? else {
        return only(format!("{DONE} is missing: the folder was never finished"));
    };
    let path = folder.join(MANIFEST);
    let manifest = fs::read_to_string(&path).map_err(Error::io("read", &path))?;
    if blake3::hash(manifest.as_bytes()).to_string() != seal.manifest_blake3 {
        return only(format!("{MANIFEST} does not match the hash in {DONE}"));
    }
    let mut faults = Vec::new();
    let mut listed = Vec::new();
    for line in manifest.lines() {
        let Some((hash, name)) = line.split_once("  ") else {
            faults.push(format!(
                "{MANIFEST} has a line that is not `hash  name`: {line}"
            ));
            continue;
        };
        listed.push(name.to_owned());
        let file = folder.join(name);
        if !file.exists() {
            faults.push(format!("{name} is missing"));
        } else if is_hashed(name) && hash_file(&file)? != hash {
            faults.push(format!(
                "{name} is not what was sealed: its hash differs from {MANIFEST}"
            ));
        }
    }
    Ok((faults, Some(listed)))
}

/// Replaces or adds files of a sealed folder as one change: `write` is called with the path to write each to.
pub fn replace_files(
    folder: &Path,
    names: &[&str],
    mut write: impl FnMut(&str, &Path) -> Result<()>,
) -> Result<()> {
    let seal = read_seal(folder)?.ok_or_else(|| {
        Error::corpus(
            folder,
            format!("has no {DONE}; generate the scenario first"),
        )
    })?;
    for name in names {
        let path = with_new_suffix(&folder.join(name));
        write(name, &path)?;
        sync(&path)?;
    }
    let manifest = manifest_with(folder, &seal, names)?;
    write_atomically(
        &with_new_suffix(&folder.join(MANIFEST)),
        manifest.as_bytes(),
    )?;
    let seal = Seal {
        manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
        ..seal
    };
    // With this file the change is decided.
    write_json(&with_new_suffix(&folder.join(DONE)), &seal)?;
    settle(folder)
}

/// Completes a decided change, drops an undecided one.
fn settle(folder: &Path) -> Result<()> {
    let mut pending = new_files_of(folder)?;
    if pending.is_empty() {
        return Ok(());
    }
    let decided = with_new_suffix(&folder.join(DONE));
    if pending.contains(&decided) {
        // The seal goes last: as long as it is there, this can be done again.
        pending.retain(|path| *path != decided);
        pending.push(decided);
        for path in &pending {
            fs::rename(path, path.with_extension(""))
                .map_err(Error::io("rename into place", path))?;
        }
    } else {
        for path in &pending {
            fs::remove_file(path).map_err(Error::io("remove", path))?;
        }
    }
    sync(folder)
}

fn with_new_suffix(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(NEW_SUFFIX);
    name.into()
}

fn new_files_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io("list", folder))? {
        let path = entry.map_err(Error::io("list", folder))?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == &NEW_SUFFIX[1..])
        {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Manifest of all files of a folder.
fn manifest_of(folder: &Path) -> Result<String> {
    let mut manifest = String::new();
    for name in files_of(folder)? {
        let hash = hash_file(&folder.join(&name))?;
        manifest.push_str(&format!("{hash}  {name}\n"));
    }
    Ok(manifest)
}

/// The sealed manifest with the `.new` form of `replaced` files in the place of the old. All other lines stay as they were
/// sealed: hashing those files anew would bless whatever happened to them since.
fn manifest_with(folder: &Path, seal: &Seal, replaced: &[&str]) -> Result<String> {
    let path = folder.join(MANIFEST);
    let sealed = fs::read_to_string(&path).map_err(Error::io("read", &path))?;
    if blake3::hash(sealed.as_bytes()).to_string() != seal.manifest_blake3 {
        return Err(Error::corpus(
            &path,
            format!("does not match the hash in {DONE}; `dtd verify` says more"),
        ));
    }
    let mut lines: Vec<(String, String)> = sealed
        .lines()
        .filter_map(|line| line.split_once("  "))
        .filter(|(_, name)| !replaced.contains(name))
        .map(|(hash, name)| (name.to_owned(), hash.to_owned()))
        .collect();
    for name in replaced {
        let hash = hash_file(&with_new_suffix(&folder.join(name)))?;
        lines.push(((*name).to_owned(), hash));
    }
    lines.sort();
    Ok(lines
        .iter()
        .map(|(name, hash)| format!("{hash}  {name}\n"))
        .collect())
}

/// Files that the seal covers, relative, with forward slashes, sorted.
fn files_of(folder: &Path) -> Result<Vec<String>> {
    fn walk(folder: &Path, prefix: &str, names: &mut Vec<String>) -> Result<()> {
        for entry in fs::read_dir(folder).map_err(Error::io("list", folder))? {
            let entry = entry.map_err(Error::io("list", folder))?;
            let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
            if entry.path().is_dir() {
                if name != UNSEALED_FOLDER {
                    walk(&entry.path(), &format!("{name}/"), names)?;
                }
            } else if ![MANIFEST, DONE].contains(&name.as_str())
                && !name.ends_with(NEW_SUFFIX)
                && !name.ends_with(".tmp")
            {
                names.push(name);
            }
        }
        Ok(())
    }
    let mut names = Vec::new();
    walk(folder, "", &mut names)?;
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sealed() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("views")).unwrap();
        fs::write(folder.path().join("frames.parquet"), "old").unwrap();
        fs::write(folder.path().join("views/left.mp4"), "video").unwrap();
        seal_folder(folder.path(), "config").unwrap();
        folder
    }

    #[test]
    fn a_sealed_folder_has_no_faults() {
        assert_eq!(faults(sealed().path()).unwrap(), Vec::<String>::new());
    }

    #[test]
    fn a_manifest_is_read_only_if_it_is_the_sealed_one_and_names_nothing_outside() {
        let folder = sealed();
        let seal = read_seal(folder.path()).unwrap().unwrap();
        let manifest = fs::read_to_string(folder.path().join(MANIFEST)).unwrap();
        let files = sealed_files(&manifest, &seal).unwrap();
        let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["frames.parquet", "views/left.mp4"]);
        assert_eq!(files[1].blake3, blake3::hash(b"video").to_string());
        assert!(
            sealed_files(&manifest.replace("left", "lift"), &seal)
                .unwrap_err()
                .contains("does not match")
        );
        for name in ["../frames.parquet", "/etc/passwd", "views/../../x", ""] {
            let evil = format!("00  {name}\n");
            let seal = Seal {
                manifest_blake3: blake3::hash(evil.as_bytes()).to_string(),
                ..seal.clone()
            };
            let message = sealed_files(&evil, &seal).unwrap_err();
            assert!(message.contains("outside of the folder"), "{message}");
        }
    }

    #[test]
    fn a_changed_a_missing_and_a_foreign_file_are_each_named() {
        let folder = sealed();
        fs::write(folder.path().join("views/left.mp4"), "vandal").unwrap();
        fs::remove_file(folder.path().join("frames.parquet")).unwrap();
        fs::write(folder.path().join("extra.txt"), "").unwrap();
        let found = faults(folder.path()).unwrap().join("\n");
        for name in [
            "views/left.mp4 is not what was sealed",
            "frames.parquet is missing",
            "extra.txt is not listed",
        ] {
            assert!(found.contains(name), "{found}");
        }
    }

    #[test]
    fn the_quick_look_sees_tables_and_lost_videos_but_not_what_is_in_a_video() {
        let folder = sealed();
        let video = folder.path().join("views/left.mp4");
        fs::write(&video, "vandal").unwrap();
        fs::write(folder.path().join("notes.txt"), "").unwrap();
        let quick = || faults_besides_videos(folder.path()).unwrap();
        assert_eq!(quick(), Vec::<String>::new());
        fs::remove_file(video).unwrap();
        fs::write(folder.path().join("frames.parquet"), "vandal").unwrap();
        assert_eq!(quick().len(), 2, "{:?}", quick());
    }

    #[test]
    fn replacing_a_file_keeps_the_seal_valid() {
        let folder = sealed();
        let names = ["frames.parquet", "boxes_truth.parquet"];
        replace_files(folder.path(), &names, |name, path| {
            fs::write(path, format!("new {name}")).map_err(Error::io("write", path))
        })
        .unwrap();
        assert_eq!(
            fs::read_to_string(folder.path().join("frames.parquet")).unwrap(),
            "new frames.parquet"
        );
        assert_eq!(faults(folder.path()).unwrap(), Vec::<String>::new());
        assert_eq!(
            read_seal(folder.path()).unwrap().unwrap().config_hash,
            "config"
        );
    }

    #[test]
    fn replacing_one_file_does_not_bless_damage_to_another() {
        let folder = sealed();
        fs::write(folder.path().join("views/left.mp4"), "vandal").unwrap();
        replace_files(folder.path(), &["frames.parquet"], |_, path| {
            fs::write(path, "new").map_err(Error::io("write", path))
        })
        .unwrap();
        let found = faults(folder.path()).unwrap().join("\n");
        assert!(
            found.contains("views/left.mp4 is not what was sealed"),
            "{found}"
        );
    }

    #[test]
    fn a_change_killed_before_it_was_decided_leaves_the_old_state() {
        let folder = sealed();
        fs::write(folder.path().join("frames.parquet.new"), "half").unwrap();
        assert_eq!(faults(folder.path()).unwrap(), Vec::<String>::new());
        assert_eq!(
            fs::read_to_string(folder.path().join("frames.parquet")).unwrap(),
            "old"
        );
        assert!(!folder.path().join("frames.parquet.new").exists());
    }

    #[test]
    fn a_change_killed_after_it_was_decided_is_completed_by_the_next_reader() {
        let folder = sealed();
        let root = folder.path();
        fs::write(root.join("frames.parquet.new"), "new").unwrap();
        let old: Seal = read_json(&root.join(DONE), "seal").unwrap();
        let manifest = manifest_with(root, &old, &["frames.parquet"]).unwrap();
        fs::write(root.join("MANIFEST.b3.new"), &manifest).unwrap();
        let seal = Seal {
            config_hash: "config".into(),
            manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
        };
        write_json(&root.join("DONE.json.new"), &seal).unwrap();
        assert_eq!(faults(root).unwrap(), Vec::<String>::new());
        assert_eq!(
            fs::read_to_string(root.join("frames.parquet")).unwrap(),
            "new"
        );
    }
}
