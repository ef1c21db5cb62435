//! Drawn aircraft with known shifts: no renderer, so that the truth is exact.

use dataset::tables::pixel_box::PixelBox;
use dataset::tables::registrations::{NoShift, Shift};
use dataset::video::PicturePart;
use glam::{DMat2, DVec2};

use super::patch::blurred;
use super::{ExpectedDifference, Patch, register};
use crate::detector::PictureView;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 200;

/// A drawn view's properties.
#[derive(Clone, Copy)]
struct Scene {
    at: DVec2,
    /// Size of the aircraft, 1 is 24 px wide.
    size: f64,
    /// Darkness of the aircraft, grey levels; 0 is an empty sky.
    contrast: f64,
    /// Brightness of two lamps below the wings, grey levels.
    lamps: f64,
    /// Standard deviation of the lens's blur, pixels.
    lens_px: f64,
    /// Standard deviation of the noise, grey levels.
    noise: f64,
    background: fn(DVec2) -> f64,
    shape: fn(DVec2) -> f64,
    seed: u64,
}

const SKY: Scene = Scene {
    at: DVec2::new(150.3, 95.7),
    size: 1.0,
    contrast: 60.0,
    lamps: 0.0,
    lens_px: 0.0,
    noise: 1.0,
    background: |_| 140.0,
    shape: airliner,
    seed: 1,
};

/// A wing, a fuselage and a fin, in units of the standard aircraft's pixels; smooth, so that it can be sampled anywhere.
fn airliner(p: DVec2) -> f64 {
    let blob = |at: DVec2, half: DVec2| (-0.5 * ((p - at) / half).length_squared()).exp();
    let wing = blob(DVec2::new(0.0, 0.5), DVec2::new(7.0, 0.9));
    let body = blob(DVec2::ZERO, DVec2::new(1.6, 1.6));
    let fin = blob(DVec2::new(0.0, -3.0), DVec2::new(0.7, 1.6));
    let engine = |x: f64| blob(DVec2::new(x, 1.4), DVec2::new(0.8, 0.8));
    (wing + body + fin + engine(-4.0) + engine(4.0)).min(1.3)
}

/// Something else of the same size: a slanted bar with a gap.
fn other(p: DVec2) -> f64 {
    let along = 0.8 * p.x + 0.6 * p.y;
    let across = 0.8 * p.y - 0.6 * p.x;
    let bar = (-0.5 * ((along / 6.0).powi(4) + (across / 1.0).powi(2))).exp();
    bar * if (along - 3.0).abs() < 2.0 { 0.0 } else { 1.0 }
}

/// Numbers that are normally distributed and depend on the seed and the place alone.
fn noise(seed: u64, index: u64) -> f64 {
    let mut sum = 0.0;
    let mut state =
        seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ index.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    for _ in 0..12 {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        sum += (mixed >> 11) as f64 / (1_u64 << 53) as f64;
    }
    sum - 6.0
}

impl Scene {
    fn box_around(&self) -> PixelBox {
        let (half_width, half_height) = (12.0 * self.size, 4.5 * self.size);
        PixelBox::from_edges(
            self.at.x - half_width,
            self.at.y - half_height,
            self.at.x + half_width,
            self.at.y + half_height,
        )
    }

    /// Draws an image part.
    fn draw(&self, part: PicturePart) -> Vec<u8> {
        // The lens mixes in the surroundings.
        let reach = (5.0 * self.lens_px).ceil() as u32;
        let drawn = |start: u32, length: u32, end: u32| {
            start.saturating_sub(reach)..(start + length + reach).min(end)
        };
        let rows = drawn(part.top_px, part.height_px, HEIGHT);
        let columns = drawn(part.left_px, part.width_px, WIDTH);
        let mut light = Vec::new();
        for row in rows.clone() {
            for column in columns.clone() {
                let pixel = DVec2::new(f64::from(column), f64::from(row));
                let p = (pixel - self.at) / self.size;
                let lamp = |x: f64| (-0.5 * (p - DVec2::new(x, 1.0)).length_squared()).exp();
                light.push(
                    (self.background)(pixel) - self.contrast * (self.shape)(p)
                        + self.lamps * (lamp(-2.0) + lamp(2.0)),
                );
            }
        }
        if self.lens_px > 0.0 {
            light = blurred(&light, columns.len(), self.lens_px);
        }
        let mut rgb = Vec::new();
        for row in part.top_px..part.top_px + part.height_px {
            let line = (row - rows.start) as usize * columns.len();
            for column in part.left_px..part.left_px + part.width_px {
                let light = light[line + (column - columns.start) as usize];
                let index = u64::from(row * WIDTH + column);
                for channel in 0..3 {
                    let noise = self.noise * noise(self.seed * 3 + channel, index);
                    rgb.push((light + noise).round().clamp(0.0, 255.0) as u8);
                }
            }
        }
        rgb
    }

