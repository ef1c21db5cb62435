//! Cameras that do not show what they report: images that are late, repeated or shaken, or taken in a different direction, with a
//! different focal length or by a different camera.
//!
//! Input: requests for images, in order. Output: for each, the content that takes its place ([`Drawn`]). Answers still echo the request: a
//! camera with such a fault does not notice it.

use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::TAU;
use std::time::Duration;

use dataset::geometry::camera::CameraPose;
use dataset::geometry::pose::Pose;
use dataset::numbers::units::Degrees;
use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use xplane_bridge::link::CaptureRequest;

use super::Faults;

/// Frequencies of a shake's sinusoids relative to the stated one. No image rate is a multiple of all.
const SINUSOIDS: [f64; 5] = [0.71, 0.87, 1.0, 1.13, 1.29];

/// A fault of a view's camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraFault {
    /// Index of the view in the rig, from 0.
    pub view: u32,
    /// Effect on its images.
    pub kind: CameraFaultKind,
}

/// Effect of a camera fault on images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraFaultKind {
    /// Everything is shown where it was some time before. Images of the time before a flight do not show its aircraft.
    Late {
        /// The time by which images are late.
        by: Duration,
        /// The time since the first tick from which on they are.
        after: Duration,
    },
    /// The camera shakes about its two transverse axes. The finished image is displaced as a whole, because each direction needs a separate
    /// backdrop, which takes seconds. With ten degrees of view that differs from a rotation by less than one percent.
    Shakes {
        /// Root mean square along each axis of the image, pixels.
        rms_px: f64,
        /// Mean frequency, hertz.
        frequency_hz: f64,
    },
    /// This share of the images repeats the previous one, 0 to 1.
    Sticks(f64),
    /// The camera's direction or focal length changes.
    Aims {
        /// The changed quantity.
        change: AimChange,
        /// The size of the change, degrees or percent.
        by: f64,
        /// The time of the change since the first tick; the duration of a drift by this angle.
        time: Duration,
    },
    /// The view shows what the camera of another view sees, without that view's faults.
    Source(u32),
}

/// Change of a camera's direction or focal length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AimChange {
    /// It points further to the right from some time on, degrees.
    Turn,
    /// It points further down from some time on, degrees.
    Tilt,
    /// Its focal length is longer from some time on, percent.
    Zoom,
    /// It turns to the right at a constant rate from the first tick to the end of the flight, degrees.
    Drift,
}

impl AimChange {
    pub(super) const ALL: [Self; 4] = [Self::Turn, Self::Tilt, Self::Zoom, Self::Drift];

    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Turn => "turn",
            Self::Tilt => "tilt",
            Self::Zoom => "zoom",
            Self::Drift => "drift",
        }
    }

    pub(super) fn allows(self, by: f64) -> bool {
        match self {
            Self::Turn | Self::Drift => by.abs() <= 180.0,
            Self::Tilt => by.abs() <= 90.0,
            Self::Zoom => by > -100.0 && by.is_finite(),
        }
    }
}

/// Content that replaces a requested image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Drawn {
    pub(crate) request: CaptureRequest,
    /// The view whose camera sees the image.
    pub(crate) source: u32,
    aim: Aim,
    /// Displacement of the finished image, pixels right and down.
    pub(crate) shift_px: DVec2,
}

impl Drawn {
    /// The image as requested.
    fn sound(request: &CaptureRequest) -> Self {
        Self {
            request: *request,
            source: request.view,
            aim: Aim::default(),
            shift_px: DVec2::ZERO,
        }
    }
}

/// Difference from a camera's reported direction and focal length.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Aim {
    right_deg: f64,
    down_deg: f64,
    zoom_percent: f64,
}

impl Aim {
    fn add(&mut self, change: AimChange, by: f64, time: Duration, time_ns: i64) {
        let is_due = time_ns >= nanoseconds(time);
        match change {
            AimChange::Drift => self.right_deg += by * time_ns as f64 / nanoseconds(time) as f64,
            AimChange::Turn if is_due => self.right_deg += by,
            AimChange::Tilt if is_due => self.down_deg += by,
            AimChange::Zoom if is_due => self.zoom_percent += by,
            AimChange::Turn | AimChange::Tilt | AimChange::Zoom => {}
        }
    }

