//! Object store client: requests, repeated while the store does not answer.

use std::collections::{BTreeMap, BTreeSet};
use std::env;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use dataset::corpus::claim::{Claim, Claimed};
use dataset::corpus::seal::{DONE, MANIFEST};
use dataset::corpus::{Corpus, ScenarioFolder, foreign_entries, is_plan};
use dataset::files::file_name::{self, BadFileName};
use dataset::files::outside_file::{self, FileKind};
use dataset::files::own_path::own_path;
use dataset::work::watch::Watch;
use futures_util::TryStreamExt;
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::local::LocalFileSystem;
use object_store::path::Path as ObjectPath;
use object_store::{
    Attribute, Attributes, BackoffConfig, ClientConfigKey, GetOptions, GetResult, ObjectMeta,
    ObjectStore, ObjectStoreExt, PutMode, PutOptions, PutResult, RetryConfig, UpdateVersion,
};
use tokio::time::{Instant, sleep, timeout};

use crate::error::{Result, StoreError, is_not_implemented};
use crate::location::StoreUrl;
use crate::stored::file_name;

/// Folder of the scenarios, as on disk.
const SCENARIOS: &str = "scenarios";
/// Key of the metadata that holds an object's BLAKE3 hash.
const HASH: &str = "blake3";
/// Folder of the locks in a `file://` store, as in a corpus.
const CLAIMS: &str = "claims";
/// Maximum size of objects that are read into memory: a plan has a hundred thousand scenarios at most.
const MAX_BYTES: u64 = 256 << 20;
/// A file in a `file://` store. The maximum size depends on the kind and is checked by the reader.
const OBJECT: FileKind = FileKind::new("object", u64::MAX);
/// Silence for this long counts as no answer: four parts of 8 MiB at once get through at 1.5 Mbit/s.
const MAX_SILENCE: Duration = Duration::from_secs(180);
/// The client's own limit is half a minute for a whole request: a video takes longer.
const MAX_REQUEST: &str = "1 day";
/// Requests are repeated this long without a message.
const MAX_QUIET_RETRIES: Duration = Duration::from_secs(8);
/// Longest wait for the first answer: wrong addresses show soon, whatever the timeout.
const MAX_FIRST_ANSWER: Duration = Duration::from_secs(20);
const FIRST_PAUSE: Duration = Duration::from_millis(500);
const MAX_PAUSE: Duration = Duration::from_secs(30);
/// Cancellation is noticed within this time while waiting.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// A corpus in an object store.
#[derive(Debug, Clone)]
pub struct CorpusStore {
    pub(crate) client: Arc<dyn ObjectStore>,
    /// Path of the corpus in the store.
    pub(crate) root: ObjectPath,
    /// Folder in a `file://` URL: its objects carry no metadata, and an entry may not be a regular file.
    pub(crate) folder: Option<PathBuf>,
    /// The URL, for messages.
    pub(crate) name: String,
    /// Longest time without progress while the store does not answer.
    pub(crate) timeout: Duration,
}

/// A store with the watch that hears of interruptions and can stop the work.
pub struct Connection<'a> {
    pub(crate) store: &'a CorpusStore,
    pub(crate) watch: &'a dyn Watch,
    bytes: AtomicU64,
}

/// Logs interruptions and never stops the work.
#[derive(Debug, Clone, Copy)]
pub struct Logged;

impl Watch for Logged {
    fn say(&self, line: &str) {
        tracing::warn!("{line}");
    }
}

impl CorpusStore {
    /// A corpus to read or, with `create`, to write. The store is not contacted yet.
    ///
    /// # Errors
    /// The environment lacks a setting, or the folder in a `file://` URL is missing.
    pub fn open(url: &StoreUrl, create: bool, timeout: Duration) -> Result<Self> {
        let name = url.to_string();
        if let Some(folder) = url.local_folder() {
            if create {
                fs::create_dir_all(&folder).map_err(dataset::Error::io("create", &folder))?;
            } else if !folder.is_dir() {
                return Err(StoreError::unusable(format!(
                    "{url}: there is no such folder"
                )));
            }
            let client = LocalFileSystem::new_with_prefix(&folder)
                .map_err(|error| StoreError::of(&name, "open it", &error))?
                .with_fsync(true);
            return Ok(Self {
                client: Arc::new(client),
                root: ObjectPath::default(),
                folder: Some(folder),
                name,
                timeout,
            });
        }
        let bucket = s3(url.0.as_str(), timeout).build();
        let bucket = bucket.map_err(|error| {
            StoreError::unusable(format!(
                "{name}: the environment lacks what is needed to reach it: {error}"
            ))
        })?;
        let root = ObjectPath::from_url_path(url.0.path())
            .map_err(|error| StoreError::bad_url(&name, error))?;
        Ok(Self {
            client: Arc::new(bucket),
            root,
            folder: None,
            name,
            timeout,
        })
    }

