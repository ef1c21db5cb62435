//! Writes a synthetic corpus of the demo's size, without a simulator:
//! `cargo run --release -p trainer --example synthetic_corpus -- FOLDER`.

use std::path::PathBuf;
use std::process::ExitCode;

use testkit::synthetic::SyntheticCorpus;

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: synthetic_corpus FOLDER");
        return ExitCode::from(2);
    };
    match SyntheticCorpus::demo().write(&folder) {
        Ok(corpus) => {
            println!("{}", corpus.root().display());
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
