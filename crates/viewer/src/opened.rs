//! A scenario that the page shows, in one state of its folder: its tables, and its videos once they were checked.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock, PoisonError};

use axum::http::StatusCode;
use dataset::corpus::open_scenario::OpenScenario;
use dataset::corpus::scenario::ScenarioRecord;

use crate::pictures::{Form, Picture, Pictures};
use crate::server::refusal::Refusal;

/// An opened scenario.
pub(crate) struct Opened {
    pub(crate) files: OpenScenario,
    pub(crate) record: ScenarioRecord,
    views: BTreeMap<String, OpenedView>,
}

/// A view of it.
#[derive(Default)]
struct OpenedView {
    /// Its video, or why there is none.
    video: OnceLock<Result<PathBuf, String>>,
    /// Its decoder, while that works.
    pictures: Mutex<Option<Pictures>>,
}

impl Opened {
    pub(crate) fn new(files: OpenScenario) -> Result<Self, Refusal> {
        let record = files.record()?;
        let views = record.views.iter();
        Ok(Self {
            views: views
                .map(|view| (view.clone(), OpenedView::default()))
                .collect(),
            files,
            record,
        })
    }

    /// The file of a view's video, which is read whole and compared with the seal the first time.
    pub(crate) fn video(&self, view: &str) -> Result<&Path, Refusal> {
        let video = self.view(view)?.video.get_or_init(|| {
            let checked = self.files.video_path(view);
            checked.map_err(|error| error.to_string())
        });
        match video {
            Ok(path) => Ok(path),
            Err(message) => Err(Refusal::new(StatusCode::UNPROCESSABLE_ENTITY, message)),
        }
    }

    /// The image of a view at a tick.
    pub(crate) fn picture(&self, view: &str, tick: u32, form: Form) -> Result<Picture, Refusal> {
        if tick >= self.record.ticks {
            let message = format!(
                "tick {tick} is not in it, expected below {}",
                self.record.ticks
            );
            return Err(Refusal::not_found(message));
        }
        let path = self.video(view)?;
        let mut place = self
            .view(view)?
            .pictures
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let mut pictures = match place.take() {
            Some(pictures) => pictures,
            None => Pictures::open(path, self.record.frame_rate)?,
        };
        // After an error the decoder is opened again.
        let picture = pictures.at(tick, form, path)?;
        *place = Some(pictures);
        Ok(picture)
    }

    fn view(&self, view: &str) -> Result<&OpenedView, Refusal> {
        self.views.get(view).ok_or_else(|| {
            let known = self.record.views.join(", ");
            Refusal::not_found(format!(
                "view {view:?} is not in it, expected one of {known}"
            ))
        })
    }
}
