//! Tests: drawn patterns can be read again, at any position and after any degradation; an incomplete one is never accepted.

use super::*;

const CODES: [u32; 6] = [0, 1, 0xffff_ffff, 0x1234_5678, 0xdead_beef, 0x8000_0000];

#[test]
fn every_cell_is_black_once_and_white_once_in_a_code_and_its_companions() {
    for code in CODES {
        let bits = both_colours(code).map(bits_of);
        let all = (1 << BITS) - 1;
        assert_eq!(bits.into_iter().fold(0, |any, bits| any | bits), all);
        assert_eq!(bits.into_iter().fold(all, |each, bits| each & bits), 0);
    }
}

fn whole(width_px: u32, height_px: u32) -> Rectangle {
    Rectangle::between(0, 0, width_px, height_px)
}

/// A screen of vertical stripes in many colours with an image somewhere on it.
fn on_a_screen(window: &RgbPicture, at: (u32, u32), screen: (u32, u32)) -> RgbPicture {
    let mut picture = RgbPicture::black(screen.0, screen.1);
    for y in 0..screen.1 {
        for (x, pixel) in picture.pixels_mut(0, screen.0, y).iter_mut().enumerate() {
            *pixel = [x as u8, (x * 7) as u8, (x / 3) as u8];
        }
    }
    for y in 0..window.height_px {
        picture
            .pixels_mut(at.0, at.0 + window.width_px, at.1 + y)
            .copy_from_slice(window.pixels(0, window.width_px, y));
    }
    picture
}

/// Scales with blending of neighbours, as desktops do.
fn scaled(picture: &RgbPicture, factor: f64) -> RgbPicture {
    let size = |px: u32| (f64::from(px) * factor).round() as u32;
    let mut out = RgbPicture::black(size(picture.width_px), size(picture.height_px));
    let sample = |px: u32, of: u32| {
        let at = ((f64::from(px) + 0.5) / factor - 0.5).clamp(0.0, f64::from(of - 1));
        let low = at.floor() as u32;
        (low, (low + 1).min(of - 1), at.fract())
    };
    for y in 0..out.height_px {
        let (top, bottom, down) = sample(y, picture.height_px);
        for x in 0..out.width_px {
            let (left, right, along) = sample(x, picture.width_px);
            let pixel = |x: u32, y: u32| picture.pixels(x, x + 1, y)[0];
            let mixed = std::array::from_fn(|channel| {
                let mix = |a: [u8; 3], b: [u8; 3], part: f64| {
                    f64::from(a[channel]) * (1.0 - part) + f64::from(b[channel]) * part
                };
                let upper = mix(pixel(left, top), pixel(right, top), along);
                let lower = mix(pixel(left, bottom), pixel(right, bottom), along);
                (upper * (1.0 - down) + lower * down).round() as u8
            });
            out.pixels_mut(x, x + 1, y)[0] = mixed;
        }
    }
    out
}

#[test]
fn every_code_is_read_again_with_its_window_in_every_size() {
    for (width_px, height_px) in [MIN_WINDOW_PX, (96, 64), (101, 77), (1_920, 1_280)] {
        for code in CODES {
            let found = read(&draw(code, width_px, height_px));
            let rectangle = whole(width_px, height_px);
            assert_eq!(found, Ok(Sighting { code, rectangle }));
        }
    }
}

#[test]
fn a_window_is_found_to_the_pixel_on_a_busy_screen() {
    let window = draw(0xcafe_f00d, 200, 120);
    for (x, y) in [(0, 0), (37, 91), (200, 180)] {
        let found = read(&on_a_screen(&window, (x, y), (400, 300))).unwrap();
        assert_eq!(found.code, 0xcafe_f00d);
        assert_eq!(found.rectangle, Rectangle::between(x, y, x + 200, y + 120));
    }
}

#[test]
fn a_scaled_window_is_read_and_its_size_is_known_within_a_pixel() {
    for factor in [0.5, 0.8, 1.25, 1.5, 2.0] {
        for code in CODES {
            let window = scaled(&draw(code, 320, 240), factor);
            let found = read(&on_a_screen(&window, (20, 30), (700, 600))).unwrap();
            assert_eq!(found.code, code, "scaled by {factor}");
            let error_px = found.rectangle.width_px.abs_diff(window.width_px);
            assert!(error_px <= 2, "scaled by {factor}: {}", found.rectangle);
        }
    }
}

#[test]
fn noise_and_low_contrast_do_not_hide_the_code() {
    // A small deterministic generator: the noise is the same everywhere.
    let mut state = 1_u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as i32 % 61 - 30
    };
    for code in CODES {
        let mut picture = draw(code, 160, 120);
        for level in &mut picture.rgb {
            let faded = 20 + i32::from(*level) * 200 / 255;
            *level = (faded + noise()).clamp(0, 255) as u8;
        }
        assert_eq!(read(&picture).map(|found| found.code), Ok(code));
    }
}

#[test]
fn a_picture_torn_between_two_codes_is_no_code() {
    let (above, below) = (draw(0x0f0f_0f0f, 160, 120), draw(0xf0f0_f0f0, 160, 120));
    for torn_at in 25..95 {
        let mut torn = above.clone();
        for y in torn_at..120 {
            torn.pixels_mut(0, 160, y)
                .copy_from_slice(below.pixels(0, 160, y));
        }
        let found = read(&torn).map(|found| found.code);
        let whole = [Ok(0x0f0f_0f0f), Ok(0xf0f0_f0f0)].contains(&found);
        let damaged = found == Err(Unreadable::Damaged(Rectangle::between(0, 0, 160, 120)));
        assert!(whole || damaged, "torn at row {torn_at}: {found:?}");
    }
}

#[test]
fn a_covered_window_and_a_screen_without_one_are_told_apart() {
    let mut covered = draw(7, 160, 120);
    for y in 40..100 {
        covered.pixels_mut(100, 160, y).fill([90, 90, 90]);
    }
    assert!(matches!(read(&covered), Err(Unreadable::Covered(_))));
    let sky = on_a_screen(&RgbPicture::black(1, 1), (0, 0), (300, 200));
    assert_eq!(read(&sky), Err(Unreadable::Absent));
    assert_eq!(read(&RgbPicture::black(0, 0)), Err(Unreadable::Absent));
}

/// Python generates the golden file from the description: both sides must fill the same rectangles.
#[test]
fn the_pattern_is_the_golden_one_to_the_pixel() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/check_pattern.json");
    let text = std::fs::read_to_string(folder).unwrap();
    let golden: serde_json::Value = serde_json::from_str(&text).unwrap();
    let samples = golden["patterns"].as_array().unwrap();
    assert!(samples.len() >= 4);
    for sample in samples {
        let number = |key: &str| sample[key].as_u64().unwrap() as u32;
        let (width_px, height_px) = (number("width_px"), number("height_px"));
        let mut expected = RgbPicture::black(width_px, height_px);
        for filled in sample["fill"].as_array().unwrap() {
            let at = |key: &str| filled[key].as_u64().unwrap() as u32;
            let rgb = std::array::from_fn(|channel| filled["rgb"][channel].as_u64().unwrap() as u8);
            for y in at("top_px")..at("bottom_px") {
                expected
                    .pixels_mut(at("left_px"), at("right_px"), y)
                    .fill(rgb);
            }
        }
        let code = number("code");
        assert!(
            draw(code, width_px, height_px) == expected,
            "code {code}, {width_px}x{height_px}"
        );
        assert_eq!(read(&expected).map(|found| found.code), Ok(code));
    }
}
