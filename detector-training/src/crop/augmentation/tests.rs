use super::*;
use crate::crop::cover::Cover;
use crate::samples::training_picture::sky_with_bar;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const SIDE: usize = 64;

/// A crop with a bar in its middle, the cover of the bar, and its truth.
fn crop(darker_by: f64) -> (Vec<f32>, Vec<f32>, CropTruth) {
    let (picture, _) = sky_with_bar(darker_by);
    let piece = picture.piece(18, 0, SIDE, SIDE);
    let behind = sky_with_bar(0.0).0.piece(18, 0, SIDE, SIDE);
    let truth = piece.aircraft.unwrap();
    let cover = Cover::of(&piece, &behind, &truth.pixel_box);
    let cover = (0..SIDE * SIDE)
        .map(|i| cover.at(i % SIDE, i / SIDE))
        .collect();
    let pixels = piece.rgb.iter().map(|&v| f32::from(v) / 255.0).collect();
    (pixels, cover, truth)
}

/// All augmentations off and no plain crops; each test enables its own.
fn nothing() -> Augmentation {
    Augmentation {
        plain_share: 0.0,
        texture_share: 0.0,
        paint_share: 0.0,
        unlit_share: 0.0,
        cloud_edge_share: 0.0,
        gradient_share: 0.0,
        structure_share: 0.0,
        blur_share: 0.0,
        noise_share: 0.0,
        tint_share: 0.0,
        ..Augmentation::default()
    }
}

fn textured() -> Augmentation {
    Augmentation {
        texture_share: 1.0,
        texture_over_share: 0.0,
        ..nothing()
    }
}

#[test]
fn texture_lies_behind_the_aircraft_and_the_box_stays() {
    let (before, cover, truth) = crop(60.0);
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let (mut on, mut off) = (0.0, 0.0);
    for _ in 0..40 {
        let (mut pixels, mut after) = (before.clone(), truth);
        textured().apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
        assert_eq!(after.pixel_box, truth.pixel_box);
        let changed = |place: usize| (pixels[3 * place] - before[3 * place]).abs();
        on += changed(30 * SIDE + 32);
        off += changed(10 * SIDE + 32);
    }
    assert!(off > 40.0 * LEVEL && on < 0.3 * off, "{on} {off}");
}

