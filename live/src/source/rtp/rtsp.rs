//! Asks an RTSP server for its video (RFC 2326). Redirects are not followed, and nothing but the video is set up.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::{Duration, Instant};

use http_auth::{PasswordClient, PasswordParams};
use percent_encoding::percent_decode_str;
use url::Url;

use super::link::{Link, Message, Response};
use super::sdp::{self, Video};
use super::sockets::Sockets;
use crate::source::limits::{OpenFault, Patience};
use crate::source::{Stream, Transport, shown};

/// A server ends a session after this time without a request, unless it says otherwise (RFC 2326, 12.37), s.
const SESSION_S: u64 = 60;

pub(super) struct Server {
    pub(super) link: Link,
    /// Address without user and password, to ask for.
    address: String,
    user: Option<[String; 2]>,
    challenge: Option<PasswordClient>,
    requests: u32,
    session: Option<String>,
    /// The request that keeps the session, its interval, and when it was last sent.
    keeps: (&'static str, Duration, Instant),
    /// Channels of packets and of reports, if they come through this connection.
    pub(super) channels: [u8; 2],
    patience: Arc<Patience>,
}

impl Server {
    /// Asks for a stream's video, and starts it. `sockets`: for separate packets.
    pub(super) fn play(
        stream: &Stream,
        patience: &Arc<Patience>,
    ) -> Result<(Self, Video, Option<Sockets>), OpenFault> {
        let mut server = Self::connect(stream, patience)?;
        let address = server.address.clone();
        let options = server.ask("OPTIONS", &address, &[])?;
        if options
            .all("Public")
            .any(|methods| methods.contains("GET_PARAMETER"))
        {
            server.keeps.0 = "GET_PARAMETER";
        }
        let described = server.ask("DESCRIBE", &address, &[("Accept", "application/sdp")])?;
        let text = String::from_utf8_lossy(&described.body);
        let (video, control) = sdp::video(&text).map_err(OpenFault::Wrong)?;
        let base = described
            .header("Content-Base")
            .or(described.header("Content-Location"));
        let base = base.unwrap_or(&address);
        let of_video = joined(base, video.control.as_deref());
        let of_all = joined(base, control.as_deref());
        let (sockets, wanted) = match stream.transport {
            Transport::Tcp => (None, "RTP/AVP/TCP;unicast;interleaved=0-1".to_owned()),
            Transport::Udp => {
                let [own, _] = server.link.addresses().map_err(absent)?;
                let (sockets, port) = Sockets::pair(own.ip()).map_err(absent)?;
                let wanted = format!("RTP/AVP;unicast;client_port={port}-{}", port + 1);
                (Some(sockets), wanted)
            }
        };
        let set_up = server.ask("SETUP", &of_video, &[("Transport", &wanted)])?;
        server.take_session(&set_up);
        let transport = set_up.header("Transport").unwrap_or_default();
        if let Some([packets, reports]) = range_of(transport, "interleaved") {
            server.channels = [packets, reports].map(|channel| channel as u8);
        }
        server.ask("PLAY", &of_all, &[("Range", "npt=0.000-")])?;
        let sockets = sockets.map(|mut sockets| {
            let [_, peer] = server.link.addresses()?;
            sockets.expect(sources(transport, peer), range_of(transport, "server_port"))?;
            server.link.stop_waiting()?;
            Ok(sockets)
        });
        Ok((server, video, sockets.transpose().map_err(absent)?))
    }

    fn connect(stream: &Stream, patience: &Arc<Patience>) -> Result<Self, OpenFault> {
        let mut address: Url = stream.address.clone();
        let host = address.host_str().unwrap_or_default().to_owned();
        let (verifies, usual_port) = if stream.is_encrypted() {
            (Some(!stream.insecure_tls), 322)
        } else {
            (None, 554)
        };
        let name = percent_decode_str(address.username())
            .decode_utf8_lossy()
            .into_owned();
        let password = stream.password.clone();
        let has_user = !name.is_empty() || password.is_some();
        let user = has_user.then(|| [name, password.unwrap_or_default()]);
        // These fail only for addresses without a host, which are rejected.
        let _ = address.set_username("");
        let _ = address.set_password(None);
        address.set_fragment(None);
        let port = address.port().unwrap_or(usual_port);
        Ok(Self {
            link: Link::connect((host.trim_matches(['[', ']']), port), verifies, patience)?,
            address: address.into(),
            user,
            challenge: None,
            requests: 0,
            session: None,
            keeps: (
                "OPTIONS",
                Duration::from_secs(SESSION_S / 2),
                Instant::now(),
            ),
            channels: [0, 1],
            patience: patience.clone(),
        })
    }

    /// Sends a request, and waits for its answer; with the password if the server asks for it.
    fn ask(
        &mut self,
        method: &str,
        address: &str,
        headers: &[(&str, &str)],
    ) -> Result<Response, OpenFault> {
        let mut response = self.ask_once(method, address, headers)?;
        if response.status == 401 && self.user.is_some() {
            let challenges = response.all("WWW-Authenticate");
            let client =
                challenges.fold(PasswordClient::builder(), |all, text| all.challenges(text));
            let why =
                |why| OpenFault::Absent(format!("it asks for a password in an unknown way: {why}"));
            self.challenge = Some(client.build().map_err(why)?);
            response = self.ask_once(method, address, headers)?;
        }
        match response.status {
            200..=299 => Ok(response),
            401 => Err(OpenFault::Wrong(
                "it asks for a password; give the user in the address (rtsp://USER@HOST/PATH) and the password in the environment, \
                 DTD_PASSWORD_VIEW, or with --password-file VIEW=FILE"
                    .into(),
            )),
            300..=399 => Err(OpenFault::Wrong(format!(
                "it redirects to {}, which is not followed because the password would go there; give that address if it is yours",
                shown(response.header("Location").unwrap_or("nowhere"))
            ))),
            _ => Err(OpenFault::Absent(format!("it answers {method} with {:?}", response.text))),
        }
    }

