//! Complete scenarios against the stand-in, over real sockets: recorded, skipped, rejected.

mod small_corpus;

use std::fs;
use std::sync::Arc;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::Flight;
use generator::generate::{Event, SimulatorTarget};
use generator::plan::{Estimate, Pacing, expand};
use generator::progress::against::{Against, Standing};
use mock_xplane::server::{BuiltIn, Engine, SceneRenderer, SceneSetting};
use store::SPLIT_AGAIN;
use verify::verify;

use small_corpus::{
    IDS, folders, options, run, run_until, same_tables, sorted_ids, stand_in, stand_in_with,
    sweep_of, sweep_toml,
};

#[tokio::test(flavor = "multi_thread")]
async fn a_sweep_becomes_a_sound_corpus_and_a_second_run_has_nothing_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep_of(&sweep_toml());
    let target = stand_in().await;
    let made = run(&sweep, folder.path(), target.clone(), &[])
        .await
        .unwrap();
    assert_eq!(made.committed, IDS);
    assert_eq!(
        (made.failed.as_slice(), made.stopped),
        ([].as_slice(), None)
    );
    assert_eq!(folders(folder.path()), sorted_ids());

    let corpus = Corpus::open(folder.path()).unwrap();
    let report = verify(&corpus);
    assert!(report.is_sound(), "{:#?}", report.findings);
    assert_eq!(report.pictures, 2 * report.ticks);
    assert!(report.ticks > 4 * 20, "{} ticks", report.ticks);

    for scenario in corpus.scenarios().unwrap() {
        let scenario = scenario.open().unwrap();
        let (record, frames) = (scenario.record().unwrap(), scenario.frames().unwrap());
        let target = record.touchdown.lat_lon();
        let dtd = |row: usize| target.distance_m(frames.rows[row].pose.position().lat_lon());
        assert!(
            (1.89 * 1_852.0..2.11 * 1_852.0).contains(&dtd(0)),
            "{} starts at {} m",
            record.id,
            dtd(0)
        );
        assert!(
            dtd(frames.rows.len() - 1) < 300.0,
            "{} ends at {} m",
            record.id,
            dtd(frames.rows.len() - 1)
        );
        assert!(record.flight_touchdown.is_some());
    }

    let again = run(&sweep, folder.path(), target.clone(), &[])
        .await
        .unwrap();
    assert_eq!((again.committed.len(), again.skipped.len()), (0, 4));

    for name in Corpus::FILES {
        let path = folder.path().join(name);
        let good = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap();
        let mut split_lost = false;
        let all = options(target.clone(), &[]);
        let again = run_until(&sweep, folder.path(), &all, |event| {
            split_lost |= matches!(event, Event::Warned(SPLIT_AGAIN));
            false
        });
        assert_eq!(again.await.unwrap().skipped.len(), 4, "{name}");
        assert!(fs::read(&path).unwrap() == good, "{name}");
        assert_eq!(split_lost, name == Corpus::SPLITS, "{name}");
    }
}

/// A simulator that draws but does not fly.
struct OnlyDraws;

