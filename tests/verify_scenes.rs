//! `dtd verify` and whole images: noise, blank images and images of another scenario are faults where the aircraft is hidden or out
//! of the image as well, and where most images of a view are wrong, the right ones are not accused.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use dataset::corpus::Corpus;
use dataset::corpus::scenario::ScenarioRecord;
use dataset::corpus::seal::seal_folder;
use dataset::video::{VideoSettings, VideoWriter};
use testkit::command::{Dtd, text};
use testkit::files::copy_folder;
use testkit::pictures::pictures;
use testkit::sweep::{FROM_2_NM, SmallSweep};
use verify::{Finding, verify};

const DTD: Dtd = Dtd::at(env!("CARGO_BIN_EXE_dtd"));
const CLEAR: &str = "1200-clear-r1";
/// In its fog no box is clear.
const FOGGY: &str = "1200-foggy-r1";
const WIDTH_PX: u32 = 192;
const HEIGHT_PX: u32 = 128;

type Picture = Vec<u8>;
/// Makes the image of a row from the recorded one.
type Change<'a> = &'a dyn Fn(usize, &[u8]) -> Picture;

/// Two recorded scenarios, made once per run of the tests.
fn sound() -> &'static Path {
    static CORPUS: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = CORPUS.get_or_init(|| {
        let weathers =
            "[weather.clear]\nvisibility_m = 80000\n[weather.foggy]\nvisibility_m = 1500\n";
        let sweep = SmallSweep {
            name: "scenes",
            seed: 5,
            weathers: &["clear", "foggy"],
            repeats: 1,
            size_px: (WIDTH_PX, HEIGHT_PX),
            frame_rate: "1/2",
            tables: &format!("{FROM_2_NM}\n{weathers}"),
        };
        DTD.recorded(&sweep.toml())
    });
    Box::leak(folder.path().join("corpus").into_boxed_path())
}

/// The images of a view of a scenario as it was recorded.
fn recorded(id: &str, view: &str) -> Vec<Picture> {
    let mut left = pictures(sound(), id);
    let right = left.split_off(left.len() / 2);
    if view == "left" { left } else { right }
}

/// Findings after the images of some views were changed and the scenario was sealed again.
fn found(id: &str, views: &[&str], change: impl Fn(usize, &[u8]) -> Picture) -> Vec<Finding> {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(sound(), folder.path());
    let corpus = Corpus::open(folder.path()).unwrap();
    let scenario = corpus.scenario(id);
    let record = ScenarioRecord::read(&scenario.record_path()).unwrap();
    for view in views {
        let path = scenario.video_path(view);
        let settings = VideoSettings::default();
        let rate = record.frame_rate;
        let mut writer = VideoWriter::create(&path, &settings, WIDTH_PX, HEIGHT_PX, rate).unwrap();
        for (row, picture) in recorded(id, view).iter().enumerate() {
            writer.write(&change(row, picture)).unwrap();
        }
        writer.finish().unwrap();
    }
    seal_folder(scenario.root(), &record.config_hash).unwrap();
    let found = verify(&corpus).findings;
    for finding in &found {
        assert_eq!(finding.scenario.as_deref(), Some(id), "{finding}");
    }
    found
}

fn views_of(found: &[Finding]) -> BTreeSet<&str> {
    (found.iter().filter_map(|finding| finding.view.as_deref())).collect()
}

/// The message of the only finding, which is of the left view as a whole.
fn only_message_of_view(found: &[Finding]) -> &str {
    let [finding] = found else {
        panic!("expected one finding: {found:#?}")
    };
    assert_eq!(
        (finding.view.as_deref(), finding.row),
        (Some("left"), None),
        "{finding}"
    );
    &finding.message
}

fn noise(row: usize, like: &[u8]) -> Picture {
    let mut noise = vec![0; like.len()];
    blake3::Hasher::new()
        .update(&row.to_le_bytes())
        .finalize_xof()
        .fill(&mut noise);
    noise
}

/// The image with some noise over it.
fn noisy(row: usize, picture: &[u8]) -> Picture {
    let levels = |noise: u8| (i16::from(noise) - 128) / 6;
    let noise = noise(row, picture).into_iter().map(levels);
    (picture.iter().zip(noise))
        .map(|(level, noise)| (i16::from(*level) + noise).clamp(0, 255) as u8)
        .collect()
}

/// One colour, the mean of the image.
fn mean_colour(picture: &[u8]) -> Picture {
    let mean = |channel: usize| {
        let levels = picture.iter().skip(channel).step_by(3);
        let sum: usize = levels.map(|level| usize::from(*level)).sum();
        (sum * 3 / picture.len()) as u8
    };
    [0, 1, 2].map(mean).repeat(picture.len() / 3)
}

