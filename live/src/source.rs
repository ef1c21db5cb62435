//! Image sources of views.

pub(crate) mod address;
pub(crate) mod input;
pub(crate) mod limits;
mod rtp;
mod undecoded;

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use url::Url;

use crate::error::{Error, Result};

/// A source of images.
#[derive(Clone, PartialEq, Eq)]
pub enum Source {
    /// A video file.
    File(PathBuf),
    /// A stream that a server sends (RTSP).
    Stream(Stream),
    /// RTP stream description (SDP).
    Description(PathBuf),
    /// A camera of this computer.
    Device(PathBuf),
    /// Recorded scenario, with a video of each view.
    Scenario {
        /// Folder of the corpus.
        corpus: PathBuf,
        /// Identifier of the scenario.
        id: String,
    },
}

/// Stream address.
#[derive(Clone, PartialEq, Eq)]
pub struct Stream {
    /// Has neither the password nor this program's parameters.
    address: Url,
    password: Option<String>,
    transport: Transport,
    /// Its server may have any certificate.
    insecure_tls: bool,
}

/// Transport of packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transport {
    /// Interleaved with the RTSP commands; without losses.
    Tcp,
    /// Separate packets.
    Udp,
}

/// Fingerprint length, digits.
const FINGERPRINT_DIGITS: usize = 16;

/// Address parameter of this program.
const TRANSPORT: &str = "transport";

impl Source {
    /// True if its images can wait: a recording, not a camera.
    pub fn is_recorded(&self) -> bool {
        matches!(self, Self::File(_) | Self::Scenario { .. })
    }

    /// False for a scenario, which has images of all views.
    pub(crate) fn is_of_one_view(&self) -> bool {
        !matches!(self, Self::Scenario { .. })
    }

    /// Text that identifies the source. A fingerprint stands for hidden parts.
    pub(crate) fn identity(&self) -> String {
        match self {
            Self::Stream(stream) => {
                let (shown, whole) = (self.to_string(), stream.address.as_str());
                let hash = blake3::hash(whole.as_bytes()).to_hex();
                if shown == whole {
                    shown
                } else {
                    format!("{shown} ({})", &hash[..FINGERPRINT_DIGITS])
                }
            }
            _ => self.to_string(),
        }
    }

    /// Sets the server's password; only streams have one.
    #[must_use]
    pub fn with_password(mut self, password: Option<String>) -> Self {
        if let Self::Stream(stream) = &mut self {
            stream.password = password;
        }
        self
    }

    /// Accepts any certificate of the server.
    #[must_use]
    pub fn with_insecure_tls(mut self) -> Self {
        if let Self::Stream(stream) = &mut self {
            stream.insecure_tls = true;
        }
        self
    }
}

impl Stream {
    fn is_encrypted(&self) -> bool {
        self.address.scheme() == "rtsps"
    }

    fn parse(text: &str) -> Result<Self> {
        let refused = |why: String| Error::Source {
            source: shown(text),
            why,
        };
        let mut address = Url::parse(text).map_err(|error| refused(error.to_string()))?;
        if !address.has_host() {
            return Err(refused(
                "it names no host; expected rtsp://HOST/PATH".into(),
            ));
        }
        let mut names = address.query_pairs().map(|(name, _)| name);
        let in_query = names.any(|name| is_password_name(&name));
        let in_path = (address.path().rsplit_once('='))
            .is_some_and(|(before, _)| before.split('=').any(is_password_name));
        if address.password().is_some() || in_query || in_path {
            return Err(refused(
                "others can read a password in a command or in settings; set DTD_PASSWORD_VIEW (e.g. DTD_PASSWORD_LEFT) or give \
                 --password-file VIEW=FILE, and leave it out here"
                    .into(),
            ));
        }
        let mut transport = Transport::Tcp;
        let mut others = Vec::new();
        for (name, value) in address.query_pairs().into_owned() {
            match (name.as_str(), value.as_str()) {
                (TRANSPORT, "tcp") => transport = Transport::Tcp,
                (TRANSPORT, "udp") => transport = Transport::Udp,
                (TRANSPORT, other) => {
                    return Err(refused(format!(
                        "transport={other} is unknown; expected tcp or udp"
                    )));
                }
                _ => others.push((name, value)),
            }
        }
        if address.query().is_some() {
            address.set_query(None);
            if !others.is_empty() {
                address.query_pairs_mut().extend_pairs(others);
            }
        }
        Ok(Self {
            address,
            password: None,
            transport,
            insecure_tls: false,
        })
    }
}

