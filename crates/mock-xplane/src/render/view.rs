//! A camera in site coordinates: east, north and up of the runway's touchdown target. Ground, clouds and fixed lamps have their
//! positions in these coordinates, so that two cameras see the same world.
//!
//! With refraction, site coordinates are apparent positions, not true ones: rays stay straight, and distant objects are lifted
//! (`dataset::geometry::refraction`). Heights above the sea account for it; no other quantity has to.

use dataset::geometry::camera::Camera;
use dataset::geometry::refraction::lift_m;
use dataset::geometry::runway::Runway;
use glam::{DMat3, DVec2, DVec3};

/// Pixels between grid nodes.
pub(crate) const CELL_PX: usize = 8;
/// Radius of the earth for the drop of the ground below the tangent plane, metres. Off by less than 0.3 % in any direction, about
/// ten centimetres at the horizon.
const EARTH_RADIUS_M: f64 = 6.36e6;

/// A camera and the frame of the site around it.
#[derive(Debug, Clone)]
pub(crate) struct View {
    /// The camera itself, in ECEF, for apparent positions: without its own refraction.
    pub(crate) camera: Camera,
    /// The camera for true positions.
    true_camera: Camera,
    /// Coefficient of refraction: ratio of the curvature of light to the curvature of the earth.
    refraction: f64,
    /// Position of the camera: east, north, up of the touchdown target, metres.
    pub(crate) position_m: DVec3,
    /// Unit vector of the landing course (horizontal).
    pub(crate) course: DVec3,
    /// Threshold of the runway, metres before the touchdown target.
    pub(crate) threshold_before_target_m: f64,
    /// Height of the touchdown target above mean sea level, metres.
    pub(crate) ground_msl_m: f64,
    /// Rotation from ECEF to east, north, up.
    pub(crate) site_from_ecef: DMat3,
    origin_ecef_m: DVec3,
    site_from_camera: DMat3,
}

impl View {
    pub(crate) fn new(camera: &Camera, runway: &Runway) -> Self {
        let target = runway.touchdown_target();
        let ned = target.ecef_from_ned();
        let site_from_ecef = DMat3::from_cols(ned.y_axis, ned.x_axis, -ned.z_axis).transpose();
        let origin_ecef_m = target.to_ecef();
        let (sin, cos) = runway.course_true_deg.to_radians().sin_cos();
        Self {
            camera: Camera {
                refraction: None,
                ..*camera
            },
            true_camera: *camera,
            refraction: camera
                .refraction
                .map_or(0.0, |refraction| refraction.coefficient),
            position_m: site_from_ecef * (camera.center_ecef_m - origin_ecef_m),
            course: DVec3::new(sin, cos, 0.0),
            threshold_before_target_m: runway.touchdown_past_threshold_m,
            ground_msl_m: target.altitude_msl_m,
            site_from_ecef,
            origin_ecef_m,
            site_from_camera: site_from_ecef * camera.ecef_from_camera,
        }
    }

    /// Unit vector (east, north, up) through a pixel.
    pub(crate) fn ray(&self, pixel: DVec2) -> DVec3 {
        (self.site_from_camera * self.camera.image_of(pixel).extend(1.0)).normalize()
    }

    /// Apparent position in camera axes, metres.
    pub(crate) fn to_camera(&self, ecef_m: DVec3) -> DVec3 {
        self.true_camera.to_camera(ecef_m)
    }

    /// A point of the site (east, north, up, metres) in the image; `None` behind the camera.
    pub(crate) fn project(&self, site_m: DVec3) -> Option<DVec2> {
        self.camera
            .project(self.origin_ecef_m + self.site_from_ecef.transpose() * site_m)
    }

    /// Height above mean sea level at a site position, metres.
    pub(crate) fn height_msl_m(&self, site_m: DVec3) -> f64 {
        let flat = site_m.truncate();
        self.ground_msl_m + site_m.z + flat.length_squared() / (2.0 * EARTH_RADIUS_M)
            - self.lift_m(flat)
    }

    /// Apparent lift of objects there, metres.
    fn lift_m(&self, horizontal_m: DVec2) -> f64 {
        let distance_m = horizontal_m.distance(self.position_m.truncate());
        lift_m(self.refraction, distance_m)
    }

    /// The point of the site with this height above mean sea level, straight above or below `horizontal_m`.
    pub(crate) fn at_height(&self, horizontal_m: DVec2, height_msl_m: f64) -> DVec3 {
        let curved = horizontal_m.length_squared() / (2.0 * EARTH_RADIUS_M);
        horizontal_m.extend(height_msl_m - self.ground_msl_m - curved + self.lift_m(horizontal_m))
    }

    /// Distances along a ray from the camera to where it passes a height above mean sea level, nearest first.
    pub(crate) fn distances_to_height(&self, ray: DVec3, height_msl_m: f64) -> Option<[f64; 2]> {
        // Height along the ray is a quadratic: a s^2 + b s + c.
        let (position, flat) = (self.position_m.truncate(), ray.truncate());
        let a =
            flat.length_squared() / (2.0 * EARTH_RADIUS_M) - lift_m(self.refraction, flat.length());
        let b = ray.z + position.dot(flat) / EARTH_RADIUS_M;
        let c = self.height_msl_m(self.position_m) - height_msl_m;
        let discriminant = b * b - 4.0 * a * c;
        if discriminant < 0.0 || a == 0.0 {
            return None;
        }
        // The formula that avoids cancellation for near-horizontal rays.
        let q = -0.5 * (b + b.signum() * discriminant.sqrt());
        let (first, second) = (q / a, c / q);
        Some([first.min(second), first.max(second)])
    }

