//! Corpus location: a folder or a URL.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use url::Url;

use crate::error::{Result, StoreError};

/// Corpus location.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CorpusLocation {
    /// A folder.
    Folder(PathBuf),
    /// An object store.
    Store(StoreUrl),
}

/// Object store URL.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoreUrl(pub(crate) Url);

impl CorpusLocation {
    /// Tells a URL, with a scheme of at least two letters and `://`, from a path such as `C:\corpus` or `a:b`.
    ///
    /// # Errors
    /// A URL that names no object store, with the supported ones.
    pub fn of(path: &Path) -> Result<Self> {
        match path.to_str().filter(|text| is_url(text)) {
            Some(text) => text.parse().map(Self::Store),
            None => Ok(Self::Folder(path.to_owned())),
        }
    }
}

fn is_url(text: &str) -> bool {
    text.split_once("://").is_some_and(|(scheme, _)| {
        scheme.len() > 1
            && scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    })
}

/// A URL or `USER:PASSWORD@HOST` without credentials, for messages. Queries are left out as well: presigned URLs have their secrets there.
pub fn redacted(text: &str) -> String {
    let Some((scheme, after)) = text.split_once("://") else {
        return match text.rsplit_once('@') {
            Some((user, host)) if user.contains(':') => format!("***@{host}"),
            _ => text.to_owned(),
        };
    };
    let (user, rest) = match after.rsplit_once('@') {
        // The @ may belong to a secret in the query.
        Some((user, _)) if user.contains(['?', '#']) => return format!("{scheme}://***"),
        Some((_, rest)) => ("***@", rest),
        None => ("", after),
    };
    let (rest, query) = match rest.find(['?', '#']) {
        Some(at) => (&rest[..=at], "***"),
        None => (rest, ""),
    };
    format!("{scheme}://{user}{rest}{query}")
}

impl FromStr for StoreUrl {
    type Err = StoreError;

    fn from_str(text: &str) -> Result<Self> {
        let bad = |why: &str| StoreError::bad_url(text, why);
        if text.contains('@') {
            return Err(bad("it holds credentials; they come from the environment"));
        }
        let mut url = Url::parse(text).map_err(|error| match error {
            url::ParseError::RelativeUrlWithoutBase => bad("it does not begin with a scheme"),
            other => bad(&format!("it is not a URL: {other}")),
        })?;
        let is_local = match url.scheme() {
            "s3" | "s3a" => false,
            "file" => true,
            other => return Err(bad(&format!("{other}:// is not a known object store"))),
        };
        if url.query().is_some() || url.fragment().is_some() {
            return Err(bad("it has a ? or #, which no object's name may have here"));
        }
        let has_host = url.host_str().is_some_and(|host| !host.is_empty());
        match (is_local, has_host) {
            (true, true) => return Err(bad("a file URL has three slashes and an absolute path")),
            (true, false) if url.path() == "/" => return Err(bad("it names no folder")),
            (false, false) => return Err(bad("it names no bucket")),
            _ => {}
        }
        let path = url.path().trim_end_matches('/').to_owned();
        url.set_path(&path);
        Ok(Self(url))
    }
}

impl fmt::Display for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.as_str().trim_end_matches('/'))
    }
}

impl StoreUrl {
    /// Folder in a `file://` URL; `None` for other stores.
    pub fn local_folder(&self) -> Option<PathBuf> {
        let is_local = self.0.scheme() == "file";
        is_local.then(|| self.0.to_file_path().ok()).flatten()
    }

