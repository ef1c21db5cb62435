//! Copies a corpus and makes the `calibration.json` of every scenario wrong, for all views or for one:
//! `cargo run --release -p trainer --example miscalibrated_corpus -- CORPUS COPY YAW_DEG PITCH_DEG ROLL_DEG FOCAL_PCT NORTH_M [VIEW]`.

use std::path::Path;
use std::process::ExitCode;

use dataset::corpus::Corpus;
use testkit::files::copy_folder;
use testkit::miscalibrated::Miscalibration;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (folders, numbers) = arguments.split_at(arguments.len().min(2));
    let (numbers, view) = numbers.split_at(numbers.len().min(5));
    let numbers: Result<Vec<f64>, _> = numbers.iter().map(|number| number.parse()).collect();
    let ([from, to], Ok(numbers)) = (folders, numbers) else {
        return usage();
    };
    let [yaw_deg, pitch_deg, roll_deg, focal_pct, north_m] = numbers[..] else {
        return usage();
    };
    let is_wrong = |id: &str| view.first().is_none_or(|view| view == id);
    copy_folder(Path::new(from), Path::new(to));
    let wrong = Miscalibration {
        yaw_deg,
        pitch_deg,
        roll_deg,
        focal_pct,
        north_m,
    };
    let copied = Corpus::open(Path::new(to)).and_then(|corpus| wrong.apply_to(&corpus, is_wrong));
    match copied {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn usage() -> ExitCode {
    eprintln!(
        "usage: miscalibrated_corpus CORPUS COPY YAW_DEG PITCH_DEG ROLL_DEG FOCAL_PCT NORTH_M [VIEW]"
    );
    ExitCode::from(2)
}
