//! Content of the page: one corpus and some runs. Shared by all requests.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use dataset::corpus::Corpus;
use dataset::files::file_name;

use crate::opened::Opened;
use crate::pictures::thumbnail::Thumbnails;
use crate::run::Run;
use crate::server::refusal::Refusal;

/// Scenarios that stay open: the shown one, and the one before.
const MAX_OPENED: usize = 2;

/// The corpus and the runs.
pub(crate) struct Library {
    pub(crate) corpus: Corpus,
    pub(crate) runs: Vec<Run>,
    pub(crate) thumbnails: Thumbnails,
    opened: Mutex<Vec<Arc<Opened>>>,
}

impl Library {
    pub(crate) fn new(corpus: Corpus, runs: Vec<Run>) -> Self {
        Self {
            corpus,
            runs,
            thumbnails: Thumbnails::new(),
            opened: Mutex::default(),
        }
    }

    /// A scenario in its current state, which stays open: its images will be requested.
    ///
    /// # Errors
    /// The name is none of a scenario, or there is no intact one of this name.
    pub(crate) fn open(&self, id: &str) -> Result<Arc<Opened>, Refusal> {
        let opened = self.look_into(id)?;
        let mut list = self.list();
        list.retain(|other| other.record.id != id);
        list.truncate(MAX_OPENED - 1);
        list.insert(0, opened.clone());
        Ok(opened)
    }

    /// The scenario for a single request. Open scenarios stay open, as a page asks for many in turn.
    pub(crate) fn look_into(&self, id: &str) -> Result<Arc<Opened>, Refusal> {
        file_name::check_id(id).map_err(Refusal::not_found)?;
        let folder = self.corpus.scenario(id);
        let seal = folder.seal()?.ok_or_else(|| {
            Refusal::not_found(format!("scenario {id} is not recorded, or not yet"))
        })?;
        let known = |opened: &&Arc<Opened>| opened.record.id == id && *opened.files.seal() == seal;
        if let Some(opened) = self.list().iter().find(known) {
            return Ok(opened.clone());
        }
        Ok(Arc::new(Opened::new(folder.open()?)?))
    }

    fn list(&self) -> MutexGuard<'_, Vec<Arc<Opened>>> {
        self.opened.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
