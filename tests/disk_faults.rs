//! A disk that fails once: after any error of any open, new folder, sync, rename, write, read or close, no sealed scenario is damaged, and
//! the same command again ends with 0 and the files of an undisturbed run.
//!
//! `DTD_DISK_FAULTS` is the number of faults for each verb (a few; 38 are about 600 in all), or `all`; `DTD_DISK_FAULTS_SEED` draws them,
//! `DTD_DISK_FAULTS_VERBS=label,push` restricts the verbs. As many faults as there are processors are tried at once.

mod tiny;

use std::collections::BTreeMap;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex};
use std::thread;

use dataset::corpus::Corpus;
use dataset::corpus::seal;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha12Rng;
use serde_json::Value;
use testkit::command::said;
use testkit::files::{contents, copy_folder};
use testkit::{repository, skipped};
use tiny::{TOO_LONG, Tiny};

/// Verbs that write, each with work to do; `{store}` stands for the URL of an object store, `{model}` for the detector.
const VERBS: [(&str, &str); 16] = [
    ("generate", "generate sweep.toml --out corpus"),
    ("label", "label corpus"),
    ("detect", "detect corpus --model {model} --force"),
    (
        "train",
        "train corpus --out run --config training.toml --seed 1",
    ),
    ("evaluate", "evaluate run --corpus corpus"),
    (
        "predict",
        "predict run --corpus corpus --out predicted.parquet",
    ),
    ("export", "export corpus --to coco --out exported"),
    (
        "export-estimators",
        "export-estimators run --out estimators",
    ),
    (
        "evaluate-detector",
        "evaluate-detector corpus --model {model} --mode scaled --out judged",
    ),
    ("push", "push corpus {store}"),
    ("fetch", "fetch {store} --out corpus"),
    ("examples", "examples examples"),
    ("man", "man man"),
    (
        "tracks",
        "tracks import track.csv --runway WSSS/02L --out recordings",
    ),
    (
        "estimate",
        "estimate run --as-fast-as-possible --offset right=auto --keep-offsets offsets.json \
         --view left=corpus/scenarios/{scenario}/views/left.mp4 --view right=corpus/scenarios/{scenario}/views/right.mp4",
    ),
    ("paper", tiny::PAPER),
];
/// Faults for each verb if nothing else is said.
const FEW: usize = 3;
/// Errors of broken and full disks, and of a process without descriptors.
const EIO: i32 = 5;
const EMFILE: i32 = 24;
const ENOSPC: i32 = 28;

/// A fault of the disk.
#[derive(Debug, Clone)]
struct Fault {
    operation: String,
    /// Number of operations of this kind up to and including it.
    number: usize,
    error: i32,
}

/// A corpus whose last scenario is only in the store.
static LACKING: LazyLock<Tiny> = LazyLock::new(|| {
    let tiny = Tiny::made().copy();
    tiny.leave_to_store(tiny.scenarios().last().unwrap());
    tiny
});

/// A corpus with labels that are slightly off in two scenarios.
static LABELLED_OTHERWISE: LazyLock<Tiny> = LazyLock::new(|| {
    let tiny = Tiny::made().copy();
    let corpus = Corpus::open(&tiny.corpus()).unwrap();
    tiny::label_otherwise(&corpus.scenarios().unwrap()[..2]);
    tiny
});

/// The start of a verb, with work to do.
fn start_of(verb: &str) -> Tiny {
    match verb {
        "generate" | "fetch" => LACKING.copy(),
        "label" => LABELLED_OTHERWISE.copy(),
        "tracks" => {
            let tiny = Tiny::made().copy();
            fs::write(tiny.path("track.csv"), track()).unwrap();
            tiny
        }
        "paper" => {
            let tiny = Tiny::made().copy();
            copy_folder(&tiny::paper().join("paper"), &tiny.path("paper"));
            leave_trainings_and_page(&tiny.path("paper"));
            tiny
        }
        _ => Tiny::made().copy(),
    }
}

/// Takes back an experiment's trainings and page. Its other stages take a minute, and `generate` and `detect` have their own faults.
fn leave_trainings_and_page(paper: &Path) {
    let notes = paper.join("PAPER.json");
    let mut written: Value = serde_json::from_slice(&fs::read(&notes).unwrap()).unwrap();
    let stages = written["stages"].as_array_mut().unwrap();
    stages.retain(|stage| {
        ["corpus", "detections", "ranges"]
            .iter()
            .any(|kept| stage["name"].as_str().unwrap().starts_with(kept))
    });
    fs::write(&notes, serde_json::to_vec(&written).unwrap()).unwrap();
    for made in ["run-other-flights", "run-scenarios-drawn", "results"] {
        fs::remove_dir_all(paper.join(made)).unwrap();
    }
    fs::remove_file(paper.join("paper.md")).unwrap();
}

