//! Style sheet colours as people with deficient colour vision see them (Machado, Oliveira and Fernandes 2009, severity 1).

use report_page::page::STYLE;

/// Linear RGB with normal vision, protanopia, deuteranopia and tritanopia.
const VISIONS: [(&str, [[f64; 3]; 3]); 4] = [
    (
        "normal",
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    ),
    (
        "protanopia",
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
    ),
    (
        "deuteranopia",
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
    ),
    (
        "tritanopia",
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ],
    ),
];
/// Linear RGB to CIE XYZ over the white of D65.
const XYZ: [[f64; 3]; 3] = [
    [0.4339, 0.3762, 0.1899],
    [0.2126, 0.7152, 0.0722],
    [0.0177, 0.1095, 0.8729],
];
/// Minimum CIE Lab distance at which adjacent lines can be distinguished.
const MIN_DISTANCE: f64 = 15.0;

fn times(matrix: &[[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum())
}

/// Linear RGB from the style sheet; `block` counts the definitions from the top: light, then dark.
fn colour(name: &str, block: usize) -> [f64; 3] {
    let start = format!("--{name}: ");
    let (at, _) = STYLE.match_indices(&start).nth(block).unwrap();
    let text = STYLE[at + start.len()..].split(';').next().unwrap();
    let bytes: Vec<u8> = match text.strip_prefix('#') {
        Some(digits) => (0..3)
            .map(|place| u8::from_str_radix(&digits[2 * place..2 * place + 2], 16).unwrap())
            .collect(),
        None => {
            let numbers = text.trim_start_matches("rgb(").trim_end_matches(')');
            numbers
                .split(',')
                .map(|part| part.parse().unwrap())
                .collect()
        }
    };
    [0, 1, 2].map(|channel| {
        let value = f64::from(bytes[channel]) / 255.0;
        if value <= 0.04045 {
            value / 12.92
        } else {
            ((value + 0.055) / 1.055).powf(2.4)
        }
    })
}

fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = times(&XYZ, rgb.map(|value| value.clamp(0.0, 1.0))).map(|value| {
        if value > 0.008856 {
            value.cbrt()
        } else {
            7.787 * value + 16.0 / 116.0
        }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[test]
fn series_and_steps_are_told_apart_with_any_colour_vision_on_light_and_on_dark_paper() {
    for (block, paper) in ["light", "dark"].into_iter().enumerate() {
        for (kind, count) in [("series", 6), ("step", 4)] {
            for (vision, matrix) in &VISIONS {
                let seen: Vec<_> = (0..count)
                    .map(|number| lab(times(matrix, colour(&format!("{kind}-{number}"), block))))
                    .collect();
                for (one, other) in (0..count).flat_map(|one| (0..one).map(move |two| (one, two))) {
                    let squares = seen[one].iter().zip(seen[other]);
                    let distance = squares.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                    assert!(
                        distance >= MIN_DISTANCE,
                        "{kind}-{one} and {kind}-{other} on {paper} paper, {vision}: {distance:.1}"
                    );
                }
            }
        }
    }
}
