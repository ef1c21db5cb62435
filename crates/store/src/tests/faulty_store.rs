//! A store in memory that answers late, loses answers, applies writes long after, and counts requests; all of it by a seed.

use std::fmt;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use futures_util::stream::{self, BoxStream};
use futures_util::{StreamExt, TryStreamExt};
use object_store::memory::InMemory;
use object_store::path::Path;
use object_store::{
    CopyOptions, GetOptions, GetResult, GetResultPayload, ListResult, MultipartUpload, ObjectMeta,
    ObjectStore, ObjectStoreExt, PutMode, PutMultipartOptions, PutOptions, PutPayload, PutResult,
    Result,
};
use tokio::task::{JoinHandle, yield_now};

/// The disturbances of a store.
#[derive(Debug, Clone, Copy)]
pub(super) struct Faults {
    /// Seed of all choices.
    pub(super) seed: u64,
    /// The longest delay of a request, in turns of the other tasks.
    pub(super) most_turns: u64,
    /// One of this number of writes is applied very late, half of these after the sender received an error. 0 for none.
    pub(super) late_write_of: u64,
    /// One of this number of requests is answered with 503. 0 for none.
    pub(super) unavailable_of: u64,
    /// True if the store compares versions.
    pub(super) is_conditional: bool,
    /// True if every answer with content breaks off after its first half.
    pub(super) cuts_content: bool,
    /// Writes of keys with this text are confirmed, and nothing is kept.
    pub(super) drops: Option<&'static str>,
    /// Objects of keys with this text have a flipped bit, with the size and ETag as before.
    pub(super) rots: Option<&'static str>,
    /// True if there is a key with an empty part.
    pub(super) has_stray_key: bool,
}

impl Faults {
    pub(super) const NONE: Self = Self {
        seed: 0,
        most_turns: 0,
        late_write_of: 0,
        unavailable_of: 0,
        is_conditional: true,
        cuts_content: false,
        drops: None,
        rots: None,
        has_stray_key: false,
    };
}

/// Numbers of requests.
#[derive(Debug, Default)]
pub(super) struct Requests {
    pub(super) lists: AtomicU32,
    pub(super) heads: AtomicU32,
    pub(super) gets: AtomicU32,
    pub(super) puts: AtomicU32,
}

/// A store that behaves as its faults say.
#[derive(Debug)]
pub(super) struct FaultyStore {
    inner: Arc<dyn ObjectStore>,
    faults: Faults,
    random: Random,
    late: Mutex<Vec<JoinHandle<()>>>,
    pub(super) requests: Requests,
}

/// Pseudo-random numbers (SplitMix64).
#[derive(Debug)]
pub(super) struct Random(Mutex<u64>);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        Self(Mutex::new(seed))
    }

    /// A number below `end`, which is not zero.
    pub(super) fn below(&self, end: u64) -> u64 {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = *state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % end
    }
}

impl FaultyStore {
    pub(super) fn new(faults: Faults) -> Arc<Self> {
        Self::over(Arc::new(InMemory::new()), faults)
    }

    /// The disturbances in front of an existing store.
    pub(super) fn over(inner: Arc<dyn ObjectStore>, faults: Faults) -> Arc<Self> {
        Arc::new(Self {
            inner,
            faults,
            random: Random::new(faults.seed),
            late: Mutex::default(),
            requests: Requests::default(),
        })
    }

    /// Waits until all late writes are applied.
    pub(super) async fn settle(&self) {
        loop {
            let late = std::mem::take(&mut *self.late.lock().unwrap());
            if late.is_empty() {
                return;
            }
            for write in late {
                write.await.unwrap();
            }
        }
    }

    /// Deletes one object, whichever.
    pub(super) async fn lose_one(&self, random: &Random) {
        let all: Vec<ObjectMeta> = self.inner.list(None).try_collect().await.unwrap();
        if !all.is_empty() {
            let lost = &all[random.below(all.len() as u64) as usize];
            self.inner.delete(&lost.location).await.unwrap();
        }
    }

    fn is_in(&self, text: Option<&str>, location: &Path) -> bool {
        text.is_some_and(|text| location.as_ref().contains(text))
    }

    async fn wait(&self) -> Result<()> {
        for _ in 0..self.random.below(self.faults.most_turns + 1) {
            yield_now().await;
        }
        let one_of = self.faults.unavailable_of;
        if one_of > 0 && self.random.below(one_of) == 0 {
            return Err(unavailable());
        }
        Ok(())
    }
}

