//! Damaged, forged and hostile input to every verb: no panic, no abort, no hang, and no change that goes unnoticed.
//!
//! Each case copies a small corpus with its run, its copy in an object store and its settings, changes one thing in one file, and
//! runs a verb that reads it. If a seal, a hash or a plan covers the file, the verb either fails, or does exactly what it does
//! without the change. For settings and resealed forgeries only crashes, hangs and resource use are checked.
//!
//! `DTD_MUTATIONS` is the number of cases (150, five for each kind of file), `DTD_MUTATION_SEED` draws them (1), `DTD_MUTATION_CASE` runs
//! only one of them.

#[path = "mutations/json.rs"]
mod json;
#[path = "mutations/outcome.rs"]
mod outcome;
#[path = "mutations/place.rs"]
mod place;
#[path = "mutations/table.rs"]
mod table;
#[path = "mutations/targets.rs"]
mod targets;
#[path = "mutations/text.rs"]
mod text;
mod tiny;

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::Output;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{LazyLock, Mutex, OnceLock};
use std::thread;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::corpus::seal::seal_folder;
use json::pick;
use outcome::Outcome;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use targets::{Form, Guard, TARGETS, Target, VERBS};
use testkit::command::said;
use tiny::Tiny;

/// Far longer than any of this takes; anything longer is a hang.
const TOO_LONG: Duration = Duration::from_secs(120);
/// Address space per verb, KiB: exceeding it means that a decompression bomb worked.
const MEMORY_KIB: u64 = 8 << 20;

/// The tiny corpus, with a recorded flight, a tape and a model, and in an object store as well.
static BASE: LazyLock<Tiny> = LazyLock::new(|| {
    let base = Tiny::made().copy();
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");
    fs::create_dir(base.path("flights")).unwrap();
    let copies = [
        (
            format!("{data}/flights/01_calm_ils.csv"),
            "flights/flight.csv",
        ),
        (format!("{data}/tape/session.mcap"), "session.mcap"),
        (tiny::MODEL.to_owned(), "model.onnx"),
        (tiny::MODEL.to_owned(), "set.onnx"),
    ];
    for (from, to) in copies {
        fs::copy(from, base.path(to)).unwrap();
    }
    let recorded = fs::read_to_string(base.path("sweep.toml")).unwrap();
    let recorded = format!("{recorded}\n[[recorded]]\nfiles = \"flights/*.csv\"\n");
    fs::write(base.path("recorded.toml"), recorded).unwrap();
    fs::write(base.path("set.onnx.toml"), SETTINGS).unwrap();
    fs::write(base.path("outside"), OUTSIDE).unwrap();
    let output = run(&base, "push over").expect("it ends");
    assert!(output.status.success(), "{}", said(&output));
    base
});

/// Settings equal to the model's defaults.
const SETTINGS: &str = r#"
layout = "rows"
aircraft_class = 0
box_origin = "pixel-center"

[input]
order = "rgb"
scale = 0.00392156862745098
"#;
const OUTSIDE: &str = "somebody else's file\n";

fn run(tiny: &Tiny, verb: &str) -> Option<Output> {
    let (_, words) = VERBS
        .iter()
        .find(|(name, _)| *name == verb)
        .expect("a verb");
    let store = format!("file://{}", tiny.path("store").display());
    let words = words.replace("{store}", &store);
    let words: Vec<&str> = words.split_whitespace().collect();
    tiny::run(
        tiny.dtd_within(MEMORY_KIB, &words)
            .env("RAYON_NUM_THREADS", "2"),
        TOO_LONG,
    )
}

