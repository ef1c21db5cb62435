use std::collections::BTreeMap;
use std::os::unix::fs::{MetadataExt, symlink};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use super::*;
use crate::corpus::Corpus;
use crate::files::new_file::failing_sync;

/// A scenario in a new corpus.
struct Example {
    _temporary: tempfile::TempDir,
    corpus: Corpus,
    folder: PathBuf,
}

impl Example {
    fn sealed() -> Self {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = Corpus::create(temporary.path()).unwrap();
        let folder = corpus.scenario("0001").root().to_owned();
        fs::create_dir_all(folder.join("views")).unwrap();
        fs::write(folder.join("frames.parquet"), "old").unwrap();
        fs::write(folder.join("views/left.mp4"), "video").unwrap();
        seal_folder(&folder, "config").unwrap();
        Self {
            _temporary: temporary,
            corpus,
            folder,
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    fn claim(&self) -> Claim {
        self.corpus.scenario("0001").claim().unwrap()
    }

    /// Replaces or adds files with the given content.
    fn replace(&self, names: &[&str], content: &str) {
        replace_files(&self.claim(), &self.folder, names, |_, path| {
            fs::write(path, content).map_err(Error::io("write", path))
        })
        .unwrap();
    }

    fn faults(&self) -> Vec<String> {
        faults(&self.folder).unwrap()
    }

    /// The leftovers when a writer is killed right after committing the replacement of `frames.parquet`.
    fn decide_new_frames(&self) {
        fs::write(self.path("frames.parquet.new"), "new").unwrap();
        let old = Sealed::read(&self.folder).unwrap().unwrap();
        let manifest = manifest_with(&old, &["frames.parquet"]).unwrap();
        fs::write(self.path("MANIFEST.b3.new"), &manifest).unwrap();
        let seal = Seal {
            manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
            ..old.seal().clone()
        };
        write_json(&self.path("DONE.json.new"), &seal).unwrap();
    }

    /// Every file with its content, inode and modification time.
    fn on_disk(&self) -> BTreeMap<PathBuf, (Vec<u8>, u64, i64, i64)> {
        let mut found = BTreeMap::new();
        let mut folders = vec![self.corpus.root().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                let metadata = fs::symlink_metadata(&path).unwrap();
                let content = if metadata.is_dir() {
                    Vec::new()
                } else {
                    fs::read(&path).unwrap()
                };
                if metadata.is_dir() {
                    folders.push(path.clone());
                }
                let state = (
                    content,
                    metadata.ino(),
                    metadata.mtime(),
                    metadata.mtime_nsec(),
                );
                found.insert(path, state);
            }
        }
        found
    }
}

#[test]
fn a_sealed_folder_has_no_faults() {
    assert_eq!(Example::sealed().faults(), Vec::<String>::new());
}

#[test]
fn a_manifest_is_read_only_if_it_is_the_sealed_one_and_names_nothing_outside() {
    let example = Example::sealed();
    let seal = read_seal(&example.folder).unwrap().unwrap();
    let manifest = example.text(MANIFEST);
    let files = sealed_files(&manifest, &seal).unwrap();
    let names: Vec<&str> = files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["frames.parquet", "views/left.mp4"]);
    assert_eq!(files[1].blake3, blake3::hash(b"video").to_string());
    assert!(
        sealed_files(&manifest.replace("left", "lift"), &seal)
            .is_err_and(|bad| bad.to_string().contains("the hash in DONE.json"))
    );
    for name in ["../frames.parquet", "/etc/passwd", "views/../../x", ""] {
        let evil = format!("00  {name}\n");
        let seal = Seal {
            manifest_blake3: blake3::hash(evil.as_bytes()).to_string(),
            ..seal.clone()
        };
        let message = sealed_files(&evil, &seal).unwrap_err().to_string();
        assert!(message.contains("outside of the folder"), "{message}");
    }
}

