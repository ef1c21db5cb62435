use super::*;
use crate::conditions::{CloudKind, CloudLayer};

fn storm() -> Weather {
    Weather {
        visibility_m: 20_000.0,
        clouds: vec![CloudLayer {
            kind: CloudKind::Cumulonimbus,
            cover_ratio: 0.9,
            base_msl_m: 600.0,
            top_msl_m: 5_000.0,
        }],
        rain_ratio: 0.6,
        wind_speed_mps: 10.0,
        wind_from_true_deg: 350.0,
        turbulence_ratio: 0.3,
    }
}

/// As X-Plane would report the storm, a little off everywhere.
fn right() -> EffectiveWeather {
    EffectiveWeather {
        visibility_m: Some(18_500.0),
        wind_speed_mps: Some(8.0),
        wind_from_true_deg: Some(5.0),
        rain_ratio: Some(0.5),
        cloud_cover_ratios: [Some(0.8), Some(0.0), Some(0.1)],
        differing: BTreeSet::new(),
    }
}

/// A wrong report of each quantity.
fn wrong() -> [(EffectiveQuantity, EffectiveWeather); 5] {
    let with = |change: fn(&mut EffectiveWeather)| {
        let mut weather = right();
        change(&mut weather);
        weather
    };
    [
        (
            EffectiveQuantity::Visibility,
            with(|w| w.visibility_m = Some(17_000.0)),
        ),
        (
            EffectiveQuantity::WindSpeed,
            with(|w| w.wind_speed_mps = Some(13.0)),
        ),
        (
            EffectiveQuantity::WindDirection,
            with(|w| w.wind_from_true_deg = Some(20.0)),
        ),
        (EffectiveQuantity::Rain, with(|w| w.rain_ratio = Some(0.0))),
        (
            EffectiveQuantity::CloudCover,
            with(|w| w.cloud_cover_ratios[2] = Some(0.5)),
        ),
    ]
}

#[test]
fn each_quantity_that_differs_is_found_alone_and_a_little_off_is_right() {
    assert_eq!(right().differences(&storm()), []);
    for (quantity, weather) in wrong() {
        let found = weather.differences(&storm());
        let quantities: Vec<_> = found.iter().map(|found| found.quantity).collect();
        assert_eq!(quantities, [quantity]);
    }
    // 10 m/s taken for knots.
    let in_knots = EffectiveWeather {
        wind_speed_mps: Some(5.1),
        ..right()
    };
    assert_eq!(in_knots.differences(&storm()).len(), 1);
    let no_number = EffectiveWeather {
        visibility_m: Some(f64::NAN),
        ..right()
    };
    assert_eq!(no_number.differences(&storm()).len(), 1);
}

#[test]
fn what_is_not_reported_is_missing_and_not_different() {
    let silent = EffectiveWeather::default();
    assert_eq!(silent.differences(&storm()), []);
    assert_eq!(silent.missing(&storm()).len(), EffectiveQuantity::ALL.len());
    assert_eq!(right().missing(&storm()), []);
}

#[test]
fn a_light_wind_has_no_direction_to_compare() {
    let breeze = Weather {
        wind_speed_mps: 2.0,
        ..storm()
    };
    let turned = EffectiveWeather {
        wind_speed_mps: Some(1.0),
        wind_from_true_deg: Some(180.0),
        ..right()
    };
    assert_eq!(turned.differences(&breeze), []);
}

#[test]
fn a_difference_says_what_was_reported_and_what_was_planned_with_units() {
    let said: Vec<String> = (wrong().iter())
        .map(|(_, weather)| weather.differences(&storm())[0].to_string())
        .collect();
    assert_eq!(
        said,
        [
            "visibility is 17000 m, planned was 20000 m",
            "wind speed is 13.0 m/s, planned was 10.0 m/s",
            "wind direction is 20 degrees, planned was 350 degrees",
            "rain is 0.00, planned was 0.60",
            "cloud cover is 0.50, planned was 0.00",
        ]
    );
}

#[test]
fn a_mark_without_a_difference_and_a_difference_without_a_mark_are_contradictions() {
    assert_eq!(right().contradiction(&storm()), None);
    for (quantity, mut weather) in wrong() {
        let unmarked = weather.contradiction(&storm()).unwrap();
        assert!(unmarked.contains("is not among `differing`"), "{unmarked}");
        weather.differing.insert(quantity);
        assert_eq!(weather.contradiction(&storm()), None);
        let groundless = EffectiveWeather {
            differing: [quantity].into(),
            ..right()
        };
        let groundless = groundless.contradiction(&storm()).unwrap();
        assert!(groundless.contains("is as planned"), "{groundless}");
    }
}

#[test]
fn a_mark_for_a_quantity_that_was_not_reported_is_no_contradiction() {
    let weather = EffectiveWeather {
        rain_ratio: None,
        differing: [EffectiveQuantity::Rain].into(),
        ..right()
    };
    assert_eq!(weather.contradiction(&storm()), None);
    let said = weather.marks(&storm())[0].to_string();
    assert_eq!(said, "rain is not reported, planned was 0.60");
}