impl fmt::Display for FaultyStore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a faulty store")
    }
}

fn unavailable() -> object_store::Error {
    object_store::Error::Generic {
        store: "faulty",
        source: "Server returned non-2xx status code: 503 Service Unavailable".into(),
    }
}

#[async_trait]
impl ObjectStore for FaultyStore {
    async fn put_opts(
        &self,
        location: &Path,
        payload: PutPayload,
        options: PutOptions,
    ) -> Result<PutResult> {
        self.requests.puts.fetch_add(1, Ordering::Relaxed);
        if !self.faults.is_conditional && !matches!(options.mode, PutMode::Overwrite) {
            // As the client words the answer of a gateway.
            return Err(object_store::Error::Generic {
                store: "faulty",
                source: "Server returned non-2xx status code: 501 Not Implemented".into(),
            });
        }
        self.wait().await?;
        let is_late =
            self.faults.late_write_of > 0 && self.random.below(self.faults.late_write_of) == 0;
        if !is_late {
            let nowhere = InMemory::new();
            let is_dropped = self.is_in(self.faults.drops, location);
            let kept: &dyn ObjectStore = if is_dropped { &nowhere } else { &*self.inner };
            let put = kept.put_opts(location, payload, options).await;
            self.wait().await?;
            return put;
        }
        let turns = self.random.below(40 * self.faults.most_turns);
        if self.random.below(2) == 0 {
            for _ in 0..turns {
                yield_now().await;
            }
            return self.inner.put_opts(location, payload, options).await;
        }
        let (inner, location) = (self.inner.clone(), location.clone());
        let write = tokio::spawn(async move {
            for _ in 0..turns {
                yield_now().await;
            }
            // The sender has given up: there is no one to return the result to.
            let _ = inner.put_opts(&location, payload, options).await;
        });
        self.late.lock().unwrap().push(write);
        Err(unavailable())
    }

    async fn put_multipart_opts(
        &self,
        location: &Path,
        options: PutMultipartOptions,
    ) -> Result<Box<dyn MultipartUpload>> {
        self.inner.put_multipart_opts(location, options).await
    }

    async fn get_opts(&self, location: &Path, options: GetOptions) -> Result<GetResult> {
        let counter = if options.head {
            &self.requests.heads
        } else {
            &self.requests.gets
        };
        counter.fetch_add(1, Ordering::Relaxed);
        self.wait().await?;
        let is_cut = self.faults.cuts_content && !options.head;
        let mut got = self.inner.get_opts(location, options.clone()).await?;
        if is_cut && location.extension() == Some("mp4") {
            let half = got.meta.size / 2;
            let bytes = self.inner.get_range(location, 0..half).await?;
            let cut = stream::iter([Ok(bytes), Err(unavailable())]);
            got.payload = GetResultPayload::Stream(cut.boxed());
        }
        if !options.head && self.is_in(self.faults.rots, location) {
            let mut bytes = got.bytes().await?.to_vec();
            bytes[0] ^= 1;
            let bytes = stream::iter([Ok(bytes.into())]).boxed();
            got = self.inner.get_opts(location, GetOptions::default()).await?;
            got.payload = GetResultPayload::Stream(bytes);
        }
        self.wait().await?;
        Ok(got)
    }

    fn delete_stream(
        &self,
        locations: BoxStream<'static, Result<Path>>,
    ) -> BoxStream<'static, Result<Path>> {
        self.inner.delete_stream(locations)
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        self.requests.lists.fetch_add(1, Ordering::Relaxed);
        if self.faults.has_stray_key {
            let stray = Path::parse("corpora/small/scenarios/a//b").unwrap_err();
            return stream::iter([Err(stray.into())]).boxed();
        }
        if self.faults.unavailable_of > 0 && self.random.below(self.faults.unavailable_of) == 0 {
            return stream::iter([Err(unavailable())]).boxed();
        }
        let turns = self.random.below(self.faults.most_turns + 1);
        let (inner, prefix) = (self.inner.clone(), prefix.cloned());
        let listed = async move {
            for _ in 0..turns {
                yield_now().await;
            }
            inner.list(prefix.as_ref())
        };
        stream::once(listed).flatten().boxed()
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.inner.list_with_delimiter(prefix).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, options: CopyOptions) -> Result<()> {
        self.inner.copy_opts(from, to, options).await
    }
}
