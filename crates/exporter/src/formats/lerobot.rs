//! LeRobotDataset v3.0, which the `lerobot` library reads: an episode per scenario, a video key per view.
//!
//! ```text
//! meta/info.json                                     rate, features, splits, templates of paths
//! meta/stats.json                                    range, mean and deviation of every feature
//! meta/tasks.parquet                                 what is flown, in words
//! meta/episodes/chunk-000/file-000.parquet           where the rows and images of each scenario are, and what it is
//! data/chunk-000/file-000.parquet                    a row per tick, scenario after scenario
//! videos/observation.images.<view>/chunk-000/file-000.mp4    a file per scenario
//! README.md                                          dataset card
//! ```
//!
//! The format finds the image of a row by its time, `frame_index / fps`, so its rate is a whole number. If all ticks are requested,
//! videos have the coded images of the corpus; otherwise the chosen images are encoded again with the corpus's settings. In both cases
//! their unit of time is a fine one, because the library joins videos without encoding them (`merge_datasets`).

mod moments;

use std::array;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::Path;

use dataset::files::json_file::{write_json_unsynced, write_unsynced};
use dataset::numbers::frame_rate::FrameRate;
use dataset::tables::columns::{TableParts, TableWriter};
use dataset::tables::frames::{TickLabels, TickRow};
use dataset::video::{VideoReader, VideoSettings, VideoWriter, refine_time_base};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use self::moments::Moments;
use crate::about::{About, split_of};
use crate::columns::meaning_in_ticks;
use crate::error::{Error, Result};
use crate::file_format::{Export, FileFormat, Writing, Written};
use crate::request::{Abilities, BoxUse, TickChoice, Ticks};
use crate::scenarios::{FLOWN, LABELLED, Source, ViewPictures};

/// Files in a folder, as the library itself has it.
const CHUNK: usize = 1000;
/// Maximum rows per data file, about a hundred megabytes uncompressed; a scenario is never divided.
const MAX_ROWS: usize = 500_000;

/// Elements of `observation.state`.
const STATE: usize = FLOWN.len() + LABELLED.len();

/// Names of the elements, in their order.
fn state_names() -> impl Iterator<Item = &'static str> {
    let flown = FLOWN.iter().map(|(name, _)| *name);
    flown.chain(LABELLED.iter().map(|(name, _)| *name))
}

fn state(row: &TickRow, labels: &TickLabels) -> [f64; STATE] {
    array::from_fn(|place| match FLOWN.get(place) {
        Some((_, value)) => value(row),
        None => LABELLED[place - FLOWN.len()].1(labels),
    })
}

/// Columns of the data whose numbers are whole.
const WHOLE: [&str; 6] = [
    "frame_index",
    "episode_index",
    "index",
    "task_index",
    "tick",
    "time_ns",
];

/// The format.
#[derive(Default)]
pub(super) struct LeRobot {
    /// The form of the first scenario, which all others share.
    form: Option<Form>,
}

impl LeRobot {
    fn form(&self) -> Result<&Form> {
        let none = || Error::Request("nothing to export: no scenario is selected".to_owned());
        self.form.as_ref().ok_or_else(none)
    }
}

impl FileFormat for LeRobot {
    fn abilities(&self) -> Abilities {
        Abilities {
            has_card: true,
            by_side: true,
            ticks: TickChoice::AnyRate,
            boxes: BoxUse::None,
            ..Abilities::of_videos("lerobot")
        }
    }

    fn check(&mut self, source: &Source<'_>, export: &Export<'_>) -> Result<()> {
        let form = Form::of(source, export.request.ticks, &export.video)?;
        match &self.form {
            Some(first) => first.check_same(&form, &source.record.id)?,
            None => self.form = Some(form),
        }
        Ok(())
    }

