//! The files of the whole corpus, ours and those in the store: which of two versions stays.

use dataset::corpus::Corpus;
use object_store::{PutMode, UpdateVersion};

use crate::corpus_store::CorpusStore;
use crate::error::StoreError;

/// Retries against others who write the same file at the same time.
const ROUNDS: u32 = 8;

/// The version of a file to keep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// The caller's.
    Ours,
    /// The existing one.
    Theirs,
}

/// The result for a file of the whole corpus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Settled {
    /// It was sent.
    Sent,
    /// The same content existed.
    Same,
    /// Other content existed and stays.
    Theirs,
}

impl CorpusStore {
    /// Uploads files of the whole corpus, by their names, in the order of [`Corpus::FILES`]. Where the store has another one, `judge`
    /// sees its name, the store's version, and which plan stayed: that is settled first, so a process that loses a race notices there,
    /// and files that belong to the plan can follow it.
    pub async fn settle_files<'a, E: From<StoreError>>(
        &self,
        files: impl IntoIterator<Item = (&'static str, &'a [u8])>,
        mut judge: impl FnMut(&'static str, &[u8], Keep) -> Result<Keep, E>,
    ) -> Result<(), E> {
        let mut plan = Keep::Ours;
        for (name, ours) in files {
            let settled = self
                .settle(name, ours, |theirs| judge(name, theirs, plan))
                .await?;
            if name == Corpus::PLAN && settled != Settled::Sent {
                plan = Keep::Theirs;
            }
        }
        Ok(())
    }

    /// Writes a file of the whole corpus unless it exists. If another one exists, `judge` sees it and decides. Of several
    /// concurrent writers one is first, and the others judge its file: the store compares, if it can (If-None-Match, If-Match).
    async fn settle<E: From<StoreError>>(
        &self,
        name: &str,
        ours: &[u8],
        mut judge: impl FnMut(&[u8]) -> Result<Keep, E>,
    ) -> Result<Settled, E> {
        self.own_key(name)?;
        // Tried first even if the file probably exists: so missing write permission shows now, not after the first scenario.
        let mut mode = PutMode::Create;
        for _ in 0..ROUNDS {
            match self.put(name, ours, mode).await {
                Ok(_) => return Ok(Settled::Sent),
                Err(
                    object_store::Error::AlreadyExists { .. }
                    | object_store::Error::Precondition { .. }
                    | object_store::Error::NotImplemented { .. },
                ) => {}
                Err(error) => return Err(self.error(&format!("write {name}"), &error).into()),
            }
            mode = match self.read_object(name).await? {
                // Stores without conditional writes.
                None => PutMode::Overwrite,
                Some((theirs, _)) if theirs == ours => return Ok(Settled::Same),
                Some((theirs, object)) => match judge(&theirs)? {
                    Keep::Theirs => return Ok(Settled::Theirs),
                    Keep::Ours if self.keeps_metadata() => PutMode::Update(UpdateVersion {
                        e_tag: object.e_tag,
                        version: object.version,
                    }),
                    // Folders have no versions.
                    Keep::Ours => PutMode::Overwrite,
                },
            };
        }
        Err(StoreError::Away {
            url: self.name().to_owned(),
            doing: format!("write {name}"),
            message: "others write it all the time".into(),
        }
        .into())
    }
}