    /// Surroundings with this box error.
    fn patch(&self, box_off: DVec2) -> Result<Patch, NoShift> {
        let mut pixel_box = self.box_around();
        pixel_box.cx_px += box_off.x;
        pixel_box.cy_px += box_off.y;
        let part = Patch::part_around(pixel_box, [WIDTH, HEIGHT])?;
        let pixels = PictureView {
            rgb: &self.draw(part),
            width_px: part.width_px,
            height_px: part.height_px,
        };
        Ok(Patch::of(&pixels, part, pixel_box))
    }
}

/// Registers two scenes whose boxes are off by so much.
fn compare(
    reference: Scene,
    view: Scene,
    expected: &ExpectedDifference,
    off: DVec2,
) -> Result<Shift, NoShift> {
    let (from, to) = (reference.patch(DVec2::new(0.4, -0.3))?, view.patch(off)?);
    register(&from, &to, expected)
}

fn same(reference: Scene, view: Scene) -> Result<Shift, NoShift> {
    compare(
        reference,
        view,
        &ExpectedDifference::SHIFT_ALONE,
        DVec2::new(-0.6, 0.5),
    )
}

fn error(reference: Scene, view: Scene, shift: &Shift) -> DVec2 {
    // Scale and rotation leave the centre of the aircraft where it is.
    DVec2::new(shift.dx_px, shift.dy_px) - (view.at - reference.at)
}

/// The same aircraft a few pixels away, with different noise.
fn moved(reference: Scene, by: DVec2) -> Scene {
    Scene {
        at: reference.at + by,
        seed: reference.seed + 1_000,
        ..reference
    }
}

/// Shifts with all subpixel positions.
fn shifts() -> impl Iterator<Item = DVec2> {
    (0..24).map(|k| {
        let k = f64::from(k);
        DVec2::new(-9.0 + 0.87 * k, 4.0 - 0.41 * k)
    })
}

fn root_mean_square(errors: &[DVec2]) -> DVec2 {
    let sum: DVec2 = errors.iter().map(|e| *e * *e).sum();
    (sum / errors.len() as f64).map(f64::sqrt)
}

/// Registers a scene with all shifts; returns the errors, and their ratios to the stated standard deviations.
fn errors_of(scene: Scene, change: impl Fn(Scene) -> Scene) -> (Vec<DVec2>, Vec<DVec2>) {
    let answers = (0..).zip(shifts()).map(|(k, by)| {
        let reference = Scene { seed: k, ..scene };
        let view = change(moved(reference, by));
        let shift =
            same(reference, view).unwrap_or_else(|reason| panic!("{reason} with a shift of {by}"));
        let error = error(reference, view, &shift);
        (error, error / DVec2::new(shift.sd_x_px, shift.sd_y_px))
    });
    answers.unzip()
}

#[test]
fn a_shift_is_measured_to_some_hundredths_of_a_pixel_and_the_deviation_is_honest() {
    for (noise, most_px) in [(0.0, 0.01), (1.0, 0.04), (3.0, 0.12)] {
        let (errors, scaled) = errors_of(Scene { noise, ..SKY }, |view| view);
        let rms = root_mean_square(&errors);
        assert!(rms.max_element() < most_px, "noise {noise}: {rms}");
        let scaled = root_mean_square(&scaled);
        assert!(scaled.max_element() < 1.5, "noise {noise}: {scaled}");
        assert!(
            noise < 2.0 || scaled.min_element() > 0.4,
            "noise {noise}: {scaled}"
        );
    }
}

#[test]
fn gradients_clouds_and_a_horizon_behind_the_aircraft_do_not_pull() {
    type Background = fn(DVec2) -> f64;
    let backgrounds: [(&str, Background, f64); 3] = [
        ("gradient", |p| 60.0 + 0.35 * p.x + 0.2 * p.y, 0.06),
        (
            "clouds",
            |p| 150.0 + 4.0 * (p.x / 19.0).sin() * (p.y / 13.0).cos(),
            0.12,
        ),
        ("horizon", |p| if p.y > 112.0 { 70.0 } else { 140.0 }, 0.2),
    ];
    for (name, background, most_px) in backgrounds {
        let (errors, _) = errors_of(Scene { background, ..SKY }, |view| view);
        let rms = root_mean_square(&errors);
        assert!(rms.max_element() < most_px, "{name}: {rms}");
    }
}

#[test]
fn exposure_and_noise_of_the_views_may_differ() {
    let (errors, _) = errors_of(SKY, |view| Scene {
        contrast: 0.5 * view.contrast,
        noise: 2.0,
        background: |_| 90.0,
        ..view
    });
    let rms = root_mean_square(&errors);
    assert!(rms.max_element() < 0.12, "{rms}");
}