    /// Solid angle per pixel in the middle of the image, steradians.
    pub(crate) fn pixel_solid_angle_sr(&self) -> f64 {
        self.camera.focal_px.powi(-2)
    }

    /// Metres past the touchdown target along the course, and metres right of the course.
    pub(crate) fn along_and_right_m(&self, site_m: DVec3) -> (f64, f64) {
        let right = DVec3::new(self.course.y, -self.course.x, 0.0);
        (site_m.dot(self.course), site_m.dot(right))
    }

    /// The horizontal point this far past the touchdown target and right of the course.
    pub(crate) fn on_runway(&self, past_target_m: f64, right_m: f64) -> DVec2 {
        let right = DVec3::new(self.course.y, -self.course.x, 0.0);
        (self.course * past_target_m + right * right_m).truncate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dataset::geometry::distortion::Distortion;
    use dataset::geometry::imaging::Imaging;

    use crate::render::tests::{changi_02l, small_camera};

    #[test]
    fn a_site_point_projects_where_its_ray_came_from() {
        let view = View::new(&small_camera(0.0), &changi_02l());
        let pixel = DVec2::new(12.5, 40.25);
        let found = view
            .project(view.position_m + view.ray(pixel) * 5_000.0)
            .unwrap();
        assert!(found.abs_diff_eq(pixel, 1e-6), "{found}");
    }

    #[test]
    fn heights_along_a_ray_are_met_where_the_quadratic_says() {
        let view = View::new(&small_camera(0.0), &changi_02l());
        for elevation in [-0.01_f64, 0.0, 0.03] {
            let ray = DVec3::new(-0.4, -0.9, 0.0).normalize() * elevation.cos()
                + DVec3::Z * elevation.sin();
            let [_, far] = view.distances_to_height(ray, 900.0).unwrap();
            let height = view.height_msl_m(view.position_m + ray * far);
            assert!((height - 900.0).abs() < 1e-3, "{height}");
        }
    }

    /// A camera of ten degrees with a strong lens in air that bends light.
    fn bent_camera() -> Camera {
        small_camera(0.0).seen_through(&Imaging {
            distortion: Some(Distortion {
                k1: -300.0,
                p1: 0.5,
                ..Distortion::default()
            }),
            refraction_coefficient: 0.13,
            degradation: None,
        })
    }

    #[test]
    fn places_appear_in_the_site_where_the_camera_model_of_the_labels_projects_them() {
        let camera = bent_camera();
        let view = View::new(&camera, &changi_02l());
        for distance_m in [3_000.0, 9_000.0, 18_520.0] {
            let place = changi_02l()
                .point_on_approach(distance_m, 120.0)
                .at_altitude_m(500.0);
            let site = view.site_from_ecef * (place.to_ecef() - view.origin_ecef_m);
            let appears = view.at_height(site.truncate(), 500.0);
            let found = view.project(appears).unwrap();
            let expected = camera.project(place.to_ecef()).unwrap();
            assert!(found.distance(expected) < 0.15, "{found} {expected}");
            let [_, far] = view
                .distances_to_height((appears - view.position_m).normalize(), 500.0)
                .unwrap();
            let reached = view.position_m + (appears - view.position_m).normalize() * far;
            assert!(reached.distance(appears) < 0.5, "{reached} {appears}");
        }
    }

    #[test]
    fn the_horizon_dips_as_on_an_earth_that_bent_light_makes_larger() {
        for coefficient in [0.0, 0.13, 0.5] {
            let camera = small_camera(0.0).seen_through(&Imaging {
                refraction_coefficient: coefficient,
                ..Imaging::default()
            });
            let view = View::new(&camera, &changi_02l());
            let meets_sea = |elevation_rad: f64| {
                let ray = DVec3::new(-0.4, -0.9, 0.0).normalize() + DVec3::Z * elevation_rad;
                view.distances_to_height(ray.normalize(), 0.0)
                    .is_some_and(|[near_m, _]| near_m > 0.0)
            };
            let (mut below, mut above) = (-0.01, 0.005);
            for _ in 0..60 {
                let middle = (below + above) / 2.0;
                *(if meets_sea(middle) {
                    &mut below
                } else {
                    &mut above
                }) = middle;
            }
            let height_m = view.height_msl_m(view.position_m);
            // Relative to the camera's own horizontal, which differs from the touchdown target's.
            let tilt =
                view.position_m.dot(DVec3::new(-0.4, -0.9, 0.0).normalize()) / EARTH_RADIUS_M;
            let expected = -(2.0 * height_m * (1.0 - coefficient) / EARTH_RADIUS_M).sqrt() - tilt;
            assert!(
                (below - expected).abs() < 5e-6,
                "{below} {expected} at {coefficient}"
            );
        }
    }

    #[test]
    fn a_pixel_of_a_lens_sees_what_is_drawn_on_it() {
        let view = View::new(&bent_camera(), &changi_02l());
        for pixel in [
            DVec2::new(-0.5, 0.0),
            DVec2::new(319.5, 191.5),
            DVec2::new(12.5, 40.25),
        ] {
            let found = view
                .project(view.position_m + view.ray(pixel) * 5_000.0)
                .unwrap();
            assert!(found.abs_diff_eq(pixel, 1e-6), "{found}");
        }
    }

    #[test]
    fn site_heights_agree_with_the_ellipsoid() {
        let view = View::new(&small_camera(0.0), &changi_02l());
        let far = changi_02l()
            .point_on_approach(18_520.0, 0.0)
            .at_altitude_m(976.0);
        let site = view.site_from_ecef * (far.to_ecef() - view.origin_ecef_m);
        assert!(
            (view.height_msl_m(site) - 976.0).abs() < 0.3,
            "{}",
            view.height_msl_m(site)
        );
    }
}
