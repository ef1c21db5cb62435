//! `docs/paper.md`, which a run of `dtd paper` made.

use std::fs;
use std::path::Path;

use paper_experiment::{Results, markdown};

#[test]
fn the_page_of_the_documentation_is_what_its_results_say() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    let results = fs::read_to_string(docs.join("results/paper.json")).unwrap();
    let results: Results = serde_json::from_str(&results).unwrap();
    let page = fs::read_to_string(docs.join("paper.md")).unwrap();
    assert_eq!(page, markdown(&results));
    for figure in page
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
    {
        assert!(docs.join(figure).is_file(), "{figure}");
    }
}
