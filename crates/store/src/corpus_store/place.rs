//! The place of a corpus in a store: whether it can be reached, and whether a corpus may be written there.

use std::time::Duration;

use dataset::corpus::{Corpus, foreign_entries, is_plan};
use futures_util::TryStreamExt;
use futures_util::future::BoxFuture;
use object_store::{ObjectMeta, ObjectStore};
use tokio::time::timeout;

use crate::corpus_store::CorpusStore;
use crate::error::{Result, StoreError};

/// Looking for credentials may query services that do not exist; this limits the wait for a first answer.
const FIRST_WORD: Duration = Duration::from_secs(20);

impl CorpusStore {
    /// Checks within seconds whether the store answers and grants access.
    ///
    /// # Errors
    /// No such bucket, wrong credentials, no answer: separate errors.
    pub fn check(&self) -> BoxFuture<'_, Result<()>> {
        Box::pin(async move {
            let mut found = self.store.list(Some(self.root()));
            self.first_answer(found.try_next()).await?;
            Ok(())
        })
    }

    /// Checks the same, and rejects a prefix that contains anything but a corpus, as [`dataset::corpus::check_place`] does with a folder:
    /// the corpus would mix with other objects or replace them.
    ///
    /// # Errors
    /// See [`Self::check`]; also fails if there are other objects but no plan or committed scenario.
    pub fn check_place(&self) -> BoxFuture<'_, Result<()>> {
        Box::pin(async move {
            let listed = self.store.list_with_delimiter(Some(self.root()));
            let found = self.first_answer(listed).await?;
            let folders = found.common_prefixes.iter().filter_map(|it| it.filename());
            let objects = found.objects.iter().filter(|it| !is_vacant(it));
            let objects = objects.filter_map(|it| it.location.filename());
            match foreign_entries(folders.chain(objects).map(str::to_owned)) {
                Some(found) if !self.has_corpus().await? => Err(StoreError::Occupied {
                    url: self.name().to_owned(),
                    found,
                }),
                _ => Ok(()),
            }
        })
    }

    /// Returns true if there is a plan of any version, or a committed scenario.
    async fn has_corpus(&self) -> Result<bool> {
        let plan = self.read(Corpus::PLAN).await?;
        Ok(
            plan.is_some_and(|text| is_plan(&text))
                || !self.listing().await?.committed().is_empty(),
        )
    }

    async fn first_answer<T>(
        &self,
        look: impl Future<Output = object_store::Result<T>>,
    ) -> Result<T> {
        let doing = "list what is there";
        match timeout(FIRST_WORD, look).await {
            Ok(answered) => answered.map_err(|error| self.error(doing, &error)),
            Err(_) => Err(StoreError::Away {
                url: self.name().to_owned(),
                doing: doing.into(),
                message: format!(
                    "no answer within {FIRST_WORD:?} (without credentials in the environment the machine's own are looked for, which \
                     may take longer)"
                ),
            }),
        }
    }
}

/// True for an empty file of a corpus, which may be replaced.
fn is_vacant(object: &ObjectMeta) -> bool {
    let name = object.location.filename();
    object.size == 0 && name.is_some_and(|name| Corpus::FILES.contains(&name))
}