    fn applied_to(&self, camera: &CameraPose) -> CameraPose {
        if *self == Self::default() {
            return *camera;
        }
        let mut aimed = *camera;
        turn_right(&mut aimed.pose, self.right_deg);
        aimed.pose.pitch_deg -= self.down_deg;
        let half_width = (camera.hfov_deg.to_radians() / 2.0).tan();
        let half_width = half_width / (1.0 + self.zoom_percent / 100.0);
        aimed.hfov_deg = 2.0 * half_width.atan().to_degrees();
        aimed
    }
}

/// All cameras during a flight.
#[derive(Debug)]
pub(crate) struct FaultyCameras {
    faults: Vec<CameraFault>,
    seed: u64,
    views: BTreeMap<u32, View>,
    /// The first tick of the flight, and the cameras that were requested in it.
    first_tick: Option<u32>,
    rig: BTreeMap<u32, CameraPose>,
}

impl FaultyCameras {
    pub(crate) fn new(faults: &Faults) -> Self {
        Self {
            faults: faults.cameras.clone(),
            seed: faults.seed,
            views: BTreeMap::new(),
            first_tick: None,
            rig: BTreeMap::new(),
        }
    }

    /// The next requests belong to a new scenario.
    pub(crate) fn begin_flight(&mut self) {
        self.first_tick = None;
        self.rig.clear();
        self.views.values_mut().for_each(View::begin_flight);
    }

    /// Refuses a fault in a view that the rig does not have, which would have no effect. `None` in the first tick, which shows the views.
    pub(crate) fn fault_of_no_view(&mut self, request: &CaptureRequest) -> Option<String> {
        if request.tick == *self.first_tick.get_or_insert(request.tick) {
            self.rig.insert(request.view, request.camera);
            return None;
        }
        let views_of = |fault: &CameraFault| match fault.kind {
            CameraFaultKind::Source(other) => [fault.view, other],
            _ => [fault.view; 2],
        };
        let (fault, missing) = self.faults.iter().find_map(|fault| {
            let mut views = views_of(fault).into_iter();
            let missing = views.find(|view| !self.rig.contains_key(view))?;
            Some((fault, missing))
        })?;
        let views: Vec<String> = self.rig.keys().map(u32::to_string).collect();
        Some(format!(
            "fault {fault} is of view {missing}, but the cameras are views {}: correct --faults",
            views.join(", ")
        ))
    }

    /// The camera that sees an image; `None` until the view that it belongs to has been requested in this flight.
    pub(crate) fn camera_of(&self, drawn: &Drawn) -> Option<CameraPose> {
        let camera = if drawn.source == drawn.request.view {
            &drawn.request.camera
        } else {
            self.rig.get(&drawn.source)?
        };
        Some(drawn.aim.applied_to(camera))
    }

    /// The content to draw for a requested image.
    pub(crate) fn drawn_for(&mut self, request: &CaptureRequest) -> Drawn {
        let faults: Vec<CameraFaultKind> = (self.faults.iter())
            .filter(|fault| fault.view == request.view)
            .map(|fault| fault.kind)
            .collect();
        if faults.is_empty() {
            return Drawn::sound(request);
        }
        let seed = self.seed;
        let view = self.views.entry(request.view);
        view.or_insert_with(|| View::new(seed, request.view))
            .drawn_for(&faults, request)
    }
}

/// A view's images since the flight began.
#[derive(Debug)]
struct View {
    /// It goes on from flight to flight, so that flights differ.
    random: ChaCha12Rng,
    /// Phases of the shake along both axes, radians.
    phases: [[f64; SINUSOIDS.len()]; 2],
    /// Requests that a late image may still need, the oldest first.
    requested: VecDeque<CaptureRequest>,
    shown: Option<Drawn>,
}

