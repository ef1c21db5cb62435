//! Opens the client of a store from a URL and the environment.

use std::env;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::local::LocalFileSystem;
use object_store::path::Path as ObjectPath;
use object_store::{BackoffConfig, ClientConfigKey, ObjectStore, RetryConfig};

use super::leftovers::Unfinished;
use crate::error::{Result, StoreError};
use crate::location::{Kind, StoreUrl};

/// A request is retried this long without a message; longer waits are reported (`patience`).
const RETRIES: RetryConfig = RetryConfig {
    backoff: BackoffConfig {
        init_backoff: Duration::from_millis(100),
        max_backoff: Duration::from_secs(2),
        base: 2.0,
    },
    max_retries: 4,
    retry_timeout: Duration::from_secs(8),
};
/// Silence for this long counts as no answer. Four parts of 8 MiB at once get through at 1.5 Mbit/s in this time.
const MAX_SILENCE: &str = "180 seconds";
/// The clients' own limit is half a minute for a whole request: a video takes longer.
const MAX_REQUEST: &str = "1 day";

/// The store of a URL and the corpus' path in it.
pub(crate) struct Opened {
    pub(crate) store: Arc<dyn ObjectStore>,
    pub(crate) root: ObjectPath,
    /// The folder, if it is one.
    pub(crate) folder: Option<PathBuf>,
    /// Place where incomplete uploads are listed.
    pub(crate) unfinished: Unfinished,
}

/// Opens the store of a URL with the environment's settings. It is not contacted yet.
pub(crate) fn open(url: &StoreUrl, create: bool) -> Result<Opened> {
    let not_configured = |error: object_store::Error| StoreError::NotConfigured {
        url: url.to_string(),
        message: error.to_string(),
    };
    if url.kind == Kind::LocalFiles {
        return open_folder(url, create);
    }
    let text = url.url.as_str();
    let mut unfinished = Unfinished::Nowhere;
    let store: Arc<dyn ObjectStore> = match url.kind {
        Kind::S3 => {
            let store = Arc::new(s3(text).build().map_err(not_configured)?);
            unfinished = Unfinished::S3(store.clone());
            store
        }
        Kind::Google => {
            let builder = GoogleCloudStorageBuilder::from_env()
                .with_url(text)
                .with_config(GoogleConfigKey::Client(SILENCE), MAX_SILENCE)
                .with_config(GoogleConfigKey::Client(REQUEST), MAX_REQUEST)
                .with_retry(RETRIES);
            Arc::new(builder.build().map_err(not_configured)?)
        }
        _ => {
            let builder = MicrosoftAzureBuilder::from_env()
                .with_url(text)
                .with_config(AzureConfigKey::Client(SILENCE), MAX_SILENCE)
                .with_config(AzureConfigKey::Client(REQUEST), MAX_REQUEST)
                .with_retry(RETRIES);
            Arc::new(builder.build().map_err(not_configured)?)
        }
    };
    let root = ObjectPath::from_url_path(url.url.path()).map_err(|error| StoreError::BadUrl {
        text: url.to_string(),
        why: error.to_string(),
    })?;
    Ok(Opened {
        store,
        root,
        folder: None,
        unfinished,
    })
}

const SILENCE: ClientConfigKey = ClientConfigKey::ReadTimeout;
const REQUEST: ClientConfigKey = ClientConfigKey::Timeout;

fn s3(url: &str) -> AmazonS3Builder {
    let mut builder = AmazonS3Builder::from_env()
        .with_url(url)
        .with_config(AmazonS3ConfigKey::Client(SILENCE), MAX_SILENCE)
        .with_config(AmazonS3ConfigKey::Client(REQUEST), MAX_REQUEST)
        .with_retry(RETRIES);
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

/// A folder of this machine, treated like a bucket.
fn open_folder(url: &StoreUrl, create: bool) -> Result<Opened> {
    let path: PathBuf = url.url.to_file_path().map_err(|()| StoreError::BadUrl {
        text: url.to_string(),
        why: "it is not a local path".into(),
    })?;
    if create {
        fs::create_dir_all(&path).map_err(dataset::Error::io("create", &path))?;
    } else if !path.is_dir() {
        return Err(StoreError::NotThere {
            url: url.to_string(),
            message: "there is no such folder".into(),
        });
    }
    let store = LocalFileSystem::new_with_prefix(&path)
        .map_err(|error| StoreError::of(&url.to_string(), "open it", &error))?
        .with_fsync(true);
    Ok(Opened {
        store: Arc::new(store),
        root: ObjectPath::default(),
        folder: Some(path.clone()),
        unfinished: Unfinished::Folder(path),
    })
}