#[test]
fn paint_changes_the_aircraft_alone_and_never_hides_it() {
    let painted = Augmentation {
        paint_share: 1.0,
        ..nothing()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(26);
    for darker_by in [15.0, 60.0] {
        let (before, cover, truth) = crop(darker_by);
        let mut on = 0.0_f32;
        for _ in 0..40 {
            let (mut pixels, mut after) = (before.clone(), truth);
            painted.apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
            assert!(after.visible);
            assert!(Strength::in_crop(&pixels, SIDE, &truth.pixel_box).stands_out());
            let changed = |place: usize| (pixels[3 * place] - before[3 * place]).abs();
            on = on.max(changed(30 * SIDE + 32));
            assert!(changed(10 * SIDE + 32) == 0.0);
        }
        assert!(on > 20.0 * LEVEL, "{on}");
    }
}

#[test]
fn without_lights_nothing_on_the_aircraft_is_brighter_than_its_sky_and_it_stays_visible() {
    let unlit = Augmentation {
        unlit_share: 1.0,
        ..nothing()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(27);
    let lamp = 3 * (30 * SIDE + 30)..3 * (30 * SIDE + 34);
    let (dark, cover, truth) = crop(60.0);
    let mut before = dark.clone();
    before[lamp.clone()].fill(1.0);
    let (mut pixels, mut after) = (before.clone(), truth);
    unlit.apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
    let sky = dark[3 * (23 * SIDE + 32)];
    assert!(pixels[lamp.clone()].iter().all(|&value| value < sky + 0.02));
    assert_eq!(pixels[..lamp.start], before[..lamp.start]);
    assert!(after.visible);

    // Against a sky of the aircraft's own colour only the lamps are visible: without them it would be hidden, so it is left as it is.
    let mut night = crop(0.0).0;
    night[lamp].fill(1.0);
    let mut pixels = night.clone();
    unlit.apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
    assert_eq!(pixels, night);
}

#[test]
fn an_aircraft_that_stays_visible_stands_out_from_its_texture() {
    let mut rng = ChaCha8Rng::seed_from_u64(22);
    for darker_by in [5.0, 15.0, 60.0] {
        let (before, cover, truth) = crop(darker_by);
        let mut visible = 0;
        for _ in 0..60 {
            let (mut pixels, mut after) = (before.clone(), truth);
            textured().apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
            let strength = Strength::in_crop(&pixels, SIDE, &truth.pixel_box);
            assert_eq!(after.visible, strength.stands_out(), "{strength:?}");
            visible += usize::from(after.visible);
        }
        assert!(
            visible > 40,
            "{visible} of 60 with a contrast of {darker_by}"
        );
    }
}

#[test]
fn an_aircraft_that_nothing_can_bring_out_is_not_asked_for() {
    let (before, _, truth) = crop(0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(23);
    let hidden = (0..40)
        .filter(|_| {
            let (mut pixels, mut after) = (before.clone(), truth);
            textured().apply(&mut pixels, SIDE, &[], Some(&mut after), &mut rng);
            !after.visible
        })
        .count();
    assert!(hidden > 30, "{hidden}");
}

#[test]
fn noise_blur_and_tint_are_as_strong_as_the_settings_allow() {
    let flat = vec![0.5; 3 * SIDE * SIDE];
    let rms = |a: &[f32]| {
        let mean = a.iter().sum::<f32>() / a.len() as f32;
        (a.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / a.len() as f32).sqrt()
    };
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    let noisy = Augmentation {
        noise_share: 1.0,
        ..nothing()
    };
    let mut largest = 0.0_f32;
    for _ in 0..60 {
        let mut pixels = flat.clone();
        noisy.apply(&mut pixels, SIDE, &[], None, &mut rng);
        largest = largest.max(rms(&pixels));
    }
    assert!((4.0 * LEVEL..5.3 * LEVEL).contains(&largest), "{largest}");

    let tinted = Augmentation {
        tint_share: 1.0,
        ..nothing()
    };
    let mut pixels = flat.clone();
    tinted.apply(&mut pixels, SIDE, &[], None, &mut rng);
    assert!(pixels.iter().all(|v| (v - 0.5).abs() <= 40.01 * LEVEL));
    assert!(pixels[..3] == pixels[3 * 100..][..3] && pixels[0] != pixels[1]);

    let mut point = vec![0.0; 3 * SIDE * SIDE];
    point[3 * (20 * SIDE + 30)] = 1.0;
    blur(&mut point, SIDE, 0.8);
    let spread: f32 = (0..SIDE)
        .map(|x| point[3 * (20 * SIDE + x)] * (x as f32 - 30.0).powi(2))
        .sum::<f32>()
        / (0..SIDE).map(|x| point[3 * (20 * SIDE + x)]).sum::<f32>();
    assert!((spread.sqrt() - 0.8).abs() < 0.05, "{}", spread.sqrt());
    assert!((point.iter().sum::<f32>() - 1.0).abs() < 1e-4);
}

#[test]
fn a_plain_crop_stays_as_it_is_and_the_same_seed_gives_the_same_crop() {
    let (before, cover, truth) = crop(30.0);
    let varied = |augmentation: &Augmentation| {
        let (mut pixels, mut after) = (before.clone(), truth);
        let mut rng = ChaCha8Rng::seed_from_u64(25);
        augmentation.apply(&mut pixels, SIDE, &cover, Some(&mut after), &mut rng);
        pixels
    };
    assert_eq!(varied(&Augmentation::none()), before);
    let all = Augmentation {
        plain_share: 0.0,
        texture_share: 1.0,
        ..Augmentation::default()
    };
    assert_eq!(varied(&all), varied(&all));
    assert_ne!(varied(&all), before);
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    Augmentation::default().check().unwrap();
    for (augmentation, setting) in [
        (
            Augmentation {
                blur_share: 1.5,
                ..Augmentation::default()
            },
            "blur_share",
        ),
        (
            Augmentation {
                largest_noise_levels: 256.0,
                ..Augmentation::default()
            },
            "largest_noise_levels",
        ),
        (
            Augmentation {
                largest_texture_levels: f32::NAN,
                ..Augmentation::default()
            },
            "largest_texture_levels",
        ),
    ] {
        let refusal = augmentation.check().unwrap_err().to_string();
        assert!(refusal.contains(setting), "{refusal}");
    }
}
