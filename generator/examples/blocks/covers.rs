//! Something that comes over the scene for a second in mid recording, in whole scenarios, and must be in none of their images.
//!
//! Scenarios of four weathers are recorded undisturbed, and then once more for each kind of cover, with the cover at a random time and
//! place. A paused world repeats every bit, so there each video has to equal the undisturbed one. Where time runs, rain and clouds differ
//! from run to run: there no image may differ in half of the cover's place as a cover does.

mod table;

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use dataset::corpus::Corpus;
use generator::generate::Event;
use mock_xplane::server::WindowForm;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use table::{Row, Table};
use testkit::sweep::{FOUR_WEATHERS, SmallSweep, WEATHER_NAMES, starting_from};
use testkit_simulator::CoverWindow;
use tracing::field::{Field, Visit};
use tracing::span;

use super::{MARGIN_PX, Recording, unlike};

const SIZE_PX: (u32, u32) = (480, 320);
/// Two percent of the image.
const COVER_PX: (u32, u32) = (96, 32);
const SHOWN: Duration = Duration::from_secs(1);
/// Parts of the time of the undisturbed recording between which a cover comes.
const COMES: (f64, f64) = (0.1, 0.75);
/// A pixel differs as a cover does if a colour differs by more than this, levels ...
const COVER_LEVELS: u8 = 24;
/// ... and an image, if this share of the pixels in the cover's place does.
const COVER_SHARE: f64 = 0.5;
/// Text of the log when a cover is noticed.
const NOTICED: &str = "something covers the scene";

static ALARMS: AtomicU32 = AtomicU32::new(0);

#[derive(Debug, Clone, Copy)]
enum Form {
    Message,
    PluginWindow,
    Notification,
    Pointer,
}

/// Left, top, width, height in the image.
type Area = [u32; 4];

/// Adds the figures to `file`, or prints them.
pub(crate) async fn covers(
    repeats: u32,
    seed: u32,
    file: Option<&Path>,
) -> Result<(), Box<dyn Error>> {
    tracing::subscriber::set_global_default(CountAlarms)?;
    let recording = Recording::start(SIZE_PX, MARGIN_PX, 0, "").await?;
    let toml = SmallSweep {
        name: "covers",
        seed,
        weathers: &WEATHER_NAMES,
        repeats,
        size_px: SIZE_PX,
        frame_rate: "6/1",
        tables: &format!(
            "{}\n[[recorded]]\nfiles = \"flights/01_calm_ils.csv\"\nweathers = {WEATHER_NAMES:?}\n{FOUR_WEATHERS}",
            starting_from(0.5, 0.5, 200)
        ),
    }
    .toml();
    let mut run = Run {
        seed,
        ..Run::default()
    };
    let expected = run.record(&recording, "undisturbed", &toml, None).await?;
    let mut rows = run.rows("none", &BTreeMap::new());
    for form in [
        Form::Message,
        Form::PluginWindow,
        Form::Notification,
        Form::Pointer,
    ] {
        let mut covered = Run {
            seed,
            expected_s: run.seconds.clone(),
            ..Run::default()
        };
        let name = format!("{form:?}");
        let found = covered.record(&recording, &name, &toml, Some(form)).await?;
        let mut pictures = BTreeMap::new();
        for (id, area) in &covered.areas {
            pictures.insert(id.clone(), covered_pictures(&expected, &found, id, *area)?);
        }
        rows.extend(covered.rows(&name, &pictures));
    }
    let table = Table::of_run(repeats, seed, rows);
    if let Some(file) = file {
        return table.add_to(file);
    }
    println!("{}", serde_json::to_string_pretty(&table)?);
    Ok(())
}

#[derive(Default)]
struct Run {
    seed: u32,
    /// Duration of each scenario without disturbance, from its flight to its last image.
    expected_s: BTreeMap<String, f64>,
    seconds: BTreeMap<String, f64>,
    areas: BTreeMap<String, Area>,
    noticed: BTreeSet<String>,
    repeated_attempts: Vec<String>,
}

