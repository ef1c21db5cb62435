//! A decoded image as a Windows bitmap: browsers show it, its pixels are exact, and it costs only a copy.

use dataset::video::BYTES_PER_PIXEL;

/// Bytes before the pixels: the file's header and the image's.
const HEADER_BYTES: u32 = 14 + 40;
/// Rows begin at multiples of this.
const ROW_ALIGNMENT: usize = 4;

/// The file with these pixels: rows of RGB from top to bottom without gaps.
pub(crate) fn of_rgb(rgb: &[u8], [width_px, height_px]: [u32; 2]) -> Vec<u8> {
    let row_bytes = width_px as usize * BYTES_PER_PIXEL;
    let padded = row_bytes.next_multiple_of(ROW_ALIGNMENT);
    let pixel_bytes = (padded * height_px as usize) as u32;
    let mut file = Vec::with_capacity((HEADER_BYTES + pixel_bytes) as usize);
    file.extend_from_slice(b"BM");
    for number in [HEADER_BYTES + pixel_bytes, 0, HEADER_BYTES, 40, width_px] {
        file.extend_from_slice(&number.to_le_bytes());
    }
    // A negative height: rows from top to bottom.
    file.extend_from_slice(&(-i64::from(height_px) as i32).to_le_bytes());
    // One plane of 24 bits, not compressed.
    file.extend_from_slice(&[1, 0, 24, 0]);
    for number in [0, pixel_bytes, 0, 0, 0, 0] {
        file.extend_from_slice(&number.to_le_bytes());
    }
    for row in rgb.chunks_exact(row_bytes) {
        let begun = file.len();
        file.extend_from_slice(row);
        for pixel in file[begun..].chunks_exact_mut(BYTES_PER_PIXEL) {
            pixel.swap(0, 2);
        }
        file.resize(begun + padded, 0);
    }
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bitmap_has_its_size_in_front_and_its_rows_in_blue_green_red() {
        let file = of_rgb(&[1, 2, 3, 4, 5, 6], [1, 2]);
        assert_eq!(file.len(), 54 + 2 * 4);
        assert_eq!(file[2..6], 62_u32.to_le_bytes());
        assert_eq!(file[18..26], [1, 0, 0, 0, 254, 255, 255, 255]);
        assert_eq!(file[54..], [3, 2, 1, 0, 6, 5, 4, 0]);
    }
}
