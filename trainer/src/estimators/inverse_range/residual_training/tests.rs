//! Networks trained on shifts that follow the contrast.

use dataset::corpus::splits::Side;

use super::super::InverseRange;
use super::super::contrast_samples::{error, learned, samples, without_network};

#[test]
fn an_error_that_contrast_tells_is_learned_and_flights_that_a_network_did_not_see_gain_by_it() {
    let samples = samples(&[]);
    let (fits, record) = learned(&samples);
    println!("{record:?}");
    assert!(record.is_kept());
    assert!(record.corrected_mape_pct < 0.5 * record.formula_mape_pct);
    let plain = without_network(&fits.all);
    let [with, without] = [&fits.all, &plain].map(|fits| error(fits, &samples.of_side(Side::Test)));
    assert!(with < 0.5 * without, "{with} {without}");
    // Each network of a part is another one, of a formula that is another one.
    assert_eq!(fits.others.len(), 4);
    for others in fits.others.iter().flatten() {
        assert!(others.residual.is_some() && others.residual != fits.all.residual);
        let plain = without_network(others);
        let [with, without] =
            [others, &plain].map(|fits| error(fits, &samples.of_side(Side::Test)));
        assert!(with < 0.8 * without, "{with} {without}");
    }
}

#[test]
fn what_the_validation_side_contradicts_is_not_kept() {
    let samples = samples(&[Side::Validation]);
    let (fits, record) = learned(&samples);
    println!("{record:?}");
    assert!(!record.is_kept());
    assert!(
        fits.all.residual.is_none()
            && fits
                .others
                .iter()
                .flatten()
                .all(|fits| fits.residual.is_none())
    );
}

#[test]
fn a_registration_unlike_all_others_moves_the_distance_no_further_than_an_unusual_one() {
    let samples = samples(&[]);
    let (fits, _) = learned(&samples);
    let mut sample = samples.of_side(Side::Test)[5].clone();
    let formula_m = fits.all.formula(0, &sample).unwrap().distance_m;
    let residual = fits.all.residual.as_ref().unwrap();
    let mut corrected_m = |gain: f64| {
        for shift in sample.observed.shifts.iter_mut().flatten() {
            shift.gain = gain;
        }
        residual.corrected_m(&sample, formula_m)
    };
    let [usual, unusual, absurd] = [1.2, 30.0, 1e6].map(&mut corrected_m);
    assert_ne!(usual, unusual);
    assert_eq!(unusual, absurd);
    assert!(
        (absurd / formula_m - 1.0).abs() < 0.02,
        "{absurd} {formula_m}"
    );
    assert_eq!(corrected_m(-1.0), formula_m, "there is no such contrast");
}

#[test]
fn damaged_numbers_are_noticed() {
    let samples = samples(&[]);
    let (fits, _) = learned(&samples);
    assert!(fits.all.is_of(2));
    let damaged = |damage: &dyn Fn(&mut serde_json::Value)| {
        let mut numbers = serde_json::to_value(&fits.all).unwrap();
        damage(&mut numbers["residual"]);
        let read: InverseRange = serde_json::from_value(numbers).unwrap();
        read.is_of(2)
    };
    assert!(damaged(&|_| ()));
    assert!(!damaged(&|residual| residual["views"] = [2].into()));
    assert!(!damaged(
        &|residual| residual["usual"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"][0]["biases"] = Vec::<f64>::new().into()
    ));
    assert!(!damaged(
        &|residual| residual["layers"][1]["weights"] = [1.0].into()
    ));
}