    fn ask_once(
        &mut self,
        method: &str,
        address: &str,
        headers: &[(&str, &str)],
    ) -> Result<Response, OpenFault> {
        self.send(method, address, headers).map_err(absent)?;
        let number = self.requests.to_string();
        loop {
            match self.link.message().map_err(OpenFault::Absent)? {
                Some(Message::Response(response))
                    if response.header("CSeq").is_none_or(|of| of == number) =>
                {
                    return Ok(response);
                }
                _ => {}
            }
            if self.patience.is_over() {
                return Err(OpenFault::Absent(format!("no answer to {method} in time")));
            }
        }
    }

    fn send(&mut self, method: &str, address: &str, headers: &[(&str, &str)]) -> io::Result<()> {
        self.requests += 1;
        let mut text = format!(
            "{method} {address} RTSP/1.0\r\nCSeq: {}\r\nUser-Agent: dtd\r\n",
            self.requests
        );
        if let (Some(challenge), Some([username, password])) = (&mut self.challenge, &self.user) {
            let with = PasswordParams {
                username,
                password,
                uri: address,
                method,
                body: Some(&[]),
            };
            let answer = challenge.respond(&with).map_err(io::Error::other)?;
            text += &format!("Authorization: {answer}\r\n");
        }
        if let Some(session) = &self.session {
            text += &format!("Session: {session}\r\n");
        }
        for (name, value) in headers {
            text += &format!("{name}: {value}\r\n");
        }
        self.link.send(&(text + "\r\n"))
    }

    fn take_session(&mut self, set_up: &Response) {
        let session = set_up.header("Session").unwrap_or_default();
        let mut parts = session.split(';').map(str::trim);
        self.session = parts.next().filter(|id| !id.is_empty()).map(str::to_owned);
        let timeout_s = parts.find_map(|part| part.strip_prefix("timeout=")?.parse().ok());
        self.keeps.1 = Duration::from_secs(timeout_s.unwrap_or(SESSION_S).clamp(2, SESSION_S) / 2);
    }

    /// The next packet with its channel; `None` if none comes. Keeps the session.
    pub(super) fn packet(&mut self) -> Result<Option<(u8, Vec<u8>)>, String> {
        let (method, interval, sent) = self.keeps;
        if sent.elapsed() >= interval {
            self.keeps.2 = Instant::now();
            let address = self.address.clone();
            self.send(method, &address, &[])
                .map_err(|error| error.to_string())?;
        }
        Ok(match self.link.message()? {
            Some(Message::Packet(channel, packet)) => Some((channel, packet)),
            _ => None,
        })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if self.session.is_some() {
            let address = self.address.clone();
            // The connection is closed in any case.
            let _ = self.send("TEARDOWN", &address, &[]);
        }
    }
}

fn absent(error: io::Error) -> OpenFault {
    OpenFault::Absent(error.to_string())
}

/// Address of a control: an address, or what follows the base.
fn joined(base: &str, control: Option<&str>) -> String {
    match control {
        None | Some("*") => base.into(),
        Some(control) if control.contains("://") => control.into(),
        Some(control) => format!(
            "{}/{}",
            base.trim_end_matches('/'),
            control.trim_start_matches('/')
        ),
    }
}

/// The value of a transport's parameter, `NAME=FROM-TO`.
fn range_of(transport: &str, name: &str) -> Option<[u16; 2]> {
    let mut pairs = transport
        .split(';')
        .filter_map(|part| part.trim().split_once('='));
    let (_, range) = pairs.find(|(of, _)| *of == name)?;
    let (from, to) = range.split_once('-').unwrap_or((range, range));
    Some([from.parse().ok()?, to.parse().ok()?])
}

/// Addresses from which packets may come.
fn sources(transport: &str, peer: SocketAddr) -> Vec<IpAddr> {
    let mut parts = transport.split(';');
    let named = parts.find_map(|part| part.trim().strip_prefix("source=")?.parse().ok());
    [Some(peer.ip()), named].into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_follow_the_base_or_are_addresses() {
        let base = "rtsp://camera/left/";
        assert_eq!(joined(base, None), base);
        assert_eq!(joined(base, Some("*")), base);
        assert_eq!(joined(base, Some("track=1")), "rtsp://camera/left/track=1");
        assert_eq!(
            joined("rtsp://camera/?a=1", Some("/one")),
            "rtsp://camera/?a=1/one"
        );
        assert_eq!(joined(base, Some("rtsp://camera/1")), "rtsp://camera/1");
    }

    #[test]
    fn a_transport_names_ports_and_the_source() {
        let text = "RTP/AVP;unicast;source=10.0.0.9;client_port=4-5;server_port=600-601";
        assert_eq!(range_of(text, "server_port"), Some([600, 601]));
        assert_eq!(range_of(text, "interleaved"), None);
        let peer = SocketAddr::from(([10, 0, 0, 1], 554));
        assert_eq!(
            sources(text, peer),
            [IpAddr::from([10, 0, 0, 1]), [10, 0, 0, 9].into()]
        );
    }
}
