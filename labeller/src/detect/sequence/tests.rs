use std::thread;
use std::time::Duration;

use dataset::corpus::Corpus;
use dataset::corpus::detections::{Detection, Detections};
use dataset::numbers::frame_rate::FrameRate;
use dataset::video::Luma;
use testkit::short_corpus;

use super::super::pictures::ViewTicks;
use super::super::view_search::{Finder, ViewFindings, search_view};
use super::*;
use crate::detector::PictureView;
use crate::tiling::find_aircraft;
use crate::tiling::tests::blob_finder::{BlobFinder, paint_blob, paint_grey_blob};

const WIDTH: u32 = 1280;
const HEIGHT: u32 = 768;
const LIVE: FrameRate = FrameRate {
    numerator: 30,
    denominator: 1,
};
const EACH_SECOND: FrameRate = FrameRate {
    numerator: 1,
    denominator: 1,
};

/// Left-most column and top-most row of a blob at a tick, if it is in the image.
type Path = fn(u32) -> Option<[u32; 2]>;

/// 24 x 8 pixels.
fn blob([left, top]: [u32; 2]) -> PixelBox {
    let [left, top] = [left, top].map(|edge| f64::from(edge) - 0.5);
    PixelBox::from_edges(left, top, left + 24.0, top + 8.0)
}

fn flight(root: &std::path::Path, rate: FrameRate, ticks: u32, paths: &[Path]) -> Corpus {
    let paint = |_: &str, tick: u32, rgb: &mut [u8]| {
        rgb.fill(20);
        for place in paths.iter().filter_map(|path| path(tick)) {
            paint_blob(rgb, WIDTH, &blob(place));
        }
    };
    short_corpus::write_flight(root, "0001-a", [WIDTH, HEIGHT], rate, ticks, &paint)
}

fn search(corpus: &Corpus, finder: &mut BlobFinder, mode: Mode) -> ViewFindings {
    let scenario = corpus.scenario("0001-a").open().unwrap();
    let view = ViewTicks::of(&scenario.frames().unwrap()).remove(0);
    let tiling = TilingSettings::default();
    let finder = Finder::Model {
        detector: finder,
        tiling: &tiling,
        mode,
    };
    search_view(&scenario, &view, finder, None, &mut |_| Ok(())).unwrap()
}

/// Search mode of each image: `f`ull, `t`racked or `s`caled; a capital if it has no box.
fn modes_of(findings: &ViewFindings, ticks: u32) -> String {
    let Detections { boxes, misses } = &findings.detections;
    let letter = |mode: SearchMode| mode.word().chars().next().unwrap();
    let of_tick = |tick: u32| {
        let found = boxes.iter().find(|found| found.tick == tick);
        let miss = misses.iter().find(|miss| miss.tick == tick);
        match (found, miss) {
            (Some(found), None) => letter(found.mode),
            (None, Some(miss)) => letter(miss.mode).to_ascii_uppercase(),
            (found, miss) => panic!("tick {tick} has {found:?} and {miss:?}"),
        }
    };
    (0..ticks).map(of_tick).collect()
}

#[test]
fn tracked_finds_the_boxes_of_full_in_a_fraction_of_the_windows() {
    let temporary = tempfile::tempdir().unwrap();
    let paths: [Path; 2] = [
        |tick| Some([100 + 2 * tick, 200]),
        |tick| Some([900 - 3 * tick, 500 + tick]),
    ];
    let corpus = flight(temporary.path(), LIVE, 45, &paths);
    for mut finder in [BlobFinder::default(), BlobFinder::of_any_size()] {
        let full = search(&corpus, &mut finder, Mode::Full);
        let first_windows = full.windows - 2 * 45;
        let tracked = search(&corpus, &mut finder, Mode::Tracked);
        assert_eq!(modes_of(&full, 45), "f".repeat(45));
        let once_a_second = format!("f{}f{}", "t".repeat(29), "t".repeat(14));
        assert_eq!(modes_of(&tracked, 45), once_a_second);
        assert_eq!(tracked.windows, 2 * 45 + first_windows * 2 / 45);
        let boxes = |findings: &ViewFindings| {
            let mut boxes: Vec<_> = findings.detections.boxes.clone();
            boxes.sort_by_key(|found| (found.tick, found.track));
            let row =
                |found: Detection| (found.tick, found.track, found.pixel_box, found.confirmed);
            boxes.into_iter().map(row).collect::<Vec<_>>()
        };
        assert_eq!(boxes(&tracked), boxes(&full));
        assert!(full.detections.boxes.iter().all(|found| found.confirmed));
    }
}

#[test]
fn an_aircraft_that_is_lost_is_looked_for_everywhere_at_once() {
    let temporary = tempfile::tempdir().unwrap();
    let jumps: Path = |tick| Some(if tick < 20 { [100, 200] } else { [900, 600] });
    let corpus = flight(temporary.path(), LIVE, 28, &[jumps]);
    let found = search(&corpus, &mut BlobFinder::default(), Mode::Tracked);
    let expected = format!("f{}f{}", "t".repeat(19), "t".repeat(7));
    assert_eq!(modes_of(&found, 28), expected);
    let tracks: Vec<_> = found
        .detections
        .boxes
        .iter()
        .map(|found| found.track)
        .collect();
    assert_eq!(tracks, [[Some(0)].repeat(20), [Some(1)].repeat(8)].concat());
}