#[test]
fn a_changed_a_missing_and_a_foreign_file_are_each_named() {
    let example = Example::sealed();
    fs::write(example.path("views/left.mp4"), "vandal").unwrap();
    fs::remove_file(example.path("frames.parquet")).unwrap();
    fs::write(example.path("extra.txt"), "").unwrap();
    let found = example.faults().join("\n");
    for name in [
        "views/left.mp4 does not match its seal",
        "frames.parquet is missing",
        "extra.txt is not listed",
    ] {
        assert!(found.contains(name), "{found}");
    }
}

#[test]
fn the_quick_look_sees_tables_and_lost_or_cut_videos_but_not_what_is_in_a_video() {
    let example = Example::sealed();
    let video = example.path("views/left.mp4");
    fs::write(&video, "vides").unwrap();
    fs::write(example.path("notes.txt"), "").unwrap();
    let quick = || faults_besides_videos(&example.folder).unwrap();
    assert_eq!(quick(), Vec::<String>::new());
    fs::write(&video, "vid").unwrap();
    let cut = "views/left.mp4 does not match its seal: it has 3 bytes, expected 5";
    assert_eq!(quick(), [cut]);
    fs::remove_file(video).unwrap();
    fs::write(example.path("frames.parquet"), "vandal").unwrap();
    assert_eq!(quick().len(), 2, "{:?}", quick());
}

#[test]
fn a_seal_of_an_earlier_version_says_nothing_of_sizes_and_holds() {
    let example = Example::sealed();
    let mut seal = read_seal(&example.folder).unwrap().unwrap();
    assert_eq!(seal.video_bytes["views/left.mp4"], 5);
    seal.video_bytes.clear();
    write_json(&example.path(DONE), &seal).unwrap();
    assert!(!example.text(DONE).contains("video_bytes"));
    assert_eq!(example.faults(), Vec::<String>::new());
}

#[test]
fn replacing_a_file_keeps_the_seal_valid() {
    let example = Example::sealed();
    example.replace(&["frames.parquet", "boxes_truth.parquet"], "new");
    assert_eq!(example.text("frames.parquet"), "new");
    assert_eq!(example.faults(), Vec::<String>::new());
    let seal = read_seal(&example.folder).unwrap().unwrap();
    assert_eq!(seal.config_hash, "config");
}

#[test]
fn replacing_one_file_does_not_bless_damage_to_another() {
    let example = Example::sealed();
    fs::write(example.path("views/left.mp4"), "vandal").unwrap();
    example.replace(&["frames.parquet"], "new");
    let found = example.faults().join("\n");
    assert!(
        found.contains("views/left.mp4 does not match its seal"),
        "{found}"
    );
}

#[test]
fn a_change_killed_before_it_was_decided_leaves_the_old_state_and_is_dropped_by_the_next_writer() {
    let example = Example::sealed();
    fs::write(example.path("frames.parquet.new"), "half").unwrap();
    fs::write(example.path("MANIFEST.b3.new"), "half").unwrap();
    let before = example.on_disk();
    assert_eq!(example.faults(), Vec::<String>::new());
    assert_eq!(example.on_disk(), before, "a reader changed something");
    example.replace(&["boxes_truth.parquet"], "boxes");
    assert_eq!(example.text("frames.parquet"), "old");
    assert_eq!(example.faults(), Vec::<String>::new());
    assert!(!example.path("frames.parquet.new").exists());
}

#[test]
fn readers_of_a_decided_change_see_the_new_state_at_every_step_and_change_nothing() {
    let example = Example::sealed();
    example.decide_new_frames();
    for renamed in ["", "MANIFEST.b3", "frames.parquet"] {
        if !renamed.is_empty() {
            let path = example.path(renamed);
            fs::rename(with_new_suffix(&path), path).unwrap();
        }
        let before = example.on_disk();
        assert_eq!(example.faults(), Vec::<String>::new());
        let sealed = Sealed::read(&example.folder).unwrap().unwrap();
        let hash = sealed.hash_of("frames.parquet").unwrap();
        assert_eq!(hash, blake3::hash(b"new").to_string());
        let FileState::Whole(path) = sealed.find("frames.parquet", hash).unwrap() else {
            panic!("it is there");
        };
        assert_eq!(fs::read(path).unwrap(), b"new");
        assert_eq!(example.on_disk(), before, "a reader changed something");
    }
}

