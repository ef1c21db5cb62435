//! `dtd install-plugin`: installs our plugin into an X-Plane folder.

use xplane_bridge::install::{FileChange, install_plugin};

use super::Outcome;
use super::output::print_json;
use crate::args::simulator::InstallPluginArgs;
use crate::failure::{Ending, Failure};

/// Runs the verb. An X-Plane that cannot run the plugin is bad input.
pub(crate) fn run(args: &InstallPluginArgs) -> Outcome {
    let report = install_plugin(&args.folder).map_err(Failure::bad_input)?;
    if args.json {
        print_json(&report)?;
        return Ok(Ending::Done);
    }
    let count = |change| {
        let files = report.files.iter();
        files.filter(|file| file.change == change).count()
    };
    println!(
        "X-Plane {}, XPPython3 {}: {} files written, {} as they were, {} removed",
        report.xplane,
        report.xppython3.as_deref().unwrap_or("of unknown version"),
        count(FileChange::Written),
        count(FileChange::Unchanged),
        count(FileChange::Removed),
    );
    for warning in &report.warnings {
        println!("warning: {warning}");
    }
    for (number, step) in report.next_steps.iter().enumerate() {
        println!("{}. {step}", number + 1);
    }
    Ok(Ending::Done)
}