    /// The URL, as messages name it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The store with a watch: it is warned when the store does not answer, once per interruption.
    pub const fn watched<'a>(&'a self, watch: &'a dyn Watch) -> Connection<'a> {
        Connection {
            store: self,
            watch,
            bytes: AtomicU64::new(0),
        }
    }

    pub(crate) fn key(&self, name: &str) -> ObjectPath {
        let parts = name.split('/').filter(|part| !part.is_empty());
        parts.fold(self.root.clone(), |key, part| key.join(part))
    }

    /// Object key to read, write or delete. In a folder, a link may lead out of the store.
    pub(crate) fn own_key(&self, name: &str) -> Result<ObjectPath> {
        if let Some(folder) = &self.folder
            && let Err(error) = own_path(folder, name)
        {
            return Err(self.damaged(name, error));
        }
        Ok(self.key(name))
    }

    pub(crate) fn error(&self, doing: &str, error: &object_store::Error) -> StoreError {
        StoreError::of(&self.name, doing, error)
    }

    pub(crate) fn away(&self, doing: &str, message: &str) -> StoreError {
        StoreError::Away {
            url: self.name.clone(),
            doing: doing.into(),
            message: message.into(),
        }
    }

    pub(crate) fn not_kept(&self, name: &str) -> StoreError {
        StoreError::Failed {
            url: self.name.clone(),
            doing: format!("write {name}"),
            message: "the store confirmed the write but did not store it. If no other process writes there, a proxy or cache may \
                      drop or change what is written: connect to the store itself, and run the same command again"
                .into(),
        }
    }

    pub(crate) fn damaged(&self, name: &str, fault: impl std::fmt::Display) -> StoreError {
        StoreError::Damaged {
            place: format!("{}/{name}", self.name),
            message: fault.to_string(),
        }
    }

    pub(crate) fn attributes(&self, blake3: &str) -> Attributes {
        let mut attributes = Attributes::new();
        if self.folder.is_none() {
            attributes.insert(Attribute::Metadata(HASH.into()), blake3.to_owned().into());
        }
        attributes
    }

    pub(crate) async fn put(
        &self,
        name: &str,
        bytes: &[u8],
        options: PutOptions,
    ) -> object_store::Result<PutResult> {
        let payload = bytes.to_vec().into();
        self.client
            .put_opts(&self.key(name), payload, options)
            .await
    }
}

fn s3(url: &str, timeout: Duration) -> AmazonS3Builder {
    let silence = format!("{} seconds", timeout.min(MAX_SILENCE).as_secs().max(1));
    let client = |key| AmazonS3ConfigKey::Client(key);
    let mut builder = AmazonS3Builder::from_env()
        .with_url(url)
        .with_config(client(ClientConfigKey::ReadTimeout), silence)
        .with_config(client(ClientConfigKey::Timeout), MAX_REQUEST)
        .with_retry(RetryConfig {
            backoff: BackoffConfig {
                init_backoff: Duration::from_millis(100),
                max_backoff: Duration::from_secs(2),
                base: 2.0,
            },
            max_retries: 4,
            retry_timeout: MAX_QUIET_RETRIES.min(timeout / 2),
        });
    // An http:// endpoint is an explicit choice: Amazon's own tools do not ask twice.
    let endpoint = [AmazonS3ConfigKey::S3Endpoint, AmazonS3ConfigKey::Endpoint]
        .iter()
        .find_map(|key| builder.get_config_value(key));
    if endpoint.is_some_and(|endpoint| endpoint.starts_with("http://"))
        && env::var_os("AWS_ALLOW_HTTP").is_none()
    {
        builder = builder.with_allow_http(true);
    }
    builder
}

/// Repeated attempts at something that the store does not answer or does not keep.
pub(crate) struct Retries {
    since: Instant,
    pause: Duration,
    /// [`Connection::bytes`] when the current attempt began.
    bytes_before: u64,
    /// Bytes of the attempt that got furthest.
    max_bytes: u64,
}

