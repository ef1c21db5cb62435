//! What is changed, which verbs read it, and the required outcome.

/// Arguments of a verb, with `{store}` for the URL of an object store.
pub(super) const VERBS: [(&str, &str); 16] = [
    ("plan", "plan sweep.toml --json"),
    ("plan recorded", "plan recorded.toml --json"),
    ("against", "plan sweep.toml --against corpus --json"),
    ("generate", "generate sweep.toml --out corpus --json"),
    ("label", "label corpus --json"),
    ("detect", "detect corpus --model model.onnx --json"),
    (
        "detect again",
        "detect corpus --model model.onnx --force --json",
    ),
    ("detect set", "detect corpus --model set.onnx --json"),
    ("undecoded", "verify corpus --no-decode --json"),
    ("verify", "verify corpus --json"),
    (
        "train",
        "train corpus --out new-run --config training.toml --json",
    ),
    ("evaluate", "evaluate run --corpus corpus --json"),
    ("push", "push corpus {store}/new --json"),
    ("push over", "push corpus {store}/a --json"),
    ("fetch", "fetch {store}/a --out fetched --json"),
    (
        "tape",
        "mock-xplane --tape session.mcap --port 0 --no-beacon --until-stdin-ends",
    ),
];

/// The required outcome of changing a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Guard {
    /// A seal covers it: every reader fails, and `verify` finds it.
    Sealed,
    /// It is about other files: every user of it fails, or does what it did before.
    Checked,
    /// It is the user's choice, or only a decoder can tell.
    Free,
}

/// File format, which determines how it is changed.
#[derive(Debug, Clone, Copy)]
pub(super) enum Form {
    Json,
    Table,
    Bytes,
    Toml,
    Csv,
}

/// A file, and the verbs that read it.
pub(super) struct Target {
    /// Path, with `{id}` for a scenario and `{model}` for the detector's hash.
    pub(super) file: &'static str,
    pub(super) form: Form,
    pub(super) guard: Guard,
    pub(super) verbs: &'static [&'static str],
}

/// Verbs that read a scenario's files.
const SCENARIO: &[&str] = &[
    "label",
    "undecoded",
    "train",
    "evaluate",
    "push",
    "against",
    "detect again",
    "verify",
    "generate",
];
const DETECTIONS: &[&str] = &["train", "evaluate", "undecoded", "detect"];
const OBJECTS: &[&str] = &["fetch", "fetch", "push over"];

/// Path, with `{id}` for a scenario, `{model}` for the detector's hash, and braces for alternatives.
#[rustfmt::skip]
pub(super) const TARGETS: [Target; 30] = [
    Target { file: "sweep.toml", form: Form::Toml, guard: Guard::Free, verbs: &["plan", "plan", "against"] },
    Target { file: "sweep.toml", form: Form::Toml, guard: Guard::Free, verbs: &["plan", "plan", "generate"] },
    Target { file: "recorded.toml", form: Form::Toml, guard: Guard::Free, verbs: &["plan recorded"] },
    Target { file: "flights/flight.csv", form: Form::Csv, guard: Guard::Free, verbs: &["plan recorded"] },
    Target { file: "training.toml", form: Form::Toml, guard: Guard::Free, verbs: &["train"] },
    Target { file: "training.toml", form: Form::Toml, guard: Guard::Free, verbs: &["train"] },
    Target { file: "model.onnx", form: Form::Bytes, guard: Guard::Free, verbs: &["detect", "detect again"] },
    Target { file: "set.onnx.toml", form: Form::Toml, guard: Guard::Free, verbs: &["detect set"] },
    Target { file: "session.mcap", form: Form::Bytes, guard: Guard::Free, verbs: &["tape"] },
    Target { file: "corpus/plan.json", form: Form::Json, guard: Guard::Checked, verbs: &["against", "undecoded", "push over", "generate"] },
    Target { file: "corpus/splits.json", form: Form::Json, guard: Guard::Checked, verbs: &["train", "evaluate", "undecoded", "push over", "generate"] },
    Target { file: "corpus/corpus.toml", form: Form::Toml, guard: Guard::Free, verbs: &["undecoded", "push", "generate"] },
    Target { file: "corpus/scenarios/{id}/scenario.json", form: Form::Json, guard: Guard::Sealed, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/scenario.json", form: Form::Json, guard: Guard::Sealed, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/calibration.json", form: Form::Json, guard: Guard::Sealed, verbs: SCENARIO },
    // The seal itself has no seal: what it says of other files is checked.
    Target { file: "corpus/scenarios/{id}/DONE.json", form: Form::Json, guard: Guard::Checked, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/MANIFEST.b3", form: Form::Bytes, guard: Guard::Sealed, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/frames.parquet", form: Form::Table, guard: Guard::Sealed, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/frames.parquet", form: Form::Table, guard: Guard::Sealed, verbs: SCENARIO },
    Target { file: "corpus/scenarios/{id}/boxes_truth.parquet", form: Form::Table, guard: Guard::Sealed, verbs: SCENARIO },
    // Only `verify` reads videos for their hashes.
    Target { file: "corpus/scenarios/{id}/views/left.mp4", form: Form::Bytes, guard: Guard::Free, verbs: &["detect again", "undecoded", "push"] },
    Target { file: "corpus/scenarios/{id}/views/left.mp4", form: Form::Bytes, guard: Guard::Sealed, verbs: &["verify"] },
    Target { file: "corpus/scenarios/{id}/detections/{model}.parquet", form: Form::Table, guard: Guard::Checked, verbs: DETECTIONS },
    Target { file: "corpus/scenarios/{id}/detections/{model}.parquet", form: Form::Table, guard: Guard::Checked, verbs: &["push over"] },
    Target { file: "corpus/scenarios/{id}/detections/{model}.json", form: Form::Json, guard: Guard::Checked, verbs: DETECTIONS },
    Target { file: "run/{run}", form: Form::Json, guard: Guard::Checked, verbs: &["evaluate"] },
    Target { file: "run/weights.safetensors", form: Form::Bytes, guard: Guard::Checked, verbs: &["evaluate"] },
    Target { file: "store/a/scenarios/{id}/{object}", form: Form::Bytes, guard: Guard::Checked, verbs: OBJECTS },
    Target { file: "store/a/{whole}", form: Form::Json, guard: Guard::Checked, verbs: OBJECTS },
    // A folder as a store keeps no hashes with its objects: a record's statement about itself is trusted.
    Target { file: "store/a/scenarios/{id}/detections/{model}.json", form: Form::Json, guard: Guard::Free, verbs: OBJECTS },
];
