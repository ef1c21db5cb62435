//! A run that takes ticks one by one: the answers of a corpus that is predicted live, and their accuracy beside those of hindsight.

use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{NewTables, replace};
use dataset::numbers::units::METERS_PER_NAUTICAL_MILE;
use dataset::tables::columns::Table;
use dataset::work::watch::Silent;
use testkit::synthetic::{MODEL_HASH, SyntheticCorpus, model};
use trainer::live::{Answer, Candidate, Look, OnlineRun, SeenTick, SeenView};
use trainer::{Moment, RunFolder, predict, train};

mod hardly_trained;
use hardly_trained::hardly_trained;

fn trained(root: &Path) -> (Corpus, RunFolder) {
    let synthetic = SyntheticCorpus {
        shift_noise_px: Some(0.05),
        ..SyntheticCorpus::tiny()
    };
    let corpus = synthetic.write(&root.join("corpus")).unwrap();
    let run = train(&corpus, &root.join("run"), &hardly_trained(), &Silent);
    (corpus, run.unwrap().run)
}

/// The ticks of a scenario, with the boxes that count live.
fn ticks(corpus: &Corpus, scenario: &str, views: &[String]) -> Vec<SeenTick> {
    let scenario = corpus.scenario(scenario).open().unwrap();
    let boxes = scenario.detections(MODEL_HASH).unwrap().boxes;
    let registrations = scenario.registrations(MODEL_HASH).unwrap();
    let index_of = |view: &String| views.iter().position(|of| of == view);
    let rows = scenario.frames().unwrap().rows;
    let mut ticks: Vec<SeenTick> = (rows.iter())
        .map(|row| SeenTick {
            time_ns: row.time_ns,
            is_recorded: true,
            views: vec![
                SeenView {
                    look: Look::Placed,
                    ..SeenView::default()
                };
                views.len()
            ],
        })
        .collect();
    for found in boxes {
        if found.counts_live == Some(true) {
            let view = index_of(&found.view).unwrap();
            ticks[found.tick as usize].views[view]
                .boxes
                .push(Candidate {
                    pixel_box: found.pixel_box,
                    score: found.score,
                    track: found.track,
                });
        }
    }
    for found in registrations.unwrap_or_default() {
        let (view, reference) = (index_of(&found.view), index_of(&found.reference));
        let registered = reference.zip(found.result.ok());
        ticks[found.tick as usize].views[view.unwrap()].registration = registered;
    }
    ticks
}

/// Table column by scenario and tick.
fn column(table: &Table, name: &str) -> BTreeMap<(String, u32), Option<f64>> {
    let scenarios = table.text("scenario").unwrap().into_iter();
    let keys = scenarios.zip(table.u32("tick").unwrap());
    keys.zip(table.optional_f64(name).unwrap()).collect()
}

#[test]
fn a_run_fed_tick_by_tick_answers_what_a_corpus_predicted_live_has() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, run) = trained(folder.path());
    let out = folder.path().join("live.parquet");
    predict(&run, &corpus, None, &out, Moment::Live, &Silent).unwrap();
    let table = Table::read(&out, u64::MAX).unwrap();
    type Number = fn(&Answer) -> Option<f64>;
    let numbers: [(&str, Number); 6] = [
        ("dtd_m", |of| Some(of.dtd_m?.value)),
        ("dtd_m_sd", |of| of.dtd_m?.sd),
        ("dtd_m_from", |of| Some(of.dtd_m?.interval?[0])),
        ("dtd_m_to", |of| Some(of.dtd_m?.interval?[1])),
        ("ground_speed_mps", |of| Some(of.ground_speed_mps?.value)),
        ("time_to_touchdown_s", |of| {
            Some(of.time_to_touchdown_s?.value)
        }),
    ];
    let columns = numbers.map(|(name, number)| {
        (
            number,
            column(&table, &format!("inverse_range_filtered_{name}")),
        )
    });
    let mut answered = 0;
    for id in corpus.scenarios().unwrap().iter().map(|of| of.id()) {
        let mut online = OnlineRun::open(&run, Some("inverse_range_filtered")).unwrap();
        let views = online.views().to_vec();
        for (tick, seen) in (0..).zip(ticks(&corpus, &id, &views)) {
            let answers = online.take(&seen);
            for (number, column) in &columns {
                let found = answers.first().and_then(number);
                let expected = column[&(id.clone(), tick)];
                match (found, expected) {
                    (Some(found), Some(expected)) => {
                        answered += 1;
                        assert!((found - expected).abs() <= 1e-9, "{id} {tick}");
                    }
                    (found, expected) => assert_eq!(found, expected, "{id} {tick}"),
                }
            }
        }
    }
    assert!(answered > 3_000, "{answered}");
}