    /// Writes the videos.
    fn write(&self, scenario: &Writing<'_>) -> Result<Value> {
        let (source, form) = (&scenario.source, self.form()?);
        let mut parts = Vec::new();
        for view in &source.selected.views {
            scenario.watch.check()?;
            let path = scenario.folder.join(form.video(view, scenario.number));
            let parent = path.parent().unwrap_or(&scenario.folder);
            fs::create_dir_all(parent).map_err(dataset::Error::io("create", parent))?;
            if source.is_whole() {
                source.scenario.copy_video(view, &path)?;
                scenario.pictures_done(source.rows().count() as u64);
            } else {
                encode(scenario, view, form.fps, &path)?;
            }
            refine_time_base(&path)?;
            parts.push(sample(&path)?);
        }
        scenario.part(&parts)
    }

    /// Writes everything but the videos.
    fn finish(&self, written: &Written<'_>) -> Result<()> {
        let folder = written.folder();
        let mut dataset = Dataset::new(&folder, self.form()?)?;
        for (source, videos) in written.sources().zip(written.parts::<Vec<VideoPart>>()) {
            dataset.add(&source?, videos?)?;
        }
        dataset.finish(&written.export.about)
    }
}

/// Properties shared by all scenarios of a dataset.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Form {
    fps: u32,
    /// Views with the width and height of their images.
    views: Vec<(String, [u32; 2])>,
    /// Ending of the videos' names.
    ending: String,
}

impl Form {
    /// `recorded` has the settings for videos that are re-encoded.
    fn of(source: &Source<'_>, ticks: Ticks, recorded: &VideoSettings) -> Result<Self> {
        let fps = fps_of(&source.record.id, source.record.frame_rate, ticks)?;
        if source.rows().any(|row| row.labels.is_none()) {
            return Err(unlabelled(source));
        }
        let mut views = Vec::new();
        let mut ending = recorded.codec.extension();
        for view in &source.selected.views {
            let (_, camera) = source.view(view)?;
            views.push((view.clone(), [camera.width_px, camera.height_px]));
            if source.is_whole() {
                let name = source.scenario.video_name(view)?;
                ending = name.rsplit('.').next().unwrap_or(ending);
            }
        }
        Ok(Self {
            fps,
            views,
            ending: ending.to_owned(),
        })
    }

    /// Refuses a scenario with a different form.
    fn check_same(&self, other: &Self, scenario: &str) -> Result<()> {
        if self == other {
            Ok(())
        } else {
            Err(Error::Request(format!(
                "scenario {scenario} has {other}, the first one {self}; a LeRobot dataset has one rate, one size of images and one type of \
                 files: choose scenarios with --only, or views with --views"
            )))
        }
    }

    fn video(&self, view: &str, episode: usize) -> String {
        let (chunk, file) = (episode / CHUNK, episode % CHUNK);
        let (key, ending) = (key_of(view), &self.ending);
        format!("videos/{key}/chunk-{chunk:03}/file-{file:03}.{ending}")
    }
}

impl std::fmt::Display for Form {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} images per second", self.fps)?;
        for (view, [width_px, height_px]) in &self.views {
            write!(f, ", {view} of {width_px}x{height_px}")?;
        }
        write!(f, " in .{} files", self.ending)
    }
}

/// The whole number of images per second.
fn fps_of(scenario: &str, rate: FrameRate, ticks: Ticks) -> Result<u32> {
    let FrameRate {
        numerator,
        denominator,
    } = rate;
    let most = numerator / denominator;
    let divisor = match ticks {
        Ticks::PerSecond(asked) if asked.get() > most && most > 0 => {
            return Err(Error::Request(format!(
                "scenario {scenario} has {rate} images per second, fewer than --rate {asked}; choose a lower one"
            )));
        }
        Ticks::PerSecond(asked) if most > 0 => return Ok(asked.get()),
        Ticks::PerSecond(_) => u64::from(denominator),
        Ticks::Every(n) => u64::from(denominator) * u64::from(n.get()),
    };
    let numerator = u64::from(numerator);
    if numerator.is_multiple_of(divisor) {
        return Ok((numerator / divisor) as u32);
    }
    let found = in_lowest_terms(numerator, divisor);
    let advice = match most {
        0 => "choose another format, or record at 1 Hz or more".to_owned(),
        most => format!("choose one from 1 to {most} with --rate"),
    };
    Err(Error::Request(format!(
        "scenario {scenario} would have {found} images per second; lerobot needs a whole number: {advice}"
    )))
}

