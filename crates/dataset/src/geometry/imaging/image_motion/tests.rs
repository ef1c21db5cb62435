use super::*;

const FOCAL_PX: f64 = 10_972.8;
/// Images of the periodograms: 120 s at 30 per second.
const SAMPLES: usize = 3_600;
const RATE_HZ: f64 = 30.0;

fn seeing(correlation_s: Option<f64>, crosswind: Option<Crosswind>) -> Seeing {
    Seeing {
        tilt_rms_arcsec: 8.0,
        blur_sigma_arcsec: 4.0,
        correlation_s,
        crosswind,
    }
}

/// A knee at 3 Hz: well within the band of 30 images per second.
const SLOW: Crosswind = Crosswind {
    wind_mps: 2.0,
    aperture_m: 0.2,
};

/// One-sided power spectral densities by Bartlett's average of periodograms with a Hann window, as the books compute them: `(hertz, power
/// per hertz)` for each frequency of the transform. Each series has a different seed.
fn periodogram(series: impl Iterator<Item = Vec<f64>>) -> Vec<(f64, f64)> {
    let hann: Vec<f64> = (0..SAMPLES)
        .map(|i| 0.5 - 0.5 * (TAU * i as f64 / SAMPLES as f64).cos())
        .collect();
    let power: f64 = hann.iter().map(|weight| weight * weight).sum();
    let table: Vec<(f64, f64)> = (0..SAMPLES)
        .map(|i| (TAU * i as f64 / SAMPLES as f64).sin_cos())
        .collect();
    let lines: Vec<usize> = (1..SAMPLES / 2).collect();
    let mut sums = vec![0.0; lines.len()];
    let mut count = 0.0;
    for values in series {
        count += 1.0;
        for (line, sum) in lines.iter().zip(&mut sums) {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for (i, (value, weight)) in values.iter().zip(&hann).enumerate() {
                let (sin, cos) = table[i * line % SAMPLES];
                real += value * weight * cos;
                imaginary -= value * weight * sin;
            }
            *sum += (real * real + imaginary * imaginary) * 2.0 / (power * RATE_HZ);
        }
    }
    let frequencies = lines
        .iter()
        .map(|line| *line as f64 * RATE_HZ / SAMPLES as f64);
    frequencies
        .zip(sums.iter().map(|sum| sum / count))
        .collect()
}

/// A motion along both axes.
fn sampled(at: impl Fn(f64) -> DVec2) -> [Vec<f64>; 2] {
    let places: Vec<DVec2> = (0..SAMPLES).map(|i| at(i as f64 / RATE_HZ)).collect();
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).collect())
}

/// Mean power density between two frequencies.
fn mean_between(spectrum: &[(f64, f64)], from_hz: f64, to_hz: f64) -> f64 {
    let inside: Vec<f64> = (spectrum.iter())
        .filter(|(frequency, _)| (from_hz..to_hz).contains(frequency))
        .map(|(_, power)| *power)
        .collect();
    inside.iter().sum::<f64>() / inside.len() as f64
}

#[test]
fn tilt_with_a_correlation_time_has_the_asked_rms_and_forgets_itself_in_the_asked_time() {
    let (mut square, mut product) = (DVec2::ZERO, DVec2::ZERO);
    let mut count = 0.0;
    for seed in 0..60 {
        let air = TiltMotion::new(&seeing(Some(0.2), None), FOCAL_PX, 1_000 + seed);
        for step in 0..50 {
            let time_s = f64::from(step) * 1.3;
            let (now, later) = (
                air.shift_px(10_000.0, time_s),
                air.shift_px(10_000.0, time_s + 0.2),
            );
            square += now * now;
            product += now * later;
            count += 1.0;
        }
    }
    let rms_arcsec = (square / count / 2.0).element_sum().sqrt() / FOCAL_PX / RADIANS_PER_ARCSEC;
    assert!((rms_arcsec / 8.0 - 1.0).abs() < 0.04, "{rms_arcsec}");
    let correlation = product.element_sum() / square.element_sum();
    assert!(
        (correlation - (-1.0_f64).exp()).abs() < 0.05,
        "{correlation}"
    );
}

