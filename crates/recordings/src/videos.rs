//! Videos of cameras: the times of their images, and the boxes that a detector finds in them.
//!
//! Videos are searched side by side, image by image. When a video ends, its boxes become a table in the workshop, named after the video,
//! the camera and the detector, so that no later import searches that video again. Damaged images are left out and counted.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use dataset::corpus::scenario::SourceFile;
use dataset::corpus::seal::hash_file;
use dataset::files::new_file::NewFile;
use dataset::video::VideoReader;
use dataset::work::watch::{Stopped, Watch};
use dataset::work::workers;
use generator::tracks::utc_s;
use labeller::{Searcher, SeenBox, VideoImages, ViewSearch};

use crate::description::{CameraDescription, UTC_S, Video};
use crate::error::{Error, Result};

/// Hexadecimal digits that name a table.
const NAME_DIGITS: usize = 32;
/// First line of a camera's table. A video's begins with the number of its damaged images; its times count from its first image, and its
/// tracks from 0.
const HEADER: &str = "time,cx,cy,width,height,score,track\n";
/// Form of a video's table, part of its name.
const FORM: &str = "2";
/// Starts stated in whole seconds let files that follow each other overlap by less.
const MAX_OVERLAP_S: f64 = 1.0;

/// A table of the boxes in a camera's videos, and where they come from.
pub(crate) struct Searched {
    pub(crate) table: PathBuf,
    pub(crate) source: SourceFile,
    pub(crate) damaged_images: u64,
}

/// A video to search.
struct Item<'a> {
    camera: &'a CameraDescription,
    video: &'a Video,
}

/// A table of one video.
struct Table {
    path: PathBuf,
    first_image_s: f64,
    video_blake3: String,
    expected_images: u64,
}

/// Searches the videos of these cameras. The results are in their order: each camera's table, or why it cannot be used.
///
/// # Errors
/// The disk fails, or the caller stops the search.
pub(crate) fn search(
    cameras: &[&CameraDescription],
    searcher: &Searcher,
    folder: &Path,
    watch: &dyn Watch,
) -> Result<Vec<Result<Searched>>> {
    fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
    let items: Vec<Item<'_>> = (cameras.iter())
        .flat_map(|camera| {
            let videos = camera.videos.iter();
            videos.map(|video| Item { camera, video })
        })
        .collect();
    let mut tables = Vec::new();
    for item in &items {
        watch.check()?;
        watch.say(&format!(
            "reading {} for its checksum",
            name_of(&item.video.file)
        ));
        match item.table(searcher, folder) {
            Err(error) if !error.is_of_a_file() => return Err(error),
            table => tables.push(table),
        }
    }
    let (made, due): (Vec<usize>, Vec<usize>) = (0..items.len())
        .filter(|at| tables[*at].is_ok())
        .partition(|at| tables[*at].as_ref().is_ok_and(|table| table.path.exists()));
    let images = |of: &[usize]| -> u64 {
        let tables = of.iter().filter_map(|at| tables[*at].as_ref().ok());
        tables.map(|table| table.expected_images).sum()
    };
    let made_images = images(&made);
    watch.begin("", made_images + images(&due));
    watch.resume(made_images);
    let done = Mutex::new(made_images);
    let image_done = || {
        let mut done = locked(&done);
        *done += 1;
        watch.advance(*done, "");
    };
    let faults = Mutex::new(Vec::new());
    let next = AtomicUsize::new(0);
    let has_failed = AtomicBool::new(false);
    let is_over = || watch.is_stopped() || has_failed.load(Ordering::Relaxed);
    let work = || -> Result<()> {
        let mut search = None;
        while let Some(&at) = due.get(next.fetch_add(1, Ordering::Relaxed))
            && let Ok(table) = &tables[at]
        {
            let searched = items[at].searched(&mut search, searcher, &image_done, &is_over);
            match searched.and_then(|rows| write(&table.path, &rows)) {
                Ok(()) => {}
                Err(error) if error.is_of_a_file() => locked(&faults).push((at, error)),
                Err(error) => {
                    has_failed.store(true, Ordering::Relaxed);
                    return Err(error);
                }
            }
        }
        Ok(())
    };
    workers::share(searcher.workers().min(due.len()), work)?;
    for (at, fault) in faults.into_inner().unwrap_or_else(PoisonError::into_inner) {
        tables[at] = Err(fault);
    }
    let mut tables = tables.into_iter();
    let of_camera = |camera: &&CameraDescription| {
        // All of them, also after a fault, since the next camera's follow.
        let tables: Vec<Result<Table>> = tables.by_ref().take(camera.videos.len()).collect();
        let tables: Result<Vec<Table>> = tables.into_iter().collect();
        joined(camera, &tables?, folder)
    };
    Ok(cameras.iter().map(of_camera).collect())
}