fn in_lowest_terms(numerator: u64, denominator: u64) -> String {
    let (mut divisor, mut rest) = (numerator, denominator);
    while rest > 0 {
        (divisor, rest) = (rest, divisor % rest);
    }
    format!("{}/{}", numerator / divisor, denominator / divisor)
}

fn unlabelled(source: &Source<'_>) -> Error {
    let path = source.scenario.folder().frames_path();
    dataset::Error::corpus(&path, "has no labels: run `dtd label` on the corpus first").into()
}

/// Key of the feature that holds a view's video.
fn key_of(view: &str) -> String {
    format!("observation.images.{view}")
}

/// A video that was written.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct VideoPart {
    codec: String,
    pixels: String,
    /// Images whose colours were counted.
    sampled: u64,
    /// Red, green and blue, from 0 to 1.
    colours: [Moments; 3],
}

fn encode(scenario: &Writing<'_>, view: &str, fps: u32, path: &Path) -> Result<()> {
    let source = &scenario.source;
    let mut pictures = ViewPictures::open(source, view)?;
    let [width_px, height_px] = pictures.size_px();
    let rate = FrameRate {
        numerator: fps,
        denominator: 1,
    };
    let mut video = VideoWriter::create(path, &scenario.export.video, width_px, height_px, rate)?;
    let mut rgb = Vec::new();
    for row in &source.frames.rows {
        scenario.watch.check()?;
        pictures.decode(row)?;
        if source.is_asked_for(row.tick) {
            pictures.convert(&mut rgb)?;
            video.write(&rgb)?;
            scenario.pictures_done(1);
        }
    }
    Ok(video.finish()?)
}

/// Counts the colours in a video's key frames; decoding all images would take longer than everything else.
fn sample(path: &Path) -> Result<VideoPart> {
    let mut video = VideoReader::open(path)?;
    video.leave_out_all_but_keys();
    let [codec, pixels] = video.codec_and_pixels().map(str::to_owned);
    let mut counts = [[0; 256]; 3];
    let mut sampled = 0;
    let mut rgb = Vec::new();
    while video.next_frame(&mut rgb)?.is_some() {
        sampled += 1;
        for pixel in rgb.chunks_exact(3) {
            for (counts, value) in counts.iter_mut().zip(pixel) {
                counts[usize::from(*value)] += 1;
            }
        }
    }
    let colours = counts.map(|counts| Moments::of_counts(&counts, 1.0 / 255.0));
    let [Some(red), Some(green), Some(blue)] = colours else {
        return Err(dataset::Error::corpus(path, "has no key frame").into());
    };
    Ok(VideoPart {
        codec,
        pixels,
        sampled,
        colours: [red, green, blue],
    })
}

/// A dataset whose tables are being written.
struct Dataset<'a> {
    folder: &'a Path,
    form: &'a Form,
    data: TableParts,
    /// Rows of the open data file.
    rows: usize,
    /// Number of the open data file.
    file: usize,
    episodes: TableParts,
    /// Number of scenarios, and of rows in all.
    episode: usize,
    index: usize,
    tasks: Vec<String>,
    /// Numbers of episodes by split.
    splits: BTreeMap<&'static str, (usize, usize)>,
    /// Moments per number, by feature, without videos.
    moments: BTreeMap<&'static str, Vec<Moments>>,
    videos: Vec<VideoPart>,
}

const EPISODES: &str = "meta/episodes/chunk-000/file-000.parquet";
const INFO: &str = "meta/info.json";
const STATS: &str = "meta/stats.json";
const TASKS: &str = "meta/tasks.parquet";