impl View {
    fn new(seed: u64, view: u32) -> Self {
        let mut random = ChaCha12Rng::seed_from_u64(seed);
        // The network's faults draw from streams 1 and 2.
        random.set_stream((u64::from(view) + 1) << 32);
        let mut view = Self {
            random,
            phases: Default::default(),
            requested: VecDeque::new(),
            shown: None,
        };
        view.begin_flight();
        view
    }

    fn begin_flight(&mut self) {
        self.requested.clear();
        self.shown = None;
        for phase in self.phases.as_flattened_mut() {
            *phase = TAU * self.random.random::<f64>();
        }
    }

    fn drawn_for(&mut self, faults: &[CameraFaultKind], request: &CaptureRequest) -> Drawn {
        let last = self.requested.back();
        if last.is_some_and(|last| last.time_ns >= request.time_ns) {
            self.begin_flight();
        }
        self.requested.push_back(*request);
        let mut drawn = Drawn::sound(request);
        let mut sticks = false;
        for fault in faults {
            match *fault {
                CameraFaultKind::Late { by, after } => {
                    if request.time_ns >= nanoseconds(after) {
                        drawn.request = self.past(nanoseconds(by));
                    }
                }
                CameraFaultKind::Shakes {
                    rms_px,
                    frequency_hz,
                } => drawn.shift_px += self.shake_px(rms_px, frequency_hz, request.time_ns),
                CameraFaultKind::Aims { change, by, time } => {
                    drawn.aim.add(change, by, time, request.time_ns);
                }
                CameraFaultKind::Source(other) => drawn.source = other,
                CameraFaultKind::Sticks(share) => sticks |= self.random.random::<f64>() < share,
            }
        }
        let mut shown = self.shown.filter(|_| sticks).unwrap_or(drawn);
        shown.request.tick = request.tick;
        self.shown = Some(shown);
        shown
    }

    /// The latest request as of some time before it: on the cubic through the two requests before it and the two after it, as far as
    /// there are any. A straight line between requests two seconds apart would fly gusts in corners.
    fn past(&mut self, by_ns: i64) -> CaptureRequest {
        let latest = self.requested[self.requested.len() - 1];
        let time_ns = latest.time_ns - by_ns;
        while self.requested.len() > 2 && self.requested[2].time_ns <= time_ns {
            self.requested.pop_front();
        }
        let after = (self.requested).partition_point(|request| request.time_ns <= time_ns);
        let Some(before) = after.checked_sub(1) else {
            return CaptureRequest {
                time_ns,
                pose: out_of_sight(latest.pose),
                ..latest
            };
        };
        let around = before.saturating_sub(1)..self.requested.len().min(after + 2);
        let near: Vec<CaptureRequest> = self.requested.range(around).copied().collect();
        let before = self.requested[before];
        let on_curve = |of: fn(&Pose) -> f64| {
            interpolated(
                time_ns,
                near.iter().map(|near| (near.time_ns, of(&near.pose))),
            )
        };
        // Angles as differences, so that a full turn between two requests does not count.
        let angle = |of: fn(&Pose) -> f64| {
            let first_deg = of(&before.pose);
            let turned_deg =
                |near: &CaptureRequest| Degrees(of(&near.pose) - first_deg).wrapped_180().0;
            let turned = near.iter().map(|near| (near.time_ns, turned_deg(near)));
            first_deg + interpolated(time_ns, turned)
        };
        CaptureRequest {
            time_ns,
            pose: Pose {
                latitude_deg: on_curve(|pose| pose.latitude_deg),
                longitude_deg: angle(|pose| pose.longitude_deg),
                altitude_msl_m: on_curve(|pose| pose.altitude_msl_m),
                heading_true_deg: angle(|pose| pose.heading_true_deg),
                pitch_deg: on_curve(|pose| pose.pitch_deg),
                roll_deg: angle(|pose| pose.roll_deg),
            },
            controls: before.controls,
            ..latest
        }
    }

