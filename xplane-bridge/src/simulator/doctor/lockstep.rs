//! The capture link at work: is the ground where it should be, and is every image the requested one?

use std::time::{Duration, Instant};

use dataset::conditions::Clock;
use dataset::geometry::camera::CameraPose;
use dataset::geometry::echo::{aircraft_mismatch, camera_mismatch};
use dataset::geometry::pose::{Controls, Pose};
use dataset::geometry::refraction::EARTH_RADIUS_M;
use dataset::geometry::runway::Runway;

use super::Check;
use super::eyes::{Eyes, SAME, Shot};
use super::talk::PlaceOnGround;
use crate::Simulator;
use crate::error::BridgeError;
use crate::link::{CaptureRequest, CapturedFrame, Deliver, PictureSize};
use crate::profile::Profile;

/// Height of the displayed aircraft above its place, so that it is not hidden.
const SHOWN_ABOVE_M: f64 = 300.0;
/// The camera's position relative to it.
const CAMERA_BEHIND_M: f64 = 150.0;
/// Distance that the aircraft is moved between images that must differ, metres.
pub(super) const MOVED_M: f64 = 15.0;
/// Image size for simulators that draw any size.
pub(super) const ANY_SIZE: PictureSize = PictureSize {
    width_px: 320,
    height_px: 214,
};
/// An image that takes longer than this makes a scenario take hours.
const SLOW: Duration = Duration::from_secs(1);

/// Takes images A A B A: all as requested, A the same each time, B different, frame numbers growing. The simulator is paused, unless
/// pauses do not show new poses and a clock runs.
pub(super) async fn lockstep(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    running_at: Option<Clock>,
) -> Check {
    const NAME: &str = "lockstep";
    let began = Instant::now();
    let mut eyes = Eyes::at(simulator, *place);
    let frames = match pictures(&mut eyes, running_at).await {
        Ok(frames) => frames,
        Err(error) => {
            return Check::failed(
                NAME,
                error.to_string(),
                "Look into the plugin's log (XPPython3Log.txt) at this moment",
            );
        }
    };
    let each = began.elapsed() / frames.len() as u32;
    let profile = simulator.profile().current();
    let restless = profile.is_some_and(Profile::pictures_move);
    if let Err(found) = judge(&frames, restless) {
        let hint = "Do not record like this. More settle frames may help; a plugin that moves the camera or the aircraft must go";
        return Check::failed(NAME, found, hint);
    }
    let seen = if frames.iter().all(|(_, frame)| frame.rgb.is_empty()) {
        "; what they show was not seen"
    } else if restless {
        "; they move by themselves, so that they were not compared"
    } else {
        ""
    };
    let found = format!(
        "{} images, each {:.0} ms, all as asked{seen}",
        frames.len(),
        each.as_secs_f64() * 1e3
    );
    if each > SLOW {
        Check::warning(
            NAME,
            found,
            "Each image takes long: lower the graphics settings, or the settle frames",
        )
    } else {
        Check::ok(NAME, found)
    }
}

async fn pictures(
    eyes: &mut Eyes<'_>,
    running_at: Option<Clock>,
) -> Result<Vec<(CaptureRequest, CapturedFrame)>, BridgeError> {
    let shots = [Shot::BEHIND, Shot::BEHIND, Shot::MOVED, Shot::BEHIND];
    let requests = (0..)
        .zip(shots)
        .map(|(tick, shot)| eyes.request(tick, shot));
    let requests: Vec<CaptureRequest> = requests.collect();
    let settle_frames = eyes.simulator.frames_to_settle();
    eyes.hold_at(settle_frames, running_at).await?;
    Ok(requests.into_iter().zip(eyes.take(shots).await?).collect())
}

/// Angle of an arc on the earth.
fn degrees(arc_m: f64) -> f64 {
    (arc_m / EARTH_RADIUS_M).to_degrees()
}

pub(super) fn request(
    place: &PlaceOnGround,
    tick: u32,
    moved_m: f64,
    size: PictureSize,
    deliver: Deliver,
) -> CaptureRequest {
    let pose = Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg + degrees(moved_m),
        altitude_msl_m: place.altitude_msl_m + SHOWN_ABOVE_M,
        heading_true_deg: 0.0,
        pitch_deg: 0.0,
        roll_deg: 0.0,
    };
    CaptureRequest {
        tick,
        // The same moment each time: motion of the scene must not make the images differ.
        time_ns: 0,
        view: 0,
        pose,
        controls: Controls::default(),
        camera: CameraPose {
            pose: Pose {
                latitude_deg: place.latitude_deg - degrees(CAMERA_BEHIND_M),
                longitude_deg: place.longitude_deg,
                ..pose
            },
            hfov_deg: 40.0,
        },
        width_px: size.width_px,
        height_px: size.height_px,
        deliver,
    }
}

