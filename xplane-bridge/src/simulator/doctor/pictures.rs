//! Measurements on a static simulator's images: whether and how soon a pause shows new poses, and the motion that remains.

use super::Check;
use super::eyes::{Eyes, SAME, SETTLED, Shot};
use super::lockstep::difference;
use crate::error::BridgeError;
use crate::link::PixelKind;
use crate::profile::{CallbackOrders, Finding, Profile};

/// Settle frames that are tried.
const TRIED: [u32; 11] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48];
/// Number of frames in which callbacks are watched.
const WATCHED: u32 = 60;

/// Measures, one after the other, since each depends on the previous one.
pub(super) async fn measure(eyes: &mut Eyes<'_>, profile: &mut Profile) {
    if let Some(reason) = eyes.blind() {
        profile.pause_shows_poses = Finding::not_measured(&reason);
        profile.still_pictures_move = Finding::not_measured(&reason);
        profile.frames_until_still = Finding::not_measured(&reason);
        profile.frames_until_settled = Finding::not_measured(&reason);
        profile.callbacks = callbacks(eyes).await;
        return;
    }
    let noise = eyes.noise(Shot::BEHIND).await;
    let level = *noise.as_ref().unwrap_or(&0.0);
    profile.pixels = noise.is_ok().then(|| eyes.simulator.pixels());
    profile.still_pictures_move = finding(noise.map(|noise| noise > 0.0));
    let pause_shows_poses = shows_poses(eyes, level).await;
    profile.pause_shows_poses = pause_shows_poses.unwrap_or_else(Finding::not_measured);
    profile.callbacks = callbacks(eyes).await;
    let Some(&is_paused) = profile.pause_shows_poses.found() else {
        return;
    };
    profile.frames_until_still = if !is_paused {
        Finding::not_measured("images are taken while time runs")
    } else if profile.pictures_move() {
        Finding::not_measured("images move by themselves")
    } else {
        until_still(eyes).await
    };
    let until_settled = until_settled(eyes, level, is_paused).await;
    profile.frames_until_settled = until_settled.unwrap_or_else(Finding::not_measured);
}

/// For a person.
pub(super) fn checks(profile: &Profile) -> Vec<Check> {
    let pause = match &profile.pause_shows_poses {
        Finding::Found(false) => Check::warning(
            "pause",
            "a pause keeps the image that was there: a pose that is written then does not show",
            "Nothing: images are taken with time running. If another plugin holds the pause or the camera, switch it off and measure again",
        ),
        other => Check::measured("pause", other, |_| {
            "poses and cameras that are written in a pause show".into()
        }),
    };
    vec![
        Check::measured("still pictures", &profile.still_pictures_move, |moves| {
            let found = if *moves {
                "move by themselves in a pause (water, trees, flags, lights): nothing waits for two that agree, and each view is watched for \
                 3 s before its images are taken one per drawn frame"
            } else {
                "those of the same scene within three seconds are the same"
            };
            found.into()
        }),
        pause,
        Check::measured("frames", &profile.frames_until_still, |frames| {
            format!("the aircraft moved: two images in a row agree after {frames} frames at most")
        }),
        Check::measured("exposure", &profile.frames_until_settled, |frames| {
            format!("the camera turned: the image is the final one with settle_frames = {frames}")
        }),
        Check::measured("callbacks", &profile.callbacks, |found| {
            let orders: Vec<String> = found
                .orders
                .iter()
                .map(|(order, frames)| format!("{frames}x {order}"))
                .collect();
            format!(
                "in {} frames, {} cycles: {}",
                found.frames,
                found.cycles,
                orders.join("; ")
            )
        }),
    ]
}

/// Measures whether a different shot changes the image in a pause. If not, it must do so while time runs: in fog all images look alike.
async fn shows_poses(eyes: &mut Eyes<'_>, noise: f64) -> Result<Finding<bool>, BridgeError> {
    eyes.freeze(SETTLED).await?;
    if differ(eyes, noise).await? {
        return Ok(Finding::Found(true));
    }
    eyes.hold(SETTLED, false).await?;
    if differ(eyes, noise).await? {
        Ok(Finding::Found(false))
    } else {
        Ok(Finding::NotMeasured(
            "the sky and the aircraft give the same image, as in fog".into(),
        ))
    }
}

async fn differ(eyes: &mut Eyes<'_>, noise: f64) -> Result<bool, BridgeError> {
    let [behind, away] = eyes.take([Shot::BEHIND, Shot::AWAY]).await?;
    Ok(difference(&behind.rgb, &away.rgb) > noise + SAME)
}

/// The maximum number of frames between two static images when only the aircraft has moved.
async fn until_still(eyes: &mut Eyes<'_>) -> Finding<u32> {
    if eyes.simulator.pixels() == PixelKind::Screen {
        return Finding::NotMeasured(
            "images come off the screen: frames cannot be counted in them".into(),
        );
    }
    let measured = async {
        eyes.freeze(1).await?;
        let (there, here) = (Shot::MOVED, Shot::BEHIND);
        let frames = eyes
            .take([here, there, here, there, here, there, here])
            .await?;
        let gaps = frames.windows(2).map(|pair| {
            pair[1]
                .header
                .sim_frame
                .saturating_sub(pair[0].header.sim_frame)
        });
        Ok(gaps.max().unwrap_or(0) as u32)
    };
    finding(measured.await)
}

/// Measures the settle frames until the image is final after the camera has looked at different light.
async fn until_settled(
    eyes: &mut Eyes<'_>,
    noise: f64,
    is_paused: bool,
) -> Result<Finding<u32>, BridgeError> {
    eyes.hold(SETTLED, is_paused).await?;
    let [_, last] = eyes.take([Shot::AWAY, Shot::BEHIND]).await?;
    for frames in TRIED {
        let mut is_final = async || {
            eyes.hold(SETTLED, is_paused).await?;
            let [_] = eyes.take([Shot::AWAY]).await?;
            eyes.hold(frames, is_paused).await?;
            let [found] = eyes.take([Shot::BEHIND]).await?;
            Ok::<_, BridgeError>(difference(&found.rgb, &last.rgb) <= noise + SAME)
        };
        // Twice: while the camera is taken away, one image settles for longer than requested.
        if is_final().await? && is_final().await? {
            return Ok(Finding::Found(frames));
        }
    }
    Ok(Finding::NotMeasured(format!(
        "after {} frames an image still differs from the one after {SETTLED}",
        TRIED[TRIED.len() - 1]
    )))
}

async fn callbacks(eyes: &mut Eyes<'_>) -> Finding<CallbackOrders> {
    let watched = async {
        eyes.freeze(1).await?;
        let [_] = eyes.take([Shot::BEHIND]).await?;
        eyes.simulator.watch_callbacks(WATCHED).await
    };
    finding(watched.await)
}

fn finding<T>(measured: Result<T, BridgeError>) -> Finding<T> {
    measured.map_or_else(Finding::not_measured, Finding::Found)
}
