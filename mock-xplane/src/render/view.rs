//! A camera seen from the site: east, north and up about the runway's touchdown target, the frame in which ground, clouds and
//! fixed lamps have their places, so that two cameras see the same world.

use dataset::camera::Camera;
use dataset::runway::Runway;
use glam::{DMat3, DVec2, DVec3};

/// Radius of the earth for the drop of the ground below the tangent plane, metres. Off by less than 0.3 % in any direction,
/// a hand's breadth at the horizon.
const EARTH_RADIUS_M: f64 = 6.36e6;

/// A camera and the frame of the site around it.
#[derive(Debug, Clone)]
pub(crate) struct View {
    /// The camera itself, in ECEF.
    pub(crate) camera: Camera,
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
            camera: *camera,
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
        let image = (pixel - self.camera.principal_px) / self.camera.focal_px;
        (self.site_from_camera * image.extend(1.0)).normalize()
    }

    /// A point of the site (east, north, up, metres) in the picture; `None` behind the camera.
    pub(crate) fn project(&self, site_m: DVec3) -> Option<DVec2> {
        self.camera
            .project(self.origin_ecef_m + self.site_from_ecef.transpose() * site_m)
    }

    /// Height above mean sea level of a point of the site, metres.
    pub(crate) fn height_msl_m(&self, site_m: DVec3) -> f64 {
        self.ground_msl_m + site_m.z + site_m.truncate().length_squared() / (2.0 * EARTH_RADIUS_M)
    }

    /// The point of the site with this height above mean sea level, straight above or below `horizontal_m`.
    pub(crate) fn at_height(&self, horizontal_m: DVec2, height_msl_m: f64) -> DVec3 {
        let curved = horizontal_m.length_squared() / (2.0 * EARTH_RADIUS_M);
        horizontal_m.extend(height_msl_m - self.ground_msl_m - curved)
    }

    /// Distances along a ray from the camera to where it passes a height above mean sea level, nearest first.
    pub(crate) fn distances_to_height(&self, ray: DVec3, height_msl_m: f64) -> Option<[f64; 2]> {
        // Height along the ray is a quadratic: a s^2 + b s + c.
        let (position, flat) = (self.position_m.truncate(), ray.truncate());
        let a = flat.length_squared() / (2.0 * EARTH_RADIUS_M);
        let b = ray.z + position.dot(flat) / EARTH_RADIUS_M;
        let c = self.height_msl_m(self.position_m) - height_msl_m;
        let discriminant = b * b - 4.0 * a * c;
        if discriminant < 0.0 || a == 0.0 {
            return None;
        }
        // The form that does not cancel for near-horizontal rays.
        let q = -0.5 * (b + b.signum() * discriminant.sqrt());
        let (first, second) = (q / a, c / q);
        Some([first.min(second), first.max(second)])
    }

    /// Solid angle of a pixel in the middle of the picture, steradians.
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
