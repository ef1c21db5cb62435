//! Leftovers of killed uploads in a store: parts of unfinished files, which no listing shows but which use space.
//!
//! Amazon's API lists incomplete uploads, a folder has files named `<name>#<number>`; Azure clears its own after a week. If an
//! upload is cleared while another process still sends it, it starts over there (`scenario/send.rs`). In a folder, only files that have
//! not been written for an hour are cleared: a missing one fails the rename of the process that writes it.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use object_store::ClientOptions;
use object_store::aws::AmazonS3;
use object_store::client::{
    HttpClient, HttpConnector, HttpRequest, HttpRequestBody, ReqwestConnector,
};
use object_store::multipart::MultipartStore;
use object_store::path::Path as ObjectPath;
use object_store::signer::{SignedUrlOptions, Signer};

use crate::corpus_store::{CorpusStore, SCENARIOS};
use crate::error::{Result, StoreError};
use futures_util::future::BoxFuture;

/// A signed request is sent at once.
const VALID_FOR: Duration = Duration::from_secs(60);
/// A file of a folder that was not written for this long belongs to a process that is gone.
const ABANDONED_AFTER: Duration = Duration::from_secs(3600);
/// Pages of a thousand uploads to read.
const MAX_PAGES: usize = 100;

/// Place where incomplete uploads are listed.
#[derive(Debug, Clone)]
pub(crate) enum Unfinished {
    /// In an S3 bucket.
    S3(Arc<AmazonS3>),
    /// In a folder.
    Folder(PathBuf),
    /// The service clears them automatically, or has none.
    Nowhere,
}

/// An incomplete upload.
#[derive(Debug, PartialEq, Eq)]
struct Upload {
    key: String,
    id: String,
}

impl CorpusStore {
    /// Clears the incomplete uploads of these scenarios; returns how many there were.
    ///
    /// # Errors
    /// The store does not list them, or does not allow clearing them.
    pub(crate) fn clear_unfinished<'a>(
        &'a self,
        scenarios: &'a BTreeSet<String>,
    ) -> BoxFuture<'a, Result<usize>> {
        Box::pin(async move {
            match &self.unfinished {
                Unfinished::Nowhere => Ok(0),
                Unfinished::Folder(root) => Ok(clear_folder(&root.join(SCENARIOS), scenarios)),
                Unfinished::S3(s3) => self.clear_bucket(s3, scenarios).await,
            }
        })
    }

    async fn clear_bucket(&self, s3: &AmazonS3, scenarios: &BTreeSet<String>) -> Result<usize> {
        let folder = self.key(SCENARIOS);
        let client = ReqwestConnector::default()
            .connect(&ClientOptions::new().with_allow_http(true))
            .map_err(|error| self.error("list unfinished uploads", &error))?;
        let mut cleared = 0;
        let mut after: Option<Upload> = None;
        for _ in 0..MAX_PAGES {
            let page = self.page_of_uploads(s3, &client, &folder, after).await?;
            for upload in uploads(&page) {
                let key = ObjectPath::from(upload.key.as_str());
                let of = key.prefix_match(&folder).and_then(|mut parts| parts.next());
                if of.is_some_and(|id| scenarios.contains(id.as_ref())) {
                    match s3.abort_multipart(&key, &upload.id).await {
                        Ok(()) => cleared += 1,
                        // Its owner was faster.
                        Err(object_store::Error::NotFound { .. }) => {}
                        Err(error) => {
                            return Err(self.error("clear an unfinished upload", &error));
                        }
                    }
                }
            }
            after = match element(&page, "IsTruncated").as_deref() {
                Some("true") => element(&page, "NextKeyMarker")
                    .zip(element(&page, "NextUploadIdMarker"))
                    .map(|(key, id)| Upload { key, id }),
                _ => None,
            };
            if after.is_none() {
                break;
            }
        }
        Ok(cleared)
    }

    async fn page_of_uploads(
        &self,
        s3: &AmazonS3,
        client: &HttpClient,
        folder: &ObjectPath,
        after: Option<Upload>,
    ) -> Result<String> {
        let failed = |message: String| StoreError::Failed {
            url: self.name().into(),
            doing: "list unfinished uploads".into(),
            message,
        };
        let mut query = vec![
            ("uploads".to_owned(), String::new()),
            ("prefix".to_owned(), format!("{folder}/")),
        ];
        if let Some(after) = after {
            query.push(("key-marker".to_owned(), after.key));
            query.push(("upload-id-marker".to_owned(), after.id));
        }
        let mut request = HttpRequest::new(HttpRequestBody::empty());
        let url = s3
            .signed_url_opts(
                request.method().clone(),
                &ObjectPath::default(),
                VALID_FOR,
                &SignedUrlOptions::default().with_query(query),
            )
            .await
            .map_err(|error| self.error("list unfinished uploads", &error))?;
        *request.uri_mut() = url
            .as_str()
            .parse()
            .map_err(|error| failed(format!("{error}")))?;
        let answer = client
            .execute(request)
            .await
            .map_err(|error| failed(error.to_string()))?;
        let status = answer.status();
        let body = answer.into_body().bytes().await;
        let body = body.map_err(|error| failed(error.to_string()))?;
        let text = String::from_utf8_lossy(&body).into_owned();
        if status.is_success() {
            Ok(text)
        } else {
            Err(failed(format!(
                "{status}: {}",
                element(&text, "Message").unwrap_or(text)
            )))
        }
    }
}

