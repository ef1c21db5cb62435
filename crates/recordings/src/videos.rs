//! Videos of cameras: the times of their images, and the boxes that a detector finds in them.
//!
//! Videos are searched side by side, image by image. When a video ends, its boxes become a table in the workshop, named after the video,
//! the camera and the detector, so that no later import searches that video again.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

use dataset::corpus::scenario::SourceFile;
use dataset::corpus::seal::hash_file;
use dataset::files::new_file::NewFile;
use dataset::video::VideoReader;
use dataset::work::watch::{Stopped, Watch};
use dataset::work::workers;
use generator::tracks::utc_s;
use labeller::{Searcher, SeenBox, VideoImages};

use crate::description::{CameraDescription, UTC_S, Video};
use crate::error::{Error, Result};

/// Hexadecimal digits that name a table.
const NAME_DIGITS: usize = 32;
/// First line of a camera's table. A video's table has none; its times count from its first image, and its tracks from 0.
const HEADER: &str = "time,cx,cy,width,height,score,track\n";

/// A table of the boxes in a camera's videos, and where they come from.
pub(crate) struct Searched {
    pub(crate) table: PathBuf,
    pub(crate) source: SourceFile,
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
    // A video that cannot be opened is refused below.
    let opened = items.iter().flat_map(|item| item.open());
    watch.begin("", opened.map(|reader| reader.expected_images()).sum());
    let done = Mutex::new(0);
    let images_done = |count: u64| {
        let mut done = locked(&done);
        *done += count;
        watch.advance(*done, "");
    };
    let found: Vec<Mutex<Option<Result<Table>>>> = items.iter().map(|_| Mutex::default()).collect();
    let next = AtomicUsize::new(0);
    let has_failed = AtomicBool::new(false);
    let is_over = || watch.is_stopped() || has_failed.load(Ordering::Relaxed);
    let work = || -> Result<()> {
        loop {
            let at = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(at) else {
                return Ok(());
            };
            match item.table(searcher, folder, &images_done, &is_over) {
                Err(error) if !error.is_of_a_file() => {
                    has_failed.store(true, Ordering::Relaxed);
                    return Err(error);
                }
                table => *locked(&found[at]) = Some(table),
            }
        }
    };
    let cores = thread::available_parallelism().map_or(1, usize::from);
    workers::share(cores.min(items.len()), work)?;
    let mut found = found.iter().filter_map(|table| locked(table).take());
    let of_camera = |camera: &&CameraDescription| {
        let tables: Vec<Result<Table>> = found.by_ref().take(camera.videos.len()).collect();
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

    /// The video's table, from the workshop if an earlier import has made it.
    fn table(
        &self,
        searcher: &Searcher,
        folder: &Path,
        images_done: &dyn Fn(u64),
        is_over: &dyn Fn() -> bool,
    ) -> Result<Table> {
        let reader = self.open()?;
        let first_image_s = self.first_image_s(&reader)?;
        let video_blake3 = hash_file(&self.video.file)?;
        let entry = serde_json::to_string(&self.camera.entry).unwrap_or_default();
        let all = format!("{video_blake3} {} {entry}", searcher.identity());
        let name = blake3::hash(all.as_bytes()).to_hex();
        let path = folder.join(format!("{}.csv", &name[..NAME_DIGITS]));
        if path.exists() {
            images_done(reader.expected_images());
        } else {
            let rows = self.searched(reader, searcher, images_done, is_over)?;
            write(&path, &rows)?;
        }
        Ok(Table {
            path,
            first_image_s,
            video_blake3,
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

    /// A row for each box of a track that counts, and for each image without one.
    fn searched(
        &self,
        reader: VideoReader,
        searcher: &Searcher,
        images_done: &dyn Fn(u64),
        is_over: &dyn Fn() -> bool,
    ) -> Result<String> {
        let unit_s = reader.time_base().seconds();
        let mut search = searcher.view_search(&self.camera.entry.camera())?;
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
            let since_s = (pts - *first_pts.get_or_insert(pts)) as f64 * unit_s;
            let boxes = search.look(&mut images, since_s)?.boxes;
            counts.extend(
                boxes
                    .iter()
                    .filter(|seen| seen.counts)
                    .map(|seen| seen.track),
            );
            found.push((since_s, boxes));
            images_done(1);
        }
        let mut rows = String::new();
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
    let mut boxes = 0;
    for (number, table) in tables.iter().enumerate() {
        let text = fs::read_to_string(&table.path);
        let text = text.map_err(dataset::Error::io("read", &table.path))?;
        for row in text.lines() {
            let parts = row.split_once(',').zip(row.rsplit_once(','));
            let Some(((since, _), (before, track))) = parts else {
                continue;
            };
            let time_s = table.first_image_s + since.parse::<f64>().unwrap_or(f64::NAN);
            let pixel_box = before.get(since.len()..).unwrap_or_default();
            let track = match track {
                "" => String::new(),
                track => format!("{number}.{track}"),
            };
            boxes += usize::from(!track.is_empty());
            let _ = writeln!(all, "{time_s:.6}{pixel_box},{track}");
        }
    }
    if boxes == 0 {
        let first = &camera.videos[0].file;
        let why = "and the camera's other videos show no aircraft that the detector finds; is it for such images (`--model`)?";
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
    })
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