#[test]
fn tilt_in_a_crosswind_has_the_spectrum_of_its_formula_up_to_the_knee_and_beyond() {
    let seeing = seeing(None, Some(SLOW));
    let tilts = (0..40).flat_map(|seed| {
        let air = TiltMotion::new(&seeing, FOCAL_PX, 500 + seed);
        sampled(|time_s| air.shift_px(10_000.0, time_s))
    });
    let spectrum = periodogram(tilts);
    // The variance fixes the height: 3 knee^(1/3) + 3/8 knee^(1/3) times it, by integration of both branches.
    let knee_hz: f64 = 0.3 * 2.0 / 0.2;
    let variance = (8.0 * FOCAL_PX * RADIANS_PER_ARCSEC).powi(2);
    let height = variance / (3.375 * knee_hz.cbrt());
    let formula = |frequency: f64| {
        let low = frequency.powf(-2.0 / 3.0);
        height * low * (frequency / knee_hz).max(1.0).powi(-3)
    };
    for (from_hz, to_hz) in [
        (0.05, 0.15),
        (0.15, 0.3),
        (0.3, 1.0),
        (1.0, 2.8),
        (3.3, 5.0),
        (5.0, 8.0),
    ] {
        let expected: Vec<(f64, f64)> = (spectrum.iter())
            .map(|(frequency, _)| (*frequency, formula(*frequency)))
            .collect();
        let ratio =
            mean_between(&spectrum, from_hz, to_hz) / mean_between(&expected, from_hz, to_hz);
        assert!(
            (0.8..1.25).contains(&ratio),
            "{ratio} times the formula from {from_hz} to {to_hz} Hz"
        );
    }
}

#[test]
fn tilt_in_a_crosswind_has_the_asked_rms_and_two_cameras_have_nothing_in_common() {
    let seeing = seeing(
        None,
        Some(Crosswind {
            wind_mps: 5.0,
            aperture_m: 0.025,
        }),
    );
    let (mut square, mut product) = (0.0, 0.0);
    for seed in 0..40 {
        let [left, right] =
            [7_000 + seed, 9_000 + seed].map(|seed| TiltMotion::new(&seeing, FOCAL_PX, seed));
        for step in 0..400 {
            let time_s = f64::from(step) * 0.7;
            let [a, b] = [&left, &right].map(|air| air.shift_px(10_000.0, time_s));
            square += (a.length_squared() + b.length_squared()) / 4.0;
            product += a.dot(b) / 2.0;
        }
    }
    let rms_arcsec = (square / 16_000.0).sqrt() / FOCAL_PX / RADIANS_PER_ARCSEC;
    assert!((rms_arcsec / 8.0 - 1.0).abs() < 0.04, "{rms_arcsec}");
    let correlation: f64 = product / square;
    assert!(correlation.abs() < 0.05, "{correlation}");
}

#[test]
fn tilt_grows_with_the_square_root_of_the_distance() {
    let air = TiltMotion::new(&seeing(Some(0.2), None), FOCAL_PX, 7);
    let ratio = air.shift_px(20_000.0, 3.0) / air.shift_px(5_000.0, 3.0);
    assert!(ratio.distance(DVec2::splat(2.0)) < 1e-9, "{ratio}");
}

#[test]
fn sway_has_the_asked_rms_and_its_power_at_the_asked_frequency() {
    let sway = Sway {
        rms_px: 1.3,
        frequency_hz: 1.7,
    };
    let series: Vec<Vec<f64>> = (0..40)
        .flat_map(|seed| {
            let mast = SwayMotion::new(&sway, seed);
            sampled(|time_s| mast.shift_px(time_s))
        })
        .collect();
    let squares: f64 = series.iter().flatten().map(|px| px * px).sum();
    let rms_px = (squares / (series.len() * SAMPLES) as f64).sqrt();
    assert!((rms_px / 1.3 - 1.0).abs() < 0.06, "{rms_px}");
    let spectrum = periodogram(series.into_iter());
    let (peak_hz, _) = spectrum.iter().fold(
        (0.0, 0.0),
        |most, line| {
            if line.1 > most.1 { *line } else { most }
        },
    );
    assert!((peak_hz - 1.7).abs() < 0.07, "{peak_hz}");
    // A quarter of the natural frequency off, a resonator with this damping has 0.7 % of the peak's density.
    let peak = mean_between(&spectrum, 1.65, 1.75);
    for off_hz in [-0.425, 0.425] {
        let ratio = mean_between(&spectrum, 1.65 + off_hz, 1.75 + off_hz) / peak;
        assert!(ratio < 0.02, "{ratio}");
    }
    // Gone at other frequencies.
    assert!(mean_between(&spectrum, 4.0, 12.0) / peak < 1e-4);
}
