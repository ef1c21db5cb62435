//! Flights whose views contradict each other.

use dataset::corpus::splits::Side;
use dataset::numbers::frame_rate::FrameRate;
use glam::DVec2;
use testkit::synthetic::SyntheticCorpus;

use super::*;
use crate::estimators::inverse_range::contradiction::Evidence;
use crate::samples::tests::fixtures::{registered_corpus, shift_of};
use crate::samples::trusted_boxes::centre_and_size;
use crate::samples::view_shift::ViewShift;
use crate::samples::{Look, Sample, Samples};

/// Fits and filter of seven flights, and two other flights in fog, with a tick every two seconds.
fn trained() -> (InverseRange, FlightFilter, Vec<Vec<Observation>>) {
    let corpus = SyntheticCorpus {
        train: 6,
        frame_rate: FrameRate {
            numerator: 1,
            denominator: 2,
        },
        miss_ratio: 0.0,
        ..registered_corpus(0.05)
    };
    let samples = Samples::synthetic(&corpus, 1.0);
    let true_boxes = samples.with_true_boxes();
    let fits = CrossFitted::fit(&samples, &true_boxes.iter().collect::<Vec<_>>());
    let flights = LabelledFlight::held_out(&fits, &samples, Clone::clone);
    let mut filter = FlightFilter::fit_to(&flights, fits.all.deviations());
    filter.kept = filter.kept_in(&fits.all, &flights);
    let in_fog = |sample: &Sample| {
        let mut observed = sample.observed.clone();
        observed.looks.fill(Look::Unplaced);
        observed
    };
    let tested = samples.flights_of_side(Side::Test);
    let tested = tested.map(|flight| flight.iter().map(in_fog).collect());
    (fits.all, filter, tested.collect())
}

/// A flight from the tick on at which both views see the aircraft.
fn whole(flight: &[Observation]) -> Vec<Observation> {
    let both = flight.iter().filter(|observed| observed.detections() == 2);
    both.cloned().collect()
}

/// A flight whose views show these views of flights, from the tick on at which both see an aircraft.
fn joined(sources: [(&[Observation], usize); 2]) -> Vec<Observation> {
    let [(first, _), (second, _)] = sources;
    let ticks = first.iter().zip(second).filter_map(|(one, other)| {
        let boxes = [*one.best(sources[0].1)?, *other.best(sources[1].1)?];
        let [from_px, to_px] = [0, 1].map(|view| centre_and_size(&boxes[view]).0);
        let shift = shift_of(from_px.to_array(), (to_px - from_px).to_array());
        let mut observed = one.clone();
        observed.show(boxes.map(Some));
        observed.shifts = vec![None, Some(ViewShift::of(0, &shift))];
        Some(observed)
    });
    ticks.collect()
}

/// Contradictions in a flight, with the number of ticks that have boxes before the first one and after it.
fn judged(
    (fits, filter, _): &(InverseRange, FlightFilter, Vec<Vec<Observation>>),
    flight: &[Observation],
) -> (Option<(Evidence, usize)>, usize) {
    let mut watch = ContradictionWatch::default();
    let found = flight.iter().enumerate().find_map(|(tick, observed)| {
        let measured = Tick::of(fits, observed);
        let found = filter.contradiction(&mut watch, fits, (observed, &measured))?;
        assert_eq!(found.withheld.views, [0, 1]);
        Some((found.withheld.cause.evidence, tick))
    });
    let followed = flight.iter().map(|observed| (Some(3), observed.clone()));
    let (kept, said) = filter.without_contradictions(fits, followed.collect());
    assert_eq!(
        said.first().map(|of| of.cause.evidence),
        found.map(|of| of.0)
    );
    (found, kept.iter().filter(|of| of.detections() > 0).count())
}

