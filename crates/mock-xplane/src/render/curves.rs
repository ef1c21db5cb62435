//! Small functions that shape light: smooth steps and tables on a logarithmic scale.

use glam::Vec3;

/// 0 below `from`, 1 above `to`, with zero slope at both.
pub(crate) fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Interpolates positive values geometrically in a table of (x, value) with increasing x; constant beyond its ends.
pub(crate) fn geometric_lookup(table: &[(f32, Vec3)], x: f32) -> Vec3 {
    let after = table.partition_point(|&(at, _)| at <= x);
    if after == 0 {
        return table[0].1;
    }
    if after == table.len() {
        return table[after - 1].1;
    }
    let ((x0, v0), (x1, v1)) = (table[after - 1], table[after]);
    let part = (x - x0) / (x1 - x0);
    (v0.map(f32::ln) * (1.0 - part) + v1.map(f32::ln) * part).map(f32::exp)
}

/// Relative luminance of a linear colour (BT.709 primaries).
pub(crate) fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometric_lookup_meets_its_nodes_and_the_geometric_mean_between() {
        let table = [(0.0, Vec3::splat(1.0)), (2.0, Vec3::splat(100.0))];
        assert!((geometric_lookup(&table, 1.0).x - 10.0).abs() < 1e-4);
        assert_eq!(geometric_lookup(&table, -5.0).x, 1.0);
        assert!((geometric_lookup(&table, 9.0).x - 100.0).abs() < 1e-4);
    }
}