fn locked<T>(content: &Mutex<T>) -> MutexGuard<'_, T> {
    content.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Item<'_> {
    fn open(&self) -> Result<VideoReader> {
        let reader = VideoReader::open_recording(&self.video.file)?;
        let (found, expected) = (
            [reader.width(), reader.height()],
            [self.camera.entry.width_px, self.camera.entry.height_px],
        );
        if found != expected {
            return Err(self.fault(format!(
                "has images of {} x {} px, expected {} x {} px as the recording states",
                found[0], found[1], expected[0], expected[1]
            )));
        }
        Ok(reader)
    }

    /// The video's table. It exists if an earlier import has made it.
    fn table(&self, searcher: &Searcher, folder: &Path) -> Result<Table> {
        let reader = self.open()?;
        let first_image_s = self.first_image_s(&reader)?;
        let video_blake3 = hash_file(&self.video.file)?;
        let entry = serde_json::to_string(&self.camera.entry).unwrap_or_default();
        let all = format!("{FORM} {video_blake3} {} {entry}", searcher.identity());
        let name = blake3::hash(all.as_bytes()).to_hex();
        Ok(Table {
            path: folder.join(format!("{}.csv", &name[..NAME_DIGITS])),
            first_image_s,
            video_blake3,
            expected_images: reader.expected_images(),
        })
    }

    fn first_image_s(&self, reader: &VideoReader) -> Result<f64> {
        let stated = || {
            let stated_s = utc_s(&reader.creation_time()?).ok()?;
            // By the camera's clock, as all its times.
            Some(stated_s - self.camera.to_utc_s)
        };
        let first_image_s = self.video.first_image_s.or_else(stated);
        let Some(first_image_s) = first_image_s else {
            let why =
                "does not say when it began; name the time of its first image as `first_image`";
            return Err(self.fault(why.to_owned()));
        };
        let possible = UTC_S.check(first_image_s).map(|()| first_image_s);
        possible.map_err(|bad| {
            self.fault(format!(
                "says that it began at {bad}; name the time of its first image as `first_image`"
            ))
        })
    }

    /// The number of damaged images, and a row for each box of a track that counts and for each image without one. The worker's search
    /// keeps its detector.
    fn searched(
        &self,
        search: &mut Option<ViewSearch>,
        searcher: &Searcher,
        image_done: &dyn Fn(),
        is_over: &dyn Fn() -> bool,
    ) -> Result<String> {
        let reader = self.open()?;
        let unit_s = reader.time_base().seconds();
        let camera = self.camera.entry.camera();
        let search = match search {
            Some(search) => search.of_camera(&camera),
            none => none.insert(searcher.view_search(&camera)?),
        };
        let mut images = VideoImages::of(reader);
        let mut found: Vec<(f64, Vec<SeenBox>)> = Vec::new();
        let mut counts = BTreeSet::new();
        let mut first_pts = None;
        while let Some(pts) = images.advance()? {
            if is_over() {
                return Err(Stopped.into());
            }
            if let Some(why) = images.reader().unlike_the_scene() {
                return Err(self.fault(why.to_owned()));
            }
            // The file's first image may be damaged.
            let damaged_pts = images.reader().first_damaged_pts();
            let first_pts = first_pts.get_or_insert(damaged_pts.map_or(pts, |at| at.min(pts)));
            let since_s = (pts - *first_pts) as f64 * unit_s;
            let boxes = search.look(&mut images, since_s)?.boxes;
            counts.extend(
                boxes
                    .iter()
                    .filter(|seen| seen.counts)
                    .map(|seen| seen.track),
            );
            found.push((since_s, boxes));
            image_done();
        }
        let mut rows = format!("{}\n", images.reader().damaged_images());
        for (since_s, boxes) in found {
            let counting = boxes.iter().filter(|seen| counts.contains(&seen.track));
            let before = rows.len();
            for seen in counting {
                let of = seen.pixel_box;
                let (score, track) = (seen.score, seen.track);
                let row = format_args!(
                    "{since_s:.6},{:.3},{:.3},{:.3},{:.3},{score:.4},{track}",
                    of.cx_px, of.cy_px, of.width_px, of.height_px
                );
                let _ = writeln!(rows, "{row}");
            }
            if rows.len() == before {
                let _ = writeln!(rows, "{since_s:.6},,,,,,");
            }
        }
        Ok(rows)
    }

    fn fault(&self, message: String) -> Error {
        dataset::Error::corpus(&self.video.file, message).into()
    }
}

