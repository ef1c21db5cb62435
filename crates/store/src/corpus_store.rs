//! A corpus in an object store: its committed scenarios, and the files of the whole corpus.

mod commit;
mod leftovers;
mod listing;
mod open;
mod place;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use dataset::corpus::seal::MANIFEST;
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use futures_util::future::BoxFuture;
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::path::Path as ObjectPath;
use object_store::{
    Attribute, Attributes, GetOptions, GetResult, ObjectMeta, ObjectStore, ObjectStoreExt, PutMode,
    PutOptions, PutResult,
};

use self::leftovers::Unfinished;
use self::open::{Opened, open};
use crate::error::{Result, StoreError};
use crate::location::StoreUrl;
use crate::scenario::{Committed, file_name};

pub(crate) use listing::ObjectInfo;
pub use listing::{Listing, Objects};

/// Folder of the scenarios, as on disk.
pub(crate) const SCENARIOS: &str = "scenarios";
/// Key of the metadata that holds an object's hash.
const HASH: &str = "blake3";
/// Small requests in parallel.
const QUESTIONS_AT_ONCE: usize = 16;
/// The largest object that is read into memory: a plan of a hundred thousand scenarios. Anything larger is not ours.
const MAX_BYTES: u64 = 256 << 20;
/// A file of a store that is a folder. Its maximum size depends on its kind.
const OBJECT: FileKind = FileKind::new("object", u64::MAX);
/// A corpus in an object store.
#[derive(Debug, Clone)]
pub struct CorpusStore {
    pub(crate) store: Arc<dyn ObjectStore>,
    root: ObjectPath,
    /// The folder, if it is one: its objects carry no metadata, and an entry may not be a regular file.
    folder: Option<PathBuf>,
    /// The URL, for messages.
    name: String,
    /// Place where incomplete uploads are listed.
    pub(crate) unfinished: Unfinished,
}

impl CorpusStore {
    /// A corpus to read or, with `create`, to write. The store is not contacted yet.
    ///
    /// # Errors
    /// The environment lacks what is needed to reach it.
    pub fn open(url: &StoreUrl, create: bool) -> Result<Self> {
        let Opened {
            store,
            root,
            folder,
            unfinished,
        } = open(url, create)?;
        Ok(Self {
            store,
            root,
            folder,
            name: url.to_string(),
            unfinished,
        })
    }

    /// A store in memory.
    #[cfg(test)]
    pub(crate) fn in_memory() -> Self {
        Self::over(Arc::new(object_store::memory::InMemory::new()))
    }

    /// A corpus in this store.
    #[cfg(test)]
    pub(crate) fn over(store: Arc<dyn ObjectStore>) -> Self {
        Self {
            store,
            root: ObjectPath::from("corpora/small"),
            folder: None,
            name: "memory:///corpora/small".into(),
            unfinished: Unfinished::Nowhere,
        }
    }