#[test]
fn an_aircraft_that_is_gone_is_lost_and_an_empty_view_is_searched_at_the_period_only() {
    let temporary = tempfile::tempdir().unwrap();
    let goes: Path = |tick| (tick < 5).then_some([100 + tick, 200]);
    let corpus = flight(temporary.path(), LIVE, 100, &[goes]);
    let found = search(&corpus, &mut BlobFinder::default(), Mode::Auto);
    // The last whole-image search was less than a quarter of a second earlier.
    let expected: String = (0..100)
        .map(|tick| match (tick % 30, tick < 5) {
            (0, true) => 'f',
            (0, false) => 'F',
            (_, true) => 't',
            (_, false) => 'T',
        })
        .collect();
    assert_eq!(modes_of(&found, 100), expected);
    let reason = |tick: u32| {
        let misses = &found.detections.misses;
        misses.iter().find(|miss| miss.tick == tick).unwrap().reason
    };
    assert_eq!(reason(15), MissReason::Lost);
    assert_eq!(reason(30), MissReason::Nothing);
    assert_eq!(reason(99), MissReason::NotSearched);
}

#[test]
fn auto_searches_the_whole_picture_while_an_aircraft_moves_by_more_than_its_length() {
    let temporary = tempfile::tempdir().unwrap();
    let brakes: Path = |tick| {
        let fast = tick.min(8);
        Some([100 + 60 * fast + 4 * (tick - fast), 300])
    };
    let corpus = flight(temporary.path(), EACH_SECOND, 20, &[brakes]);
    let found = search(&corpus, &mut BlobFinder::default(), Mode::Auto);
    let modes = modes_of(&found, 20);
    assert!(modes.contains("tttt"), "{modes}");
    assert!(modes[..8].chars().all(|mode| mode == 'f'), "{modes}");
    assert!(found.detections.boxes.iter().all(|found| found.confirmed));
}

#[test]
fn at_one_picture_a_second_every_fifth_is_searched_whole_while_a_slow_aircraft_is_followed() {
    let temporary = tempfile::tempdir().unwrap();
    let slow: Path = |tick| Some([100 + 4 * tick, 300]);
    let corpus = flight(temporary.path(), EACH_SECOND, 16, &[slow]);
    let found = search(&corpus, &mut BlobFinder::default(), Mode::Auto);
    // After a single sighting the motion is unknown, and the aircraft is confirmed in the third image.
    assert_eq!(modes_of(&found, 16), "fffttttfttttfttt");
    assert!(found.detections.boxes.iter().all(|found| found.confirmed));
}

#[test]
fn scaled_searches_every_picture_once_in_one_window() {
    let temporary = tempfile::tempdir().unwrap();
    let still: Path = |_| Some([100, 200]);
    let corpus = flight(temporary.path(), LIVE, 5, &[still]);
    let found = search(&corpus, &mut BlobFinder::of_any_size(), Mode::Scaled);
    assert_eq!((modes_of(&found, 5), found.windows), ("sssss".into(), 5));
}

#[test]
fn the_time_of_a_search_is_told_apart_by_stage() {
    let temporary = tempfile::tempdir().unwrap();
    let still: Path = |_| Some([100, 200]);
    let corpus = flight(temporary.path(), LIVE, 5, &[still]);
    let cpu_s = search(&corpus, &mut BlobFinder::default(), Mode::Full).cpu_s;
    for part_s in [cpu_s.decode, cpu_s.convert, cpu_s.infer, cpu_s.rest] {
        assert!(part_s > 0.0, "{cpu_s:?}");
    }
}

