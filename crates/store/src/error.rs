//! Errors of a corpus in an object store, distinguished by who can fix them.

use std::error::Error;
use std::io;

use dataset::work::watch::Stopped;
use object_store::client::{HttpError, HttpErrorKind};

use crate::scenario::StoredFaults;

/// Results of this crate.
pub type Result<T> = std::result::Result<T, StoreError>;

/// The supported URLs, for messages.
const SCHEMES: &str =
    "s3://BUCKET/PREFIX, gs://BUCKET/PREFIX, az://CONTAINER/PREFIX, file:///FOLDER";

/// An object store that cannot be used, or a corpus in it. Every message names it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The text is not the URL of an object store.
    #[error("{text}: {why}; expected {}", SCHEMES)]
    BadUrl {
        /// The text.
        text: String,
        /// The fault.
        why: String,
    },
    /// The environment lacks what is needed to reach the store.
    #[error("{url}: the environment lacks what is needed to reach it: {message}")]
    NotConfigured {
        /// The corpus.
        url: String,
        /// The missing or invalid setting.
        message: String,
    },
    /// There is no such bucket, or the path is empty.
    #[error("{url}: {message}")]
    NotThere {
        /// The corpus.
        url: String,
        /// The object that was looked for.
        message: String,
    },
    /// Access denied, or not authenticated.
    #[error("{url}: access denied when asked to {doing}: {message}. {HINT}")]
    Refused {
        /// The corpus.
        url: String,
        /// The operation.
        doing: String,
        /// The store's message.
        message: String,
    },
    /// The store does not answer, or is temporarily unavailable.
    #[error("{url}: the store does not answer, when asked to {doing}: {message}")]
    Away {
        /// The corpus.
        url: String,
        /// The operation.
        doing: String,
        /// The failure.
        message: String,
    },
    /// Any other error of the store.
    #[error("{url}: cannot {doing}: {message}")]
    Failed {
        /// The corpus.
        url: String,
        /// The operation.
        doing: String,
        /// The store's message.
        message: String,
    },
    /// Content that does not match its seal.
    #[error("{place}: {message}")]
    Damaged {
        /// The folder or URL of the scenario.
        place: String,
        /// The difference.
        message: String,
    },
    /// A committed scenario in the store that is not as it was sealed.
    #[error("{place}: {faults}")]
    Faulty {
        /// The URL of the scenario.
        place: String,
        /// The faults, each of one file.
        faults: StoredFaults,
    },
    /// Objects of others in the place of a corpus.
    #[error(
        "{url}: is not a corpus, and contains {found}; expected a corpus, an empty prefix or a new name, such as {url}/corpus"
    )]
    Occupied {
        /// The URL.
        url: String,
        /// Content found there.
        found: String,
    },
    /// The local side cannot be read or written.
    #[error(transparent)]
    Local(#[from] dataset::Error),
    /// The caller stopped the transfer.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// Denials with other codes than 401 or 403: S3 returns 400 for an expired token.
const REFUSALS: [&str; 3] = [
    "ExpiredToken",
    "InvalidToken",
    "AuthorizationHeaderMalformed",
];
/// The client's words for a redirect without a target, S3's answer in the wrong region.
const WRONG_REGION: &str = "incorrectly configured region";
/// Codes of buckets that do not exist.
const NO_BUCKET: [&str; 2] = ["NoSuchBucket", "ContainerNotFound"];
/// Hosts from which a cloud's own machines get their credentials.
const OWN_CREDENTIALS: [&str; 3] = [
    "169.254.169.254",
    "169.254.170.2",
    "metadata.google.internal",
];
/// Advice for wrong credentials.
const HINT: &str = "Credentials come from the environment (docs/corpus.md), for S3 AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, \
                    AWS_REGION; from a profile: eval \"$(aws configure export-credentials --format env)\"";

impl StoreError {
    /// True if the caller must change the request or the environment, because the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::BadUrl { .. }
            | Self::NotConfigured { .. }
            | Self::NotThere { .. }
            | Self::Occupied { .. }
            | Self::Refused { .. } => true,
            Self::Local(error) => error.is_bad_content(),
            _ => false,
        }
    }

    /// True if the same request may succeed in a moment.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Away { .. })
    }

    /// Classifies a store's error. `doing` completes "cannot ...".
    pub(crate) fn of(url: &str, doing: &str, error: &object_store::Error) -> Self {
        let (url, doing) = (url.to_owned(), doing.to_owned());
        let answer = Answer::of(error);
        let message = answer.in_short();
        // Without credentials the clients query services that exist only on the cloud's machines.
        if answer.from_own_machine {
            return Self::NotConfigured {
                url,
                message: format!(
                    "it holds no credentials, and this machine has none of its own ({message}). {HINT}"
                ),
            };
        }
        match error {
            object_store::Error::PermissionDenied { .. }
            | object_store::Error::Unauthenticated { .. } => Self::Refused {
                url,
                doing,
                message,
            },
            object_store::Error::NotFound { .. } => Self::NotThere {
                url,
                message: format!(
                    "there is no such bucket or object, when asked to {doing}: {message}"
                ),
            },
            // Listing does not distinguish the following from each other.
            _ if answer.status == Some(404) || answer.has_code(&NO_BUCKET) => Self::NotThere {
                url,
                message: format!("there is no such bucket, when asked to {doing}: {message}"),
            },
            // A folder whose file another process moved away or cleared meanwhile.
            _ if answer.lost_file => Self::Away {
                url,
                doing,
                message: format!("another process changed it at the same time: {message}"),
            },
            _ if answer.never_came || matches!(answer.status, Some(408 | 429 | 500..)) => {
                Self::Away {
                    url,
                    doing,
                    message,
                }
            }
            _ if matches!(answer.status, Some(401 | 403))
                || answer.has_code(&REFUSALS)
                || answer.wrong_region =>
            {
                Self::Refused {
                    url,
                    doing,
                    message,
                }
            }
            _ => Self::Failed {
                url,
                doing,
                message,
            },
        }
    }
}