    /// The URL, as messages name it.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub(crate) fn root(&self) -> &ObjectPath {
        &self.root
    }

    /// The states of several scenarios of a listing; the ones without a seal are left out.
    pub async fn states(
        &self,
        listing: &Listing,
        ids: impl IntoIterator<Item = String>,
    ) -> Result<BTreeMap<String, Committed>> {
        let committed = listing.committed();
        let ids = ids.into_iter().filter(|id| committed.contains(id));
        let states = ids.map(|id| async move {
            let state = self.committed_state(&id, Some(&listing.of(&id))).await?;
            Ok::<_, StoreError>((id, state))
        });
        stream::iter(states)
            .buffer_unordered(QUESTIONS_AT_ONCE)
            .try_filter(|(_, state)| std::future::ready(*state != Committed::No))
            .try_collect()
            .await
    }

    /// A small file, if it exists; named as in the corpus' folder.
    pub fn read<'a>(&'a self, name: &'a str) -> BoxFuture<'a, Result<Option<Vec<u8>>>> {
        Box::pin(async move { Ok(self.read_object(name).await?.map(|(bytes, _)| bytes)) })
    }

    pub(crate) async fn read_object(&self, name: &str) -> Result<Option<(Vec<u8>, ObjectMeta)>> {
        let Some(got) = self.get(name, GetOptions::default()).await? else {
            return Ok(None);
        };
        let object = got.meta.clone();
        // Objects that readers of a folder would reject are not downloaded.
        let most_bytes = match file_name(name).rsplit('/').next() {
            Some(MANIFEST) => FileKind::MANIFEST.most_bytes(),
            _ => MAX_BYTES,
        };
        if object.size > most_bytes {
            return Err(StoreError::Damaged {
                place: format!("{}/{name}", self.name),
                message: format!(
                    "is {} bytes large, expected at most {most_bytes}; remove it from the store and push it again",
                    object.size
                ),
            });
        }
        let bytes = got
            .bytes()
            .await
            .map_err(|error| self.error(&format!("read {name}"), &error))?;
        Ok(Some((bytes.to_vec(), object)))
    }

    pub(crate) fn keeps_metadata(&self) -> bool {
        self.folder.is_none()
    }

    /// The folder that is the store, if it is one.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// An object, if it exists.
    pub(crate) async fn get(&self, name: &str, options: GetOptions) -> Result<Option<GetResult>> {
        let key = self.own_key(name)?;
        // A FIFO is refused: it has no writer, so opening it would block forever.
        if let Some(folder) = &self.folder
            && let Err(error) = outside_file::open(&folder.join(name), OBJECT)
            && !error.is_not_found()
        {
            return Err(StoreError::Damaged {
                place: format!("{}/{name}", self.name),
                message: format!("cannot be read: {error}"),
            });
        }
        match self.store.get_opts(&key, options).await {
            Ok(got) => Ok(Some(got)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.error(&format!("read {name}"), &error)),
        }
    }

    /// Writes a small file unconditionally; named as in the corpus' folder.
    pub fn write<'a>(&'a self, name: &'a str, bytes: &'a [u8]) -> BoxFuture<'a, Result<()>> {
        Box::pin(async move {
            self.own_key(name)?;
            self.put(name, bytes, PutMode::Overwrite)
                .await
                .map_err(|error| self.error(&format!("write {name}"), &error))?;
            Ok(())
        })
    }

    /// Deletes a small file, if it exists. Checks first: write permission does not imply permission to delete.
    pub fn remove<'a>(&'a self, name: &'a str) -> BoxFuture<'a, Result<()>> {
        Box::pin(async move {
            match self.read(name).await? {
                Some(_) => self.delete(name).await,
                None => Ok(()),
            }
        })
    }

    /// Deletes an object, if it exists.
    pub(crate) async fn delete(&self, name: &str) -> Result<()> {
        match self.store.delete(&self.own_key(name)?).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.error(&format!("delete {name}"), &error)),
        }
    }

    /// Names of the files directly in a folder of the corpus.
    pub fn names_in<'a>(&'a self, folder: &'a str) -> BoxFuture<'a, Result<BTreeSet<String>>> {
        Box::pin(async move {
            let folder_key = self.key(folder);
            let list = self.store.list_with_delimiter(Some(&folder_key)).await;
            let found = list.map_err(|error| self.error(&format!("list {folder}"), &error))?;
            let names = found.objects.iter();
            Ok(names
                .filter_map(|object| Some(object.location.filename()?.to_owned()))
                .collect())
        })
    }

    pub(crate) async fn put(
        &self,
        name: &str,
        bytes: &[u8],
        mode: PutMode,
    ) -> object_store::Result<PutResult> {
        let options = PutOptions {
            mode,
            ..PutOptions::default()
        };
        self.store
            .put_opts(&self.key(name), bytes.to_vec().into(), options)
            .await
    }

    /// BLAKE3 hash of an object, if it exists: the one in its metadata. Objects without, such as a folder's files, are read.
    pub(crate) async fn hash_of(&self, name: &str) -> Result<Option<String>> {
        if self.keeps_metadata() {
            let options = GetOptions {
                head: true,
                ..GetOptions::default()
            };
            let Some(got) = self.get(name, options).await? else {
                return Ok(None);
            };
            if let Some(hash) = got.attributes.get(&Attribute::Metadata(HASH.into())) {
                return Ok(Some((**hash).to_owned()));
            }
        }
        let Some(got) = self.get(name, GetOptions::default()).await? else {
            return Ok(None);
        };
        let mut hasher = blake3::Hasher::new();
        let mut stream = got.into_stream();
        while let Some(bytes) = stream
            .try_next()
            .await
            .map_err(|error| self.error(&format!("read {name}"), &error))?
        {
            hasher.update(&bytes);
        }
        Ok(Some(hasher.finalize().to_string()))
    }

    /// The metadata of an object with this hash.
    pub(crate) fn attributes(&self, blake3: &str) -> Attributes {
        let mut attributes = Attributes::new();
        if self.keeps_metadata() {
            attributes.insert(Attribute::Metadata(HASH.into()), blake3.to_owned().into());
        }
        attributes
    }

    /// The key of an object to read, write or delete. In a folder a link may lead out of the store.
    pub(crate) fn own_key(&self, name: &str) -> Result<ObjectPath> {
        if let Some(folder) = &self.folder
            && let Err(error) = own_path(folder, name)
        {
            return Err(StoreError::Damaged {
                place: format!("{}/{name}", self.name),
                message: error.to_string(),
            });
        }
        Ok(self.key(name))
    }

    pub(crate) fn key(&self, name: &str) -> ObjectPath {
        let parts = name.split('/').filter(|part| !part.is_empty());
        parts.fold(self.root.clone(), |key, part| key.join(part))
    }

    pub(crate) fn error(&self, doing: &str, error: &object_store::Error) -> StoreError {
        StoreError::of(&self.name, doing, error)
    }
}

/// Name of a scenario's file in the corpus.
pub(crate) fn scenario_file(id: &str, file: &str) -> String {
    format!("{SCENARIOS}/{id}/{file}")
}
