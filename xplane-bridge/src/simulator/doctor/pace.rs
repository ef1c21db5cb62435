//! How fast pictures come: taken as a recording takes them, from two views in turn, with several requests under way.

use std::time::Instant;

use super::Check;
use super::eyes::{Eyes, Shot};
use super::talk::PlaceOnGround;
use crate::Simulator;
use crate::error::BridgeError;
use crate::link::{PictureSize, PixelKind};
use crate::profile::{Finding, Pace, PacedBy};

/// Pictures that are not counted: the first ones load what the others find loaded.
const NOT_COUNTED: usize = 6;
/// Pictures that are counted.
const COUNTED: usize = 24;

/// Measures the pace of pictures with the frames that recordings let settle. Nothing is encoded.
pub(super) async fn measure(simulator: &mut Simulator, place: &PlaceOnGround) -> Finding<Pace> {
    let settle_frames = simulator.frames_to_settle();
    let mut eyes = Eyes::at(simulator, *place);
    if let Some(reason) = eyes.blind() {
        return Finding::NotMeasured(reason);
    }
    if eyes.simulator.pixels() == PixelKind::Screenshot {
        return Finding::NotMeasured("X-Plane writes screenshots, which takes seconds each".into());
    }
    match pace(&mut eyes, settle_frames).await {
        Ok(pace) => Finding::Found(pace),
        Err(error) => Finding::NotMeasured(error.to_string()),
    }
}

async fn pace(eyes: &mut Eyes<'_>, settle_frames: u32) -> Result<Pace, BridgeError> {
    let paused = !eyes
        .simulator
        .description()
        .profile
        .current()
        .is_some_and(|profile| profile.time_has_to_run());
    eyes.hold(settle_frames, paused).await?;
    let views = |number: usize| [Shot::BEHIND, Shot::AWAY][number % 2];
    eyes.take::<NOT_COUNTED>(std::array::from_fn(views)).await?;
    let began = Instant::now();
    let frames = eyes.take::<COUNTED>(std::array::from_fn(views)).await?;
    let took_s = began.elapsed().as_secs_f64();
    eyes.simulator.let_go().await?;
    eyes.simulator.resume().await?;
    let [first, ..] = &frames;
    Ok(Pace {
        measured_by: PacedBy::Doctor,
        size: PictureSize {
            width_px: first.width_px,
            height_px: first.height_px,
        },
        settle_frames,
        pictures_per_s: COUNTED as f64 / took_s,
        loading_s: None,
        weather_s: None,
    })
}

/// For a person.
pub(super) fn check(pace: &Finding<Pace>) -> Check {
    Check::measured("pace", pace, |pace| {
        format!(
            "{:.1} pictures of {} a second from two views in turn, each settled for {} frames; `dtd plan SWEEP --sim HOST:PORT` counts with it",
            pace.pictures_per_s, pace.size, pace.settle_frames
        )
    })
}