impl Engine for OnlyDraws {
    fn prepare(&self, scene: &SceneSetting<'_>) -> Box<dyn SceneRenderer> {
        BuiltIn.prepare(scene)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn computed_flights_are_only_shown_by_the_simulator_and_the_corpus_says_so() {
    let [one, other] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let live = sweep_toml();
    let computed = sweep_of(&live.replace("speed_mps = 72", "speed_mps = 72\nfly = \"computed\""));
    let (address, _) = stand_in_with(Arc::new(OnlyDraws)).await;
    let only_draws = SimulatorTarget::Address(address);
    let made = run(&computed, one.path(), only_draws.clone(), &[]).await;
    assert_eq!(made.unwrap().committed, IDS);
    let made = run(&computed, other.path(), stand_in().await, &[]).await;
    assert_eq!(made.unwrap().committed, IDS);
    same_tables(one.path(), other.path());

    let corpus = Corpus::open(one.path()).unwrap();
    let report = verify(&corpus);
    assert!(report.is_sound(), "{:#?}", report.findings);
    let model = flight_model::VERSION;
    let record = |id: &str| corpus.scenario(id).open().unwrap().record().unwrap();
    assert_eq!(record(IDS[0]).flight, Flight::Computed { model });
    assert_eq!(record(IDS[0]).trajectory, format!("computed-{}", IDS[0]));
    assert!(record(IDS[0]).flight_touchdown.is_some());
    assert!(matches!(record(IDS[1]).flight, Flight::Recorded { .. }));

    let error = run(&sweep_of(&live), one.path(), only_draws, &[]).await;
    let error = error.unwrap_err();
    assert!(error.is_bad_input(), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_corpus_takes_more_repeats_but_no_other_plan() {
    let folder = tempfile::tempdir().unwrap();
    let target = stand_in().await;
    let one = sweep_toml()
        .replace(
            "weathers = [\"clear\", \"foggy\"]\nrepeats = 2",
            "weathers = [\"clear\"]\nrepeats = 1",
        )
        .replace(
            "[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = [\"foggy\"]\n",
            "",
        );
    run(&sweep_of(&one), folder.path(), target.clone(), &[])
        .await
        .unwrap();
    let plan = fs::read(folder.path().join("plan.json")).unwrap();

    let other = sweep_of(&one.replace("visibility_m = 30000", "visibility_m = 20000"));
    let error = run(&other, folder.path(), target.clone(), &[])
        .await
        .unwrap_err();
    assert!(error.is_bad_input(), "{error}");
    assert!(
        error
            .to_string()
            .contains("visibility_m was 30000.0, now 20000.0"),
        "{error}"
    );
    assert_eq!(
        fs::read(folder.path().join("plan.json")).unwrap(),
        plan,
        "the frozen plan was touched"
    );

    let corpus = Corpus::open(folder.path()).unwrap();
    let changed = Against::compare(&expand(&other), &corpus).unwrap();
    assert_eq!(changed.standings[0], Standing::Changed);
    assert_eq!(
        changed.difference.changed[0].what,
        "parameters.conditions.weather.visibility_m was 30000.0, now 20000.0"
    );

    let more = sweep_of(&one.replace("repeats = 1", "repeats = 2"));
    let plan = expand(&more);
    let grown = Against::compare(&plan, &corpus).unwrap();
    assert_eq!(grown.standings, [Standing::Whole, Standing::New]);
    let scenario = corpus.scenarios().unwrap()[0].root().to_owned();
    for name in ["views/left.mp4", "frames.parquet", "DONE.json"] {
        let (path, away) = (scenario.join(name), folder.path().join("away"));
        fs::rename(&path, &away).unwrap();
        let damaged = Against::compare(&plan, &corpus).unwrap();
        assert_eq!(damaged.standings, [Standing::Damaged, Standing::New]);
        let what = &damaged.damaged["1200-clear-r1"];
        assert!(what.contains(name), "{name}: {what}");
        fs::rename(&away, &path).unwrap();
    }
    let video = scenario.join("views/right.mp4");
    let good = fs::read(&video).unwrap();
    fs::write(&video, &good[1..]).unwrap();
    let damaged = Against::compare(&plan, &corpus).unwrap();
    assert_eq!(damaged.standings, [Standing::Damaged, Standing::New]);
    fs::write(&video, &good).unwrap();
    let size = grown.size.unwrap();
    let record = corpus.scenarios().unwrap()[0]
        .open()
        .unwrap()
        .record()
        .unwrap();
    assert_eq!(
        (size.scenarios, size.pictures),
        (1, 2 * u64::from(record.ticks))
    );
    let estimate = Estimate::new(&plan.common, &plan.scenarios, &Pacing::StandIn, grown.size);
    let expected = size.bytes * estimate.pictures / size.pictures;
    assert!(estimate.bytes.unwrap().abs_diff(expected) <= 1);
    let outcome = run(&more, folder.path(), target, &["1200-clear-r2"])
        .await
        .unwrap();
    assert_eq!(
        (outcome.committed.as_slice(), outcome.skipped.len()),
        (&["1200-clear-r2".to_owned()][..], 0)
    );
    assert!(verify(&Corpus::open(folder.path()).unwrap()).is_sound());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_begin_is_said_at_once_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let sweep = sweep_of(&sweep_toml());
    fs::write(folder.path().join("thesis.tex"), "years of work").unwrap();
    for (only, words) in [
        (&["0099-nowhere"][..], "1200-clear-r1"),
        (&[], "contains thesis.tex"),
    ] {
        let error = run(&sweep, folder.path(), stand_in().await, only).await;
        let error = error.unwrap_err();
        assert!(
            error.is_bad_input() && error.to_string().contains(words),
            "{error}"
        );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