/// Joins the tables of a camera's videos.
fn joined(camera: &CameraDescription, tables: &[Table], folder: &Path) -> Result<Searched> {
    let mut all = HEADER.to_owned();
    let (mut images, mut boxes, mut damaged_images) = (0, 0, 0);
    let mut spans: Vec<(f64, f64, &Path)> = Vec::new();
    for (number, table) in tables.iter().enumerate() {
        let text = fs::read_to_string(&table.path);
        let text = text.map_err(dataset::Error::io("read", &table.path))?;
        let mut rows = text.lines();
        let damaged = rows.next().and_then(|count| count.parse::<u64>().ok());
        damaged_images += damaged.unwrap_or_default();
        let mut last_s = table.first_image_s;
        for row in rows {
            let parts = row.split_once(',').zip(row.rsplit_once(','));
            let Some(((since, _), (before, track))) = parts else {
                continue;
            };
            let time_s = table.first_image_s + since.parse::<f64>().unwrap_or(f64::NAN);
            let pixel_box = before.get(since.len()..).unwrap_or_default();
            last_s = time_s;
            images += 1;
            let track = match track {
                "" => String::new(),
                track => format!("{number}.{track}"),
            };
            boxes += usize::from(!track.is_empty());
            let _ = writeln!(all, "{time_s:.6}{pixel_box},{track}");
        }
        let file = camera.videos[number].file.as_path();
        spans.push((table.first_image_s, last_s, file));
    }
    refuse_overlap(spans)?;
    if boxes == 0 {
        let first = &camera.videos[0].file;
        let why = if images == 0 {
            "and the camera's other videos have no image that can be decoded without errors; copy them again"
        } else {
            "and the camera's other videos show no aircraft that the detector finds; is it for such images (`--model`)?"
        };
        return Err(dataset::Error::corpus(first, why).into());
    }
    let table = folder.join(format!("{}.csv", camera.name));
    write(&table, &all)?;
    let names: Vec<String> = camera
        .videos
        .iter()
        .map(|video| name_of(&video.file))
        .collect();
    let blake3 = match tables {
        [one] => one.video_blake3.clone(),
        several => {
            let hashes: Vec<&str> = several.iter().map(|table| &*table.video_blake3).collect();
            blake3::hash(hashes.join("\n").as_bytes()).to_string()
        }
    };
    Ok(Searched {
        table,
        source: SourceFile {
            file: names.join(", "),
            blake3,
        },
        damaged_images,
    })
}

