//! `dtd doctor`: examines a live connection point by point.

use std::path::{Path, PathBuf};

use generator::sweep::Sweep;
use xplane_bridge::WebApiPlace;
use xplane_bridge::doctor::{Check, DoctorOptions, Intent, Measuring, Verdict, examine};
use xplane_bridge::link::PictureSize;

use super::Outcome;
use super::address::simulator;
use super::async_runtime::async_runtime;
use super::output::print_json;
use crate::args::simulator::DoctorArgs;
use crate::failure::{Ending, Failure};

/// The sweep that most people record first.
const USUAL_SWEEP: &str = "demo.toml";

/// Runs the verb. Fails if a check does.
pub(crate) fn run(args: &DoctorArgs) -> Outcome {
    // Without an address, the X-Plane that announces itself is examined.
    let address = match &args.sim {
        Some(text) => simulator(text)?,
        None => None,
    };
    let web_api = match args.web_api {
        Some(place) => place,
        None => WebApiPlace::from_environment().map_err(Failure::bad_input)?,
    };
    let options = DoctorOptions {
        web_api,
        local_udp: args.local_udp.options(),
        measuring: match (args.measure, args.no_measure) {
            (true, _) => Measuring::Again,
            (_, true) => Measuring::Never,
            _ => Measuring::Once,
        },
        intent: intent(args.sweep.as_deref())?,
        ..DoctorOptions::at(address)
    };
    if options.measuring != Measuring::Never && !args.json {
        eprintln!(
            "doctor: an X-Plane 12 with our plugin is measured once per installation, which takes up to eight minutes if clouds are slow \
             (--no-measure leaves it out)"
        );
    }
    let mut show = |check: &Check| {
        if !args.json {
            print(check);
        }
    };
    let checks = async_runtime()?.block_on(examine(&options, &mut show));
    if args.json {
        print_json(&checks)?;
    }
    match checks
        .iter()
        .filter(|check| check.verdict == Verdict::Failed)
        .count()
    {
        0 => Ok(Ending::Done),
        failed => Err(Failure::Failed(anyhow::anyhow!(
            "{failed} of {} checks failed",
            checks.len()
        ))),
    }
}

/// The sweep to record, and its image size.
fn intent(sweep: Option<&Path>) -> Result<Option<Intent>, Failure> {
    let file = match sweep {
        Some(file) => file.to_owned(),
        None => PathBuf::from(USUAL_SWEEP),
    };
    if sweep.is_none() && !file.is_file() {
        return Ok(None);
    }
    let picture = Sweep::read(&file).map_err(Failure::bad_input)?.picture;
    Ok(Some(Intent {
        sweep: file.display().to_string(),
        pictures: PictureSize {
            width_px: picture.width_px,
            height_px: picture.height_px,
        },
    }))
}

fn print(check: &Check) {
    println!("{:<8} {:<18} {}", check.verdict, check.name, check.found);
    if let Some(hint) = &check.hint {
        println!("{:<8} {:<18} -> {hint}", "", "");
    }
}