#[test]
fn a_change_killed_after_it_was_decided_is_completed_by_the_next_writer() {
    let example = Example::sealed();
    example.decide_new_frames();
    assert!(is_unsettled(&example.folder));
    settle(&example.claim(), &example.folder).unwrap();
    assert!(!is_unsettled(&example.folder));
    assert_eq!(example.text("frames.parquet"), "new");
    assert_eq!(example.faults(), Vec::<String>::new());
    let names: Vec<_> = fs::read_dir(&example.folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .filter(|name| name.to_string_lossy().ends_with(NEW_SUFFIX))
        .collect();
    assert_eq!(names, Vec::<std::ffi::OsString>::new());
}

#[test]
fn a_persons_notes_survive_readers_and_writers() {
    let example = Example::sealed();
    for name in ["notes.new", "notes.tmp"] {
        fs::write(example.path(name), "mine").unwrap();
    }
    faults(&example.folder).unwrap();
    example.replace(&["frames.parquet"], "new");
    example.decide_new_frames();
    example.replace(&["frames.parquet"], "newer");
    for name in ["notes.new", "notes.tmp"] {
        assert_eq!(example.text(name), "mine");
    }
}

#[test]
fn readers_beside_a_writer_see_a_whole_state_each_time() {
    let example = Example::sealed();
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        let read = || {
            let mut rounds = 0;
            while !ended.load(Ordering::SeqCst) || rounds == 0 {
                assert_eq!(example.faults(), Vec::<String>::new());
                rounds += 1;
            }
        };
        let readers = [scope.spawn(read), scope.spawn(read)];
        for round in 0..30 {
            example.replace(
                &["frames.parquet", "boxes_truth.parquet"],
                &format!("state {round}"),
            );
        }
        ended.store(true, Ordering::SeqCst);
        for reader in readers {
            reader.join().unwrap();
        }
    });
    assert_eq!(example.text("frames.parquet"), "state 29");
}

#[test]
fn what_leads_out_of_the_folder_is_refused_by_name_and_not_followed() {
    for (name, linked) in [
        ("frames.parquet", "frames.parquet"),
        ("views/left.mp4", "views"),
        ("views/left.mp4", "views/left.mp4"),
    ] {
        let example = Example::sealed();
        let outside = tempfile::tempdir().unwrap();
        let target = outside.path().join("target");
        // The same content, so that only the link differs.
        fs::rename(example.path(linked), &target).unwrap();
        symlink(&target, example.path(linked)).unwrap();
        let found = example.faults().join("\n");
        assert!(found.contains("is a symbolic link"), "{name}: {found}");
    }
    let example = Example::sealed();
    let outside = tempfile::tempdir().unwrap();
    let target = outside.path().join("0001");
    fs::rename(&example.folder, &target).unwrap();
    symlink(&target, &example.folder).unwrap();
    let (sound, damaged) = example.corpus.without_damaged().unwrap();
    assert!(sound.scenarios().unwrap().is_empty());
    assert!(
        damaged[0].reason.contains("is a symbolic link"),
        "{damaged:?}"
    );
}

#[test]
fn planted_links_are_never_written_through() {
    let example = Example::sealed();
    let outside = tempfile::tempdir().unwrap();
    let target = outside.path().join("precious");
    fs::write(&target, "precious").unwrap();
    for name in [
        "frames.parquet",
        "frames.parquet.tmp",
        "frames.parquet.new",
        "frames.parquet.new.tmp",
        "MANIFEST.b3.tmp",
        "MANIFEST.b3.new",
        "MANIFEST.b3.new.tmp",
        "DONE.json.tmp",
        "DONE.json.new.tmp",
    ] {
        let _ = fs::remove_file(example.path(name));
        symlink(&target, example.path(name)).unwrap();
    }
    example.replace(&["frames.parquet"], "new");
    assert_eq!(fs::read(&target).unwrap(), b"precious");
    assert_eq!(example.text("frames.parquet"), "new");
}

