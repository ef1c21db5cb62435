//! An open scenario in one state: its tables, and its videos once they were checked.

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

/// An open view.
#[derive(Default)]
struct OpenedView {
    /// The video, or the reason why it is missing.
    video: OnceLock<Result<PathBuf, String>>,
    /// The decoder; `None` after a failure.
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

    /// A view's video file, which is read whole and compared with the seal the first time.
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
