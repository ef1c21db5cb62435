//! Sources of the images of a view.

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
    /// A description of an RTP stream (SDP).
    Description(PathBuf),
    /// A camera of this computer.
    Device(PathBuf),
    /// A scenario of a corpus, which has a video of each view.
    Scenario {
        /// Folder of the corpus.
        corpus: PathBuf,
        /// Identifier of the scenario.
        id: String,
    },
}

/// Address of a stream.
#[derive(Clone, PartialEq, Eq)]
pub struct Stream {
    /// Without password and without our own parameters.
    address: Url,
    password: Option<String>,
    transport: Transport,
}

/// Transport of packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transport {
    /// In the connection of the commands: nothing is lost.
    Tcp,
    /// On their own.
    Udp,
}

impl Transport {
    /// FFmpeg's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::Udp => "udp",
        }
    }
}

/// Our own parameter of an address.
const TRANSPORT: &str = "transport";

impl Source {
    /// True if its images can wait: a recording, not a camera.
    pub fn is_recorded(&self) -> bool {
        matches!(self, Self::File(_) | Self::Scenario { .. })
    }

    /// With the password of its server; other sources have none.
    #[must_use]
    pub fn with_password(mut self, password: Option<String>) -> Self {
        if let Self::Stream(stream) = &mut self {
            stream.password = password;
        }
        self
    }
}

impl Stream {
    /// The address for FFmpeg, with the password. It must not be logged.
    pub(crate) fn secret_address(&self) -> String {
        let mut address = self.address.clone();
        // Fails only for addresses without a host, which are rejected.
        let _ = address.set_password(self.password.as_deref());
        address.into()
    }

    pub(crate) fn transport(&self) -> Transport {
        self.transport
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
        if address.password().is_some() {
            return Err(refused(
                "all users of this computer can read the password in a command; set DTD_PASSWORD_VIEW (e.g. DTD_PASSWORD_LEFT) or give \
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
        if text.contains("://") {
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

/// An address without its secrets: whatever stands before the host.
fn shown(text: &str) -> String {
    match (text.split_once("://"), text.rsplit_once('@')) {
        (Some((scheme, _)), Some((_, host))) => format!("{scheme}://***@{host}"),
        _ => text.into(),
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) | Self::Description(path) | Self::Device(path) => {
                path.display().fmt(f)
            }
            Self::Stream(stream) => stream.address.fmt(f),
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
        self.address.fmt(f)
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
        for text in ["corpus:0001-a", "http://camera/left", "rtsp:///left"] {
            assert!(text.parse::<Source>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_password_in_an_address_is_refused_and_not_repeated() {
        let error = "rtsp://me:secret@camera/left"
            .parse::<Source>()
            .unwrap_err();
        let said = error.to_string();
        assert!(
            !said.contains("secret") && said.contains("DTD_PASSWORD_LEFT"),
            "{said}"
        );
    }

    #[test]
    fn a_password_reaches_the_server_and_no_text() {
        let source: Source = "rtsp://me@camera/left?transport=udp&channel=2"
            .parse()
            .unwrap();
        let source = source.with_password(Some("p@ss/word".into()));
        assert_eq!(source.to_string(), "rtsp://me@camera/left?channel=2");
        assert_eq!(format!("{source:?}"), source.to_string());
        let Source::Stream(stream) = source else {
            panic!("it is a stream")
        };
        assert_eq!(
            stream.secret_address(),
            "rtsp://me:p%40ss%2Fword@camera/left?channel=2"
        );
        assert_eq!(stream.transport(), Transport::Udp);
    }
}
