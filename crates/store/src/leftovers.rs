//! Leftovers of killed uploads in a store: parts of unfinished files, which no listing shows but which use space.
//!
//! S3 lists unfinished uploads, a folder has files named `<name>#<number>`. An upload that is cleared while it is still being sent starts
//! over. In a folder only files that have not been written for an hour are cleared: a missing one fails its writer's rename.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use object_store::ClientOptions;
use object_store::aws::AmazonS3;
use object_store::client::{
    HttpClient, HttpConnector, HttpRequest, HttpRequestBody, ReqwestConnector,
};
use object_store::multipart::MultipartStore;
use object_store::path::Path as ObjectPath;
use object_store::signer::{SignedUrlOptions, Signer};
use serde::Deserialize;

use crate::client::{Connection, SCENARIOS};
use crate::error::{Result, StoreError};

/// A signed request is sent at once.
const VALID_FOR: Duration = Duration::from_secs(60);
/// The writer of a file that did not grow for this long is gone.
const ABANDONED_AFTER: Duration = Duration::from_secs(3600);
/// Pages to read, each with a thousand uploads.
const MAX_PAGES: usize = 100;

/// A page from S3's list of unfinished uploads.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Page {
    #[serde(default)]
    is_truncated: bool,
    next_key_marker: Option<String>,
    next_upload_id_marker: Option<String>,
    #[serde(default)]
    upload: Vec<Upload>,
}

#[derive(Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Upload {
    key: String,
    upload_id: String,
}

impl Connection<'_> {
    /// Clears these scenarios' unfinished uploads; returns their number.
    ///
    /// # Errors
    /// The store does not list them, or does not allow clearing them.
    pub(crate) async fn clear_unfinished(&self, scenarios: &BTreeSet<String>) -> Result<usize> {
        match (&self.store.bucket, &self.store.folder) {
            (Some(bucket), _) => self.clear_bucket(bucket, scenarios).await,
            (None, Some(folder)) => Ok(clear_folder(&folder.join(SCENARIOS), scenarios)),
            (None, None) => Ok(0),
        }
    }

    async fn clear_bucket(&self, bucket: &AmazonS3, scenarios: &BTreeSet<String>) -> Result<usize> {
        let folder = self.store.key(SCENARIOS);
        let options = ClientOptions::new().with_allow_http(true);
        let client = ReqwestConnector::default().connect(&options);
        let client = client.map_err(|error| self.not_listed(error))?;
        let mut cleared = 0;
        let mut query = vec![
            ("uploads".to_owned(), String::new()),
            ("prefix".to_owned(), format!("{folder}/")),
        ];
        for _ in 0..MAX_PAGES {
            let page = self.page_of_uploads(bucket, &client, query.clone()).await?;
            for upload in page.upload {
                let Ok(key) = ObjectPath::parse(&upload.key) else {
                    continue;
                };
                let parts = key.prefix_match(&folder);
                let id = parts.and_then(|mut parts| parts.next());
                if !id.is_some_and(|id| scenarios.contains(id.as_ref())) {
                    continue;
                }
                match bucket.abort_multipart(&key, &upload.upload_id).await {
                    Ok(()) => cleared += 1,
                    // Its owner was faster.
                    Err(object_store::Error::NotFound { .. }) => {}
                    Err(error) => {
                        return Err(self.store.error("clear an unfinished upload", &error));
                    }
                }
            }
            let next = page.next_key_marker.zip(page.next_upload_id_marker);
            let Some((key, upload)) = next.filter(|_| page.is_truncated) else {
                break;
            };
            query.truncate(2);
            query.push(("key-marker".to_owned(), key));
            query.push(("upload-id-marker".to_owned(), upload));
        }
        Ok(cleared)
    }

    async fn page_of_uploads(
        &self,
        bucket: &AmazonS3,
        client: &HttpClient,
        query: Vec<(String, String)>,
    ) -> Result<Page> {
        let mut request = HttpRequest::new(HttpRequestBody::empty());
        let options = SignedUrlOptions::default().with_query(query);
        let root = ObjectPath::default();
        let url = bucket.signed_url_opts(request.method().clone(), &root, VALID_FOR, &options);
        let url = url.await.map_err(|error| self.not_listed(error))?;
        *request.uri_mut() = (url.as_str().parse()).map_err(|error| self.not_listed(error))?;
        let answer = client.execute(request).await;
        let answer = answer.map_err(|error| self.not_listed(error))?;
        let status = answer.status();
        let body = answer.into_body().bytes().await;
        let body = body.map_err(|error| self.not_listed(error))?;
        let text = String::from_utf8_lossy(&body);
        if !status.is_success() {
            return Err(self.not_listed(format!("{status}: {text}")));
        }
        quick_xml::de::from_str(&text).map_err(|error| self.not_listed(error))
    }

    fn not_listed(&self, message: impl ToString) -> StoreError {
        StoreError::Failed {
            url: self.store.name().into(),
            doing: "list unfinished uploads".into(),
            message: message.to_string(),
        }
    }
}

/// Clears leftovers of the folder's own way of writing: `<name>#<number>` next to `<name>`.
fn clear_folder(all: &Path, scenarios: &BTreeSet<String>) -> usize {
    let mut folders: Vec<PathBuf> = scenarios.iter().map(|id| all.join(id)).collect();
    let mut cleared = 0;
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let number = name.rsplit_once('#').map(|(_, number)| number);
            let is_unfinished = number.is_some_and(|number| number.parse::<u64>().is_ok());
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
        let page = "<?xml version=\"1.0\"?><ListMultipartUploadsResult xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\"><Bucket>b</Bucket>\
                    <KeyMarker/><IsTruncated>false</IsTruncated><Upload><Key>a &amp;amp; b/scenarios/1/views/left.mp4</Key>\
                    <UploadId>x.1</UploadId><Owner><ID>1</ID></Owner></Upload><CommonPrefixes/></ListMultipartUploadsResult>";
        let page: Page = quick_xml::de::from_str(page).unwrap();
        let expected = Upload {
            key: "a &amp; b/scenarios/1/views/left.mp4".into(),
            upload_id: "x.1".into(),
        };
        assert_eq!((page.upload, page.is_truncated), (vec![expected], false));
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