impl Connection<'_> {
    /// Bytes transferred, including those of failed attempts.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    pub(crate) fn passed(&self, bytes: usize) {
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub(crate) fn retries(&self) -> Retries {
        Retries {
            since: Instant::now(),
            pause: FIRST_PAUSE,
            bytes_before: self.bytes(),
            max_bytes: 0,
        }
    }

    /// Waits before the next attempt, longer each time; returns the error of the last attempt once the timeout has passed.
    ///
    /// An attempt that transferred more than all earlier ones restarts the timeout. Bytes that are transferred again do not count:
    /// a store that always breaks off at the same place would be retried forever.
    pub(crate) async fn wait(&self, retries: &mut Retries, error: StoreError) -> Result<()> {
        let bytes = self.bytes() - retries.bytes_before;
        if bytes > retries.max_bytes {
            retries.max_bytes = bytes;
            retries.since = Instant::now();
            retries.pause = FIRST_PAUSE;
        }
        if retries.pause == FIRST_PAUSE {
            self.watch.warn(&format!("retrying the store: {error}"));
        }
        if retries.since.elapsed() + retries.pause > self.store.timeout {
            return Err(error);
        }
        let until = Instant::now() + retries.pause;
        while Instant::now() < until {
            self.watch.check()?;
            sleep(POLL_INTERVAL.min(until - Instant::now())).await;
        }
        retries.pause = (retries.pause * 2).min(MAX_PAUSE);
        retries.bytes_before = self.bytes();
        Ok(())
    }

    /// Repeats a request while the store does not answer.
    pub(crate) async fn ask<T>(&self, mut request: impl AsyncFnMut() -> Result<T>) -> Result<T> {
        let mut retries = self.retries();
        loop {
            self.watch.check()?;
            match request().await {
                Err(error) if error.is_passing() => self.wait(&mut retries, error).await?,
                other => return other,
            }
        }
    }

    /// The first request: a wrong address shows soon.
    async fn first<T>(
        &self,
        mut request: impl AsyncFnMut() -> object_store::Result<T>,
    ) -> Result<T> {
        let (store, doing) = (self.store, "list what is there");
        let limit = store.timeout.min(MAX_FIRST_ANSWER);
        let asked = self.ask(async || request().await.map_err(|error| store.error(doing, &error)));
        timeout(limit, asked).await.unwrap_or_else(|_| {
            let message = format!(
                "no answer within {limit:?} (without credentials in the environment the machine's own are looked for, which may take longer)"
            );
            Err(store.away(doing, &message))
        })
    }

    /// Checks that the store answers and grants access.
    ///
    /// # Errors
    /// No such bucket, wrong credentials or no answer.
    pub async fn check(&self) -> Result<()> {
        let store = self.store;
        self.first(async || store.client.list(Some(&store.root)).try_next().await)
            .await?;
        Ok(())
    }

    /// Checks the same, and rejects a prefix that contains anything but a corpus, as [`dataset::corpus::check_place`] does with a folder.
    ///
    /// # Errors
    /// See [`Self::check`]; also fails if there are other objects but no plan or committed scenario.
    pub async fn check_place(&self) -> Result<()> {
        let store = self.store;
        let listed = async || store.client.list_with_delimiter(Some(&store.root)).await;
        let found = self.first(listed).await?;
        let folders = found.common_prefixes.iter().filter_map(|it| it.filename());
        // Empty corpus files may be replaced.
        let is_vacant = |name: &str| Corpus::FILES.contains(&name);
        let objects = found.objects.iter().filter_map(|object| {
            let name = object.location.filename()?;
            (object.size > 0 || !is_vacant(name)).then_some(name)
        });
        let Some(found) = foreign_entries(folders.chain(objects).map(str::to_owned)) else {
            return Ok(());
        };
        let plan = self.read(Corpus::PLAN).await?;
        if plan.is_some_and(|text| is_plan(&text)) || !self.listing().await?.committed().is_empty()
        {
            return Ok(());
        }
        let url = store.name();
        Err(StoreError::unusable(format!(
            "{url}: is not a corpus, and contains {found}; expected a corpus, an empty prefix or a new name, such as {url}/corpus"
        )))
    }

    /// A small file, if it exists; named as in the corpus' folder.
    pub async fn read(&self, name: &str) -> Result<Option<Vec<u8>>> {
        Ok(self.read_object(name).await?.map(|(bytes, _)| bytes))
    }

    pub(crate) async fn read_object(&self, name: &str) -> Result<Option<(Vec<u8>, ObjectMeta)>> {
        // Objects that folder readers would reject are not downloaded.
        let max_bytes = match file_name(name).rsplit('/').next() {
            Some(MANIFEST) => FileKind::MANIFEST.most_bytes(),
            _ => MAX_BYTES,
        };
        self.ask(async || {
            let Some(got) = self.get(name, GetOptions::default()).await? else {
                return Ok(None);
            };
            let object = got.meta.clone();
            if object.size > max_bytes {
                let found = object.size;
                return Err(self.store.damaged(name, format!(
                    "is {found} bytes large, expected at most {max_bytes}; remove it from the store and push it again"
                )));
            }
            let bytes = got.bytes().await;
            let bytes = bytes.map_err(|error| self.store.error(&format!("read {name}"), &error))?;
            Ok(Some((bytes.to_vec(), object)))
        })
        .await
    }

    /// Opens an object, if it exists, without a retry.
    pub(crate) async fn get(&self, name: &str, options: GetOptions) -> Result<Option<GetResult>> {
        let store = self.store;
        let key = store.own_key(name)?;
        // A FIFO is refused: it has no writer, so opening it would block forever.
        if let Some(folder) = &store.folder
            && let Err(error) = outside_file::open(&folder.join(name), OBJECT)
            && !error.is_not_found()
        {
            return Err(store.damaged(name, format!("cannot be read: {error}")));
        }
        match store.client.get_opts(&key, options).await {
            Ok(got) => Ok(Some(got)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(store.error(&format!("read {name}"), &error)),
        }
    }

    /// BLAKE3 hash for an object, if it exists: from the metadata or, if `reads` is set or there is none, from the content.
    pub(crate) async fn hash_of(&self, name: &str, reads: bool) -> Result<Option<String>> {
        self.ask(async || {
            if !reads && self.store.folder.is_none() {
                let head = GetOptions {
                    head: true,
                    ..GetOptions::default()
                };
                let Some(got) = self.get(name, head).await? else {
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
            let mut content = got.into_stream();
            let failed = |error| self.store.error(&format!("read {name}"), &error);
            while let Some(bytes) = content.try_next().await.map_err(failed)? {
                self.watch.check()?;
                hasher.update(&bytes);
                self.passed(bytes.len());
            }
            Ok(Some(hasher.finalize().to_string()))
        })
        .await
    }

    /// Writes a small file unconditionally; named as in the corpus' folder.
    pub async fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        self.store.own_key(name)?;
        self.ask(async || {
            let put = self.store.put(name, bytes, PutOptions::default()).await;
            put.map_err(|error| self.store.error(&format!("write {name}"), &error))
        })
        .await?;
        Ok(())
    }

    /// Deletes a small file, if it exists. Looks first: permission to write does not imply permission to delete.
    pub async fn remove(&self, name: &str) -> Result<()> {
        if self.read(name).await?.is_none() {
            return Ok(());
        }
        let key = self.store.own_key(name)?;
        self.ask(async || match self.store.client.delete(&key).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(self.store.error(&format!("delete {name}"), &error)),
        })
        .await
    }

    /// Writes an object if it is still the version that was read (If-Match), or still missing (If-None-Match). Returns false if it is not.
    ///
    /// A folder and a store without conditions are compared just before the write; in a folder a lock is held meanwhile.
    pub(crate) async fn replace(
        &self,
        name: &str,
        bytes: &[u8],
        before: Option<&ObjectMeta>,
    ) -> Result<bool> {
        let store = self.store;
        store.own_key(name)?;
        let failed = |error| store.error(&format!("write {name}"), &error);
        let mode = match before {
            None => Some(PutMode::Create),
            Some(ObjectMeta { e_tag: None, .. }) => None,
            Some(before) => Some(PutMode::Update(UpdateVersion {
                e_tag: before.e_tag.clone(),
                version: before.version.clone(),
            })),
        };
        self.ask(async || {
            if let Some(mode) = mode.clone().filter(|_| store.folder.is_none()) {
                match store.put(name, bytes, mode.into()).await {
                    Ok(_) => return Ok(true),
                    Err(
                        object_store::Error::AlreadyExists { .. }
                        | object_store::Error::Precondition { .. },
                    ) => return Ok(false),
                    Err(error) if is_not_implemented(&error) => {}
                    Err(error) => return Err(failed(error)),
                }
            }
            let _claim = self.claim_in_folder(name)?;
            let head = GetOptions {
                head: true,
                ..GetOptions::default()
            };
            let now = self.get(name, head).await?;
            let now = now.map(|now| now.meta.e_tag);
            if now != before.map(|before| before.e_tag.clone()) {
                return Ok(false);
            }
            let put = store.put(name, bytes, PutOptions::default()).await;
            put.map_err(failed)?;
            Ok(true)
        })
        .await
    }

    /// Write lock in a `file://` store; `None` on a file system without locks, and in a bucket.
    fn claim_in_folder(&self, name: &str) -> Result<Option<Claim>> {
        let Some(folder) = &self.store.folder else {
            return Ok(None);
        };
        match Claim::take_in(&folder.join(CLAIMS), &name.replace('/', "-")) {
            Ok(Claimed::Mine(claim)) => Ok(Some(claim)),
            Ok(Claimed::Theirs(_)) => {
                let doing = format!("write {name}");
                Err(self.store.away(&doing, "another process holds its claim"))
            }
            Err(error) if error.is_of_disk() => Err(error.into()),
            Err(error) => {
                tracing::debug!(%error, name, "the store is a folder without locks");
                Ok(None)
            }
        }
    }

    /// Names of the files directly in a folder of the corpus.
    pub async fn names_in(&self, folder: &str) -> Result<BTreeSet<String>> {
        let listed = self.list(folder).await?;
        let names = listed.into_iter().map(|(name, _)| name);
        Ok(names.filter(|name| !name.contains('/')).collect())
    }

    /// Lists the scenarios.
    pub async fn listing(&self) -> Result<Listing> {
        let mut listed: BTreeMap<String, Listed> = BTreeMap::new();
        for (name, info) in self.list(SCENARIOS).await? {
            if let Some((id, name)) = name.split_once('/') {
                listed.entry(id.to_owned()).or_default().add(name, &info);
            }
        }
        listed.retain(|_, scenario| scenario.is_sealed);
        Ok(Listing(listed))
    }

    /// Lists a scenario's objects, committed or not.
    pub(crate) async fn objects(&self, id: &str) -> Result<Objects> {
        let objects = self.list(&scenario_file(id, "")).await?;
        Ok(Objects(objects.into_iter().collect()))
    }

    /// Objects below a folder, by their names there.
    async fn list(&self, folder: &str) -> Result<Vec<(String, ObjectInfo)>> {
        let key = self.store.key(folder);
        let named = |object: ObjectMeta| {
            let parts = object.location.prefix_match(&key)?;
            let parts: Vec<_> = parts.map(|part| part.as_ref().to_owned()).collect();
            let info = ObjectInfo {
                bytes: object.size,
                e_tag: object.e_tag,
                modified: object.last_modified.into(),
            };
            Some((parts.join("/"), info))
        };
        self.ask(async || {
            let listed = self.store.client.list(Some(&key));
            let listed: object_store::Result<Vec<_>> = listed.try_collect().await;
            let doing = format!("list {folder}");
            let listed = listed.map_err(|error| self.store.error(&doing, &error))?;
            Ok(listed.into_iter().filter_map(named).collect())
        })
        .await
    }
}

