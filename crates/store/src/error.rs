//! Object store errors, distinguished by who can fix them.

use std::error::Error;
use std::fmt::{self, Display};
use std::io;

use dataset::work::watch::Stopped;
use object_store::client::{HttpError, HttpErrorKind};

/// Results of this crate.
pub type Result<T> = std::result::Result<T, StoreError>;

/// The supported URLs, for messages.
const SCHEMES: &str = "s3://BUCKET/PREFIX or file:///FOLDER";

/// An object store that cannot be used, or a corpus in it. Every message names it.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The caller must change the request, the environment or the store.
    #[error("{message}")]
    Unusable {
        /// Place, fault and remedy.
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
        /// The failure.
        message: String,
    },
    /// Content that does not match its seal, or corpus files that contradict each other.
    #[error("{place}: {message}")]
    Damaged {
        /// The folder, URL or file.
        place: String,
        /// The difference.
        message: String,
    },
    /// A committed scenario in the store that is not as it was sealed.
    #[error("{place}: {faults}")]
    Faulty {
        /// URL of the scenario.
        place: String,
        /// The faults, each in one file.
        faults: Faults,
    },
    /// The local side cannot be read or written.
    #[error(transparent)]
    Local(#[from] dataset::Error),
    /// The caller stopped the transfer.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

/// A file in a committed scenario that is not as it was sealed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// Name within the scenario.
    pub file: String,
    /// The file's name and the difference.
    pub message: String,
}

impl Fault {
    /// A fault whose message begins with the file's name.
    pub(crate) fn of(file: &str, difference: impl Display) -> Self {
        Self {
            file: file.to_owned(),
            message: format!("{file} {difference}"),
        }
    }

    pub(crate) fn missing(file: &str) -> Self {
        Self::of(file, "is missing")
    }
}

/// A scenario's faults; displayed in one line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Faults(pub Vec<Fault>);

impl From<Fault> for Faults {
    fn from(fault: Fault) -> Self {
        Self(vec![fault])
    }
}

impl Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let messages: Vec<&str> = self.0.iter().map(|it| it.message.as_str()).collect();
        f.write_str(&messages.join("; "))
    }
}

/// S3 answers 400 with these codes for an expired token.
const REFUSALS: [&str; 3] = [
    "ExpiredToken",
    "InvalidToken",
    "AuthorizationHeaderMalformed",
];
/// The client's words for a redirect without a target, S3's answer in the wrong region.
const WRONG_REGION: &str = "incorrectly configured region";
/// Hosts that serve credentials to a cloud's own machines.
const OWN_CREDENTIALS: [&str; 2] = ["169.254.169.254", "169.254.170.2"];
/// Advice for wrong credentials.
const HINT: &str = "Credentials come from the environment (docs/corpus.md): AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION; from a \
                    profile: eval \"$(aws configure export-credentials --format env)\"";

impl StoreError {
    pub(crate) fn unusable(message: impl Display) -> Self {
        Self::Unusable {
            message: message.to_string(),
        }
    }

    /// A folder that cannot be used, unless the disk is broken or full.
    pub(crate) fn of_folder(error: dataset::Error) -> Self {
        if error.is_of_disk() {
            error.into()
        } else {
            Self::unusable(error)
        }
    }

    pub(crate) fn bad_url(text: &str, why: impl Display) -> Self {
        let text = crate::location::redacted(text);
        Self::unusable(format!("{text}: {why}; expected {SCHEMES}"))
    }

    /// True if the caller must change the request or the environment, because the same call will fail again.
    pub fn is_bad_input(&self) -> bool {
        match self {
            Self::Unusable { .. } => true,
            Self::Local(error) => error.is_bad_content(),
            _ => false,
        }
    }

    /// True if the same request may succeed in a moment.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Away { .. })
    }

    /// True if only one scenario is affected: the others can be transferred.
    pub fn is_of_scenario(&self) -> bool {
        match self {
            Self::Damaged { .. } | Self::Faulty { .. } => true,
            Self::Local(error) => error.is_bad_content(),
            _ => false,
        }
    }

    /// Classifies a store's error. `doing` completes "cannot ...".
    pub(crate) fn of(url: &str, doing: &str, error: &object_store::Error) -> Self {
        let text = last_cause(error);
        let (code, message) = (element(&text, "Code"), element(&text, "Message"));
        let message = match (&code, message) {
            (Some(code), Some(message)) => {
                let answer = text.split_once(": <").map_or("", |(answer, _)| answer);
                format!("{code}: {message} ({answer})")
            }
            _ => text.clone(),
        };
        let has_code = |codes: &[&str]| code.as_deref().is_some_and(|code| codes.contains(&code));
        let refused = || {
            let doing = format!("access denied when asked to {doing}");
            Self::unusable(format!("{url}: {doing}: {message}. {HINT}"))
        };
        let (url, doing) = (url.to_owned(), doing.to_owned());
        // Without credentials the client queries services that exist only on the cloud's machines.
        if causes(error).any(|cause| is_of_own_machine(&cause.to_string())) {
            return Self::unusable(format!(
                "{url}: the environment holds no credentials, and this machine has none of its own ({message}). {HINT}"
            ));
        }
        match (error, status(&text)) {
            (object_store::Error::InvalidPath { source }, _) => Self::unusable(format!(
                "{url}: cannot {doing}: {source}. A key with an empty or dotted part is not of a corpus and keeps the store from being \
                 listed: delete that object, e.g. with `aws s3api delete-object --bucket BUCKET --key KEY`, and run the same command again"
            )),
            (
                object_store::Error::PermissionDenied { .. }
                | object_store::Error::Unauthenticated { .. },
                _,
            )
            | (_, Some(401 | 403)) => refused(),
            _ if has_code(&REFUSALS) || text.contains(WRONG_REGION) => refused(),
            (object_store::Error::NotFound { .. }, _) | (_, Some(404)) => Self::unusable(format!(
                "{url}: there is no such bucket or object, when asked to {doing}: {message}"
            )),
            // Not implemented, or too old a version of HTTP.
            (_, Some(501 | 505)) => Self::Failed {
                url,
                doing,
                message,
            },
            (_, Some(408 | 429 | 500..)) => Self::Away {
                url,
                doing,
                message,
            },
            _ if is_lost_on_the_way(error) => Self::Away {
                url,
                doing,
                message,
            },
            _ => Self::Failed {
                url,
                doing,
                message,
            },
        }
    }
}