/// Checks the frames; the error names the one out of step. In a restless scene (water), images are not compared.
fn judge(frames: &[(CaptureRequest, CapturedFrame)], restless: bool) -> Result<(), String> {
    for (asked, frame) in frames {
        let aircraft = aircraft_mismatch(&frame.header.pose, &asked.pose);
        let camera = camera_mismatch(&frame.header.camera, &asked.camera);
        for (what, mismatch) in [("aircraft", aircraft), ("camera", camera)] {
            if let Some(mismatch) = mismatch {
                return Err(format!(
                    "tick {}: the {what} was drawn at {mismatch}",
                    asked.tick
                ));
            }
        }
    }
    for pair in frames.windows(2) {
        let [(_, before), (_, after)] = pair else {
            continue;
        };
        if after.header.sim_frame <= before.header.sim_frame {
            return Err(format!(
                "frame number {} comes after {}",
                after.header.sim_frame, before.header.sim_frame
            ));
        }
    }
    let [(_, first), (_, again), (_, moved), (_, back)] = frames else {
        return Err(format!("{} images instead of 4", frames.len()));
    };
    if first.rgb.is_empty() || restless {
        return Ok(());
    }
    for (name, same) in [("at once", again), ("after another one", back)] {
        let difference = difference(&first.rgb, &same.rgb);
        if difference > SAME {
            return Err(format!(
                "the same pose {name} gives another image: {difference:.2} of 255 on the average"
            ));
        }
    }
    if largest_difference(&first.rgb, &moved.rgb) <= largest_difference(&first.rgb, &again.rgb) {
        return Err(format!(
            "an aircraft that is {MOVED_M} m away gives the same image"
        ));
    }
    Ok(())
}

/// Mean difference between two images, of 255.
pub(super) fn difference(one: &[u8], other: &[u8]) -> f64 {
    let sum: u64 = one
        .iter()
        .zip(other)
        .map(|(a, b)| u64::from(a.abs_diff(*b)))
        .sum();
    sum as f64 / one.len().max(1) as f64
}

fn largest_difference(one: &[u8], other: &[u8]) -> u8 {
    one.iter()
        .zip(other)
        .map(|(a, b)| a.abs_diff(*b))
        .max()
        .unwrap_or(0)
}

/// A runway at the aircraft's place: the plugin needs it to load the right surroundings.
pub(super) fn runway(place: &PlaceOnGround) -> Runway {
    let ground = Pose {
        latitude_deg: place.latitude_deg,
        longitude_deg: place.longitude_deg,
        altitude_msl_m: place.ground_msl_m,
        heading_true_deg: 0.0,
        pitch_deg: 0.0,
        roll_deg: 0.0,
    };
    Runway {
        airport: "HERE".into(),
        name: "00".into(),
        threshold: ground.position(),
        course_true_deg: 0.0,
        glide_path_deg: 3.0,
        touchdown_past_threshold_m: 300.0,
        ils_frequency_mhz: None,
        course_magnetic_deg: None,
        length_m: None,
        width_m: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::FrameHeader;

    const PLACE: PlaceOnGround = PlaceOnGround {
        latitude_deg: 1.35,
        longitude_deg: 103.98,
        altitude_msl_m: 10.0,
        ground_msl_m: 7.0,
    };

    /// Images A A B A from a correct simulator.
    fn sound() -> Vec<(CaptureRequest, CapturedFrame)> {
        let frame = |tick: u32, moved_m: f64| {
            let request = request(&PLACE, tick, moved_m, ANY_SIZE, Deliver::Picture);
            let header = FrameHeader {
                tick,
                view: 0,
                sim_frame: u64::from(tick) + 7,
                pose: request.pose,
                camera: request.camera,
                width_px: request.width_px,
                height_px: request.height_px,
            };
            let frame = CapturedFrame {
                header,
                rgb: vec![if moved_m > 0.0 { 200 } else { 100 }; 64].into(),
            };
            (request, frame)
        };
        vec![
            frame(0, 0.0),
            frame(1, 0.0),
            frame(2, MOVED_M),
            frame(3, 0.0),
        ]
    }

    #[test]
    fn a_sound_simulator_passes_and_every_fault_is_named() {
        assert_eq!(judge(&sound(), false), Ok(()));
        type Fault = fn(&mut [(CaptureRequest, CapturedFrame)]);
        let faults: [(&str, Fault); 5] = [
            ("tick 2: the aircraft", |frames| {
                frames[2].1.header.pose.latitude_deg += 1e-6;
            }),
            ("tick 1: the camera", |frames| {
                frames[1].1.header.camera.hfov_deg += 0.01;
            }),
            ("frame number 7 comes after 8", |frames| {
                frames[2].1.header.sim_frame = 7;
            }),
            ("the same pose at once", |frames| {
                frames[1].1.rgb = vec![90; 64].into();
            }),
            ("gives the same image", |frames| {
                frames[2].1.rgb = vec![100; 64].into();
            }),
        ];
        for (words, fault) in faults {
            let mut frames = sound();
            fault(&mut frames);
            let found = judge(&frames, false).unwrap_err();
            // Frame 8 is the second; the third then comes after it.
            assert!(found.contains(words), "{words}: {found}");
        }
    }
}