/// A recorded flight as a receiver would report it, once in a second.
fn track() -> String {
    let recorded = repository().join("tests/data/flights/01_calm_ils.csv");
    let mut text =
        "timestamp,icao24,latitude,longitude,altitude,groundspeed,track,vertical_rate,onground\n"
            .to_owned();
    for line in fs::read_to_string(recorded).unwrap().lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        if row[0].fract() > 0.0 {
            continue;
        }
        let (north_mps, east_mps, down_mps) = (row[8], row[9], row[10]);
        let knots = north_mps.hypot(east_mps) * 3_600.0 / 1_852.0;
        let track_deg = east_mps.atan2(north_mps).to_degrees();
        let [feet, feet_per_min] = [row[3], -down_mps * 60.0].map(|metres| metres / 0.3048);
        let on_ground = row[13] > 0.0;
        text += &format!(
            "{},76ccaa,{},{},{feet:.0},{knots:.1},{track_deg:.2},{feet_per_min:.0},{on_ground}\n",
            1_700_000_000.0 + row[0],
            row[1],
            row[2]
        );
    }
    text
}

/// The library that makes a disk fail, built once; `None` without a compiler.
static FAILING_DISK: LazyLock<Option<PathBuf>> = LazyLock::new(|| {
    let library = Path::new(env!("CARGO_TARGET_TMPDIR")).join("failing_disk.so");
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o"])
        .arg(&library)
        .arg(repository().join("tests/disk_faults/failing_disk.c"))
        .arg("-ldl")
        .output();
    match built {
        Ok(output) if output.status.success() => Some(library),
        Ok(output) => panic!("{}", said(&output)),
        Err(_) => None,
    }
});

fn run_on(tiny: &Tiny, line: &str, log: &Path, fault: Option<&Fault>) -> Output {
    let mut command = tiny.dtd(&tiny.arguments(line));
    command
        .env("LD_PRELOAD", FAILING_DISK.as_ref().unwrap())
        .env("DISK_FAULT_ROOT", tiny.root())
        .env("DISK_FAULT_LOG", log);
    if let Some(fault) = fault {
        command
            .env("DISK_FAULT_OPERATION", &fault.operation)
            .env("DISK_FAULT_NUMBER", fault.number.to_string())
            .env("DISK_FAULT_ERROR", fault.error.to_string());
    }
    tiny::run(&mut command, TOO_LONG).unwrap_or_else(|| panic!("{line} with {fault:?} hung"))
}

/// Every file but those that contain times or paths, which differ between any two runs.
fn files(tiny: &Tiny, varying: &[PathBuf]) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found: BTreeMap<_, _> = contents(tiny.root()).into_iter().collect();
    for name in varying {
        if let Some(content) = found.get_mut(name) {
            content.clear();
        }
    }
    found
}

/// The verb's files without faults, and all its disk operations.
struct Undisturbed {
    files: BTreeMap<PathBuf, Vec<u8>>,
    varying: Vec<PathBuf>,
    faults: Vec<Fault>,
}

impl Undisturbed {
    /// `None` if a process cannot be watched here.
    fn of(verb: &str, line: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let [one, other] = [(); 2].map(|()| {
            let tiny = start_of(verb);
            let output = run_on(&tiny, line, &log, None);
            assert!(output.status.success(), "{line}: {}", said(&output));
            tiny
        });
        let operations = fs::read_to_string(&log).ok()?;
        // Some results record which ones they replace.
        run_on(&other, line, &log, None);
        let operations: Vec<&str> = operations
            .lines()
            .filter_map(|line| line.split(' ').next())
            .collect();
        let count = |name| {
            operations
                .iter()
                .filter(|operation| **operation == name)
                .count()
                / 2
        };
        let mut faults = Vec::new();
        for (operation, errors) in [
            ("open", &[EIO, EMFILE][..]),
            ("mkdir", &[EIO, ENOSPC]),
            ("close", &[EIO]),
            ("sync", &[EIO, ENOSPC]),
            ("rename", &[EIO, ENOSPC]),
            ("write", &[EIO, ENOSPC]),
            ("read", &[EIO]),
        ] {
            for number in 1..=count(operation) {
                faults.extend(errors.iter().map(|&error| Fault {
                    operation: operation.into(),
                    number,
                    error,
                }));
            }
        }
        let [one, other] = [one, other].map(|tiny| files(&tiny, &[]));
        assert_eq!(
            one.keys().collect::<Vec<_>>(),
            other.keys().collect::<Vec<_>>(),
            "{line}"
        );
        // Measured times round to the same text now and then.
        let has_times = |name: &Path| {
            name.starts_with("judged") && !name.starts_with("judged/searched")
                || name.starts_with("paper")
                    && (name.ends_with("report.html") || name.ends_with("paper.md"))
        };
        let differs = |name: &&PathBuf| one[*name] != other[*name] || has_times(name);
        let varying: Vec<PathBuf> = one.keys().filter(differs).cloned().collect();
        let mut files = one;
        for name in &varying {
            files.insert(name.clone(), Vec::new());
        }
        Some(Self {
            files,
            varying,
            faults,
        })
    }

