//! The archive that `scripts/package.sh` makes of this build, unpacked elsewhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use testkit::{onnx_runtime, repository};

/// Packs this build into `folder`, and returns the archives of the program and of its symbols.
fn pack(folder: &Path) -> [PathBuf; 2] {
    let output = Command::new("bash")
        .arg(repository().join("scripts/package.sh"))
        .arg(folder)
        .env("DTD", env!("CARGO_BIN_EXE_dtd"))
        .output()
        .unwrap();
    let printed = successful(&output, "scripts/package.sh");
    let archives: Vec<PathBuf> = printed.lines().map(PathBuf::from).collect();
    archives.try_into().expect("two archives")
}

/// Unpacks an archive, and returns the one folder that it contains.
fn unpack(archive: &Path, into: &Path) -> PathBuf {
    fs::create_dir(into).unwrap();
    let status = Command::new("tar")
        .arg("-xzf")
        .arg(archive)
        .current_dir(into)
        .status();
    assert!(status.unwrap().success());
    let mut entries = fs::read_dir(into).unwrap().map(|entry| entry.unwrap());
    let folder = entries.next().expect("a folder").path();
    assert!(
        entries.next().is_none(),
        "{} has one folder",
        archive.display()
    );
    folder
}

/// Standard output of a successful command.
fn successful(output: &Output, what: &str) -> String {
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{what}: {stderr}");
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// A program's section names.
fn sections(program: &Path) -> String {
    let output = Command::new("readelf")
        .args(["--section-headers", "--wide"])
        .arg(program)
        .output()
        .unwrap();
    successful(&output, "readelf")
}

#[test]
fn the_archive_runs_where_it_is_unpacked_with_its_licences_and_without_symbols() {
    let folder = tempfile::tempdir().unwrap();
    let [archive, symbols] = pack(&folder.path().join("packages"));
    let unpacked = unpack(&archive, &folder.path().join("unpacked"));
    let program = unpacked.join("bin/dtd");

    let run = |arguments: &[&str], directory: &Path| {
        let output = Command::new(&program)
            .args(arguments)
            .env_clear()
            .current_dir(directory)
            .output()
            .unwrap();
        successful(&output, &arguments.join(" "))
    };
    let version = run(&["--version"], folder.path());
    assert_eq!(version.trim(), concat!("dtd ", env!("CARGO_PKG_VERSION")));
    run(&["examples", "sweeps"], folder.path());
    let plan = run(&["plan", "demo.toml"], &folder.path().join("sweeps"));
    assert!(plan.contains("0600-clear-r1"), "{plan}");

    let library = fs::read(unpacked.join("lib/dtd/libonnxruntime.so")).unwrap();
    assert!(library == fs::read(onnx_runtime()).unwrap());
    for file in [
        "README.md",
        "share/man/man1/dtd.1",
        "share/bash-completion/completions/dtd",
        "share/zsh/site-functions/_dtd",
        "share/fish/vendor_completions.d/dtd.fish",
        "share/doc/dtd/LICENSE-MIT",
        "share/doc/dtd/LICENSE-APACHE",
        "share/doc/dtd/onnxruntime/LICENSE",
        "share/doc/dtd/onnxruntime/ThirdPartyNotices.txt",
    ] {
        let size = fs::metadata(unpacked.join(file)).map(|metadata| metadata.len());
        assert!(size.is_ok_and(|bytes| bytes > 0), "{file}");
    }
    let crates = fs::read_to_string(unpacked.join("share/doc/dtd/crates.txt")).unwrap();
    for text in ["\nburn ", "\nclap ", "Permission is hereby granted"] {
        assert!(crates.contains(text), "{text:?}");
    }

    let present = sections(&program);
    assert!(present.contains(".gnu_debuglink"), "{present}");
    assert!(
        !present.contains(".symtab") && !present.contains(".debug_info"),
        "{present}"
    );
    let checkout = repository().to_str().unwrap().as_bytes();
    let bytes = fs::read(&program).unwrap();
    assert!(
        !bytes
            .windows(checkout.len())
            .any(|window| window == checkout)
    );

    let symbols = unpack(&symbols, &folder.path().join("symbols"));
    assert_eq!(symbols.file_name(), unpacked.file_name());
    // The profile of a release adds line tables.
    assert!(sections(&symbols.join("bin/dtd.debug")).contains(".symtab"));
}