impl Run {
    /// Records the sweep, with a cover once in each scenario.
    async fn record(
        &mut self,
        recording: &Recording,
        name: &str,
        toml: &str,
        form: Option<Form>,
    ) -> Result<Corpus, Box<dyn Error>> {
        let mut began = Instant::now();
        let display = recording.xvfb.display().to_owned();
        let mut listen = |event: Event<'_>| match event {
            Event::Flown { id, .. } => {
                began = Instant::now();
                ALARMS.store(0, Ordering::Relaxed);
                if let Some(form) = form.filter(|_| !self.areas.contains_key(id)) {
                    let (area, after) = self.place_and_time(id, form);
                    self.areas.insert(id.to_owned(), area);
                    let (covers, display) = (recording.covers.clone(), display.clone());
                    thread::spawn(move || {
                        thread::sleep(after);
                        show(form, area, &covers, &display);
                    });
                }
            }
            Event::Captured { id, .. } => {
                self.seconds
                    .insert(id.to_owned(), began.elapsed().as_secs_f64());
                if ALARMS.load(Ordering::Relaxed) > 0 {
                    self.noticed.insert(id.to_owned());
                }
            }
            Event::Retrying { id, reason, .. } => {
                self.repeated_attempts.push(format!("{id}: {reason}"));
                self.noticed.insert(id.to_owned());
            }
            _ => {}
        };
        recording.generate(name, toml.to_owned(), &mut listen).await
    }

    fn place_and_time(&self, id: &str, form: Form) -> (Area, Duration) {
        let seed = *blake3::hash(format!("{id} {form:?} {}", self.seed).as_bytes()).as_bytes();
        let mut random = ChaCha8Rng::from_seed(seed);
        let (width, height) = COVER_PX;
        let area = [
            random.random_range(0..=SIZE_PX.0 - width),
            random.random_range(0..=SIZE_PX.1 - height),
            width,
            height,
        ];
        let took_s = self.expected_s.get(id).copied().unwrap_or_default();
        let share = random.random_range(COMES.0..COMES.1);
        (area, Duration::from_secs_f64(share * took_s))
    }

    /// The figures of each weather. `covered_pictures`: of each scenario.
    fn rows(&self, cover: &str, covered_pictures: &BTreeMap<String, u32>) -> Vec<Row> {
        let named = |id: &str| format!("seed {}: {id}", self.seed);
        let row = |weather: &str| {
            let of_weather = |id: &&String| id.contains(weather);
            let missed = |id: &&String| !self.noticed.contains(*id);
            let counted = |ids: &BTreeSet<String>| ids.iter().filter(of_weather).count() as u32;
            Row {
                cover: cover.to_owned(),
                weather: weather.to_owned(),
                scenarios: self.seconds.keys().filter(of_weather).count() as u32,
                noticed_in: counted(&self.noticed),
                covered_pictures: covered_pictures
                    .iter()
                    .filter(|(id, _)| of_weather(id))
                    .map(|(_, pictures)| pictures)
                    .sum(),
                not_noticed: self
                    .areas
                    .keys()
                    .filter(of_weather)
                    .filter(missed)
                    .map(|id| named(id))
                    .collect(),
                repeated_attempts: self
                    .repeated_attempts
                    .iter()
                    .filter(of_weather)
                    .map(|attempt| named(attempt))
                    .collect(),
            }
        };
        WEATHER_NAMES.map(row).into()
    }
}

/// Covers an area of the image for a second.
fn show(form: Form, area: Area, covers: &mock_xplane::server::WindowCovers, display: &str) {
    let [left, top, width, height] = [area[0] + MARGIN_PX, area[1] + MARGIN_PX, area[2], area[3]];
    let in_window = [left, top, left + width, top + height];
    let on_display = [left, top, width, height].map(|px| px as i32);
    let window = match form {
        Form::Message => return covers.show(WindowForm::Message, in_window, SHOWN),
        Form::PluginWindow => return covers.show(WindowForm::Plugin, in_window, SHOWN),
        Form::Notification => CoverWindow::notification(Some(display), on_display),
        Form::Pointer => CoverWindow::pointer_with_hint(Some(display), on_display),
    };
    match window {
        Ok(_window) => thread::sleep(SHOWN),
        Err(error) => eprintln!("no cover: {error}"),
    }
}

/// Images that show a cover.
fn covered_pictures(
    expected: &Corpus,
    found: &Corpus,
    id: &str,
    area: Area,
) -> Result<u32, Box<dyn Error>> {
    let record = found.scenario(id).open()?.record()?;
    let time_runs = record
        .weather()
        .is_some_and(|weather| weather.rain_ratio > 0.0);
    unlike(expected, found, id, |one, other| {
        if time_runs {
            differing_share(one, other, area) > COVER_SHARE
        } else {
            one != other
        }
    })
}

/// Share of the area's pixels that differ as a cover does.
fn differing_share(one: &[u8], other: &[u8], [left, top, width, height]: Area) -> f64 {
    let mut differing = 0;
    for y in top..top + height {
        for x in left..left + width {
            let pixel = ((y * SIZE_PX.0 + x) * 3) as usize;
            let colours = one[pixel..pixel + 3].iter().zip(&other[pixel..pixel + 3]);
            let most = colours.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
            differing += u32::from(most > COVER_LEVELS);
        }
    }
    f64::from(differing) / f64::from(width * height)
}

/// Counts the covers that the log reports.
struct CountAlarms;

impl tracing::Subscriber for CountAlarms {
    fn enabled(&self, metadata: &tracing::Metadata<'_>) -> bool {
        *metadata.level() <= tracing::Level::WARN
    }

    fn new_span(&self, _: &span::Attributes<'_>) -> span::Id {
        span::Id::from_u64(1)
    }

    fn record(&self, _: &span::Id, _: &span::Record<'_>) {}

    fn record_follows_from(&self, _: &span::Id, _: &span::Id) {}

    fn event(&self, event: &tracing::Event<'_>) {
        event.record(&mut Noticed);
    }

    fn enter(&self, _: &span::Id) {}

    fn exit(&self, _: &span::Id) {}
}

struct Noticed;

impl Visit for Noticed {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" && format!("{value:?}").contains(NOTICED) {
            ALARMS.fetch_add(1, Ordering::Relaxed);
        }
    }
}
