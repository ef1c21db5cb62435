//! A connection to an RTSP server, with or without TLS, and its messages within limits: a server must not fill the memory.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::Duration;

use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, aws_lc_rs};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, SignatureScheme, StreamOwned};
use rustls_platform_verifier::BuilderVerifierExt;

use crate::source::limits::{OpenFault, Patience};

/// Maximum wait within which the program's end is noticed.
pub(super) const SLICE: Duration = Duration::from_millis(50);
/// Bytes of the largest head of a message, and of the largest body: descriptions have a few thousand.
const MAX_HEAD: usize = 16 << 10;
const MAX_BODY: usize = 256 << 10;
/// Bytes that are read at once.
const CHUNK: usize = 64 << 10;

/// The connection, or what TLS makes of it.
trait Channel: Read + Write + Send {}
impl<T: Read + Write + Send> Channel for T {}

/// A message of a server.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Message {
    Response(Response),
    /// A packet of a channel.
    Packet(u8, Vec<u8>),
    /// A server's request, which gets no answer.
    Request,
}

#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Response {
    pub(super) status: u16,
    /// Status line without the protocol.
    pub(super) text: String,
    headers: Vec<(String, String)>,
    pub(super) body: Vec<u8>,
}

impl Response {
    pub(super) fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a str> {
        let headers = self.headers.iter();
        let found = headers.filter(move |(of, _)| of.eq_ignore_ascii_case(name));
        found.map(|(_, value)| &**value)
    }

    pub(super) fn header<'a>(&'a self, name: &'a str) -> Option<&'a str> {
        self.all(name).next()
    }
}

pub(super) struct Link {
    socket: TcpStream,
    channel: Box<dyn Channel>,
    unread: Unread,
}

impl Link {
    /// Connects to a server. `verifies`: with a certificate that this computer trusts; `None` without TLS.
    pub(super) fn connect(
        host: (&str, u16),
        verifies: Option<bool>,
        patience: &Patience,
    ) -> Result<Self, OpenFault> {
        let absent = |error: io::Error| OpenFault::Absent(format!("no connection: {error}"));
        let addresses = host.to_socket_addrs().map_err(absent)?;
        let mut last = Err(absent(ErrorKind::AddrNotAvailable.into()));
        for address in addresses {
            let left = patience.left().max(SLICE);
            last = TcpStream::connect_timeout(&address, left).map_err(absent);
            if last.is_ok() {
                break;
            }
        }
        let socket = last?;
        let set_up = || {
            socket.set_nodelay(true)?;
            socket.set_read_timeout(Some(SLICE))?;
            socket.set_write_timeout(Some(Duration::from_secs(1)))?;
            socket.try_clone()
        };
        let channel = set_up().map_err(absent)?;
        Ok(Self {
            channel: match verifies {
                None => Box::new(channel),
                Some(verifies) => Box::new(encrypted(channel, host.0, verifies, patience)?),
            },
            socket,
            unread: Unread::default(),
        })
    }

    /// Addresses of this computer and of the server.
    pub(super) fn addresses(&self) -> io::Result<[SocketAddr; 2]> {
        Ok([self.socket.local_addr()?, self.socket.peer_addr()?])
    }

    /// Stops waiting for messages that have not arrived.
    pub(super) fn stop_waiting(&self) -> io::Result<()> {
        self.socket.set_nonblocking(true)
    }

    /// True if something has come that is not read yet.
    pub(super) fn has_bytes(&self) -> bool {
        self.unread.from < self.unread.bytes.len() || has_bytes(&self.socket)
    }

    pub(super) fn send(&mut self, text: &str) -> io::Result<()> {
        self.channel.write_all(text.as_bytes())?;
        self.channel.flush()
    }