impl<'a> Dataset<'a> {
    fn new(folder: &'a Path, form: &'a Form) -> Result<Self> {
        Ok(Self {
            folder,
            form,
            data: table(folder, &data_file(0))?,
            rows: 0,
            file: 0,
            episodes: table(folder, EPISODES)?,
            episode: 0,
            index: 0,
            tasks: Vec::new(),
            splits: BTreeMap::new(),
            moments: BTreeMap::new(),
            videos: Vec::new(),
        })
    }

    fn add(&mut self, source: &Source<'_>, videos: Vec<VideoPart>) -> Result<()> {
        let length = source.rows().count();
        if self.rows > 0 && self.rows + length > MAX_ROWS {
            self.file += 1;
            let next = table(self.folder, &data_file(self.file))?;
            std::mem::replace(&mut self.data, next).finish()?;
            self.rows = 0;
        }
        let runway = &source.record.runway;
        let task = format!("land on runway {} of {}", runway.name, runway.airport);
        let task_index = match self.tasks.iter().position(|known| *known == task) {
            Some(index) => index,
            None => {
                self.tasks.push(task.clone());
                self.tasks.len() - 1
            }
        };
        self.add_rows(source, task_index)?;
        self.add_episode(source, length, task)?;
        self.videos = if self.videos.is_empty() {
            videos
        } else {
            std::mem::take(&mut self.videos)
                .into_iter()
                .zip(videos)
                .map(|(all, one)| all.and(one))
                .collect()
        };
        let split = split_of(source.selected.side);
        let range = self.splits.entry(split).or_insert((self.episode, 0));
        range.1 = self.episode + 1;
        self.episode += 1;
        self.index += length;
        self.rows += length;
        Ok(())
    }

    fn add_rows(&mut self, source: &Source<'_>, task: usize) -> Result<()> {
        let mut states = Vec::new();
        let mut times_s = Vec::new();
        let mut whole: [Vec<i64>; WHOLE.len()] = Default::default();
        for (frame, row) in source.rows().enumerate() {
            let labels = row.labels.as_ref().ok_or_else(|| unlabelled(source))?;
            states.push(state(row, labels));
            times_s.push(frame as f32 / self.form.fps as f32);
            let numbers = [frame, self.episode, self.index + frame, task];
            let numbers = numbers.map(|number| number as i64);
            let of_corpus = [i64::from(row.tick), row.time_ns];
            for (column, number) in whole.iter_mut().zip(numbers.into_iter().chain(of_corpus)) {
                column.push(number);
            }
        }
        for state in &states {
            self.see("observation.state", state);
        }
        for time_s in &times_s {
            self.see("timestamp", &[f64::from(*time_s)]);
        }
        let mut rows = TableWriter::new()
            .f64s("observation.state", states)
            .f32("timestamp", times_s);
        for (name, numbers) in WHOLE.into_iter().zip(whole) {
            for number in &numbers {
                self.see(name, &[*number as f64]);
            }
            rows = rows.i64(name, numbers);
        }
        Ok(self.data.add(rows)?)
    }

    fn see(&mut self, feature: &'static str, numbers: &[f64]) {
        let new = numbers.iter().map(|number| Moments::of(*number));
        match self.moments.get_mut(feature) {
            Some(all) => all
                .iter_mut()
                .zip(new)
                .for_each(|(all, one)| *all = all.and(one)),
            None => drop(self.moments.insert(feature, new.collect())),
        }
    }

