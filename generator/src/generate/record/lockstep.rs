//! Replays a flight tick by tick and captures every view of every tick.
//!
//! The simulator stands still between requests. A request states the scene, the answer states the drawn one; any difference ends the
//! attempt. A few requests are in flight at once, so that the simulator draws while images travel and are encoded.

use std::fmt::Debug;

use dataset::conditions::Weather;
use dataset::corpus::calibration::CameraEntry;
use dataset::geometry::echo::{aircraft_mismatch, camera_mismatch};
use dataset::geometry::pose::FlightState;
use dataset::numbers::frame_rate::FrameRate;
use dataset::plan::Picture;
use xplane_bridge::link::FrameHeader;
use xplane_bridge::{CaptureRequest, CapturedFrame, Deliver, Simulator};

use super::encoders::Encoders;
use crate::generate::error::ScenarioError;
use crate::generate::event::Event;
use crate::generate::run::attempt::Attempt;

/// Requests in flight: enough to keep the simulator drawing, few enough to keep memory small (7 MB per image).
const UNDER_WAY: usize = 4;

/// Captures all images into `encoders`; returns the drawn states by tick and view.
pub(crate) async fn capture(
    simulator: &mut Simulator,
    (states, views, picture): (&[FlightState], &[(String, CameraEntry)], Picture),
    weather: &Weather,
    encoders: &mut Encoders,
    attempt: &Attempt<'_, '_>,
) -> Result<Vec<Vec<FrameHeader>>, ScenarioError> {
    let total = states.len() * views.len();
    let deliver = simulator.deliver();
    let request = |number: usize| {
        let (tick, view) = (number / views.len(), number % views.len());
        request(
            (picture, deliver),
            tick as u32,
            &states[tick],
            view as u32,
            &views[view].1,
        )
    };
    let mut drawn: Vec<Vec<FrameHeader>> = Vec::with_capacity(states.len());
    let mut last_sim_frame = None;
    let mut sent = 0;
    let under_way = UNDER_WAY.min(simulator.most_outstanding());
    for due in 0..total {
        while sent < total.min(due + under_way) {
            let next = request(sent);
            attempt.answered(simulator.send_capture(&next)).await?;
            sent += 1;
        }
        let frame = attempt.answered(simulator.receive_frame()).await?;
        let view = due % views.len();
        let id = &views[view].0;
        let seen = check(&request(due), &frame, id, last_sim_frame)?;
        check_content(&frame, id, weather)?;
        last_sim_frame = Some(seen.sim_frame);
        attempt
            .unless_cancelled(encoders.write(view, frame.rgb))
            .await?;
        while let Some(memory) = encoders.take_written() {
            simulator.recycle(memory);
        }
        match drawn.last_mut() {
            Some(tick) if view > 0 => tick.push(seen),
            _ => drawn.push(vec![seen]),
        }
        if view + 1 == views.len() {
            attempt.reporter.tell(Event::Captured {
                id: attempt.id,
                done: drawn.len() as u32,
            });
        }
    }
    // The screen's registration before the first image must still hold after the last.
    attempt.unless_cancelled(simulator.confirm_pixels()).await?;
    Ok(drawn)
}

pub(crate) fn request(
    (picture, deliver): (Picture, Deliver),
    tick: u32,
    state: &FlightState,
    index: u32,
    camera: &CameraEntry,
) -> CaptureRequest {
    let rate: FrameRate = picture.frame_rate;
    CaptureRequest {
        tick,
        time_ns: rate.time_of_tick(tick).0,
        view: index,
        pose: state.pose,
        controls: state.controls,
        camera: camera.placed,
        width_px: picture.width_px,
        height_px: picture.height_px,
        deliver,
    }
}

/// Rejects an image that does not match its request, within the precision of X-Plane's 32-bit floats, or that is not newer than the
/// previous one.
pub(crate) fn check(
    asked: &CaptureRequest,
    frame: &CapturedFrame,
    view: &str,
    last_sim_frame: Option<u64>,
) -> Result<FrameHeader, ScenarioError> {
    let header = &frame.header;
    let refuse = |what: String| {
        Err(ScenarioError::NotInStep {
            tick: asked.tick,
            view: view.to_owned(),
            what,
        })
    };
    let not_in_step = |what: &str, found: &dyn Debug, expected: &dyn Debug| {
        refuse(format!("{what} is {found:?}, expected {expected:?}"))
    };
    if header.tick != asked.tick {
        return not_in_step("tick", &header.tick, &asked.tick);
    }
    if header.view != asked.view {
        return not_in_step("number of the view", &header.view, &asked.view);
    }
    if let Some(mismatch) = aircraft_mismatch(&header.pose, &asked.pose) {
        return refuse(format!("the aircraft was drawn with {mismatch}"));
    }
    if let Some(mismatch) = camera_mismatch(&header.camera, &asked.camera) {
        return refuse(format!("the camera stood with {mismatch}"));
    }
    let (found, expected) = (
        (header.width_px, header.height_px),
        (asked.width_px, asked.height_px),
    );
    if found != expected || frame.rgb.len() != asked.rgb_bytes() {
        return not_in_step(
            "size of the image",
            &(found, frame.rgb.len()),
            &(expected, asked.rgb_bytes()),
        );
    }
    if let Some(last) = last_sim_frame
        && header.sim_frame <= last
    {
        return not_in_step(
            "simulator's frame number",
            &header.sim_frame,
            &format!("more than {last}"),
        );
    }
    Ok(*header)
}