#[test]
fn untouched_scenes_have_no_fault_and_the_views_without_a_clear_box_are_listed() {
    assert_eq!(found(CLEAR, &["left"], |_, picture| picture.to_vec()), []);
    assert_eq!(found(FOGGY, &["left"], |_, picture| picture.to_vec()), []);
    let output = DTD.run(&["verify", text(sound())]);
    let listed = String::from_utf8_lossy(&output.stdout);
    for view in ["left", "right"] {
        let line = format!("no ground-truth box is clear enough in {FOGGY} view {view}:");
        assert!(listed.contains(&line), "{listed}");
        assert!(
            !listed.contains(&format!("in {CLEAR} view {view}")),
            "{listed}"
        );
    }
}

#[test]
fn noise_in_all_pictures_is_found_in_each_of_its_views_in_any_weather() {
    for id in [CLEAR, FOGGY] {
        for views in [&["left"][..], &["left", "right"]] {
            let found = found(id, views, noise);
            let expected: BTreeSet<&str> = views.iter().copied().collect();
            assert_eq!(views_of(&found), expected, "{found:#?}");
        }
    }
}

#[test]
fn pictures_without_a_sky_are_a_fault_of_their_view() {
    // Each block of 8 x 8 pixels has one random grey.
    let blocks = |row: usize, picture: &[u8]| -> Picture {
        let noise = noise(row, picture);
        let width = WIDTH_PX as usize;
        let pixels = (0..picture.len() / 3).flat_map(|pixel| {
            let (x, y) = (pixel % width, pixel / width);
            [noise[y / 8 * width + x / 8]; 3]
        });
        pixels.collect()
    };
    let found = found(CLEAR, &["left"], blocks);
    let is_named = |finding: &Finding| {
        finding.view.as_deref() == Some("left") && finding.message.contains("show no sky")
    };
    assert!(found.iter().any(is_named), "{found:#?}");
    assert_eq!(views_of(&found), ["left"].into(), "{found:#?}");
}

#[test]
fn blank_pictures_and_those_of_another_scenario_are_found_where_no_box_is_clear() {
    for (id, other) in [(CLEAR, FOGGY), (FOGGY, CLEAR)] {
        let elsewhere = recorded(other, "right");
        let replacements: [Change<'_>; 4] = [
            &|_, picture| vec![0; picture.len()],
            &|_, picture| vec![200; picture.len()],
            &|_, picture| mean_colour(picture),
            &|row, _| elsewhere[row.min(elsewhere.len() - 1)].clone(),
        ];
        let last = recorded(id, "left").len() - 2;
        for replacement in replacements {
            let replaced = |from: usize, to: usize| {
                found(id, &["left"], |row, picture| {
                    if (from..=to).contains(&row) {
                        replacement(row, picture)
                    } else {
                        picture.to_vec()
                    }
                })
            };
            let one = replaced(last, last);
            assert!(!one.is_empty(), "{id} row {last}");
            for finding in &one {
                assert_eq!(finding.row, Some(last as u64), "{finding}");
            }
            let some = replaced(last - 1, usize::MAX);
            assert_eq!(views_of(&some), ["left"].into(), "{id}: {some:#?}");
        }
    }
}

#[test]
fn a_long_run_of_black_pictures_in_fog_is_named_beside_the_others() {
    let found = found(FOGGY, &["left"], |row, picture| match row {
        8..=19 => vec![0; picture.len()],
        _ => picture.to_vec(),
    });
    let message = only_message_of_view(&found);
    assert!(message.contains("another in rows 8 to 19"), "{message}");
}

#[test]
fn where_most_pictures_are_damaged_the_good_ones_are_not_accused() {
    let is_damaged = |row: usize| row % 2 == 1 || row > 12;
    let noise_in_most = found(CLEAR, &["left"], |row, picture| {
        if is_damaged(row) {
            noise(row, picture)
        } else {
            picture.to_vec()
        }
    });
    assert_eq!(views_of(&noise_in_most), ["left"].into());
    for finding in &noise_in_most {
        let accused = finding.row.map(|row| row as usize);
        assert!(accused.is_none_or(is_damaged), "{finding}");
    }
    let less_noise = found(CLEAR, &["left"], |row, picture| {
        if is_damaged(row) {
            noisy(row, picture)
        } else {
            picture.to_vec()
        }
    });
    let message = only_message_of_view(&less_noise);
    assert!(message.contains("another in rows 0, 2, 4"), "{message}");
    // All but the first are darker.
    let all_but_one = found(CLEAR, &["left"], |row, picture| match row {
        0 => picture.to_vec(),
        _ => picture.iter().map(|level| level - level / 8).collect(),
    });
    let message = only_message_of_view(&all_but_one);
    assert!(message.contains("another in row 0"), "{message}");
}