/// A camera takes one image at a time: files that overlap have a wrong start, or are of several cameras.
fn refuse_overlap(mut spans: Vec<(f64, f64, &Path)>) -> Result<()> {
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    for pair in spans.windows(2) {
        let [(_, end_s, before), (first_s, _, file)] = pair else {
            continue;
        };
        let overlap_s = end_s - first_s;
        if overlap_s >= MAX_OVERLAP_S {
            let why = format!(
                "begins {overlap_s:.1} s before {} of the same camera ends; correct their `first_image`",
                name_of(before)
            );
            return Err(dataset::Error::corpus(file, why).into());
        }
    }
    Ok(())
}

/// Name of a file, for people.
pub(crate) fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn write(path: &Path, text: &str) -> Result<()> {
    let mut new = NewFile::create(path)?;
    let written = new.file().write_all(text.as_bytes());
    written.map_err(dataset::Error::io("write", path))?;
    Ok(new.commit()?)
}

#[cfg(test)]
mod tests {
    use dataset::corpus::calibration::CameraEntry;
    use dataset::geometry::camera::CameraPose;
    use dataset::geometry::pose::Pose;

    use super::*;
    use crate::description::BoxFormat;

    const SIZE_PX: [u32; 2] = [640, 480];
    const BEGAN_S: f64 = 1_780_293_600.0;

    /// A camera with videos that begin at these times.
    fn camera(folder: &Path, began_s: &[f64]) -> CameraDescription {
        let [width_px, height_px] = SIZE_PX;
        let placed = CameraPose {
            pose: Pose {
                latitude_deg: 0.0,
                longitude_deg: 0.0,
                altitude_msl_m: 0.0,
                heading_true_deg: 0.0,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
            hfov_deg: 20.0,
        };
        let video = |(number, began_s): (usize, &f64)| Video {
            file: folder.join(format!("{number}.mp4")),
            first_image_s: Some(*began_s),
        };
        CameraDescription {
            name: "left".into(),
            boxes: PathBuf::new(),
            videos: began_s.iter().enumerate().map(video).collect(),
            format: BoxFormat::Csv,
            numbered: None,
            to_utc_s: 0.0,
            clock_sd_s: 10.0,
            drift_sd_ppm: 20.0,
            entry: CameraEntry::from_pose(placed, width_px, height_px),
            is_guess: false,
            position_sd_m: 0.0,
            direction_sd_deg: 0.0,
            focal_sd_pct: 0.0,
        }
    }

    /// Tables of videos whose images follow each other by a second, each with two damaged images.
    fn tables(camera: &CameraDescription, folder: &Path, images: u32) -> Vec<Table> {
        let table = |(number, video): (usize, &Video)| {
            let path = folder.join(format!("table-{number}.csv"));
            let rows: String = (0..images)
                .map(|second| format!("{second}.0,300.0,200.0,40.0,20.0,0.9,0\n"))
                .collect();
            write(&path, &format!("2\n{rows}")).unwrap();
            Table {
                path,
                first_image_s: video.first_image_s.unwrap(),
                video_blake3: String::new(),
                expected_images: u64::from(images) + 2,
            }
        };
        camera.videos.iter().enumerate().map(table).collect()
    }

    #[test]
    fn files_of_a_camera_may_follow_each_other_and_may_not_overlap() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let join = |began_s: [f64; 2]| {
            let camera = camera(folder, &began_s);
            joined(&camera, &tables(&camera, folder, 61), folder)
        };
        // In any order; starts are stated in whole seconds.
        let sound = join([BEGAN_S + 60.0, BEGAN_S]).ok().unwrap();
        assert_eq!(sound.damaged_images, 4);
        let error = join([BEGAN_S + 30.0, BEGAN_S]).err().unwrap().to_string();
        for words in ["0.mp4", "30.0 s before 1.mp4", "first_image"] {
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn videos_without_any_sound_image_are_refused_as_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let camera = camera(folder.path(), &[BEGAN_S]);
        let tables = tables(&camera, folder.path(), 0);
        let error = joined(&camera, &tables, folder.path()).err().unwrap();
        assert!(
            error.to_string().contains("no image that can be decoded"),
            "{error}"
        );
    }
}
