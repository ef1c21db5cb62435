//! Thumbnails: one image per scenario, cut out around the aircraft where it is nearest while still well in sight.
//!
//! Ground-truth boxes say where that is, else detections; a scenario without either shows its last image. Thumbnails are made when a page
//! asks for them, a few at a time, and kept in memory.

use std::cmp::Ordering;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use axum::body::Bytes;
use axum::http::StatusCode;
use dataset::conditions::sight::{CloudBase, Sight};
use dataset::corpus::detections::models_of;
use dataset::corpus::seal::Seal;
use dataset::tables::frames::TickRow;
use dataset::tables::pixel_box::PixelBox;
use dataset::video::jpeg;
use image::imageops::thumbnail;
use report_page::crop::Part;
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;

use crate::library::Library;
use crate::opened::Opened;
use crate::server::refusal::Refusal;

/// Thumbnails made at the same time: images of the open scenario come first.
const AT_ONCE: usize = 2;
/// Thumbnails kept, bytes: about 1,000.
const KEPT_BYTES: usize = 16 << 20;
/// Maximum thumbnail width: about twice its place on a page.
const MAX_COLUMNS: u32 = 480;
/// Visible part from which on an aircraft counts as whole.
const WHOLE: f64 = 0.99;

/// The thumbnails that were made last.
pub(crate) struct Thumbnails {
    permits: Arc<Semaphore>,
    kept: Mutex<VecDeque<CachedThumbnail>>,
}

/// A cached thumbnail.
struct CachedThumbnail {
    id: String,
    seal: Seal,
    models: Vec<String>,
    jpeg: Bytes,
}

/// The image that a thumbnail is cut out of.
#[derive(Debug, Clone, PartialEq)]
struct Moment {
    view: String,
    tick: u32,
    aircraft: Option<PixelBox>,
}

impl Thumbnails {
    pub(crate) fn new() -> Self {
        Self {
            permits: Arc::new(Semaphore::new(AT_ONCE)),
            kept: Mutex::default(),
        }
    }

    fn find(&self, id: &str, seal: &Seal, models: &[String]) -> Option<Bytes> {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let is_it =
            |kept: &&CachedThumbnail| kept.id == id && kept.seal == *seal && kept.models == models;
        kept.iter().find(is_it).map(|kept| kept.jpeg.clone())
    }

    fn keep(&self, new: CachedThumbnail) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|old| old.id != new.id);
        kept.push_back(new);
        let mut bytes: usize = kept.iter().map(|kept| kept.jpeg.len()).sum();
        while bytes > KEPT_BYTES
            && let Some(oldest) = kept.pop_front()
        {
            bytes -= oldest.jpeg.len();
        }
    }
}

/// A scenario's thumbnail as JPEG.
///
/// # Errors
/// There is no intact scenario of this name, or its image cannot be read.
pub(crate) async fn read(library: Arc<Library>, id: String) -> Result<Bytes, Refusal> {
    // A request that is cancelled while waiting here uses no resources.
    let permits = library.thumbnails.permits.clone();
    let permit = permits.acquire_owned().await.map_err(failed)?;
    let shared = library.clone();
    spawn_blocking(move || {
        // Held to the end of the work, which goes on if the request is cancelled.
        let _permit = permit;
        let opened = shared.look_into(&id)?;
        let seal = opened.files.seal().clone();
        let models = models_of(opened.files.folder()).unwrap_or_default();
        if let Some(jpeg) = shared.thumbnails.find(&id, &seal, &models) {
            return Ok(jpeg);
        }
        let jpeg = make(&opened, &models)?;
        shared.thumbnails.keep(CachedThumbnail {
            id,
            seal,
            models,
            jpeg: jpeg.clone(),
        });
        Ok(jpeg)
    })
    .await
    .map_err(failed)?
}

fn failed(error: impl ToString) -> Refusal {
    Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, error)
}