#[derive(Debug, Clone)]
pub(crate) struct ObjectInfo {
    pub(crate) bytes: u64,
    pub(crate) e_tag: Option<String>,
    pub(crate) modified: SystemTime,
}

/// A scenario's objects, by their names within the scenario.
#[derive(Debug, Clone, Default)]
pub(crate) struct Objects(pub(crate) BTreeMap<String, ObjectInfo>);

/// Scenarios that have a seal.
#[derive(Debug, Default)]
pub struct Listing(BTreeMap<String, Listed>);

/// A scenario, by the names of its objects.
#[derive(Debug, Default)]
pub struct Listed {
    is_sealed: bool,
    /// True with ground-truth boxes.
    pub is_labelled: bool,
    /// True with detections.
    pub is_searched: bool,
    /// When its last video was stored.
    pub recorded: Option<SystemTime>,
}

impl Listed {
    fn add(&mut self, name: &str, info: &ObjectInfo) {
        match file_name(name).as_str() {
            DONE => self.is_sealed = true,
            ScenarioFolder::TRUTH_BOXES => self.is_labelled = true,
            name if name.starts_with("detections/") => self.is_searched = true,
            name if name.starts_with("views/") => {
                self.recorded = self.recorded.max(Some(info.modified));
            }
            _ => {}
        }
    }
}

impl Listing {
    /// Identifiers of the committed scenarios.
    pub fn committed(&self) -> BTreeSet<String> {
        let names = self.0.keys().cloned();
        names
            .filter(|name| file_name::check_id(name).is_ok())
            .collect()
    }

    /// Names that cannot be identifiers of scenarios, with the reason.
    pub fn foreign(&self) -> impl Iterator<Item = (&str, BadFileName)> {
        let names = self.0.keys();
        names.filter_map(|name| Some((name.as_str(), file_name::check_id(name).err()?)))
    }

    /// A scenario that has a seal.
    pub fn scenario(&self, id: &str) -> Option<&Listed> {
        self.0.get(id)
    }
}

pub(crate) fn scenario_file(id: &str, file: &str) -> String {
    format!("{SCENARIOS}/{id}/{file}")
}