#[test]
fn faint_boxes_count_where_clear_ones_confirm_their_track_and_are_dropped_elsewhere() {
    let temporary = tempfile::tempdir().unwrap();
    let (ticks, clear_ticks) = (20, 8..12);
    let aircraft = |tick: u32| blob([100 + 4 * tick, 200]);
    let paint = |_: &str, tick: u32, rgb: &mut [u8]| {
        rgb.fill(20);
        let grey = if clear_ticks.contains(&tick) {
            255
        } else {
            170
        };
        paint_grey_blob(rgb, WIDTH, &aircraft(tick), grey);
        paint_grey_blob(rgb, WIDTH, &blob([900, 600]), 170);
    };
    let size = [WIDTH, HEIGHT];
    let corpus =
        short_corpus::write_flight(temporary.path(), "0001-a", size, EACH_SECOND, ticks, &paint);
    for mode in [Mode::Full, Mode::Tracked] {
        let found = search(&corpus, &mut BlobFinder::of_any_size(), mode).detections;
        assert_eq!(found.misses, [], "{mode:?}");
        let seen: Vec<_> = found.boxes.iter().map(|seen| seen.tick).collect();
        assert_eq!(seen, (0..ticks).collect::<Vec<_>>(), "one box an image");
        for seen in &found.boxes {
            assert!(seen.confirmed, "{seen:?}");
            assert_eq!(seen.score < 0.4, !clear_ticks.contains(&seen.tick));
            assert!((seen.pixel_box.cx_px - aircraft(seen.tick).cx_px).abs() < 2.0);
        }
    }

    let faint_alone = tempfile::tempdir().unwrap();
    let paint = |_: &str, tick: u32, rgb: &mut [u8]| {
        rgb.fill(20);
        paint_grey_blob(rgb, WIDTH, &aircraft(tick), 170);
    };
    let corpus = short_corpus::write_flight(
        faint_alone.path(),
        "0001-a",
        size,
        EACH_SECOND,
        ticks,
        &paint,
    );
    let found = search(&corpus, &mut BlobFinder::of_any_size(), Mode::Full).detections;
    assert_eq!(found.boxes, []);
    let missed: Vec<_> = found.misses.iter().map(|miss| miss.tick).collect();
    assert_eq!(missed, (0..ticks).collect::<Vec<_>>());
    let mut reasons = found.misses.iter().map(|miss| miss.reason);
    assert!(reasons.all(|reason| reason == MissReason::Refuted));

    let mut rgb = vec![0; (WIDTH * HEIGHT * 3) as usize];
    paint("", 0, &mut rgb);
    let picture = PictureView {
        rgb: &rgb,
        width_px: WIDTH,
        height_px: HEIGHT,
    };
    let mut finder = BlobFinder::of_any_size();
    let alone = find_aircraft(&mut finder, &picture, &TilingSettings::default()).unwrap();
    assert!(alone.is_empty(), "an image by itself confirms nothing");
}

/// A finder for which a whole image takes 60 ms.
struct SlowFinder(BlobFinder);

impl Detector for SlowFinder {
    fn window_size(&self) -> WindowSize {
        self.0.window_size()
    }

    fn detect(
        &mut self,
        picture: &PictureView<'_>,
        windows: &[Window],
        score_floor: f64,
    ) -> Result<Vec<Vec<ScoredBox>>> {
        let pixels: u32 = windows.iter().map(|of| of.width_px * of.height_px).sum();
        let part = f64::from(pixels) / f64::from(WIDTH * HEIGHT);
        thread::sleep(Duration::from_secs_f64(0.06 * part));
        self.0.detect(picture, windows, score_floor)
    }

    fn first_pass_shrink(&self) -> u32 {
        self.0.first_pass_shrink()
    }

    fn description(&self) -> String {
        self.0.description()
    }
}

/// An image in memory.
struct Drawn(Vec<u8>, Vec<u8>);

impl Image for Drawn {
    fn size_px(&self) -> [u32; 2] {
        [WIDTH, HEIGHT]
    }

    fn whole(&mut self) -> Result<PictureView<'_>> {
        Ok(PictureView {
            rgb: &self.0,
            width_px: WIDTH,
            height_px: HEIGHT,
        })
    }

    fn part(&mut self, part: PicturePart) -> Result<PictureView<'_>> {
        let row = |row: u32| {
            let from = 3 * (row * WIDTH + part.left_px) as usize;
            &self.0[from..from + 3 * part.width_px as usize]
        };
        self.1 = (part.top_px..part.top_px + part.height_px)
            .flat_map(row)
            .copied()
            .collect();
        Ok(PictureView {
            rgb: &self.1,
            width_px: part.width_px,
            height_px: part.height_px,
        })
    }

    fn lumas(&self) -> [Option<Luma<'_>>; 2] {
        [None, None]
    }
}

#[test]
fn strips_find_what_enters_and_what_is_lost_and_no_later_image_is_searched_whole() {
    let mut sequence = Sequence::new(TilingSettings::default(), Mode::Auto, None).spread();
    let mut finder = SlowFinder(BlobFinder::of_any_size());
    let mut found = Vec::new();
    for tick in 0..150 {
        let mut image = Drawn(vec![20; (WIDTH * HEIGHT * 3) as usize], Vec::new());
        // It jumps by more than a window.
        let left = if tick < 110 { 100 } else { 500 };
        if tick >= 20 {
            paint_blob(&mut image.0, WIDTH, &blob([left + tick, 600]));
        }
        let looked = sequence
            .look(&mut finder, &mut image, f64::from(tick) / 30.0)
            .unwrap();
        assert!(tick == 0 || looked.mode == SearchMode::Tracked, "{tick}");
        found.push(!looked.boxes.is_empty());
    }
    let first = |from: usize| (from..150).find(|tick| found[*tick]);
    // Longer on a busy machine.
    assert!(first(20).is_some_and(|tick| tick < 90), "{found:?}");
    assert!(first(110).is_some_and(|tick| tick < 130), "{found:?}");
    assert!(found[140..].iter().all(|is_found| *is_found), "{found:?}");
}