fn make(opened: &Opened, models: &[String]) -> Result<Bytes, Refusal> {
    let Moment {
        view,
        tick,
        aircraft,
    } = moment(opened, models)?;
    let picture = opened.files.picture(&view, tick)?;
    let part = match &aircraft {
        Some(aircraft) => Part::around(aircraft, picture.size_px),
        None => Part::whole(picture.size_px),
    };
    let mut shown = part.cut(&picture.rgb, picture.size_px[0]);
    if shown.width() > MAX_COLUMNS {
        let rows = shown.height() * MAX_COLUMNS / shown.width();
        shown = thumbnail(&shown, MAX_COLUMNS, rows.max(1));
    }
    let (width, height) = shown.dimensions();
    Ok(jpeg(Path::new("the thumbnail"), &shown, [width, height])?.into())
}

/// The moment with the nearest aircraft well in sight, else the last one in the first view.
fn moment(opened: &Opened, models: &[String]) -> Result<Moment, Refusal> {
    let files = &opened.files;
    let found = match files.truth_boxes_if_labelled()? {
        Some(boxes) => {
            let clouds = CloudBase::of(opened.record.weather());
            let rows = files.frames()?.rows;
            let altitudes: BTreeMap<u32, f64> = rows.iter().map(altitude).collect();
            let first = boxes.iter().filter(|real| real.is_of_first());
            let candidates = first.map(|real| {
                let altitude_msl_m = altitudes.get(&real.tick).copied().unwrap_or_default();
                let sight = clouds.sight(altitude_msl_m, real.transmission);
                let is_clear = real.visible_fraction >= WHOLE && sight == Sight::Open;
                (is_clear, real.pixel_box, &real.view, real.tick)
            });
            nearest(candidates)
        }
        None => {
            // Damaged detections are named on the scenario's page.
            let detections = models.last().and_then(|model| files.detections(model).ok());
            detections.and_then(|found| {
                let candidates = found.boxes.iter();
                nearest(candidates.map(|one| (one.confirmed, one.pixel_box, &one.view, one.tick)))
            })
        }
    };
    let last = || {
        Some(Moment {
            view: opened.record.views.first()?.clone(),
            tick: opened.record.ticks.checked_sub(1)?,
            aircraft: None,
        })
    };
    found
        .or_else(last)
        .ok_or_else(|| Refusal::not_found("the scenario has no images"))
}

fn altitude(row: &TickRow) -> (u32, f64) {
    (row.tick, row.pose.altitude_msl_m)
}

/// The largest box that is clear, or of any if none is.
fn nearest<'a>(
    candidates: impl Iterator<Item = (bool, PixelBox, &'a String, u32)>,
) -> Option<Moment> {
    let order = |one: &(bool, PixelBox, _, _), other: &(bool, PixelBox, _, _)| -> Ordering {
        let by_sight = one.0.cmp(&other.0);
        by_sight.then(one.1.area().total_cmp(&other.1.area()))
    };
    let (_, aircraft, view, tick) = candidates.max_by(order)?;
    Some(Moment {
        view: view.clone(),
        tick,
        aircraft: Some(aircraft),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_clear_box_is_shown_and_without_a_clear_one_the_largest() {
        let view = "left".to_owned();
        let sized = |width_px: f64| PixelBox::from_edges(0.0, 0.0, width_px, 10.0);
        let boxes = [
            (true, sized(20.0), &view, 3),
            (true, sized(30.0), &view, 4),
            (false, sized(40.0), &view, 5),
        ];
        assert_eq!(nearest(boxes.into_iter()).unwrap().tick, 4);
        let hidden = boxes.map(|(_, pixel_box, view, tick)| (false, pixel_box, view, tick));
        assert_eq!(nearest(hidden.into_iter()).unwrap().tick, 5);
        assert_eq!(nearest(std::iter::empty()), None);
    }

    #[test]
    fn thumbnails_beyond_the_bound_are_forgotten_the_oldest_first() {
        let thumbnails = Thumbnails::new();
        let seal = Seal {
            config_hash: "0".into(),
            manifest_blake3: "1".into(),
            video_bytes: BTreeMap::new(),
        };
        for number in 0..5 {
            thumbnails.keep(CachedThumbnail {
                id: number.to_string(),
                seal: seal.clone(),
                models: Vec::new(),
                jpeg: vec![0; KEPT_BYTES / 4].into(),
            });
        }
        let has = |id: &str| thumbnails.find(id, &seal, &[]).is_some();
        assert_eq!(["0", "1", "4"].map(has), [false, true, true]);
        assert!(thumbnails.find("4", &seal, &["model".to_owned()]).is_none());
    }
}