impl FromStr for Source {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        if text.starts_with("rtsp://") || text.starts_with("rtsps://") {
            return Stream::parse(text).map(Self::Stream);
        }
        if let Some(place) = text.strip_prefix("corpus:") {
            let parts = place.trim_end_matches('/').rsplit_once('/');
            let (corpus, id) = parts
                .filter(|(corpus, id)| !corpus.is_empty() && !id.is_empty())
                .ok_or_else(|| Error::Source {
                    source: text.into(),
                    why: "expected corpus:CORPUS/SCENARIO".into(),
                })?;
            return Ok(Self::Scenario {
                corpus: corpus.into(),
                id: id.into(),
            });
        }
        let scheme = text.split_once(':').map(|(scheme, _)| scheme);
        let is_slashless =
            scheme.is_some_and(|scheme| ["rtsp", "rtsps"].contains(&&*scheme.to_ascii_lowercase()));
        if is_slashless || text.contains("://") {
            return Err(Error::Source {
                source: shown(text),
                why: "expected rtsp://, a video file, an SDP file, /dev/videoN or corpus:CORPUS/SCENARIO".into(),
            });
        }
        if text.starts_with("/dev/video") {
            return Ok(Self::Device(text.into()));
        }
        Ok(match text.rsplit_once('.') {
            Some((_, "sdp")) => Self::Description(text.into()),
            _ => Self::File(text.into()),
        })
    }
}

/// True if a value with this name is a password: `password`, `loginpwd`, `user=admin_passwd`.
fn is_password_name(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let last_word = name.rsplit(|letter: char| !letter.is_ascii_alphanumeric());
    let is_short = |word: &str| ["pass", "pw"].contains(&word);
    ["password", "passwd", "pwd"]
        .iter()
        .any(|end| name.ends_with(end))
        || last_word.take(1).any(is_short)
}

/// A text that is no address, or is refused as one, without its possible secrets: what stands before the host, after `=`, `?` and `#`.
fn shown(text: &str) -> String {
    let Some((scheme, rest)) = text.split_once(':') else {
        return text.into();
    };
    let slashes = if rest.starts_with("//") { "//" } else { "" };
    let rest = &rest[slashes.len()..];
    let head = rest.split(['?', '#']).next().unwrap_or_default();
    let end = if head.len() < rest.len() { "?***" } else { "" };
    let place = match (head.rsplit_once('@'), rest.contains('@')) {
        (Some((_, place)), _) => format!("***@{place}"),
        (None, true) => "***".into(),
        (None, false) => head.into(),
    };
    let place = match place.split_once('=') {
        Some((name, _)) => format!("{name}=***"),
        None => place,
    };
    format!("{scheme}:{slashes}{place}{end}")
}

/// The address without parameter values, which may be secrets.
fn without_values(address: &Url) -> Url {
    let mut shown = address.clone();
    shown.set_fragment(None);
    let parts = address.query_pairs().map(|(name, value)| match &*value {
        // It may be a token that has no name.
        "" => "***".into(),
        _ => format!("{name}=***"),
    });
    let query: Vec<String> = parts.collect();
    shown.set_query((!query.is_empty()).then(|| query.join("&")).as_deref());
    shown
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) | Self::Description(path) | Self::Device(path) => {
                path.display().fmt(f)
            }
            Self::Stream(stream) => without_values(&stream.address).fmt(f),
            Self::Scenario { corpus, id } => write!(f, "corpus:{}/{id}", corpus.display()),
        }
    }
}

