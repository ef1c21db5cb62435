//! Joins pieces of RTP packets to coded images without waiting for the next image.
//!
//! FFmpeg's parser ends an image when the next one begins, a whole frame later. Without it, pieces come as packets do: it
//! begins a unit (start code and header) or continues one, and all pieces of an image have the same timestamp. The end of an image is not
//! marked, but streams are regular: all images have the same number of slices, and the last piece is shorter than the largest of its kind.
//! This rule ends an image once it was right for [`PROVEN`] images in a row; otherwise the next timestamp does.

/// Codecs whose units are known here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum UnitCodec {
    H264,
    H265,
}

const START_CODE: [u8; 4] = [0, 0, 0, 1];
/// Images in a row for which the rule must have been right before it is used.
const PROVEN: u32 = 30;
/// Images without the rule after it was wrong while it was used.
const PENALTY: u32 = 3_000;
/// Bytes of the largest image that is joined: a sender whose timestamps stand still must not fill the memory.
const MAX_BYTES: usize = 16 << 20;

/// A coded image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AccessUnit {
    pub(crate) pts: i64,
    pub(crate) data: Vec<u8>,
    /// It was larger than the limit, and its rest is missing.
    pub(crate) is_cut: bool,
}

/// The current image, and statistics of earlier ones.
pub(crate) struct AccessUnits {
    codec: UnitCodec,
    pts: Option<i64>,
    data: Vec<u8>,
    is_cut: bool,
    pieces: u32,
    slices: u32,
    /// Number of pieces after which the rule ended this image.
    ended_after: Option<u32>,
    was_handed_over: bool,
    usual_slices: u32,
    /// Bytes of the largest piece that continues a unit, and of the largest that begins one.
    largest: [usize; 2],
    /// Images in a row for which the rule was right; negative: a penalty.
    proven: i64,
}

impl AccessUnits {
    pub(crate) fn new(codec: UnitCodec) -> Self {
        Self {
            codec,
            pts: None,
            data: Vec::new(),
            is_cut: false,
            pieces: 0,
            slices: 0,
            ended_after: None,
            was_handed_over: false,
            usual_slices: 0,
            largest: [0; 2],
            proven: 0,
        }
    }

    /// Takes a piece, and returns the images that are complete: one that ends before it, and one that ends with it.
    pub(crate) fn take(&mut self, pts: i64, piece: &[u8]) -> [Option<AccessUnit>; 2] {
        let before = (self.pts != Some(pts)).then(|| self.next(pts)).flatten();
        self.pieces = self.pieces.saturating_add(1);
        self.slices = (self.slices).saturating_add(u32::from(self.begins_slice(piece)));
        self.is_cut |= self.data.len() + piece.len() > MAX_BYTES;
        if !self.is_cut {
            self.data.extend_from_slice(piece);
        }
        let largest = &mut self.largest[usize::from(piece.starts_with(&START_CODE))];
        *largest = piece.len().max(*largest);
        let seems_whole =
            self.slices > 0 && self.slices == self.usual_slices && piece.len() < *largest;
        if seems_whole && self.ended_after.is_none() {
            self.ended_after = Some(self.pieces);
        }
        let is_whole = self.ended_after == Some(self.pieces);
        let now = (is_whole && self.proven >= i64::from(PROVEN)).then(|| self.hand_over(pts));
        [before, now.flatten()]
    }

    /// Ends the image before one with this timestamp.
    fn next(&mut self, pts: i64) -> Option<AccessUnit> {
        let before = self.pts.replace(pts)?;
        let was_right = self.ended_after == Some(self.pieces);
        self.proven = if was_right {
            self.proven + 1
        } else if self.was_handed_over {
            // It was cut in two.
            -i64::from(PENALTY)
        } else {
            self.proven.min(0)
        };
        self.usual_slices = self.slices;
        let rest = self.hand_over(before);
        (self.pieces, self.slices) = (0, 0);
        (self.ended_after, self.was_handed_over) = (None, false);
        rest
    }