    /// Everything that is wrong after a fault and the same command again; `None` if the fault did not happen, since no two runs do exactly
    /// the same.
    fn wrong_after(&self, verb: &str, line: &str, fault: &Fault) -> Option<Vec<String>> {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        let tiny = start_of(verb);
        let first = run_on(&tiny, line, &log, Some(fault));
        let at = fs::read_to_string(&log).unwrap_or_default();
        let mut wrong = Vec::new();
        let words = said(&first);
        if words.contains("panicked") || first.status.code().is_none() {
            wrong.push(format!("ended with {}: {words}", first.status));
        }
        if fault.operation != "read" && first.status.code() == Some(2) {
            wrong.push(format!("called a failing disk bad input: {words}"));
        }
        if words.contains("move the folder") || words.contains("move its folder") {
            wrong.push(format!("called a sound scenario damaged: {words}"));
        }
        let corpus = Corpus::open(&tiny.corpus()).unwrap();
        for scenario in corpus.folders().unwrap() {
            for fault in seal::faults(scenario.root()).unwrap() {
                wrong.push(format!("{}: {fault}", scenario.id()));
            }
        }
        // A service goes on without its offsets.
        if !first.status.success() || words.contains("is not kept") {
            let mut again = tiny.dtd(&tiny.arguments(line));
            let second = tiny::run(&mut again, TOO_LONG).unwrap();
            if !second.status.success() {
                wrong.push(format!(
                    "the second time, it ended with {}: {}",
                    second.status,
                    said(&second)
                ));
            }
        }
        let found = files(&tiny, &self.varying);
        for (name, content) in &self.files {
            match found.get(name) {
                None => wrong.push(format!("{} is missing", name.display())),
                Some(found) if found != content => {
                    wrong.push(format!("{} differs", name.display()));
                }
                Some(_) => {}
            }
        }
        for name in found.keys().filter(|name| !self.files.contains_key(*name)) {
            wrong.push(format!("{} is left over", name.display()));
        }
        if !wrong.is_empty() {
            wrong.insert(
                0,
                format!("at {}, the first time it said: {words}", at.trim()),
            );
        }
        (!at.is_empty() || !wrong.is_empty()).then_some(wrong)
    }
}

/// Faults of each kind of operation in turn: there are far more reads than others.
fn in_turn(faults: &[Fault]) -> impl Iterator<Item = &Fault> {
    let mut turns = BTreeMap::new();
    let mut numbered = Vec::new();
    for fault in faults {
        let turn = turns.entry(&fault.operation).or_insert(0_usize);
        numbered.push((*turn, fault));
        *turn += 1;
    }
    numbered.sort_by_key(|(turn, _)| *turn);
    numbered.into_iter().map(|(_, fault)| fault)
}

fn setting(variable: &str) -> Option<String> {
    env::var(variable).ok()
}

#[test]
fn after_one_fault_of_the_disk_the_same_command_ends_with_the_files_of_an_undisturbed_run() {
    if FAILING_DISK.is_none() {
        return skipped("there is no C compiler to build the failing disk with");
    }
    let seed = setting("DTD_DISK_FAULTS_SEED").map_or(1, |text| text.parse().unwrap());
    let number = setting("DTD_DISK_FAULTS").map_or(FEW, |text| match text.as_str() {
        "all" => usize::MAX,
        number => number.parse().unwrap(),
    });
    let only = setting("DTD_DISK_FAULTS_VERBS");
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let (struck, broken) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let mut tried = 0;
    for (verb, line) in VERBS {
        if only
            .as_ref()
            .is_some_and(|only| !only.split(',').any(|name| name == verb))
        {
            continue;
        }
        let Some(mut undisturbed) = Undisturbed::of(verb, line) else {
            return skipped("nothing can be preloaded into a process");
        };
        undisturbed.faults.shuffle(&mut random);
        let chosen = in_turn(&undisturbed.faults);
        let chosen: Vec<_> = chosen.take(number).collect();
        println!(
            "{verb}: {} of {} faults, varying {:?}",
            chosen.len(),
            undisturbed.faults.len(),
            undisturbed.varying
        );
        tried += chosen.len();
        let chosen = Mutex::new(chosen.into_iter());
        let next = || chosen.lock().unwrap().next();
        let try_faults = || {
            while let Some(fault) = next() {
                let Some(wrong) = undisturbed.wrong_after(verb, line, fault) else {
                    continue;
                };
                struck.fetch_add(1, Ordering::Relaxed);
                if !wrong.is_empty() {
                    broken.fetch_add(1, Ordering::Relaxed);
                    eprintln!(
                        "{verb} with {fault:?} of seed {seed}:\n  {}",
                        wrong.join("\n  ")
                    );
                }
            }
        };
        thread::scope(|scope| {
            for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(try_faults);
            }
        });
    }
    let (struck, broken) = (struck.into_inner(), broken.into_inner());
    println!("{struck} faults, {broken} broken");
    assert!(
        struck > 0 && 2 * struck >= tried,
        "{struck} of {tried} faults happened"
    );
    assert_eq!(broken, 0, "of {struck} faults, see above");
}
