//! `dtd import`: a corpus of recordings that no simulator made.

use labeller::Searcher;
use recordings::{CameraOutcome, Error, import};

use super::Outcome;
use super::output::{count, print_json};
use crate::args::imports::ImportArgs;
use crate::failure::{Ending, Failure};
use crate::progress::verb_watch::VerbWatch;
use crate::shipped::Detector;

/// Runs the verb.
pub(crate) fn run(args: &ImportArgs) -> Outcome {
    let model = Detector::chosen(args.model.as_deref())?;
    let watch = VerbWatch::new("import", "images");
    let load = || Searcher::load(model.path(), &args.runtime.options());
    let outcome =
        import(&args.recording, &args.out, load, &watch).map_err(|error| match error {
            Error::Stopped(_) => Failure::Interrupted { resumes: true },
            error => Failure::bad_input_if(error.is_bad_input(), error),
        })?;
    drop(watch);
    if args.json {
        print_json(&outcome)?;
    } else {
        for camera in &outcome.cameras {
            println!("{}", line(camera));
        }
    }
    for camera in &outcome.cameras {
        if let Some(cause) = &camera.likely_cause {
            eprintln!(
                "camera {}: its clock differs from the tracks'; likely cause: {cause}; corrected",
                camera.camera
            );
        }
        if camera.damaged_images > 0 {
            eprintln!(
                "camera {}: {} left out",
                camera.camera,
                count(camera.damaged_images as usize, "damaged image")
            );
        }
        for doubt in &camera.doubts {
            eprintln!("camera {}: {doubt}", camera.camera);
        }
    }
    for refused in &outcome.refused {
        eprintln!("refused: {}: {}", refused.what, refused.reason);
    }
    eprintln!(
        "{} imported, {} refused",
        count(outcome.scenarios.len(), "arrival"),
        outcome.refused.len()
    );
    Ok(Ending::with_losses(&outcome.refused))
}

/// A camera's clock, direction and boxes.
fn line(camera: &CameraOutcome) -> String {
    let CameraOutcome {
        camera: name,
        offset_s,
        offset_sd_s,
        drift_ppm,
        drift_sd_ppm,
        turned: [pan, tilt, roll, focal],
        turned_sd,
        residual_px,
        matched,
        unmatched,
        ..
    } = camera;
    let turned = if turned_sd.iter().all(|sd| *sd == 0.0) {
        String::new()
    } else {
        format!(
            ", pan {pan:+.3} ({:.3}), tilt {tilt:+.3} ({:.3}), roll {roll:+.3} ({:.3}) degrees, focal length {focal:+.2} ({:.2}) %",
            turned_sd[0], turned_sd[1], turned_sd[2], turned_sd[3]
        )
    };
    format!(
        "{name}: clock {offset_s:+.3} ({offset_sd_s:.3}) s, drift {drift_ppm:+.1} ({drift_sd_ppm:.1}) ppm{turned}; {matched} boxes match \
         within {residual_px:.1} px, {unmatched} do not"
    )
}