#[test]
fn lamps_help_and_one_that_only_one_view_sees_hardly_pulls() {
    let lit = Scene {
        lamps: 300.0,
        background: |_| 20.0,
        contrast: 10.0,
        ..SKY
    };
    let (errors, _) = errors_of(lit, |view| view);
    assert!(root_mean_square(&errors).max_element() < 0.04);
    // The wing's lamp in the second view only.
    let (errors, _) = errors_of(SKY, |view| Scene {
        background: |p| {
            140.0 + 90.0 * (-0.5 * ((p - DVec2::new(170.0, 97.0)) / 1.2).length_squared()).exp()
        },
        ..view
    });
    let rms = root_mean_square(&errors);
    assert!(rms.max_element() < 0.2, "{rms}");
}

#[test]
fn scale_and_rotation_that_the_cameras_expect_are_taken_out() {
    let by = DVec2::new(5.3, -2.6);
    for size in [1.2, 1.04, 0.9, 0.8, 0.5] {
        let reference = Scene {
            // As large in coarser pixels.
            lens_px: 1.4,
            // Large enough for the coarsest pixels.
            size: if size < 0.8 { 3.0 } else { 1.0 },
            ..SKY
        };
        let other = Scene {
            size: size * reference.size,
            contrast: 0.8 * SKY.contrast,
            ..moved(reference, by)
        };
        let expected = ExpectedDifference {
            view_from_reference: DMat2::from_diagonal(DVec2::splat(size)),
            ..ExpectedDifference::SHIFT_ALONE
        };
        // With a box that is not centred on the aircraft, the followed point moves with the scale.
        let off = DVec2::new(0.4, -0.3) * (size - 1.0);
        let shift = compare(reference, other, &expected, DVec2::new(0.2, 0.5)).unwrap();
        let wrong = error(reference, other, &shift) - off;
        assert!(wrong.abs().max_element() < 0.05, "{shift:?}: {wrong}");
        let scaled = wrong / DVec2::new(shift.sd_x_px, shift.sd_y_px);
        assert!(scaled.abs().max_element() < 3.0, "{shift:?}: {scaled}");
    }
}

#[test]
fn a_box_that_is_off_by_several_pixels_gives_the_same_shift() {
    let view = moved(SKY, DVec2::new(7.4, 2.2));
    for off in [(0.0, 0.0), (5.0, -3.0), (-6.0, 4.0), (4.0, 5.0)] {
        let off = DVec2::from(off);
        let shift = compare(SKY, view, &ExpectedDifference::SHIFT_ALONE, off).unwrap();
        let wrong = error(SKY, view, &shift);
        assert!(wrong.abs().max_element() < 0.15, "off by {off}: {wrong}");
    }
}

#[test]
fn a_large_aircraft_is_looked_at_with_coarser_pixels() {
    let large = Scene {
        size: 9.0,
        at: DVec2::new(158.0, 98.0),
        ..SKY
    };
    let view = Scene {
        seed: 77,
        at: large.at + DVec2::new(-3.6, 1.7),
        ..large
    };
    assert_eq!(large.patch(DVec2::ZERO).unwrap().bin(), 2);
    let shift = same(large, view).unwrap();
    let wrong = error(large, view, &shift);
    assert!(wrong.abs().max_element() < 0.1, "{wrong}");
}

#[test]
fn there_is_no_answer_on_an_empty_sky_in_fog_at_the_edge_or_on_another_aircraft() {
    let answers = |reference: Scene, view: Scene| -> Vec<_> {
        let seeded = |k: u64, scene: Scene| Scene {
            seed: scene.seed + 31 * k,
            ..scene
        };
        (0..20)
            .map(|k| same(seeded(k, reference), seeded(k, view)))
            .filter_map(Result::ok)
            .collect()
    };
    let by = DVec2::new(2.3, -1.1);
    let empty = Scene {
        contrast: 0.0,
        ..SKY
    };
    let foggy = Scene {
        contrast: 0.4,
        ..SKY
    };
    let cloud = Scene {
        contrast: 0.0,
        background: |p| 120.0 + 20.0 * (p.x / 7.0).sin() * (p.y / 5.0).sin(),
        ..SKY
    };
    for (name, scene) in [("empty", empty), ("fog", foggy), ("cloud", cloud)] {
        assert_eq!(answers(scene, moved(scene, by)), [], "{name}");
        assert_eq!(answers(SKY, moved(scene, by)), [], "{name} in one view");
    }
    let another = Scene {
        shape: other,
        ..moved(SKY, by)
    };
    assert_eq!(answers(SKY, another), []);
    let reason = same(SKY, another).unwrap_err();
    assert!(
        [NoShift::Different, NoShift::Lost].contains(&reason),
        "{reason}"
    );
    let negative = Scene {
        contrast: -60.0,
        ..moved(SKY, by)
    };
    assert_eq!(answers(SKY, negative), []);
    let cut_off = Scene {
        at: DVec2::new(6.0, 95.0),
        ..SKY
    };
    assert_eq!(same(SKY, cut_off), Err(NoShift::Edge));
}