    /// The next message; `None` if there is none within [`SLICE`].
    ///
    /// # Errors
    /// The connection is gone, or the server sends anything else: the cause.
    pub(super) fn message(&mut self) -> Result<Option<Message>, String> {
        if let Some(message) = self.unread.message()? {
            return Ok(Some(message));
        }
        let mut chunk = [0; CHUNK];
        match self.channel.read(&mut chunk) {
            Ok(0) => Err("the server closed the connection".into()),
            Ok(bytes) => {
                self.unread.add(&chunk[..bytes]);
                self.unread.message()
            }
            Err(error) if is_later(&error) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// True if something has come to a socket that is not read yet.
pub(super) fn has_bytes(socket: impl AsFd) -> bool {
    rustix::io::ioctl_fionread(socket).is_ok_and(|bytes| bytes > 0)
}

/// True if the call may be repeated.
pub(super) fn is_later(error: &io::Error) -> bool {
    let kinds = [
        ErrorKind::WouldBlock,
        ErrorKind::TimedOut,
        ErrorKind::Interrupted,
    ];
    kinds.contains(&error.kind())
}

/// Bytes of messages that are not complete.
#[derive(Default)]
struct Unread {
    bytes: Vec<u8>,
    from: usize,
}

impl Unread {
    fn add(&mut self, bytes: &[u8]) {
        self.bytes.drain(..std::mem::take(&mut self.from));
        self.bytes.extend(bytes);
    }

    fn message(&mut self) -> Result<Option<Message>, String> {
        let first = first_message(&self.bytes[self.from..])?;
        Ok(first.map(|(message, bytes)| {
            self.from += bytes;
            message
        }))
    }
}

/// The first message of these bytes with its length; `None` if it is not complete.
pub(super) fn first_message(bytes: &[u8]) -> Result<Option<(Message, usize)>, String> {
    if let [b'$', channel, high, low, rest @ ..] = bytes {
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        let packet = rest.get(..length);
        return Ok(packet.map(|packet| (Message::Packet(*channel, packet.into()), 4 + length)));
    }
    if bytes.is_empty() || bytes[0] == b'$' {
        return Ok(None);
    }
    let head = &bytes[..bytes.len().min(MAX_HEAD)];
    if !bytes[0].is_ascii_alphabetic() && !b"\r\n".contains(&bytes[0]) {
        return Err("it does not answer as an RTSP server".into());
    }
    let end = head.windows(4).position(|end| end == b"\r\n\r\n");
    let Some(end) = end else {
        let is_too_long = head.len() == MAX_HEAD;
        let why = || format!("its answer has more than {MAX_HEAD} bytes of headers");
        return if is_too_long { Err(why()) } else { Ok(None) };
    };
    let head = String::from_utf8_lossy(&head[..end]);
    let mut lines = head.trim_start().lines();
    let first = lines.next().unwrap_or_default();
    let headers = lines.filter_map(|line| line.split_once(':'));
    let headers = headers.map(|(name, value)| (name.trim().into(), value.trim().into()));
    let mut response = Response {
        headers: headers.collect(),
        ..Response::default()
    };
    let length = response.header("Content-Length").map_or(Ok(0), str::parse);
    let length = length.ok().filter(|length| *length <= MAX_BODY);
    let length = length.ok_or_else(|| {
        let length = response.header("Content-Length").unwrap_or_default();
        format!("its answer has {length} bytes, expected at most {MAX_BODY}")
    })?;
    let Some(body) = bytes.get(end + 4..end + 4 + length) else {
        return Ok(None);
    };
    let message = match first
        .strip_prefix("RTSP/")
        .and_then(|rest| rest.split_once(' '))
    {
        Some((_, text)) => {
            response.status = text
                .get(..3)
                .and_then(|code| code.parse().ok())
                .unwrap_or(0);
            response.text = text.chars().take(80).collect();
            response.body = body.into();
            Message::Response(response)
        }
        None => Message::Request,
    };
    Ok(Some((message, end + 4 + length)))
}

fn encrypted(
    mut socket: TcpStream,
    host: &str,
    verifies: bool,
    patience: &Patience,
) -> Result<StreamOwned<ClientConnection, TcpStream>, OpenFault> {
    let failed = |error: rustls::Error| OpenFault::Absent(format!("no encryption: {error}"));
    let provider = Arc::new(aws_lc_rs::default_provider());
    let builder = ClientConfig::builder_with_provider(provider.clone());
    let builder = builder
        .with_safe_default_protocol_versions()
        .map_err(failed)?;
    let config = if verifies {
        builder
            .with_platform_verifier()
            .map_err(failed)?
            .with_no_client_auth()
    } else {
        let any = Arc::new(AnyCertificate(provider));
        builder
            .dangerous()
            .with_custom_certificate_verifier(any)
            .with_no_client_auth()
    };
    let name = ServerName::try_from(host.trim_matches(['[', ']']).to_owned());
    let name =
        name.map_err(|error| OpenFault::Useless(format!("its host has no valid name: {error}")))?;
    let mut connection = ClientConnection::new(Arc::new(config), name).map_err(failed)?;
    while connection.is_handshaking() {
        match connection.complete_io(&mut socket) {
            Ok(_) if !patience.is_over() => {}
            Err(error) if is_later(&error) && !patience.is_over() => {}
            Ok(_) => {
                let why = "no end of its first messages in time";
                return Err(OpenFault::Absent(format!("no encryption: {why}")));
            }
            Err(error) => {
                let cause = error.get_ref().and_then(|cause| cause.downcast_ref());
                return Err(match cause {
                    Some(rustls::Error::InvalidCertificate(why)) => OpenFault::Wrong(format!(
                        "this computer does not trust its certificate: {why:?}; install the authority that has signed it, or give \
                         --insecure-tls VIEW on a network that you trust"
                    )),
                    _ => OpenFault::Absent(format!("no encryption: {error}")),
                });
            }
        }
    }
    Ok(StreamOwned::new(connection, socket))
}

/// Takes any certificate. Whose key has signed the connection then proves nothing.
#[derive(Debug)]
struct AnyCertificate(Arc<CryptoProvider>);

impl ServerCertVerifier for AnyCertificate {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages of these bytes, which come in pieces of this length.
    fn messages(bytes: &[u8], piece: usize) -> Result<Vec<Message>, String> {
        let mut unread = Unread::default();
        let mut all = Vec::new();
        for piece in bytes.chunks(piece) {
            unread.add(piece);
            while let Some(message) = unread.message()? {
                all.push(message);
            }
        }
        Ok(all)
    }

    #[test]
    fn answers_and_packets_are_read_however_they_are_cut() {
        let text = b"$\x00\x00\x02ab\r\nRTSP/1.0 200 OK\r\nCSeq: 1\r\ncontent-length:2\r\n\r\nxy$\x01\x00\x00OPTIONS * RTSP/1.0\r\n\r\n";
        for piece in [1, 5, text.len()] {
            let all = messages(text, piece).unwrap();
            let Message::Response(response) = &all[1] else {
                panic!("{all:?}")
            };
            assert_eq!(
                (response.status, &*response.text, &*response.body),
                (200, "200 OK", &b"xy"[..])
            );
            assert_eq!(response.header("cseq"), Some("1"));
            assert_eq!(all[0], Message::Packet(0, b"ab".into()));
            assert_eq!(all[2..], [Message::Packet(1, Vec::new()), Message::Request]);
        }
    }

    #[test]
    fn what_is_too_long_or_is_no_answer_is_refused() {
        let said = |bytes: &[u8]| messages(bytes, 1_000).unwrap_err();
        assert!(
            said(b"RTSP/1.0 200 OK\r\nContent-Length: 2000000000\r\n\r\n")
                .contains("2000000000 bytes")
        );
        assert!(
            said(&[b"RTSP/1.0 200 OK\r\n", &b"X: y\r\n".repeat(3_000)[..]].concat())
                .contains("headers")
        );
        assert!(said(&[0xa5; 40]).contains("does not answer as an RTSP server"));
    }
}