#[test]
fn views_that_do_not_show_what_the_training_saw_give_no_distance_within_twenty_seconds() {
    let trained = trained();
    let [one, other] = trained.2.as_slice() else {
        panic!()
    };
    for flight in [one, other] {
        let usual = whole(flight);
        assert_eq!(judged(&trained, &usual), (None, usual.len()));
    }
    let later = &one[4..];
    for (name, sources, evidence) in [
        ("exchanged", [(&one[..], 1), (one, 0)], Evidence::Closing),
        ("one twice", [(one, 0), (one, 0)], Evidence::Closing),
        ("other flight", [(one, 0), (other, 1)], Evidence::Rows),
        ("late", [(one, 0), (later, 1)], Evidence::Rows),
    ] {
        let (found, kept) = judged(&trained, &joined(sources));
        let (of, tick) = found.unwrap_or_else(|| panic!("{name}"));
        assert!(of == evidence && tick <= 11, "{name}: {of:?} {tick}");
        assert_eq!(kept, 0, "{name}");
    }
}

#[test]
fn a_camera_that_was_turned_sideways_in_fog_gives_no_distances() {
    let trained = trained();
    let flight = whole(&trained.2[0]);
    for off_px in [-20.0, 20.0] {
        let right = DVec2::new(off_px, 0.0);
        let turned = flight.iter().map(|observed| {
            let turned = |view, place_px| Some(place_px + f64::from(view == 1) * right);
            observed.moved(turned)
        });
        let mut turned: Vec<Observation> = turned.collect();
        let (found, kept) = judged(&trained, &turned);
        assert_eq!(found.map(|of| of.0), Some(Evidence::Paths));
        assert_eq!(kept, 0);
        // A visible background reveals turns, so this is another path.
        turned
            .iter_mut()
            .for_each(|observed| observed.looks.fill(Look::Placed));
        assert_eq!(judged(&trained, &turned), (None, turned.len()));
    }
}

#[test]
fn what_follows_a_contradiction_begins_anew_and_what_agreed_before_stays() {
    let trained = trained();
    let flight = whole(&trained.2[0]);
    let (fits, filter, _) = &trained;
    let mut exchanged = joined([(&trained.2[0], 1), (&trained.2[0], 0)]);
    let (from, to) = (30, 60);
    let mut mixed = flight.clone();
    mixed[from..to].swap_with_slice(&mut exchanged[from..to]);
    let followed = mixed.iter().map(|observed| (Some(3), observed.clone()));
    let (kept, _) = filter.without_contradictions(fits, followed.collect());
    let estimates = filter.predict(fits, &kept, Knowing::Past);
    let answered = |ticks: std::ops::Range<usize>| estimates[ticks].iter().flatten().count();
    // Most of a window of eleven ticks tells.
    assert!(answered(0..from) >= from - 5);
    assert_eq!(answered(from + 12..to), 0);
    assert!(answered(to + 12..kept.len()) >= kept.len() - to - 14);
}

#[test]
fn a_contradiction_begins_once_although_another_aircraft_is_followed_in_between() {
    let (fits, filter, flights) = trained();
    let exchanged = joined([(&flights[0], 1), (&flights[0], 0)]);
    let mut followed: Vec<_> = exchanged.iter().map(|of| (Some(3), of.clone())).collect();
    followed[25].0 = Some(7);
    let (kept, said) = filter.without_contradictions(&fits, followed);
    assert_eq!(said.len(), 1);
    let starts: Vec<usize> = (0..kept.len())
        .filter(|tick| kept[*tick].restarts)
        .collect();
    assert_eq!(starts, [0]);
}

#[test]
fn with_fewer_than_four_flights_the_training_says_what_it_does_not_watch() {
    let (fits, filter, _) = trained();
    assert_eq!(filter.kept.unwatched(&fits), None);
    let untrained = KeptInTraining::default();
    let line = untrained.unwatched(&fits).unwrap();
    assert!(line.contains("rows and paths"), "{line}");
    assert_eq!(untrained.unwatched(&fits.without(1)), None, "a single view");
}