fn uploads(page: &str) -> Vec<Upload> {
    let blocks = page.split("<Upload>").skip(1);
    blocks
        .filter_map(|block| {
            Some(Upload {
                key: element(block, "Key")?,
                id: element(block, "UploadId")?,
            })
        })
        .collect()
}

/// The text of the first element of a name.
fn element(page: &str, name: &str) -> Option<String> {
    let (_, rest) = page.split_once(&format!("<{name}>"))?;
    let (text, _) = rest.split_once(&format!("</{name}>"))?;
    let plain = [
        ("&lt;", "<"),
        ("&gt;", ">"),
        ("&quot;", "\""),
        ("&apos;", "'"),
        ("&#39;", "'"),
        // Last: its result is not the start of any other entity.
        ("&amp;", "&"),
    ];
    Some(
        plain
            .iter()
            .fold(text.to_owned(), |text, (coded, character)| {
                text.replace(coded, character)
            }),
    )
}

/// Clears leftovers of the folder's own way of writing: `<name>#<number>` next to `<name>`.
fn clear_folder(all: &Path, scenarios: &BTreeSet<String>) -> usize {
    let mut folders: Vec<PathBuf> = scenarios.iter().map(|id| all.join(id)).collect();
    let mut cleared = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let number = name.rsplit_once('#').map(|(_, number)| number);
            let is_unfinished = number.is_some_and(|number| {
                !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit())
            });
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                Ok(kind) if kind.is_file() && is_unfinished && is_abandoned(&entry) => {
                    cleared += usize::from(fs::remove_file(entry.path()).is_ok());
                }
                _ => {}
            }
        }
    }
    cleared
}

fn is_abandoned(entry: &fs::DirEntry) -> bool {
    let written = entry.metadata().and_then(|about| about.modified());
    written.is_ok_and(|written| written.elapsed().is_ok_and(|since| since > ABANDONED_AFTER))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::time::SystemTime;

    #[test]
    fn a_page_of_unfinished_uploads_is_read_whatever_its_keys_hold() {
        let page = "<?xml version=\"1.0\"?><ListMultipartUploadsResult><IsTruncated>false</IsTruncated>\
                    <Upload><Key>a &amp;amp; b/scenarios/1/views/left.mp4</Key><UploadId>x.1</UploadId></Upload>\
                    <Upload><Key>c</Key></Upload></ListMultipartUploadsResult>";
        let expected = Upload {
            key: "a &amp; b/scenarios/1/views/left.mp4".into(),
            id: "x.1".into(),
        };
        assert_eq!(uploads(page), [expected]);
        assert_eq!(element(page, "IsTruncated").as_deref(), Some("false"));
    }

    #[test]
    fn only_unfinished_files_of_the_named_scenarios_are_cleared() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1/views", "2/views"] {
            fs::create_dir_all(folder.path().join(name)).unwrap();
        }
        let files = [
            "1/views/left.mp4",
            "1/views/left.mp4#12",
            "1/a#b",
            "2/views/left.mp4#1",
        ];
        let long_ago = SystemTime::now() - 2 * ABANDONED_AFTER;
        for name in files {
            let file = File::create(folder.path().join(name)).unwrap();
            file.set_modified(long_ago).unwrap();
        }
        // Still being written by another process.
        let fresh = folder.path().join("1/views/right.mp4#1");
        fs::write(&fresh, "").unwrap();
        let cleared = clear_folder(folder.path(), &BTreeSet::from(["1".into(), "3".into()]));
        assert_eq!(cleared, 1);
        assert!(fresh.exists());
        let left = files.map(|name| folder.path().join(name).exists());
        assert_eq!(left, [true, false, true, true]);
    }
}
