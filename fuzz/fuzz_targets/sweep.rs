//! Any text as a sweep: rejected with its position, or expanded to the same plan twice, and that plan can be read.

#![no_main]

use std::path::Path;

use dataset::plan::Plan;
use generator::plan::expand;
use generator::sweep::Sweep;
use libfuzzer_sys::fuzz_target;

/// More would be slow and teach nothing.
const SCENARIOS: usize = 200;

fuzz_target!(|text: &str| {
    // Whatever files a generated glob names, there are none.
    let folder = Path::new("/dev/null");
    let read = || Sweep::parse(Path::new("sweep.toml"), folder, text.to_owned());
    if let Ok(sweep) = read()
        && sweep.len() <= SCENARIOS
    {
        let again = read().expect("it could be read a moment ago");
        let plan = expand(&sweep);
        assert_eq!(plan.plan_hash, expand(&again).plan_hash);
        let text = serde_json::to_vec(&plan).unwrap();
        let reread = Plan::parse(&text, Path::new("plan.json"));
        let reread = reread.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(reread.check_hashes(), Ok(()));
        assert_eq!(reread.plan_hash, plan.plan_hash);
    }
});
