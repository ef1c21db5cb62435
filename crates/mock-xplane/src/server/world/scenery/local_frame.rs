use dataset::geometry::geodesy::Geodetic;
use glam::DVec3;

/// Local coordinates with one origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::server) struct LocalFrame {
    /// The point (0, 0, 0).
    pub(in crate::server) origin: Geodetic,
}

impl LocalFrame {
    /// Coordinates around a position: the origin is the centre of its one-degree square.
    pub(in crate::server) fn around(position: Geodetic) -> Self {
        Self {
            origin: Geodetic {
                latitude_deg: position.latitude_deg.floor() + 0.5,
                longitude_deg: position.longitude_deg.floor() + 0.5,
                altitude_msl_m: 0.0,
            },
        }
    }

    /// East, up, south, metres.
    pub(in crate::server) fn local(&self, position: Geodetic) -> DVec3 {
        let ned =
            self.origin.ecef_from_ned().transpose() * (position.to_ecef() - self.origin.to_ecef());
        DVec3::new(ned.y, -ned.z, -ned.x)
    }

    pub(in crate::server) fn world(&self, local: DVec3) -> Geodetic {
        let ned = DVec3::new(-local.z, local.x, -local.y);
        Geodetic::from_ecef(self.origin.to_ecef() + self.origin.ecef_from_ned() * ned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn east_up_and_south_are_positive_and_the_way_back_is_exact() {
        let position = Geodetic {
            latitude_deg: 1.4,
            longitude_deg: 103.6,
            altitude_msl_m: 1_000.0,
        };
        let frame = LocalFrame::around(position);
        let local = frame.local(position);
        assert!((local.x - 11_130.0).abs() < 20.0, "{local}");
        assert!((local.z - 11_058.0).abs() < 20.0, "{local}");
        // The earth falls away from the tangent plane by 19 m at 15.7 km.
        assert!((local.y - 981.0).abs() < 2.0, "{local}");
        let back = frame.world(local);
        assert!((back.latitude_deg - 1.4).abs() < 1e-12);
        assert!((back.longitude_deg - 103.6).abs() < 1e-12);
        assert!((back.altitude_msl_m - 1_000.0).abs() < 1e-6);
    }
}