#[test]
fn live_answers_are_about_as_accurate_as_those_of_hindsight_and_have_no_smoother() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, run) = trained(folder.path());
    let table = |moment: Moment| {
        let out = folder.path().join(format!("{moment:?}.parquet"));
        predict(&run, &corpus, None, &out, moment, &Silent).unwrap();
        Table::read(&out, u64::MAX).unwrap()
    };
    let [hindsight, live] = [Moment::Hindsight, Moment::Live].map(table);
    let truth: BTreeMap<(String, u32), f64> = (corpus.scenarios().unwrap().iter())
        .flat_map(|folder| {
            let rows = folder.open().unwrap().frames().unwrap().rows;
            let id = folder.id();
            rows.into_iter()
                .filter(|row| row.labels.is_some_and(|labels| labels.along_track_m > 0.0))
                .map(move |row| ((id.clone(), row.tick), row.labels.unwrap().dtd_m))
        })
        .filter(|(_, dtd_m)| *dtd_m > METERS_PER_NAUTICAL_MILE)
        .collect();
    let judged = |table: &Table| -> (f64, f64) {
        let answers = column(table, "inverse_range_filtered_dtd_m");
        let errors: Vec<f64> = (truth.iter())
            .filter_map(|(key, dtd_m)| Some((answers[key]? - dtd_m).abs() / dtd_m * 100.0))
            .collect();
        let count = errors.len() as f64;
        (
            errors.iter().sum::<f64>() / count,
            count / truth.len() as f64,
        )
    };
    let ((before, covered), (after, covered_live)) = (judged(&hindsight), judged(&live));
    println!("hindsight {before:.4} % of {covered:.3}, live {after:.4} % of {covered_live:.3}");
    assert!(after < 1.3 * before + 0.02, "{before} % and live {after} %");
    assert!(
        covered_live > covered - 0.05,
        "{covered}, live {covered_live}"
    );
    let smoothed = column(&live, "inverse_range_smoothed_dtd_m");
    assert!(smoothed.values().all(Option::is_none));
}

#[test]
fn detections_of_an_earlier_version_and_estimators_that_look_ahead_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, run) = trained(folder.path());
    for name in [
        "inverse_range_smoothed",
        "triangulation",
        "no_vision_time_weather",
        "guess",
    ] {
        let refused = OnlineRun::open(&run, Some(name)).err().unwrap().to_string();
        assert!(refused.contains("inverse_range_filtered"), "{refused}");
    }
    let scenario = corpus.scenarios().unwrap().remove(0);
    let source = scenario.open().unwrap();
    let mut found = source.detections(MODEL_HASH).unwrap();
    for seen in &mut found.boxes {
        seen.counts_live = None;
    }
    let claim = scenario.claim().unwrap();
    let tables = NewTables::unregistered(&found);
    replace(&claim, &source, &model(), MODEL_HASH, tables, |made| made).unwrap();
    let out = folder.path().join("live.parquet");
    let refused = predict(&run, &corpus, None, &out, Moment::Live, &Silent).unwrap_err();
    let message = refused.to_string();
    assert!(message.contains("dtd detect --force"), "{message}");
    assert!(!out.exists());
}

#[test]
fn a_tick_with_an_earlier_time_counts_as_one_at_the_time_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let (corpus, run) = trained(folder.path());
    let mut online = OnlineRun::open(&run, Some("inverse_range_filtered")).unwrap();
    let views = online.views().to_vec();
    let scenario = corpus.scenarios().unwrap()[0].id();
    let ticks = ticks(&corpus, &scenario, &views);
    for tick in &ticks[..60] {
        online.take(tick);
    }
    let late = SeenTick {
        time_ns: ticks[10].time_ns,
        ..ticks[60].clone()
    };
    let answers = online.take(&late);
    let [earlier_s, last_s] = [50, 59].map(|tick| ticks[tick].time_ns as f64 * 1e-9);
    assert!((earlier_s..=last_s).contains(&answers[0].seen_s));
    let after = online.take(&ticks[61]);
    assert!(after[0].dtd_m.unwrap().value < answers[0].dtd_m.unwrap().value);
}
