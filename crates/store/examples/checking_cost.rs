//! Measures the cost of checking that a store has a complete corpus, as `dtd push` and `dtd generate --out URL` do before they call a
//! scenario complete.
//!
//! ```sh
//! AWS_ENDPOINT_URL=http://127.0.0.1:5000 .. cargo run --release -p dtd-store --example checking_cost -- s3://bucket/corpus 1000
//! ```

use std::error::Error;
use std::time::Instant;
use std::{env, fs};

use dataset::corpus::Corpus;
use dataset::corpus::seal::seal_folder;
use dataset::work::watch::Silent;
use store::{CorpusStore, Pushed, StoreUrl, Transfer};

/// The files of a labelled scenario with two views.
const FILES: [&str; 6] = [
    "scenario.json",
    "calibration.json",
    "frames.parquet",
    "boxes_truth.parquet",
    "views/left.mp4",
    "views/right.mp4",
];

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let url: StoreUrl = arguments
        .next()
        .ok_or("expected URL [SCENARIOS]")?
        .parse()?;
    let scenarios: usize = arguments.next().as_deref().unwrap_or("1000").parse()?;
    let folder = tempfile::tempdir()?;
    let corpus = Corpus::create(folder.path())?;
    for number in 0..scenarios {
        write_scenario(&corpus, &format!("{number:05}"))?;
    }
    let store = CorpusStore::open(&url, true)?;
    for round in ["empty", "complete"] {
        let began = Instant::now();
        let listing = store.listing().await?;
        let mut unchanged = 0;
        for folder in corpus.scenarios()? {
            let seen = listing.of(&folder.id());
            let pushed = store
                .push_scenario(&folder, Some(&seen), &Transfer::new(&Silent))
                .await?;
            unchanged += usize::from(pushed == Pushed::Same);
        }
        println!(
            "push to a store that is {round}: {:.1} s, {unchanged} of {scenarios} there already",
            began.elapsed().as_secs_f64()
        );
    }
    let began = Instant::now();
    let listing = store.listing().await?;
    let states = store.states(&listing, listing.committed()).await?;
    println!(
        "generate finds {} complete scenarios: {:.1} s",
        states.len(),
        began.elapsed().as_secs_f64()
    );
    Ok(())
}

/// Writes and seals a small scenario. Its record names it, as uploads require.
fn write_scenario(corpus: &Corpus, id: &str) -> Result<(), Box<dyn Error>> {
    let root = corpus.scenario(id).root().to_owned();
    fs::create_dir_all(root.join("views"))?;
    for name in FILES {
        let content = match name {
            "scenario.json" => format!("{{\"id\": \"{id}\", \"config_hash\": \"config\"}}"),
            name => format!("{name} of {id}"),
        };
        fs::write(root.join(name), content)?;
    }
    seal_folder(&root, "config")?;
    Ok(())
}