impl fmt::Debug for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        without_values(&self.address).fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_is_what_its_text_looks_like() {
        let of = |text: &str| text.parse::<Source>().unwrap();
        assert_eq!(of("a/left.mp4"), Source::File("a/left.mp4".into()));
        assert_eq!(of("left.sdp"), Source::Description("left.sdp".into()));
        assert_eq!(of("/dev/video2"), Source::Device("/dev/video2".into()));
        let scenario = Source::Scenario {
            corpus: "my/corpus".into(),
            id: "0001-a".into(),
        };
        assert_eq!(of("corpus:my/corpus/0001-a"), scenario);
        for text in [
            "corpus:0001-a",
            "http://camera/left",
            "rtsp:///left",
            "rtsp:/camera/left",
        ] {
            assert!(text.parse::<Source>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_password_in_an_address_is_refused_and_not_repeated() {
        for text in [
            "rtsp://me:secret@camera/left",
            "rtsp://camera/left?user=me&password=secret",
            "rtsp://camera/left?user=me&Pwd=secret&channel=1",
            "rtsp://camera/left?user=me&p%61ss=secret",
            "rtsp://camera/user=me_password=secret_channel=1.sdp",
        ] {
            let said = text.parse::<Source>().unwrap_err().to_string();
            assert!(
                !said.contains("secret") && said.contains("DTD_PASSWORD_LEFT"),
                "{said}"
            );
        }
    }

    #[test]
    fn no_refusal_repeats_a_secret() {
        for text in [
            "rtsp:/me:secret@camera/left",
            "rtsp:me:secret@camera/left",
            "RTSP://me:secret@camera/left",
            "http://me:secret@camera/left",
            "rtsp://me:se?secret@camera/left",
            "rtsp://me:se#secret@camera/left",
            "http://camera/left?token=secret",
            "http://camera/token=secret",
        ] {
            let said = text.parse::<Source>().unwrap_err().to_string();
            assert!(!said.contains("secret"), "{said}");
        }
    }

    #[test]
    fn the_values_of_parameters_are_not_shown() {
        for text in [
            "rtsp://camera/left?token=secret&channel=2",
            "rtsp://camera/left?secret",
            "rtsp://camera/left#secret",
        ] {
            let source: Source = text.parse().unwrap();
            for said in [source.to_string(), format!("{source:?}")] {
                assert!(!said.contains("secret"), "{said}");
            }
        }
    }

    #[test]
    fn channels_of_one_recorder_are_different_sources_although_their_texts_are_the_same() {
        let of = |text: &str| text.parse::<Source>().unwrap();
        let [one, two] = [1, 2].map(|channel| of(&format!("rtsp://camera/?channel={channel}")));
        assert_eq!(one.to_string(), two.to_string());
        assert_ne!(one.identity(), two.identity());
        let with_password = one.clone().with_password(Some("secret".into()));
        assert_eq!(with_password.identity(), one.identity());
        assert_eq!(of("rtsp://camera/left").identity(), "rtsp://camera/left");
        assert_eq!(of("left.mp4").identity(), "left.mp4");
    }

    #[test]
    fn a_password_is_in_no_text() {
        let source: Source = "rtsp://me@camera/left?transport=udp&channel=2"
            .parse()
            .unwrap();
        let source = source.with_password(Some("p@ss/word".into()));
        assert_eq!(source.to_string(), "rtsp://me@camera/left?channel=***");
        assert_eq!(format!("{source:?}"), source.to_string());
        let Source::Stream(stream) = source else {
            panic!("it is a stream")
        };
        assert_eq!(stream.address.as_str(), "rtsp://me@camera/left?channel=2");
        assert_eq!(stream.transport, Transport::Udp);
    }
}