#[test]
fn files_of_a_terabyte_are_named_and_not_read() {
    for (name, found) in [
        ("views/left.mp4", "it has 1099511627776 bytes, expected 5"),
        ("frames.parquet", "has 1099511627776 bytes"),
    ] {
        let example = Example::sealed();
        // Takes no disk space.
        let file = fs::File::create(example.path(name)).unwrap();
        file.set_len(1 << 40).unwrap();
        let faults = example.faults();
        assert_eq!(faults.len(), 1, "{faults:?}");
        assert!(faults[0].contains(name), "{faults:?}");
        assert!(faults[0].contains(found), "{faults:?}");
        let sealed = Sealed::read(&example.folder).unwrap().unwrap();
        assert!(sealed.check(name).is_err());
    }
}

/// The error for a sealed manifest with these files.
fn said_of(names: &[&str]) -> String {
    let hash = blake3::hash(b"").to_string();
    let manifest: String = names
        .iter()
        .map(|name| format!("{hash}  {name}\n"))
        .collect();
    let seal = Seal {
        config_hash: "config".into(),
        manifest_blake3: blake3::hash(manifest.as_bytes()).to_string(),
        video_bytes: BTreeMap::new(),
    };
    sealed_files(&manifest, &seal).map_or_else(|fault| fault.to_string(), |_| "nothing".into())
}

#[test]
fn a_file_has_one_line_and_nothing_else_lies_among_the_videos() {
    assert_eq!(
        said_of(&["frames.parquet", "views/left.mp4", "views/right.mp4"]),
        "nothing"
    );
    for (names, words) in [
        (
            ["frames.parquet", "frames.parquet"],
            "two lines for frames.parquet",
        ),
        (
            ["frames.parquet", "views/notes.txt"],
            "names views/notes.txt, expected only videos",
        ),
        (
            ["frames.parquet", "views/more/left.mp4"],
            "names views/more/left.mp4",
        ),
    ] {
        let said = said_of(&names);
        assert!(said.contains(words), "{said}");
    }
    let example = Example::sealed();
    fs::write(example.path("views/left.mov"), "no video").unwrap();
    let message = seal_folder(&example.folder, "config")
        .unwrap_err()
        .to_string();
    assert!(message.contains("names views/left.mov"), "{message}");
    assert_eq!(
        example.faults(),
        ["views/left.mov is not listed in MANIFEST.b3"]
    );
}

#[test]
fn a_sync_that_fails_at_any_point_of_a_change_leaves_one_of_the_two_states_and_the_next_writer_goes_on()
 {
    const NAMES: [&str; 2] = ["frames.parquet", "boxes_truth.parquet"];
    for settles in [false, true] {
        let (mut old, mut new) = (0, 0);
        for before in 0.. {
            let example = Example::sealed();
            if settles {
                example.decide_new_frames();
            }
            let (result, struck) = failing_sync::after(before, || {
                let write = |_: &str, path: &Path| {
                    fs::write(path, "newer").map_err(Error::io("write", path))
                };
                replace_files(&example.claim(), &example.folder, &NAMES, write)
            });
            assert_eq!(result.is_err(), struck, "sync {before}: {result:?}");
            // Readers find every sealed file, all from the same state.
            assert_eq!(example.faults(), Vec::<String>::new(), "sync {before}");
            let sealed = Sealed::read(&example.folder).unwrap().unwrap();
            let content = |name| sealed.content(name, FileKind::TABLE).unwrap();
            let expected = if settles { "new" } else { "old" };
            match content(NAMES[1]) {
                Some(boxes) => {
                    assert_eq!(
                        (boxes, content(NAMES[0])),
                        (b"newer".into(), Some(b"newer".into()))
                    );
                    new += 1;
                }
                None => {
                    assert_eq!(content(NAMES[0]), Some(expected.into()), "sync {before}");
                    old += 1;
                }
            }
            example.replace(&NAMES, "newest");
            assert_eq!(example.faults(), Vec::<String>::new(), "sync {before}");
            assert_eq!(NAMES.map(|name| example.text(name)), ["newest", "newest"]);
            assert!(!is_unsettled(&example.folder));
            if !struck {
                break;
            }
        }
        // Also after the commit: the sync of the folder that follows it, and the two of completing it.
        assert!(old > 0 && new > 3, "{old} old, {new} new");
    }
}
