//! Replaces a small object only if it has not changed since it was read: the seal that commits a scenario, the record that commits
//! detections.
//!
//! Stores compare on the server (If-None-Match, If-Match). A folder cannot: there, the scenario's claim is held while the object is
//! compared and written. A store with neither is compared just before it is written.

use std::time::Duration;

use dataset::corpus::claim::{Claim, Claimed};
use object_store::{PutMode, UpdateVersion};
use tokio::time::sleep;

use crate::corpus_store::{CorpusStore, scenario_file};
use crate::error::{Result, StoreError};

/// Folder of the claims of a store that is a folder, as in a corpus.
const CLAIMS: &str = "claims";
/// A claim is held while one small file is written.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
const MAX_POLLS: u32 = 3_000;

impl CorpusStore {
    /// Writes an object of a scenario if it is still the version that was read, or still missing. Returns whether it was written.
    pub(crate) async fn replace_version(
        &self,
        id: &str,
        file: &str,
        bytes: &[u8],
        before: Option<&UpdateVersion>,
    ) -> Result<bool> {
        let name = scenario_file(id, file);
        self.own_key(&name)?;
        let mode = before.map_or(PutMode::Create, |before| PutMode::Update(before.clone()));
        let put = if self.keeps_metadata() {
            self.put(&name, bytes, mode).await
        } else {
            self.put_claimed(id, &name, bytes, before).await?
        };
        match put {
            Ok(_) => Ok(true),
            Err(
                object_store::Error::AlreadyExists { .. }
                | object_store::Error::Precondition { .. },
            ) => Ok(false),
            Err(object_store::Error::NotImplemented { .. }) => {
                if !self.is_version(&name, before).await? {
                    return Ok(false);
                }
                self.put(&name, bytes, PutMode::Overwrite)
                    .await
                    .map_err(|error| self.error(&format!("write {name}"), &error))?;
                Ok(true)
            }
            Err(error) => Err(self.error(&format!("write {name}"), &error)),
        }
    }

    /// The same in a folder, where the only built-in comparison is whether a file exists.
    async fn put_claimed(
        &self,
        id: &str,
        name: &str,
        bytes: &[u8],
        before: Option<&UpdateVersion>,
    ) -> Result<object_store::Result<object_store::PutResult>> {
        let _claim = self.claim_in_folder(id).await?;
        if before.is_none() {
            return Ok(self.put(name, bytes, PutMode::Create).await);
        }
        if !self.is_version(name, before).await? {
            return Ok(Err(object_store::Error::Precondition {
                path: name.to_owned(),
                source: "another process has written it".into(),
            }));
        }
        Ok(self.put(name, bytes, PutMode::Overwrite).await)
    }

    /// The claim of a scenario of a store that is a folder; `None` on a file system without locks.
    async fn claim_in_folder(&self, id: &str) -> Result<Option<Claim>> {
        let Some(folder) = self.folder() else {
            return Ok(None);
        };
        for _ in 0..MAX_POLLS {
            match Claim::take_in(&folder.join(CLAIMS), id) {
                Ok(Claimed::Mine(claim)) => return Ok(Some(claim)),
                Ok(Claimed::Theirs(_)) => sleep(POLL_INTERVAL).await,
                Err(error) if error.is_of_disk() => return Err(error.into()),
                Err(error) => {
                    tracing::debug!(%error, id, "the store is a folder without locks");
                    return Ok(None);
                }
            }
        }
        Err(StoreError::Away {
            url: self.name().into(),
            doing: format!("write scenario {id}"),
            message: "another process holds its claim".into(),
        })
    }

    async fn is_version(&self, name: &str, before: Option<&UpdateVersion>) -> Result<bool> {
        let now = self.read_object(name).await?;
        Ok(match (now, before) {
            (None, None) => true,
            (Some((_, now)), Some(before)) => now.e_tag == before.e_tag,
            _ => false,
        })
    }
}