    fn hand_over(&mut self, pts: i64) -> Option<AccessUnit> {
        self.was_handed_over = true;
        let data = std::mem::take(&mut self.data);
        let is_cut = std::mem::take(&mut self.is_cut);
        (!data.is_empty()).then_some(AccessUnit { pts, data, is_cut })
    }

    /// True if a piece begins a unit with coded pixels.
    fn begins_slice(&self, piece: &[u8]) -> bool {
        let Some(&header) = piece
            .strip_prefix(&START_CODE)
            .and_then(|unit| unit.first())
        else {
            return false;
        };
        match self.codec {
            UnitCodec::H264 => (1..=5).contains(&(header & 0x1f)),
            UnitCodec::H265 => (header >> 1 & 0x3f) < 32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A piece of `bytes` bytes that begins a unit.
    fn unit(kind: u8, bytes: usize) -> Vec<u8> {
        let mut piece = vec![0, 0, 0, 1, kind];
        piece.resize(bytes, 7);
        piece
    }

    /// Feeds a one-slice image in pieces; returns the number of pieces before it was handed over.
    fn image(units: &mut AccessUnits, pts: i64, sizes: &[usize]) -> Vec<(usize, AccessUnit)> {
        let mut done = Vec::new();
        for (index, &size) in sizes.iter().enumerate() {
            let piece = match index {
                0 => unit(5, size),
                _ => vec![7; size],
            };
            let handed = units.take(pts, &piece);
            done.extend(handed.into_iter().flatten().map(|unit| (index, unit)));
        }
        done
    }

    #[test]
    fn a_regular_stream_is_handed_over_with_its_last_piece() {
        let mut units = AccessUnits::new(UnitCodec::H264);
        let sizes = [1400, 1395, 300];
        for number in 0..40 {
            let done = image(&mut units, number, &sizes);
            for (piece, unit) in done {
                assert_eq!(unit.data.len(), 3095);
                let is_proven = unit.pts > i64::from(PROVEN);
                let expected = if is_proven {
                    (2, number)
                } else {
                    (0, number - 1)
                };
                assert_eq!((piece, unit.pts), expected, "image {number}");
            }
        }
    }

    #[test]
    fn a_stream_that_breaks_the_rule_waits_for_the_next_image_from_then_on() {
        let mut units = AccessUnits::new(UnitCodec::H264);
        for number in 0..40 {
            image(&mut units, number, &[1400, 1395, 300]);
        }
        let cut = image(&mut units, 40, &[1400, 1395, 300, 200]);
        assert_eq!(cut.len(), 1, "{cut:?}");
        let rest = image(&mut units, 41, &[1400, 1395, 300]);
        assert_eq!((rest[0].1.pts, rest[0].1.data.len()), (40, 200));
        let after = image(&mut units, 42, &[1400, 1395, 300]);
        assert_eq!(after.len(), 1);
        assert_eq!((after[0].0, after[0].1.pts), (0, 41));
    }

    #[test]
    fn timestamps_that_stand_still_fill_no_memory_and_the_image_is_cut() {
        let mut units = AccessUnits::new(UnitCodec::H264);
        let piece = vec![7; 1 << 20];
        units.take(1, &unit(5, 20));
        for _ in 0..40 {
            assert_eq!(units.take(1, &piece), [None, None]);
            assert!(units.data.len() <= MAX_BYTES);
        }
        let [cut, _] = units.take(2, &unit(5, 20));
        assert!(cut.unwrap().is_cut);
        let [whole, _] = units.take(3, &unit(5, 20));
        assert!(!whole.unwrap().is_cut);
    }

    #[test]
    fn parameter_sets_are_no_slices() {
        let units = AccessUnits::new(UnitCodec::H264);
        assert!(!units.begins_slice(&unit(7, 20)) && units.begins_slice(&unit(0x65, 20)));
        let units = AccessUnits::new(UnitCodec::H265);
        assert!(!units.begins_slice(&unit(32 << 1, 20)) && units.begins_slice(&unit(19 << 1, 20)));
    }
}
