//! Measurements on a static simulator's images: whether a pause shows new poses, how soon they are final, and the motion that remains.

pub(super) mod controls;

use super::Check;
use super::eyes::{Eyes, SAME, SETTLED, Shot};
use super::lockstep::difference;
use crate::error::BridgeError;
use crate::profile::{Finding, Profile};

/// Settle frames that are tried.
const TRIED: [u32; 11] = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48];

/// Measures, one after the other, since each depends on the previous one.
pub(super) async fn measure(eyes: &mut Eyes<'_>, profile: &mut Profile) {
    if let Some(reason) = eyes.blind() {
        profile.pause_shows_poses = Finding::not_measured(&reason);
        profile.still_pictures_move = Finding::not_measured(&reason);
        profile.frames_until_settled = Finding::not_measured(&reason);
        return;
    }
    let noise = eyes.noise(Shot::BEHIND).await;
    let level = *noise.as_ref().unwrap_or(&0.0);
    profile.still_pictures_move = noise.map(|noise| noise > 0.0).into();
    profile.pause_shows_poses = shows_poses(eyes, level).await.into();
    let Some(&is_paused) = profile.pause_shows_poses.found() else {
        return;
    };
    profile.frames_until_settled = until_settled(eyes, level, is_paused).await.into();
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
        Check::measured("exposure", &profile.frames_until_settled, |frames| {
            format!("the camera turned: the image is the final one with settle_frames = {frames}")
        }),
    ]
}

/// Measures whether a different shot changes the image in a pause. If not, it must do so while time runs: in fog all images look alike.
async fn shows_poses(eyes: &mut Eyes<'_>, noise: f64) -> Result<bool, BridgeError> {
    eyes.hold(SETTLED, true).await?;
    if differ(eyes, noise).await? {
        return Ok(true);
    }
    eyes.hold(SETTLED, false).await?;
    if differ(eyes, noise).await? {
        return Ok(false);
    }
    let reason = "the sky and the aircraft give the same image, as in fog";
    Err(BridgeError::Failed(reason.into()))
}

async fn differ(eyes: &mut Eyes<'_>, noise: f64) -> Result<bool, BridgeError> {
    let [behind, away] = eyes.take([Shot::BEHIND, Shot::AWAY]).await?;
    Ok(difference(&behind.rgb, &away.rgb) > noise + SAME)
}

/// Measures the settle frames until the image is final after the camera has looked at different light.
async fn until_settled(
    eyes: &mut Eyes<'_>,
    noise: f64,
    is_paused: bool,
) -> Result<u32, BridgeError> {
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
            return Ok(frames);
        }
    }
    Err(BridgeError::Failed(format!(
        "after {} frames an image still differs from the one after {SETTLED}",
        TRIED[TRIED.len() - 1]
    )))
}