    /// Displacement by the shake, pixels.
    fn shake_px(&self, rms_px: f64, frequency_hz: f64, time_ns: i64) -> DVec2 {
        // A sinusoid of amplitude 1 has a mean square of 1/2.
        let amplitude_px = rms_px * (2.0 / SINUSOIDS.len() as f64).sqrt();
        let turns = frequency_hz * Duration::from_nanos(time_ns.unsigned_abs()).as_secs_f64();
        let axes = self.phases.map(|phases| {
            let sinusoids = SINUSOIDS.iter().zip(phases);
            let sum: f64 = sinusoids
                .map(|(relative, phase)| (TAU * turns * relative + phase).sin())
                .sum();
            amplitude_px * sum
        });
        axes.into()
    }
}

/// The value at a time of the polynomial through some values (Lagrange).
fn interpolated(time_ns: i64, values: impl Iterator<Item = (i64, f64)> + Clone) -> f64 {
    let part = |(of_ns, value): (i64, f64)| {
        let others = values.clone().filter(|(other_ns, _)| *other_ns != of_ns);
        let factors =
            others.map(|(other_ns, _)| (time_ns - other_ns) as f64 / (of_ns - other_ns) as f64);
        value * factors.product::<f64>()
    };
    values.clone().map(part).sum()
}

/// Nowhere in any image: on the other side of the Earth.
fn out_of_sight(pose: Pose) -> Pose {
    Pose {
        latitude_deg: -pose.latitude_deg,
        longitude_deg: Degrees(pose.longitude_deg + 180.0).wrapped_180().0,
        ..pose
    }
}

fn nanoseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// Turns a camera to the right in its image by a small angle, degrees.
fn turn_right(camera: &mut Pose, right_deg: f64) {
    let heading_deg = right_deg / camera.pitch_deg.to_radians().cos();
    camera.heading_true_deg = Degrees(camera.heading_true_deg + heading_deg)
        .wrapped_360()
        .0;
}

#[cfg(test)]
mod tests {
    use dataset::geometry::camera::CameraPose;
    use dataset::geometry::pose::Controls;
    use xplane_bridge::link::Deliver;

    use super::*;

    /// A request at one image every two seconds.
    fn request(view: u32, tick: u32) -> CaptureRequest {
        let at = f64::from(tick);
        let pose = Pose {
            latitude_deg: 1.0 + 0.001 * at,
            longitude_deg: 103.9,
            altitude_msl_m: 900.0 - 8.0 * at,
            heading_true_deg: (359.0 + at).rem_euclid(360.0),
            pitch_deg: 1.0,
            roll_deg: 0.0,
        };
        CaptureRequest {
            tick,
            time_ns: i64::from(tick) * 2_000_000_000,
            view,
            pose,
            controls: Controls::default(),
            camera: CameraPose {
                pose: Pose {
                    heading_true_deg: 203.0,
                    pitch_deg: 2.0,
                    ..pose
                },
                hfov_deg: 10.0,
            },
            width_px: 1000,
            height_px: 600,
            deliver: Deliver::Picture,
        }
    }

    fn cameras(faults: &str) -> FaultyCameras {
        FaultyCameras::new(&faults.parse::<Faults>().unwrap())
    }

    #[test]
    fn a_late_view_shows_the_aircraft_where_it_was_and_the_other_view_is_untouched() {
        let mut cameras = cameras("late=1:450");
        let before = cameras.drawn_for(&request(1, 0)).request;
        assert_eq!(before.pose.latitude_deg, -request(1, 0).pose.latitude_deg);
        assert_eq!(before.camera, request(1, 0).camera);
        let drawn = cameras.drawn_for(&request(1, 1)).request;
        assert_eq!(drawn.time_ns, 1_550_000_000);
        assert!((drawn.pose.altitude_msl_m - (900.0 - 8.0 * 0.775)).abs() < 1e-9);
        assert!((drawn.pose.heading_true_deg.rem_euclid(360.0) - 359.775).abs() < 1e-9);
        assert_eq!(drawn.camera.pose.heading_true_deg, 203.0);
        assert_eq!(cameras.drawn_for(&request(0, 1)).request, request(0, 1));
        // More than a tick late.
        let mut slow = self::cameras("late=0:3000");
        let drawn: Vec<_> = (0..5)
            .map(|tick| slow.drawn_for(&request(0, tick)).request)
            .collect();
        assert!((drawn[4].pose.altitude_msl_m - (900.0 - 8.0 * 2.5)).abs() < 1e-9);
        // On time at first.
        let mut later = self::cameras("late=0:3000:4");
        let times_ns = [1, 2].map(|tick| later.drawn_for(&request(0, tick)).request.time_ns);
        assert_eq!(times_ns, [2_000_000_000, 1_000_000_000]);
        // The next flight does not begin with the end of this one.
        slow.begin_flight();
        let drawn = slow.drawn_for(&request(0, 20)).request;
        assert_eq!(drawn.pose, out_of_sight(request(0, 20).pose));
    }

