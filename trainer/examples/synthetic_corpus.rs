//! Writes a synthetic corpus of the demo's size, or of the full one's, without a simulator:
//! `cargo run --release -p trainer --example synthetic_corpus -- FOLDER [full]`.

use std::path::PathBuf;
use std::process::ExitCode;

use testkit::synthetic::SyntheticCorpus;

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    let (folder, corpus) = match arguments.as_slice() {
        [folder] => (PathBuf::from(folder), SyntheticCorpus::demo()),
        [folder, size] if size == "full" => (PathBuf::from(folder), SyntheticCorpus::full()),
        _ => {
            eprintln!("usage: synthetic_corpus FOLDER [full]");
            return ExitCode::from(2);
        }
    };
    match corpus.write(&folder) {
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
