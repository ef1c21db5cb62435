//! Stream descriptions (SDP, RFC 8866): the first video whose coding is known.

use std::net::IpAddr;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Coding of a video in RTP packets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coding {
    H264,
    H265,
    Jpeg,
}

impl Coding {
    fn of(name: &str) -> Option<Self> {
        match &*name.to_ascii_uppercase() {
            "H264" => Some(Self::H264),
            "H265" => Some(Self::H265),
            "JPEG" => Some(Self::Jpeg),
            _ => None,
        }
    }
}

/// A video that is sent.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Video {
    pub(crate) coding: Coding,
    pub(crate) payload_type: u8,
    pub(crate) clock_hz: u32,
    /// Where its server is asked for it: an address, or the end of one.
    pub(crate) control: Option<String>,
    /// Parameter sets that it may lack, as the decoder reads them.
    pub(crate) parameters: Vec<u8>,
    /// Where packets are sent to without a server.
    pub(crate) address: Option<IpAddr>,
    pub(crate) port: u16,
}

/// A description's lines about a medium, and the session's before the first one.
#[derive(Default)]
struct Section<'a> {
    medium: &'a str,
    lines: Vec<(&'a str, &'a str)>,
}

impl<'a> Section<'a> {
    /// Values of an attribute: `a=NAME:VALUE`.
    fn attribute(&self, name: &str) -> impl Iterator<Item = &'a str> {
        let attributes = self.lines.iter().filter(|(kind, _)| *kind == "a");
        let values = attributes.filter_map(|(_, text)| text.split_once(':'));
        let found = values.filter(move |(of, _)| of.eq_ignore_ascii_case(name));
        found.map(|(_, value)| value.trim())
    }

    /// Value of an attribute of a payload type: `a=NAME:TYPE VALUE`.
    fn of_payload(&self, name: &str, payload: &str) -> Option<&'a str> {
        let mut pairs = self.attribute(name).filter_map(|of| of.split_once(' '));
        let found = pairs.find(|(of_payload, _)| *of_payload == payload);
        found.map(|(_, value)| value.trim())
    }

    fn address(&self) -> Option<IpAddr> {
        let (_, text) = self.lines.iter().find(|(kind, _)| *kind == "c")?;
        let address = text.split_whitespace().nth(2)?;
        address.split('/').next()?.parse().ok()
    }

    /// The video of this section, or the name of its coding.
    fn video(&self, session: &Self) -> Result<Video, String> {
        let mut words = self.medium.split_whitespace().skip(1);
        let port = words.next().and_then(|port| port.split('/').next());
        let payload = words.nth(1).unwrap_or_default();
        let map = self.of_payload("rtpmap", payload);
        // The only static type of a coding that is known here.
        let map = map.unwrap_or(if payload == "26" {
            "JPEG/90000"
        } else {
            payload
        });
        let (name, clock) = map.split_once('/').unwrap_or((map, ""));
        let coding = Coding::of(name).ok_or_else(|| name.to_owned())?;
        let format = self.of_payload("fmtp", payload).unwrap_or_default();
        let clock = clock.split('/').next().unwrap_or_default();
        Ok(Video {
            coding,
            payload_type: payload.parse().map_err(|_| name.to_owned())?,
            clock_hz: clock.parse().ok().filter(|hz| *hz > 0).unwrap_or(90_000),
            control: self.attribute("control").next().map(str::to_owned),
            parameters: parameters(coding, format),
            address: self.address().or_else(|| session.address()),
            port: port.and_then(|port| port.parse().ok()).unwrap_or(0),
        })
    }
}

/// The video that a description names, and the address that controls all of its media.
///
/// # Errors
/// There is none, or none whose coding is known: the cause.
pub(crate) fn video(text: &str) -> Result<(Video, Option<String>), String> {
    let mut sections = vec![Section::default()];
    for line in text.lines() {
        let Some((kind, value)) = line.trim().split_once('=') else {
            continue;
        };
        if kind == "m" {
            sections.push(Section::default());
        }
        let Some(section) = sections.last_mut() else {
            continue;
        };
        if kind == "m" {
            section.medium = value;
        }
        section.lines.push((kind, value));
    }
    let (session, media) = (&sections[0], &sections[1..]);
    if session.lines.is_empty() {
        return Err("it is no description of a stream (SDP)".into());
    }
    let videos = media.iter().filter(|of| of.medium.starts_with("video "));
    let mut others = Vec::new();
    for section in videos {
        match section.video(session) {
            Ok(video) => {
                return Ok((
                    video,
                    session.attribute("control").next().map(str::to_owned),
                ));
            }
            Err(name) => others.push(name),
        }
    }
    Err(match others.first() {
        None => "there is no video in it".into(),
        Some(name) => format!(
            "its video is coded as {name:?}, expected H264, H265 or JPEG; set the camera to one of them"
        ),
    })
}

/// The parameter sets of a format, with start codes.
fn parameters(coding: Coding, format: &str) -> Vec<u8> {
    let value = |name: &str| {
        let mut pairs = format.split(';').filter_map(|pair| pair.split_once('='));
        let found = pairs.find(|(of, _)| of.trim().eq_ignore_ascii_case(name));
        found.map_or("", |(_, value)| value.trim())
    };
    let names: &[&str] = match coding {
        Coding::H264 => &["sprop-parameter-sets"],
        Coding::H265 => &["sprop-vps", "sprop-sps", "sprop-pps"],
        Coding::Jpeg => &[],
    };
    let sets = names.iter().flat_map(|name| value(name).split(','));
    let decoded = sets.filter_map(|set| STANDARD.decode(set.trim()).ok());
    let units = decoded.filter(|unit| !unit.is_empty());
    units
        .flat_map(|unit| [&super::units::START_CODE[..], &unit].concat())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_video_whose_coding_is_known_is_chosen() {
        let text = "v=0\r\nc=IN IP4 239.1.2.3/64\r\na=control:rtsp://camera/all\r\nm=audio 0 RTP/AVP 0\r\na=control:one\r\n\
            m=video 0 RTP/AVP 97\r\na=rtpmap:97 VP8/90000\r\nm=video 5004 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n\
            a=fmtp:96 packetization-mode=1; sprop-parameter-sets=Z0IA,aM4=\r\na=control:two\r\n";
        let (video, control) = video(text).unwrap();
        assert_eq!(control.as_deref(), Some("rtsp://camera/all"));
        let expected = Video {
            coding: Coding::H264,
            payload_type: 96,
            clock_hz: 90_000,
            control: Some("two".into()),
            parameters: vec![0, 0, 0, 1, 0x67, 0x42, 0, 0, 0, 0, 1, 0x68, 0xce],
            address: Some([239, 1, 2, 3].into()),
            port: 5004,
        };
        assert_eq!(video, expected);
    }

    #[test]
    fn a_description_without_a_video_that_can_be_decoded_says_so() {
        let of = |text: &str| video(text).unwrap_err();
        assert!(of("words").contains("no description"));
        assert!(of("v=0\r\nm=audio 0 RTP/AVP 0\r\n").contains("no video"));
        let other = "v=0\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 AV1/90000\r\n";
        assert!(of(other).contains("\"AV1\""));
    }
}
