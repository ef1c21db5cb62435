use std::collections::BTreeSet;

use dataset::plan::Plan;

use super::*;
use crate::plan::expand;
use crate::plan::tests::sweep_of;
use crate::sweep::tests::SMALL;

fn plan_of(tables: &str) -> Plan {
    expand(&sweep_of(&format!("{SMALL}\n{tables}")))
}

/// The degradations of both cameras of each scenario.
fn degradations(plan: &Plan) -> Vec<[Degradation; 2]> {
    let of = |camera: &str, imaging: &BTreeMap<String, Imaging>| imaging[camera].degradation;
    (plan.scenarios.iter())
        .map(|scenario| {
            ["left", "right"].map(|camera| of(camera, &scenario.parameters.imaging).unwrap())
        })
        .collect()
}

#[test]
fn the_presets_are_sound() {
    assert_eq!(PRESETS.keys().collect::<Vec<_>>(), [&Preset::TowerCamera]);
    for values in PRESETS.values() {
        let table: ImagingTable = values.clone().try_into().unwrap();
        assert!(
            table
                .clone()
                .checked(values)
                .is_ok_and(|same| same == table)
        );
        let tables = format!("\n[imaging]\n{}", toml::to_string(values).unwrap());
        sweep_of(&format!(
            "{SMALL}{}",
            tables
                .replace("\n[", "\n[imaging.")
                .replacen("imaging.imaging", "imaging", 1)
        ));
    }
}

#[test]
fn a_tower_camera_has_values_of_its_own_in_the_air_of_its_scenario() {
    let plan = plan_of("[imaging]\npreset = \"tower-camera\"\n");
    let mut seeds = BTreeSet::new();
    for cameras in degradations(&plan) {
        let [left, right] = cameras.map(|camera| camera.seeing.unwrap());
        assert_eq!(left.tilt_rms_arcsec, 5.0);
        assert_eq!(left.correlation_s, None);
        let [left, right] = [left, right].map(|seeing| seeing.crosswind.unwrap());
        assert_eq!(left.wind_mps, right.wind_mps);
        assert_ne!(left.aperture_m, right.aperture_m);
        assert!((12.0..=96.0).contains(&left.knee_hz()), "{left:?}");
        let [a, b] = cameras;
        assert_ne!(a.sway, b.sway);
        assert_ne!(a.stream, b.stream);
        for camera in cameras {
            assert!((0.6..=0.9).contains(&camera.blur_sigma_px));
            let sway = camera.sway.unwrap();
            assert!((0.5..=2.0).contains(&sway.rms_px), "{sway:?}");
            assert!((0.5..=3.0).contains(&sway.frequency_hz), "{sway:?}");
            let sensor = camera.sensor.unwrap();
            assert!((5_000.0..=10_000.0).contains(&sensor.full_well_electrons));
            assert!(sensor.exposure_ev.abs() <= 0.33);
            let rate = camera.stream.unwrap().mbit_per_s;
            assert!((4.0..=8.0).contains(&rate), "{rate}");
            seeds.insert(camera.seed);
        }
    }
    assert_eq!(seeds.len(), 2 * plan.scenarios.len());
}

#[test]
fn keys_of_the_sweep_take_precedence_and_the_plan_has_the_values_that_apply() {
    let all = degradations(&plan_of("[imaging]\npreset = \"tower-camera\"\n"));
    let tables = "[imaging]\npreset = \"tower-camera\"\nrefraction_coefficient = 0.13\n[imaging.seeing]\ntilt_rms_arcsec = 2\ncorrelation_s = 0.2\n[imaging.sway]\nrms_px = 0\n[imaging.stream]\nmbit_per_s = 12\n";
    let plan = plan_of(tables);
    for (own, preset) in degradations(&plan).into_iter().zip(all) {
        for (own, preset) in own.into_iter().zip(preset) {
            let seeing = own.seeing.unwrap();
            assert_eq!(
                (
                    seeing.tilt_rms_arcsec,
                    seeing.correlation_s,
                    seeing.crosswind
                ),
                (2.0, Some(0.2), None)
            );
            assert_eq!(own.sway, None);
            assert_eq!(own.stream, Some(Stream { mbit_per_s: 12.0 }));
            // Unstated values are drawn as in the preset.
            let others = |of: Degradation| (of.blur_sigma_px, of.sensor, of.seed);
            assert_eq!(others(own), others(preset));
        }
    }
    let text = serde_json::to_string(&plan).unwrap();
    assert!(!text.contains("tower-camera") && text.contains("\"mbit_per_s\":12.0"));
    let imaging = &plan.scenarios[0].parameters.imaging["left"];
    assert_eq!(imaging.refraction_coefficient, 0.13);
    assert_eq!(serde_json::from_str::<Plan>(&text).unwrap(), plan);
}

#[test]
fn parts_of_a_preset_can_be_had_without_it() {
    let tables = "[imaging.seeing]\ntilt_rms_arcsec = 5\nwind_mps = 4\naperture_m = 0.04\n[imaging.sway]\nrms_px = 1\n";
    for [left, right] in degradations(&plan_of(tables)) {
        let knee_hz = left.seeing.unwrap().crosswind.unwrap().knee_hz();
        assert!((knee_hz - 30.0).abs() < 1e-9, "{knee_hz}");
        let sway = Sway {
            rms_px: 1.0,
            frequency_hz: 1.0,
        };
        assert_eq!(left.sway, Some(sway));
        assert_eq!((right.stream, right.sensor), (None, None));
    }
}
