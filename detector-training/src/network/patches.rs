//! Images cut into the disjoint patches that the network's first layer multiplies.
//!
//! Input: interleaved RGB, row-major, values 0 to 1. Output: one row per 4x4 patch, ordered by pixel row, pixel column, colour.

/// Patch side, px: the first layer's stride.
pub(crate) const PATCH_SIDE_PX: usize = 4;
/// Numbers in a patch.
pub(crate) const PATCH_VALUES: usize = PATCH_SIDE_PX * PATCH_SIDE_PX * 3;

/// A batch of equally sized images, as patches.
#[derive(Debug, Clone)]
pub struct PatchBatch {
    /// `[batch * (height / 4) * (width / 4), 48]`.
    pub values: Vec<f32>,
    /// Number of images.
    pub batch: usize,
    /// Image height, pixels.
    pub height_px: usize,
    /// Image width, pixels.
    pub width_px: usize,
}

impl PatchBatch {
    /// Black images. Sides must be multiples of [`PATCH_SIDE_PX`].
    pub fn new(batch: usize, height_px: usize, width_px: usize) -> Self {
        assert!(
            height_px.is_multiple_of(PATCH_SIDE_PX) && width_px.is_multiple_of(PATCH_SIDE_PX),
            "an image of {width_px}x{height_px} px cannot be cut into patches of {PATCH_SIDE_PX} px"
        );
        Self {
            values: vec![0.0; batch * height_px * width_px * 3],
            batch,
            height_px,
            width_px,
        }
    }

    /// Sets image `index` from `height * width * 3` values.
    pub fn fill(&mut self, index: usize, rgb: &[f32]) {
        let (height, width) = (self.height_px, self.width_px);
        assert_eq!(
            rgb.len(),
            height * width * 3,
            "an image of {width}x{height} px has three values a pixel"
        );
        let out = &mut self.values[index * rgb.len()..][..rgb.len()];
        let across = width / PATCH_SIDE_PX;
        let run = PATCH_SIDE_PX * 3;
        for y in 0..height {
            let line = &rgb[y * width * 3..][..width * 3];
            for (patch, pixels) in line.chunks_exact(run).enumerate() {
                let row = (y / PATCH_SIDE_PX) * across + patch;
                out[row * PATCH_VALUES + (y % PATCH_SIDE_PX) * run..][..run]
                    .copy_from_slice(pixels);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_lands_in_its_patch_at_its_place() {
        let mut batch = PatchBatch::new(2, 8, 12);
        let mut picture = vec![0.0; 8 * 12 * 3];
        let (x, y, colour) = (9, 6, 2);
        picture[(y * 12 + x) * 3 + colour] = 1.0;
        batch.fill(1, &picture);
        let patch = 6 + 3 + 2; // six patches of the first picture, then the second of two rows of three
        let place = (2 * PATCH_SIDE_PX + 1) * 3 + colour;
        let found: Vec<usize> = (0..batch.values.len())
            .filter(|&i| batch.values[i] == 1.0)
            .collect();
        assert_eq!(found, [patch * PATCH_VALUES + place]);
    }
}