/// A server's answer. The clients keep status and code in a private type (`RetryError`) and expose only its text, which is parsed here
/// alone.
struct Answer {
    /// The HTTP status, if the server answered.
    status: Option<u16>,
    /// The store's code and message, if it answered with a page of XML.
    code: Option<String>,
    message: Option<String>,
    /// True if the request or its answer was lost on the way.
    never_came: bool,
    /// True if the request went to a service that only a cloud's own machines have.
    from_own_machine: bool,
    wrong_region: bool,
    /// True if a file or folder was missing in a store that is a folder.
    lost_file: bool,
    /// The text without causes above it, which count attempts.
    text: String,
}

impl Answer {
    fn of(error: &(dyn Error + 'static)) -> Self {
        let text = causes(error)
            .last()
            .map_or_else(String::new, ToString::to_string);
        let element = |name: &str| {
            let (_, rest) = text.split_once(&format!("<{name}>"))?;
            Some(rest.split_once("</")?.0.trim().to_owned())
        };
        let status = text.split_once("status code: ").and_then(|(_, rest)| {
            let digits = rest.split(|c: char| !c.is_ascii_digit()).next()?;
            digits.parse().ok()
        });
        Self {
            status,
            code: element("Code"),
            message: element("Message"),
            never_came: causes(error)
                .filter_map(|cause| cause.downcast_ref::<HttpError>())
                .any(|error| {
                    matches!(
                        error.kind(),
                        HttpErrorKind::Connect
                            | HttpErrorKind::Request
                            | HttpErrorKind::Timeout
                            | HttpErrorKind::Interrupted
                            // A pooled connection that closed before it was used: "connection was not ready".
                            | HttpErrorKind::Unknown
                    )
                }),
            from_own_machine: causes(error)
                .map(ToString::to_string)
                .any(|said| OWN_CREDENTIALS.iter().any(|service| said.contains(service))),
            wrong_region: text.contains(WRONG_REGION),
            lost_file: causes(error)
                .filter_map(|cause| cause.downcast_ref::<io::Error>())
                .any(|error| error.kind() == io::ErrorKind::NotFound),
            text,
        }
    }

    fn has_code(&self, codes: &[&str]) -> bool {
        self.code
            .as_deref()
            .is_some_and(|code| codes.contains(&code))
    }

    /// Of a page of XML, only code and message.
    fn in_short(&self) -> String {
        match (&self.code, &self.message) {
            (Some(code), Some(message)) => {
                let status = self.text.split_once(": <").map_or("", |(status, _)| status);
                format!("{code}: {message} ({status})")
            }
            _ => self.text.clone(),
        }
    }
}

fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |error| (**error).source())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error as the clients build it, without a server.
    fn said(source: &str) -> object_store::Error {
        object_store::Error::Generic {
            store: "S3",
            source: source.to_owned().into(),
        }
    }

    #[test]
    fn what_passes_what_the_caller_mends_and_the_rest_are_told_apart() {
        let sort = |source: &str| StoreError::of("s3://b/p", "list", &said(source));
        for passing in [
            "Server returned non-2xx status code: 503 Service Unavailable: ",
            "Server returned non-2xx status code: 429 Too Many Requests: ",
        ] {
            assert!(sort(passing).is_passing(), "{passing}");
        }
        for mended in [
            "Server returned non-2xx status code: 400 Bad Request: <Error><Code>ExpiredToken</Code><Message>x</Message></Error>",
            "Server returned non-2xx status code: 403 Forbidden: <Error><Code>InvalidAccessKeyId</Code><Message>x</Message></Error>",
            "Received redirect without LOCATION, this normally indicates an incorrectly configured region",
            "Error performing PUT http://169.254.169.254/latest/api/token in 3s - HTTP error",
        ] {
            let error = sort(mended);
            assert!(error.is_bad_input() && !error.is_passing(), "{error}");
            assert!(error.to_string().contains("AWS_REGION"), "{error}");
        }
        let rest = sort("something else");
        assert!(!rest.is_passing() && !rest.is_bad_input());
    }

    #[test]
    fn of_a_page_of_xml_people_see_code_and_message() {
        let page = "Server returned non-2xx status code: 403 Forbidden: <?xml version=\"1.0\"?>\n<Error><Code>AccessDenied</Code>\
                    <Message>Not you</Message><RequestId>1</RequestId></Error>";
        assert_eq!(
            Answer::of(&said(page)).in_short(),
            "AccessDenied: Not you (Server returned non-2xx status code: 403 Forbidden)"
        );
        assert_eq!(Answer::of(&said("plain words")).in_short(), "plain words");
    }
}
