//! One listing of the scenarios of a corpus in an object store.

use std::collections::{BTreeMap, BTreeSet};
use std::time::SystemTime;

use dataset::corpus::seal::DONE;
use dataset::files::file_name::{self, BadFileName};
use futures_util::TryStreamExt;
use futures_util::future::BoxFuture;

use crate::corpus_store::{CorpusStore, SCENARIOS, scenario_file};
use crate::error::Result;

/// Attributes of an object from a listing.
#[derive(Debug, Clone)]
pub(crate) struct ObjectInfo {
    pub(crate) bytes: u64,
    /// Time of writing, by the store's clock.
    pub(crate) modified: SystemTime,
    pub(crate) e_tag: Option<String>,
}

/// The objects of one scenario, by their names within it.
#[derive(Debug, Clone, Default)]
pub struct Objects(pub(crate) BTreeMap<String, ObjectInfo>);

/// The objects of all scenarios.
#[derive(Debug, Default)]
pub struct Listing {
    scenarios: BTreeMap<String, Objects>,
}

impl Listing {
    /// Identifiers of the committed scenarios: the ones with a seal.
    pub fn committed(&self) -> BTreeSet<String> {
        let sealed = self.sealed();
        sealed
            .filter(|id| file_name::check_id(id).is_ok())
            .map(str::to_owned)
            .collect()
    }

    /// Names that have a seal, but cannot be identifiers of scenarios, with the reason.
    pub fn foreign(&self) -> impl Iterator<Item = (&str, BadFileName)> {
        self.sealed()
            .filter_map(|id| Some((id, file_name::check_id(id).err()?)))
    }

    /// The objects of a scenario, committed or not.
    pub fn of(&self, id: &str) -> Objects {
        self.scenarios.get(id).cloned().unwrap_or_default()
    }

    fn sealed(&self) -> impl Iterator<Item = &str> {
        let sealed = self.scenarios.iter();
        sealed
            .filter(|(_, objects)| objects.0.contains_key(DONE))
            .map(|(id, _)| id.as_str())
    }
}

impl CorpusStore {
    /// Lists the objects of all scenarios.
    pub fn listing(&self) -> BoxFuture<'_, Result<Listing>> {
        Box::pin(async move {
            let mut listing = Listing::default();
            for (name, info) in self.list(SCENARIOS).await? {
                if let Some((id, file)) = name.split_once('/') {
                    let objects = listing.scenarios.entry(id.to_owned()).or_default();
                    objects.0.insert(file.to_owned(), info);
                }
            }
            Ok(listing)
        })
    }

    /// Lists the objects of one scenario, committed or not.
    pub(crate) async fn objects(&self, id: &str) -> Result<Objects> {
        let objects = self.list(&scenario_file(id, "")).await?;
        Ok(Objects(objects.into_iter().collect()))
    }

    /// Objects below a folder, with their names within it.
    async fn list(&self, folder: &str) -> Result<Vec<(String, ObjectInfo)>> {
        let folder_key = self.key(folder);
        let list = self.store.list(Some(&folder_key));
        let named = list.try_filter_map(|object| {
            let parts = object.location.prefix_match(&folder_key);
            let name = parts.map(|parts| {
                let parts: Vec<_> = parts.map(|part| part.as_ref().to_owned()).collect();
                parts.join("/")
            });
            let info = ObjectInfo {
                bytes: object.size,
                modified: object.last_modified.into(),
                e_tag: object.e_tag,
            };
            std::future::ready(Ok(name.map(|name| (name, info))))
        });
        named
            .try_collect()
            .await
            .map_err(|error| self.error(&format!("list {folder}"), &error))
    }
}