    #[test]
    fn between_requests_a_late_view_flies_the_curve_through_them() {
        let height_m = |second: f64| 900.0 + (second - 5.0).powi(3);
        let at = |tick: u32| {
            let mut request = request(0, tick);
            request.pose.altitude_msl_m = height_m(2.0 * f64::from(tick));
            request
        };
        // With a lag of more than a tick, two requests on both sides are known.
        let mut cameras = cameras("late=0:3000");
        let drawn: Vec<_> = (0..6)
            .map(|tick| cameras.drawn_for(&at(tick)).request)
            .collect();
        for (tick, drawn) in (0..).zip(&drawn).skip(3) {
            let expected_m = height_m(2.0 * f64::from(tick) - 3.0);
            assert!(
                (drawn.pose.altitude_msl_m - expected_m).abs() < 1e-6,
                "{tick}"
            );
        }
        // Of the latest tick, none after it.
        let mut cameras = self::cameras("late=0:500");
        let parabola = |tick: u32| {
            let mut request = request(0, tick);
            request.pose.altitude_msl_m = (2.0 * f64::from(tick)).powi(2);
            request
        };
        let drawn: Vec<_> = (0..4)
            .map(|tick| cameras.drawn_for(&parabola(tick)).request)
            .collect();
        assert!((drawn[3].pose.altitude_msl_m - 5.5_f64.powi(2)).abs() < 1e-9);
    }

    #[test]
    fn a_shaking_camera_has_the_stated_root_mean_square_along_both_axes_and_flights_differ() {
        let mut cameras = cameras("shake=0:2:1.1,seed=3");
        let mut flight = || -> Vec<DVec2> {
            let drawn: Vec<_> = (0..4_000)
                .map(|tick| cameras.drawn_for(&request(0, tick)))
                .collect();
            cameras.begin_flight();
            assert!(
                (0..)
                    .zip(&drawn)
                    .all(|(tick, drawn)| drawn.request == request(0, tick))
            );
            drawn.iter().map(|drawn| drawn.shift_px).collect()
        };
        let (first, second) = (flight(), flight());
        for axis in 0..2 {
            let squares: f64 = first.iter().map(|px| px[axis] * px[axis]).sum();
            let rms_px = (squares / first.len() as f64).sqrt();
            assert!((rms_px - 2.0).abs() < 0.1, "{rms_px}");
        }
        assert_ne!(first[0], second[0]);
    }

    #[test]
    fn a_fault_of_a_view_that_no_camera_has_is_named_from_the_second_tick_on() {
        let mut cameras = cameras("late=2:450");
        for (view, tick) in [(0, 5), (1, 5)] {
            assert_eq!(cameras.fault_of_no_view(&request(view, tick)), None);
        }
        let message = cameras.fault_of_no_view(&request(0, 6)).unwrap();
        let words =
            "fault late=2:450:0 is of view 2, but the cameras are views 0, 1: correct --faults";
        assert_eq!(message, words);
        let mut exchanged = self::cameras("source=1:2");
        assert_eq!(exchanged.fault_of_no_view(&request(1, 0)), None);
        let message = exchanged.fault_of_no_view(&request(1, 1)).unwrap();
        assert!(message.contains("source=1:2 is of view 2"), "{message}");
        // A rig of three has that view.
        cameras.begin_flight();
        for (view, tick) in [(0, 0), (1, 0), (2, 0), (0, 1)] {
            assert_eq!(cameras.fault_of_no_view(&request(view, tick)), None);
        }
    }