/// Rejects an empty image.
pub(crate) fn check_content(
    frame: &CapturedFrame,
    view: &str,
    weather: &Weather,
) -> Result<(), ScenarioError> {
    match blank(&frame.rgb, weather) {
        Some(color) => Err(ScenarioError::Blank {
            tick: frame.header.tick,
            view: view.to_owned(),
            color,
            visibility_m: weather.visibility_m,
        }),
        None => Ok(()),
    }
}

/// Maximum component of black pixels: codecs and screens round.
const BLACK: u8 = 1;
/// Maximum visibility at which fog fills an image from edge to edge with one colour, metres. A camera of long focal length that looks over
/// the ground, as the paper's do, sees nothing else at 5 NM.
const FOG_FILLS_PICTURE_M: f64 = 10_000.0;

/// Colour of empty images: black all over, or a single colour that fog does not explain. Almost free if two pixels near the start differ.
fn blank(rgb: &[u8], weather: &Weather) -> Option<[u8; 3]> {
    let (pixels, _) = rgb.as_chunks();
    let first = *pixels.first()?;
    let one_color =
        weather.visibility_m >= FOG_FILLS_PICTURE_M && pixels.iter().all(|pixel| *pixel == first);
    let black = || rgb.iter().all(|value| *value <= BLACK);
    (one_color || black()).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::geometry::camera::CameraPose;
    use dataset::geometry::pose::{Controls, Pose};

    fn asked() -> CaptureRequest {
        let pose = Pose {
            latitude_deg: 1.3,
            longitude_deg: 103.9,
            altitude_msl_m: 300.0,
            heading_true_deg: 23.0,
            pitch_deg: 2.0,
            roll_deg: 0.0,
        };
        CaptureRequest {
            tick: 5,
            time_ns: 5_000_000_000,
            view: 1,
            pose,
            controls: Controls::default(),
            camera: CameraPose {
                pose,
                hfov_deg: 10.0,
            },
            width_px: 4,
            height_px: 2,
            deliver: Deliver::Picture,
        }
    }

    fn answer() -> CapturedFrame {
        let CaptureRequest {
            tick,
            view,
            pose,
            camera,
            width_px,
            height_px,
            ..
        } = asked();
        let header = FrameHeader {
            tick,
            view,
            sim_frame: 100,
            pose,
            camera,
            width_px,
            height_px,
        };
        CapturedFrame {
            header,
            rgb: vec![0; 24].into(),
        }
    }

    #[test]
    fn a_picture_that_shows_nothing_is_told_from_night_and_fog() {
        let weather = |visibility_m: f64| Weather {
            visibility_m,
            clouds: Vec::new(),
            rain_ratio: 0.0,
            wind_speed_mps: 0.0,
            wind_from_true_deg: 0.0,
            turbulence_ratio: 0.0,
        };
        let (clear, fog) = (weather(50_000.0), weather(50.0));
        let filled = |value: u8| vec![value; 64 * 32 * 3];
        assert_eq!(blank(&filled(0), &clear), Some([0; 3]));
        assert_eq!(blank(&filled(1), &fog), Some([1; 3]));
        assert_eq!(blank(&filled(90), &clear), Some([90; 3]));
        assert_eq!(blank(&filled(90), &fog), None);
        // A star in the last pixel.
        let mut night = filled(0);
        night[64 * 32 * 3 - 1] = 9;
        assert_eq!(blank(&night, &clear), None);
    }

    #[test]
    fn what_was_asked_for_passes() {
        assert_eq!(
            check(&asked(), &answer(), "right", Some(99))
                .unwrap()
                .sim_frame,
            100
        );
    }

    #[test]
    fn every_difference_is_refused_with_tick_and_view() {
        type Change = fn(&mut CapturedFrame);
        let wrong: [(&str, Change); 6] = [
            ("tick is 4, expected 5", |f| f.header.tick = 4),
            ("number of the view", |f| f.header.view = 0),
            ("the aircraft was drawn with position", |f| {
                f.header.pose.latitude_deg += 1e-6;
            }),
            ("the camera stood with hfov_deg 10.1", |f| {
                f.header.camera.hfov_deg = 10.1;
            }),
            ("size of the image", |f| f.rgb = vec![0; 23].into()),
            ("frame number is 99, expected \"more than 99\"", |f| {
                f.header.sim_frame = 99;
            }),
        ];
        for (words, change) in wrong {
            let mut frame = answer();
            change(&mut frame);
            let message = check(&asked(), &frame, "right", Some(99))
                .unwrap_err()
                .to_string();
            assert!(
                message.contains("tick 5, view right") && message.contains(words),
                "{message}"
            );
        }
    }
}
