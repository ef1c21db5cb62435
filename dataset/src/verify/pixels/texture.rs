//! The texture of whole pictures: noise, and blank pictures, have another one than the scene of a camera that stands still.

use super::Faults;
use super::sight::DecodedPicture;
use super::timing::median;

/// Rows and columns between the pixels that are compared with their right-hand neighbour.
const STEP: usize = 3;
/// A picture of noise is this many times as rough as the middle one of its view, and by this many grey levels ...
const MOST_TIMES: f64 = 4.0;
const LEAST_MORE: f64 = 6.0;
/// ... and a blank one has less than this part of its roughness, if that is measurable.
const LEAST_PART: f64 = 0.1;
const LEAST_ROUGHNESS: f64 = 0.3;
/// With fewer pictures there is no usual one.
const LEAST_PICTURES: usize = 3;

/// The mean difference between neighbouring pixels, grey levels.
pub(super) fn roughness(picture: &DecodedPicture) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u32);
    for (left, right) in picture.neighbours(STEP) {
        sum += (left - right).abs();
        count += 1;
    }
    sum / f64::from(count.max(1))
}

/// Reports the pictures that cannot be of the same scene as the others.
pub(super) fn judge(roughness: &[f64], file: &str, view: &str, faults: &mut Faults) {
    if roughness.len() < LEAST_PICTURES {
        return;
    }
    let Some(usual) = median(roughness.iter().copied()) else {
        return;
    };
    for (tick, found) in roughness.iter().enumerate() {
        let is_noise = *found > MOST_TIMES * usual && *found > usual + LEAST_MORE;
        let is_blank = usual >= LEAST_ROUGHNESS && *found < LEAST_PART * usual;
        if is_noise || is_blank {
            let message = format!(
                "neighbouring pixels differ by {found:.2} grey levels, in the middle picture of the view by {usual:.2}"
            );
            faults.view_row(view, file, tick, "another scene", message);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_and_a_blank_picture_stand_out_and_a_passing_cloud_does_not() {
        let rows = |roughness: &[f64]| -> Vec<Option<u64>> {
            let mut faults = Faults::of_scenario("0001");
            judge(roughness, "views/left.mp4", "left", &mut faults);
            let findings = faults.into_findings().into_iter();
            findings.map(|finding| finding.row).collect()
        };
        assert_eq!(rows(&[1.2, 1.3, 80.0, 1.1]), [Some(2)]);
        assert_eq!(rows(&[1.2, 0.0, 1.4]), [Some(1)]);
        assert_eq!(rows(&[1.2, 2.9, 1.3, 0.7]), []);
        // Fog is smooth, and so are all its pictures.
        assert_eq!(rows(&[0.2, 0.01, 0.2]), []);
        assert_eq!(rows(&[1.0, 80.0]), []);
    }
}