    #[test]
    fn a_sticking_camera_repeats_its_share_of_the_images() {
        let mut cameras = cameras("stick=0:0.04,seed=5");
        let drawn: Vec<_> = (0..5_000)
            .map(|tick| cameras.drawn_for(&request(0, tick)).request)
            .collect();
        let again = drawn
            .windows(2)
            .filter(|pair| pair[0].pose == pair[1].pose && pair[0].time_ns == pair[1].time_ns);
        let share = again.count() as f64 / 5_000.0;
        assert!((share - 0.04).abs() < 0.01, "{share}");
        assert!((0..).zip(&drawn).all(|(tick, drawn)| drawn.tick == tick));
    }

    #[test]
    fn each_change_of_aim_is_drawn_from_its_time_on_and_the_first_image_is_not_exempt() {
        let focal = |camera: CameraPose| 1.0 / (camera.hfov_deg.to_radians() / 2.0).tan();
        let sound = request(0, 0).camera;
        for (faults, tick, right_deg, down_deg, focal_ratio) in [
            ("turn=0:-0.3:120", 59, 0.0, 0.0, 1.0),
            ("turn=0:-0.3:120", 60, -0.3, 0.0, 1.0),
            ("turn=0:0.0026:0", 0, 0.0026, 0.0, 1.0),
            ("tilt=0:0.01:10", 4, 0.0, 0.0, 1.0),
            ("tilt=0:0.01:0,tilt=0:-0.03:0", 0, 0.0, -0.02, 1.0),
            ("zoom=0:0.02:0", 0, 0.0, 0.0, 1.0002),
            ("zoom=0:-0.5:0", 9, 0.0, 0.0, 0.995),
            ("drift=0:0.1:300", 0, 0.0, 0.0, 1.0),
            ("drift=0:0.1:300", 75, 0.05, 0.0, 1.0),
            ("drift=0:0.1:300", 300, 0.2, 0.0, 1.0),
        ] {
            let mut cameras = cameras(faults);
            let drawn = cameras.drawn_for(&request(0, tick));
            assert_eq!(drawn.request, request(0, tick), "{faults}");
            let camera = cameras.camera_of(&drawn).unwrap();
            let turned_deg = camera.pose.heading_true_deg - sound.pose.heading_true_deg;
            let turned_deg = turned_deg * sound.pose.pitch_deg.to_radians().cos();
            assert!((turned_deg - right_deg).abs() < 1e-9, "{faults}");
            let lowered_deg = sound.pose.pitch_deg - camera.pose.pitch_deg;
            assert!((lowered_deg - down_deg).abs() < 1e-9, "{faults}");
            let ratio = focal(camera) / focal(sound);
            assert!((ratio - focal_ratio).abs() < 1e-9, "{faults}: {ratio}");
        }
    }

    #[test]
    fn exchanged_views_show_what_the_other_camera_sees_as_soon_as_both_are_known() {
        let mut cameras = cameras("source=0:1,source=1:0,late=0:2000,turn=1:0.3:0");
        let of = |view: u32, tick| {
            let mut request = request(view, tick);
            request.camera.pose.heading_true_deg += 10.0 * f64::from(view);
            request
        };
        assert_eq!(cameras.fault_of_no_view(&of(0, 0)), None);
        let left = cameras.drawn_for(&of(0, 0));
        assert_eq!((left.source, cameras.camera_of(&left)), (1, None));
        assert_eq!(cameras.fault_of_no_view(&of(1, 0)), None);
        assert_eq!(cameras.camera_of(&left), Some(of(1, 0).camera));
        let right = cameras.drawn_for(&of(1, 0));
        let right = cameras.camera_of(&right).unwrap().pose.heading_true_deg;
        assert!((right - 203.3).abs() < 1e-3, "{right}");
        let left = cameras.drawn_for(&of(0, 1));
        assert_eq!(cameras.camera_of(&left), Some(of(1, 0).camera));
        assert_eq!(left.request.pose, of(0, 0).pose);
    }
}