    /// Unique name for a local folder that belongs to this URL: its readable part and its hash.
    pub fn folder_name(&self) -> String {
        let text = self.to_string();
        let readable: String = text
            .chars()
            .map(|c| match c {
                'a'..='z' | 'A'..='Z' | '0'..='9' | '.' | '-' => c,
                _ => '_',
            })
            .take(80)
            .collect();
        let hash = blake3::hash(text.as_bytes()).to_hex();
        format!("{readable}-{}", &hash[..8])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store(text: &str) -> StoreUrl {
        match CorpusLocation::of(Path::new(text)) {
            Ok(CorpusLocation::Store(url)) => url,
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn paths_stay_paths_whatever_colons_they_have() {
        for path in [
            "corpus",
            "/data/corpus",
            r"C:\corpus",
            "C:/corpus",
            "C://corpus",
            "a:b",
            "s3:bucket",
            "s3:/bucket",
            "./s3://bucket/x",
            "run: 12://x",
            "://x",
        ] {
            assert_eq!(
                CorpusLocation::of(Path::new(path)).unwrap(),
                CorpusLocation::Folder(path.into())
            );
        }
    }

    #[test]
    fn urls_are_known_by_their_scheme_and_lose_the_last_slash() {
        for (text, shown, is_local) in [
            ("s3://bucket/a/b/", "s3://bucket/a/b", false),
            ("s3://bucket", "s3://bucket", false),
            ("file:///data/corpus/", "file:///data/corpus", true),
        ] {
            let url = store(text);
            assert_eq!(url.to_string(), shown);
            assert_eq!(url.local_folder().is_some(), is_local);
        }
    }

    #[test]
    fn other_urls_are_refused_with_those_that_are_known() {
        for text in [
            "http://host/corpus",
            "ftp://host/corpus",
            "gs://bucket/a",
            "az://container/a",
            "s3:///prefix",
            "file://host/a",
            "file:///",
        ] {
            let error = CorpusLocation::of(Path::new(text)).unwrap_err();
            assert!(error.is_bad_input());
            let message = error.to_string();
            assert!(
                message.contains(text) && message.contains("s3://BUCKET"),
                "{message}"
            );
        }
    }

    #[test]
    fn credentials_in_a_url_are_refused_and_not_repeated() {
        for text in [
            "s3://KEY:SECRET@bucket/a",
            "s3://KEY:SEC/RET@bucket/a",
            "s3://SECRET@bucket/a",
            "https://KEY:SECRET@host/a",
        ] {
            let error = CorpusLocation::of(Path::new(text)).unwrap_err();
            let message = error.to_string();
            assert!(error.is_bad_input());
            assert!(
                message.contains("environment") && message.contains("://***@"),
                "{message}"
            );
            for secret in ["KEY", "SEC", "RET"] {
                assert!(!message.contains(secret), "{message}");
            }
        }
    }

    #[test]
    fn secrets_in_a_query_or_before_a_host_are_not_repeated() {
        for (text, shown) in [
            ("s3://bucket/a?X-Amz-Signature=SECRET", "s3://bucket/a?***"),
            ("s3://bucket/a#SECRET", "s3://bucket/a#***"),
            ("s3://KEY:SECRET@bucket/a?b=SECRET", "s3://***@bucket/a?***"),
            ("s3://bucket/a?b=SEC@SECRET", "s3://***"),
            ("user:SECRET@host", "***@host"),
            ("corpus@home", "corpus@home"),
            ("127.0.0.1:49000", "127.0.0.1:49000"),
        ] {
            assert_eq!(redacted(text), shown);
        }
        let refused = CorpusLocation::of(Path::new("s3://bucket/a?b=SECRET")).unwrap_err();
        let message = refused.to_string();
        assert!(
            message.contains("s3://bucket/a?***") && !message.contains("SECRET"),
            "{message}"
        );
    }

    #[test]
    fn each_url_has_a_folder_name_of_its_own() {
        let names = ["s3://bucket/a/b", "s3://bucket/a_b", "file:///bucket/a/b"]
            .map(|text| store(text).folder_name());
        assert!(names[0].starts_with("s3___bucket_a_b-"), "{}", names[0]);
        assert!(names[0] != names[1] && names[0] != names[2]);
        assert_eq!(names[0], store("s3://bucket/a/b/").folder_name());
    }
}