/// True for an operation that the store does not offer, such as a condition.
pub(crate) fn is_not_implemented(error: &object_store::Error) -> bool {
    matches!(error, object_store::Error::NotImplemented { .. })
        || status(&last_cause(error)) == Some(501)
}

/// Text without the causes above it, which count attempts.
fn last_cause(error: &object_store::Error) -> String {
    causes(error)
        .last()
        .map_or_else(String::new, ToString::to_string)
}

/// HTTP status. The client keeps it in a private type and exposes only its text.
fn status(text: &str) -> Option<u16> {
    let (_, rest) = text.split_once("status code: ")?;
    rest.split(|c: char| !c.is_ascii_digit())
        .next()?
        .parse()
        .ok()
}

/// Text inside an XML element.
fn element(text: &str, name: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("<{name}>"))?;
    Some(rest.split_once("</")?.0.trim().to_owned())
}

fn is_of_own_machine(text: &str) -> bool {
    OWN_CREDENTIALS.iter().any(|host| text.contains(host))
}

/// True if the request or its answer did not arrive, or if a file in a `file://` store was moved meanwhile.
fn is_lost_on_the_way(error: &object_store::Error) -> bool {
    causes(error).any(|cause| {
        let is_of_network = cause.downcast_ref::<HttpError>().is_some_and(|error| {
            matches!(
                error.kind(),
                HttpErrorKind::Connect
                    | HttpErrorKind::Request
                    | HttpErrorKind::Timeout
                    | HttpErrorKind::Interrupted
                    // A pooled connection that closed before it was used: "connection was not ready".
                    | HttpErrorKind::Unknown
            )
        });
        let file = cause.downcast_ref::<io::Error>();
        is_of_network || file.is_some_and(|error| error.kind() == io::ErrorKind::NotFound)
    })
}

fn causes<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = &'a (dyn Error + 'static)> {
    std::iter::successors(Some(error), |error| (**error).source())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An error as the client builds it, without a server.
    fn classified(source: &str) -> StoreError {
        let error = object_store::Error::Generic {
            store: "S3",
            source: source.to_owned().into(),
        };
        StoreError::of("s3://b/p", "list", &error)
    }

    #[test]
    fn what_passes_what_the_caller_mends_and_the_rest_are_told_apart() {
        for passing in [
            "Server returned non-2xx status code: 503 Service Unavailable: ",
            "Server returned non-2xx status code: 429 Too Many Requests: ",
        ] {
            assert!(classified(passing).is_passing(), "{passing}");
        }
        for mended in [
            "Server returned non-2xx status code: 400 Bad Request: <Error><Code>ExpiredToken</Code><Message>x</Message></Error>",
            "Server returned non-2xx status code: 403 Forbidden: <Error><Code>InvalidAccessKeyId</Code><Message>x</Message></Error>",
            "Received redirect without LOCATION, this normally indicates an incorrectly configured region",
            "Error performing PUT http://169.254.169.254/latest/api/token in 3s - HTTP error",
        ] {
            let error = classified(mended);
            assert!(error.is_bad_input() && !error.is_passing(), "{error}");
            assert!(error.to_string().contains("AWS_REGION"), "{error}");
        }
        for rest in [
            "something else",
            "Server returned non-2xx status code: 501 Not Implemented: ",
        ] {
            let error = classified(rest);
            assert!(!error.is_passing() && !error.is_bad_input(), "{error}");
        }
    }

    #[test]
    fn of_a_page_of_xml_people_see_code_and_message() {
        let page = "Server returned non-2xx status code: 400 Bad Request: <?xml version=\"1.0\"?>\n<Error><Code>EntityTooLarge</Code>\
                    <Message>Too much</Message><RequestId>1</RequestId></Error>";
        let message = classified(page).to_string();
        let words =
            "EntityTooLarge: Too much (Server returned non-2xx status code: 400 Bad Request)";
        assert!(message.ends_with(words), "{message}");
    }
}
