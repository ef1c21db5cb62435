//! Images for both benches: an approach at 10 nautical miles, drawn by the stand-in's renderer in full size, as the left camera
//! of the sweeps sees it.

use dataset::conditions::{Clock, CloudKind, CloudLayer, Weather};
use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::pose::{Controls, Pose};
use mock_xplane::render::Scene;
use testkit::changi_02l;

pub(crate) const WIDTH_PX: u32 = 1920;
pub(crate) const HEIGHT_PX: u32 = 1280;
/// Distance to touchdown at the first image.
pub(crate) const DTD_M: f64 = 18_520.0;
const SPEED_MPS: f64 = 82.0;
const PICTURES_PER_S: f64 = 30.0;
const LANDING: Controls = Controls {
    flap_ratio: 0.75,
    gear_ratio: 1.0,
};

pub(crate) struct Scenery {
    scene: Scene,
    camera: Camera,
}

pub(crate) fn clear() -> Weather {
    Weather {
        visibility_m: 80_000.0,
        clouds: Vec::new(),
        rain_ratio: 0.0,
        wind_speed_mps: 2.0,
        wind_from_true_deg: 20.0,
        turbulence_ratio: 0.0,
    }
}

pub(crate) fn cloudy() -> Weather {
    Weather {
        visibility_m: 50_000.0,
        clouds: vec![CloudLayer {
            kind: CloudKind::Cumulus,
            cover_ratio: 0.6,
            base_msl_m: 1_100.0,
            top_msl_m: 1_900.0,
        }],
        ..clear()
    }
}

impl Scenery {
    /// `local_h`: hours of the day at the airport, 8 hours ahead of UTC.
    pub(crate) fn new(weather: &Weather, local_h: f64) -> Self {
        let runway = changi_02l();
        let at = runway.point_on_approach(-1_500.0, -300.0);
        let pose = Pose {
            latitude_deg: at.latitude_deg,
            longitude_deg: at.longitude_deg,
            altitude_msl_m: runway.threshold.altitude_msl_m + 10.0,
            heading_true_deg: runway.course_true_deg + 180.0 - 5.3,
            pitch_deg: 1.6,
            roll_deg: 0.0,
        };
        let placed = CameraPose {
            pose,
            hfov_deg: 10.0,
        };
        let camera = Camera::from_pose(&placed, WIDTH_PX, HEIGHT_PX);
        let clock = Clock {
            day_of_year: 172,
            zulu_time_s: (local_h - 8.0).rem_euclid(24.0) * 3_600.0,
        };
        Self {
            scene: Scene::new(&camera, &runway, weather, &clock),
            camera,
        }
    }

    /// Place of the aircraft in image `number`: on the glide path.
    fn pose(number: u32) -> Pose {
        let runway = changi_02l();
        let to_go_m = DTD_M - f64::from(number) * SPEED_MPS / PICTURES_PER_S;
        let at = runway.point_on_approach(to_go_m, 0.0);
        Pose {
            latitude_deg: at.latitude_deg,
            longitude_deg: at.longitude_deg,
            altitude_msl_m: runway.threshold.altitude_msl_m
                + to_go_m * runway.glide_path_deg.to_radians().tan(),
            heading_true_deg: runway.course_true_deg,
            pitch_deg: 2.0,
            roll_deg: 0.0,
        }
    }

    pub(crate) fn picture(&self, number: u32) -> Vec<u8> {
        self.draw(&Self::pose(number), number)
    }

    /// The image without the aircraft.
    #[allow(dead_code, reason = "one of the two benches asks for it")]
    pub(crate) fn backdrop(&self, number: u32) -> Vec<u8> {
        let elsewhere = Pose {
            latitude_deg: 40.0,
            ..Self::pose(number)
        };
        self.draw(&elsewhere, number)
    }

    /// Column and row of the aircraft's centre of gravity.
    #[allow(dead_code, reason = "one of the two benches asks for it")]
    pub(crate) fn place_px(&self, number: u32) -> (f64, f64) {
        let point = Self::pose(number).position().to_ecef();
        let pixel = self
            .camera
            .project(point)
            .expect("the approach is in front of the camera");
        (pixel.x, pixel.y)
    }

    fn draw(&self, pose: &Pose, number: u32) -> Vec<u8> {
        let mut rgb = vec![0; WIDTH_PX as usize * HEIGHT_PX as usize * 3];
        let time_s = f64::from(number) / PICTURES_PER_S;
        self.scene.render(pose, &LANDING, time_s, &mut rgb);
        rgb
    }
}