    fn add_episode(&mut self, source: &Source<'_>, length: usize, task: String) -> Result<()> {
        let record = &source.record;
        let number = |value: usize| [value as i64];
        let file = self.file;
        let calibration = serde_json::to_string(&source.calibration);
        let mut row = TableWriter::new()
            .i64("episode_index", number(self.episode))
            .texts("tasks", [vec![task]])
            .i64("length", number(length))
            .i64("dataset_from_index", number(self.index))
            .i64("dataset_to_index", number(self.index + length))
            .i64("data/chunk_index", number(file / CHUNK))
            .i64("data/file_index", number(file % CHUNK))
            .i64("meta/episodes/chunk_index", [0])
            .i64("meta/episodes/file_index", [0])
            .text("scenario", [&record.id])
            .text("trajectory", [&record.trajectory])
            .text("split", [split_of(source.selected.side)])
            .text("weather", [&record.conditions.weather_name])
            .text("time_of_day", [&record.conditions.time_of_day])
            .text("calibration", [calibration.unwrap_or_default()]);
        for (view, _) in &self.form.views {
            let key = key_of(view);
            let to_s = length as f64 / f64::from(self.form.fps);
            row = row
                .i64(
                    &format!("videos/{key}/chunk_index"),
                    number(self.episode / CHUNK),
                )
                .i64(
                    &format!("videos/{key}/file_index"),
                    number(self.episode % CHUNK),
                )
                .f64(&format!("videos/{key}/from_timestamp"), [0.0])
                .f64(&format!("videos/{key}/to_timestamp"), [to_s]);
        }
        Ok(self.episodes.add(row)?)
    }

    fn finish(self, about: &About) -> Result<()> {
        let (info, stats) = (self.info(), self.stats());
        self.data.finish()?;
        self.episodes.finish()?;
        tasks(&self.tasks).write(&self.folder.join(TASKS))?;
        write_json_unsynced(&self.folder.join(INFO), &info)?;
        write_json_unsynced(&self.folder.join(STATS), &stats)?;
        write_unsynced(&self.folder.join("README.md"), card_of(about).as_bytes())?;
        Ok(())
    }

    fn info(&self) -> Value {
        let mut features = Map::new();
        for ((view, [width_px, height_px]), video) in self.form.views.iter().zip(&self.videos) {
            let described = json!({
                "dtype": "video",
                "shape": [height_px, width_px, 3],
                "names": ["height", "width", "channels"],
                "info": {
                    "video.height": height_px,
                    "video.width": width_px,
                    "video.channels": 3,
                    "video.fps": self.form.fps,
                    "video.codec": video.codec,
                    "video.pix_fmt": video.pixels,
                    "video.is_depth_map": false,
                    "has_audio": false,
                },
            });
            features.insert(key_of(view), described);
        }
        let names: Vec<_> = state_names().collect();
        let state = json!({"dtype": "float64", "shape": [STATE], "names": names});
        features.insert("observation.state".into(), state);
        let number = |kind| json!({"dtype": kind, "shape": [1], "names": null});
        features.insert("timestamp".into(), number("float32"));
        for name in WHOLE {
            features.insert(name.into(), number("int64"));
        }
        let splits = self.splits.iter();
        let splits = splits.map(|(name, (from, to))| (*name, format!("{from}:{to}")));
        json!({
            "codebase_version": "v3.0",
            "robot_type": "aircraft",
            "total_episodes": self.episode,
            "total_frames": self.index,
            "total_tasks": self.tasks.len(),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self.form.fps,
            "splits": splits.collect::<BTreeMap<_, _>>(),
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": format!(
                "videos/{{video_key}}/chunk-{{chunk_index:03d}}/file-{{file_index:03d}}.{}",
                self.form.ending
            ),
            "features": features,
        })
    }

    fn stats(&self) -> Value {
        let mut stats = Map::new();
        for (name, moments) in &self.moments {
            stats.insert(
                (*name).into(),
                stats_of(moments, self.index as u64, |n| json!(n)),
            );
        }
        for ((view, _), video) in self.form.views.iter().zip(&self.videos) {
            let of_channel = |number| json!([[number]]);
            let described = stats_of(&video.colours, video.sampled, of_channel);
            stats.insert(key_of(view), described);
        }
        stats.into()
    }
}

/// Statistics over `count` rows.
fn stats_of(moments: &[Moments], count: u64, shaped: impl Fn(f64) -> Value) -> Value {
    let each = |value: fn(&Moments) -> f64| -> Vec<Value> {
        moments.iter().map(|one| shaped(value(one))).collect()
    };
    json!({
        "min": each(|one| one.min),
        "max": each(|one| one.max),
        "mean": each(|one| one.mean),
        "std": each(Moments::deviation),
        "count": [count],
    })
}