/// The outcome of a verb for the unchanged base.
fn undisturbed(verb: &'static str) -> &'static Outcome {
    static KNOWN: LazyLock<BTreeMap<&str, OnceLock<Outcome>>> = LazyLock::new(|| {
        VERBS
            .iter()
            .map(|(name, _)| (*name, OnceLock::new()))
            .collect()
    });
    KNOWN[verb].get_or_init(|| {
        let once = || {
            let copy = BASE.copy();
            let output = run(&copy, verb).expect("it ends");
            assert_eq!(output.status.code(), Some(0), "{verb}: {}", said(&output));
            Outcome::of(&copy, &output)
        };
        once().steady_part(&once())
    })
}

/// A copy of the base with one thing changed.
struct Mutated {
    tiny: Tiny,
    /// The file, relative to the copy.
    name: String,
    what: String,
    guard: Guard,
}

impl Mutated {
    fn new(target: &Target, random: &mut ChaCha12Rng) -> Self {
        let tiny = BASE.copy();
        let name = file_name(target.file, &tiny, random);
        let path = tiny.path(&name);
        let mut mutated = Self {
            guard: target.guard,
            what: String::new(),
            name,
            tiny,
        };
        if random.random_bool(0.15) {
            mutated.what = place::mutate(&path, &mutated.tiny.path("outside"), random);
            // Without its seal a scenario is left out, whatever its content is.
            if mutated.name.ends_with("DONE.json") && !path.is_file() {
                mutated.guard = Guard::Free;
            }
            return mutated;
        }
        let before = fs::read(&path).unwrap();
        while fs::read(&path).unwrap() == before {
            mutated.what = change(target.form, &path, random);
        }
        let is_listed = target.guard == Guard::Sealed && !mutated.name.ends_with("MANIFEST.b3");
        if is_listed && random.random_bool(0.4) {
            mutated.forge_seal();
        }
        mutated
    }

    /// Seals the scenario in its current state, as a forger would.
    fn forge_seal(&mut self) {
        let id = self.name.split('/').nth(2).expect("corpus/scenarios/ID/..");
        let scenario = |tiny: &Tiny| Corpus::open(&tiny.corpus()).unwrap().scenario(id);
        let seal = scenario(&BASE).seal().unwrap().unwrap();
        seal_folder(scenario(&self.tiny).root(), &seal.config_hash).unwrap();
        self.guard = Guard::Free;
        self.what += ", and sealed again";
    }

    /// The fault of an outcome that reports success.
    fn silent_change(&self, verb: &'static str, output: &Output) -> Option<String> {
        // Recording, detecting or uploading again repairs the fault, and reports it.
        let mends = match verb {
            "generate" | "detect" | "detect again" => true,
            "push over" => self.name.starts_with("store/"),
            _ => false,
        };
        if self.guard == Guard::Free || self.what == place::BESIDE || mends {
            return None;
        }
        if self.guard == Guard::Sealed && ["undecoded", "verify"].contains(&verb) {
            return Some("verify finds nothing".into());
        }
        // Nor is a plan silent that calls the scenario damaged.
        let plan: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
        let damaged = plan["against"]["damaged"].as_object();
        if damaged.is_some_and(|damaged| damaged.keys().any(|id| self.name.contains(id))) {
            return None;
        }
        let found = Outcome::of(&self.tiny, output);
        let difference = undisturbed(verb).difference(&found, &self.name)?;
        // A message about the very file is not silence.
        let file = self.name.rsplit('/').next().unwrap_or_default();
        if ["push over", "fetch"].contains(&verb) && said(output).contains(&format!("{file} ")) {
            return None;
        }
        Some(format!("ended with 0, but {difference}"))
    }
}

/// Runs a case. Returns the change, and the outcome's fault.
fn case(number: usize, seed: u64) -> (String, Vec<String>) {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    random.set_stream(number as u64);
    let target = &TARGETS[number % TARGETS.len()];
    let verb = *pick(target.verbs, &mut random);
    let mutated = Mutated::new(target, &mut random);
    let mut wrong = match run(&mutated.tiny, verb) {
        None => vec![format!("did not end within {TOO_LONG:?}")],
        Some(output) => {
            let mut wrong = faults_of_process(&output);
            if wrong.is_empty() && output.status.success() {
                wrong.extend(mutated.silent_change(verb, &output));
            }
            wrong
        }
    };
    let outside = fs::read_to_string(mutated.tiny.path("outside"));
    if outside.ok().as_deref() != Some(OUTSIDE) {
        wrong.push("changed a file outside of the corpus".into());
    }
    let Mutated { name, what, .. } = mutated;
    (
        format!("case {number} of seed {seed}: {name}: {what}; dtd {verb}"),
        wrong,
    )
}

fn change(form: Form, path: &std::path::Path, random: &mut ChaCha12Rng) -> String {
    let mutate = match form {
        Form::Table => return table::mutate(path, random),
        Form::Json => json::mutate,
        Form::Bytes => text::mutate,
        Form::Toml => text::mutate_toml,
        Form::Csv => text::mutate_csv,
    };
    let (bytes, what) = mutate(&fs::read(path).unwrap(), random);
    fs::write(path, bytes).unwrap();
    what
}

/// A file of the base for a target.
fn file_name(pattern: &str, tiny: &Tiny, random: &mut ChaCha12Rng) -> String {
    let scenarios = tiny.scenarios();
    let folder = pick(&scenarios, random);
    let id = folder.file_name().unwrap().to_string_lossy();
    let objects = [
        "scenario.json",
        "calibration.json",
        "frames.parquet",
        "boxes_truth.parquet",
        "views/left.mp4",
        "MANIFEST.b3",
        "DONE.json",
    ];
    let files = tiny.files();
    let of_run: Vec<&str> = files
        .iter()
        .filter_map(|name| name.strip_prefix("run/"))
        .filter(|name| name.ends_with(".json") || name.ends_with(".b3"))
        .collect();
    let model = fs::read_dir(folder.join("detections"))
        .unwrap()
        .find_map(|entry| {
            let path = entry.unwrap().path();
            (path.extension()? == "parquet")
                .then(|| path.file_stem().unwrap().to_string_lossy().into_owned())
        })
        .unwrap();
    let name = pattern
        .replace("{id}", &id)
        .replace("{model}", &model)
        .replace("{object}", pick::<&str>(&objects, random))
        .replace("{run}", pick::<&str>(&of_run, random))
        .replace(
            "{whole}",
            pick::<&str>(&["plan.json", "splits.json"], random),
        );
    // In a store, the hash of its content is a part of an object's name.
    let (stem, ending) = name.rsplit_once('.').expect("a file with an ending");
    let is_object = |file: &String| {
        file.starts_with(&format!("{stem}.")) && file.ends_with(&format!(".{ending}"))
    };
    let object = name
        .starts_with("store/")
        .then(|| files.into_iter().find(is_object));
    object.flatten().unwrap_or(name)
}

/// Requirements on every process, whatever the input.
fn faults_of_process(output: &Output) -> Vec<String> {
    let words = said(output);
    let shown: String = words.lines().take(12).collect::<Vec<_>>().join("\n    ");
    let mut wrong = Vec::new();
    if let Some(signal) = output.status.signal() {
        wrong.push(format!("ended by signal {signal}: {shown}"));
    } else if !matches!(output.status.code(), Some(0 | 1 | 2 | 3 | 75)) {
        wrong.push(format!("ended with {}: {shown}", output.status));
    } else if words.contains("panicked at") {
        wrong.push(format!("panicked: {shown}"));
    } else if output.status.code() != Some(0) && output.stderr.is_empty() {
        wrong.push(format!("ended with {} and no word", output.status));
    }
    if let Some(letter) = words
        .chars()
        .find(|letter| letter.is_control() && !['\n', '\t'].contains(letter))
    {
        wrong.push(format!(
            "printed the control character {letter:?}: {}",
            shown.escape_debug()
        ));
    }
    wrong
}

fn number(variable: &str) -> Option<u64> {
    let text = std::env::var(variable).ok()?;
    Some(
        text.parse()
            .unwrap_or_else(|_| panic!("{variable} is {text:?}, expected a number")),
    )
}

#[test]
fn no_mutation_breaks_a_verb_or_passes_in_silence() {
    let seed = number("DTD_MUTATION_SEED").unwrap_or(1);
    let one = number("DTD_MUTATION_CASE").map(|number| number as usize);
    let cases = number("DTD_MUTATIONS").unwrap_or(150) as usize;
    let (next, end) = one.map_or((0, cases), |number| (number, number + 1));
    let (next, wrong) = (AtomicUsize::new(next), Mutex::new(Vec::new()));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    if number >= end {
                        return;
                    }
                    let (what, faults) = case(number, seed);
                    if one.is_some() {
                        println!("{what}");
                    }
                    for fault in faults {
                        let fault = format!("{what}: {fault}");
                        eprintln!("{fault}");
                        wrong.lock().unwrap().push(fault);
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().unwrap();
    assert!(wrong.is_empty(), "{} faults, see above", wrong.len());
}
