use glam::DVec2;

use super::Ray;
use crate::geometry::camera::Camera;

/// Ranges of the points that define a line, metres.
const NEAR_M: f64 = 2_000.0;
const FAR_M: f64 = 30_000.0;

/// Seconds between distances from the line that tell a lag: errors of neighbouring images are alike.
pub const LAG_STEP_S: f64 = 0.95;
/// Standard deviation of distances from the line, pixels, and per pixel of the aircraft's width: its parts have other distances.
const SD_PX: f64 = 0.04;
const SD_PART: f64 = 0.003;

/// Standard deviation of the distance between an aircraft's registered places and the line, pixels. `width_px`: of the aircraft.
pub fn across_sd_px(width_px: f64) -> f64 {
    SD_PX.hypot(SD_PART * width_px)
}

/// The line in the second view where the first view's pixel must appear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpipolarLine {
    far_px: DVec2,
    /// Unit vector across it, downwards.
    pub across: DVec2,
}

impl EpipolarLine {
    /// `None` if the second camera cannot see along the line of sight, or sees it as a point.
    pub fn of([first, second]: [&Camera; 2], pixel: DVec2) -> Option<Self> {
        let ray = Ray::through(first, pixel);
        let at = |range_m: f64| second.project(ray.origin_m + range_m * ray.direction);
        let (near, far) = (at(NEAR_M)?, at(FAR_M)?);
        let along = (far - near).try_normalize()?;
        Some(Self {
            far_px: far,
            across: along.perp() * along.x.signum(),
        })
    }

    /// Distance of the second view's pixel from it, pixels.
    pub fn off_px(&self, pixel: DVec2) -> f64 {
        self.across.dot(pixel - self.far_px)
    }
}