impl VideoPart {
    /// Combines the videos of two scenarios.
    fn and(self, other: Self) -> Self {
        let [a, b, c] = self.colours;
        let [d, e, f] = other.colours;
        Self {
            sampled: self.sampled + other.sampled,
            colours: [a.and(d), b.and(e), c.and(f)],
            ..self
        }
    }
}

fn data_file(number: usize) -> String {
    format!(
        "data/chunk-{:03}/file-{:03}.parquet",
        number / CHUNK,
        number % CHUNK
    )
}

/// A table that is to be written.
fn table(folder: &Path, name: &str) -> Result<TableParts> {
    let path = folder.join(name);
    let parent = path.parent().unwrap_or(folder);
    fs::create_dir_all(parent).map_err(dataset::Error::io("create", parent))?;
    Ok(TableParts::new(&path))
}

/// The library looks tasks up as row names in a pandas frame.
fn tasks(tasks: &[String]) -> TableWriter {
    let column = |name, pandas_type, numpy_type| {
        json!({
            "name": name,
            "field_name": name,
            "pandas_type": pandas_type,
            "numpy_type": numpy_type,
            "metadata": null,
        })
    };
    let pandas = json!({
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [column("task_index", "int64", "int64"), column("task", "unicode", "object")],
        "pandas_version": "2.2.0",
    });
    TableWriter::new()
        .i64("task_index", 0..tasks.len() as i64)
        .text("task", tasks)
        .note("pandas", pandas.to_string())
}

fn card_of(about: &About) -> String {
    let mut card = format!(
        "---\n{}task_categories: [robotics]\ntags: [LeRobot, aviation, multi-camera, simulation]\nconfigs:\n- config_name: default\n  \
         data_files: data/*/*.parquet\n---\n\n{}\n\nA [LeRobot](https://github.com/huggingface/lerobot) dataset, v3.0: an episode per scenario, \
         a video key per view. `observation.state` has, in this order:\n\n| | name | meaning |\n|---|---|---|\n",
        about.card_license(),
        about.introduction(),
    );
    for (place, name) in state_names().enumerate() {
        let meaning = meaning_in_ticks(name);
        let _ = writeln!(card, "| {place} | `{name}` | {meaning} |");
    }
    card.push_str(
        "\nThere is no `action`. `timestamp` is `frame_index / fps`; `time_ns` is the time of the tick itself. The colours in `stats.json` are \
         those of key frames.\n\n```python\nfrom lerobot.datasets.lerobot_dataset import LeRobotDataset\n\n\
         dataset = LeRobotDataset(\"dtd/corpus\", root=\"FOLDER\")\n```\n",
    );
    card
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use super::*;

    #[test]
    fn only_whole_rates_are_exported_and_others_say_which_to_choose() {
        let fps = |numerator, denominator, ticks| {
            let rate = FrameRate::new(numerator, denominator).unwrap();
            fps_of("a", rate, ticks).map_err(|error| error.to_string())
        };
        let every = |n| Ticks::Every(NonZeroU32::new(n).unwrap());
        let per_second = |n| Ticks::PerSecond(NonZeroU32::new(n).unwrap());
        for (numerator, denominator, ticks, expected) in [
            (30, 1, Ticks::ALL, 30),
            (60, 2, Ticks::ALL, 30),
            (30, 1, every(6), 5),
            (30_000, 1_001, per_second(29), 29),
            (30, 1, per_second(30), 30),
        ] {
            assert_eq!(fps(numerator, denominator, ticks), Ok(expected));
        }
        for (numerator, denominator, ticks, words) in [
            (30_000, 1_001, Ticks::ALL, "from 1 to 29 with --rate"),
            (30, 1, every(7), "30/7 images per second"),
            (30_000, 1_001, per_second(30), "fewer than --rate 30"),
            (1, 2, Ticks::ALL, "choose another format"),
            (1, 2, per_second(1), "choose another format"),
        ] {
            let message = fps(numerator, denominator, ticks).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
    }
}
