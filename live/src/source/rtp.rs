//! Images that come as RTP: from an RTSP server, or as a description (SDP) says.
//!
//! FFmpeg's reader shows neither the marker bit, which ends an image, nor sequence numbers, which show losses, and it sends the password to
//! whomever a server redirects to.

mod jpeg;
mod link;
mod packets;
mod rtsp;
pub(crate) mod sdp;
mod sockets;
mod units;

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;

use dataset::files::outside_file::{self, FileKind};

use crate::clock::Clues;
use crate::source::Stream;
use crate::source::limits::{End, OpenFault, Patience};
use packets::{Order, Packet, Timeline, sender_report};
use rtsp::Server;
use sdp::Video;
use sockets::Sockets;
use units::{Unit, Units};

/// Wait for packets that others have overtaken, s.
const REORDER_S: f64 = 0.06;
/// Minimum time between two reports that give a rate, s.
const MIN_SPAN_S: f64 = 4.0;

/// An image as it was sent.
pub(crate) struct CodedImage {
    pub(crate) pts: i64,
    pub(crate) data: Vec<u8>,
    pub(crate) clues: Clues,
    pub(crate) is_damaged: bool,
}

pub(crate) struct RtpStream {
    pub(crate) video: Video,
    server: Option<Server>,
    sockets: Option<Sockets>,
    order: Order,
    units: Units,
    times: Timeline,
    /// The sender's last report and one before it: timestamps with its clock, seconds since the start.
    reports: [Option<(i64, f64)>; 2],
    /// Time from the sender's clock to the arrival of the last report, s.
    report_delay_s: Option<f64>,
    ready: VecDeque<CodedImage>,
    /// Nothing had come when the next image was asked for.
    is_prompt: bool,
    patience: Arc<Patience>,
}

impl RtpStream {
    /// Starts a server's video.
    pub(crate) fn of_server(stream: &Stream, patience: &Arc<Patience>) -> Result<Self, OpenFault> {
        let (server, video, sockets) = Server::play(stream, patience)?;
        Ok(Self::new(video, Some(server), sockets, patience))
    }

    /// Receives what a description names.
    pub(crate) fn of_description(path: &Path, patience: &Arc<Patience>) -> Result<Self, OpenFault> {
        let bytes = outside_file::read(path, FileKind::SETTINGS)
            .map_err(|error| OpenFault::Useless(error.to_string()))?;
        let (video, _) =
            sdp::video(&String::from_utf8_lossy(&bytes)).map_err(OpenFault::Useless)?;
        let port = video.port;
        let sockets = Sockets::receiving(video.address, port);
        let sockets = sockets
            .map_err(|error| OpenFault::Absent(format!("port {port} cannot be used: {error}")))?;
        Ok(Self::new(video, None, Some(sockets), patience))
    }

    fn new(
        video: Video,
        server: Option<Server>,
        sockets: Option<Sockets>,
        patience: &Arc<Patience>,
    ) -> Self {
        Self {
            order: Order::new(if sockets.is_some() { REORDER_S } else { 0.0 }),
            units: Units::new(video.coding, video.parameters.clone()),
            video,
            server,
            sockets,
            times: Timeline::default(),
            reports: [None; 2],
            report_delay_s: None,
            ready: VecDeque::new(),
            is_prompt: false,
            patience: patience.clone(),
        }
    }

    /// The next image; `most_ms`: maximum wait for it.
    pub(crate) fn next(&mut self, most_ms: u64) -> Result<CodedImage, End> {
        self.patience.wait(most_ms);
        self.is_prompt = self.ready.is_empty() && !self.has_packet();
        loop {
            if let Some(image) = self.ready.pop_front() {
                return Ok(image);
            }
            if self.patience.is_stopped() {
                return Err(End::Stopped);
            }
            if self.patience.is_over() {
                return Err(End::Silent(most_ms));
            }
            self.receive().map_err(End::Lost)?;
        }
    }

    /// True if packets have come that are not read yet.
    fn has_packet(&self) -> bool {
        match (&self.sockets, &self.server) {
            (Some(sockets), _) => sockets.has_packet(),
            (None, server) => server.as_ref().is_some_and(|of| of.link.has_bytes()),
        }
    }

    /// Takes what comes within a short time.
    fn receive(&mut self) -> Result<(), String> {
        if let Some(server) = &mut self.server
            && let Some((channel, bytes)) = server.packet()?
        {
            match server.channels.iter().position(|of| *of == channel) {
                Some(0) => self.take_packet(bytes),
                Some(_) => self.take_report(&bytes),
                None => {}
            }
        }
        let Some(sockets) = &mut self.sockets else {
            return Ok(());
        };
        let report = sockets.report().map_err(|error| error.to_string())?;
        let packet = sockets.packet().map_err(|error| error.to_string())?;
        if let Some(bytes) = report {
            self.take_report(&bytes);
        }
        match packet {
            Some(bytes) => self.take_packet(bytes),
            None => self.take_ordered(),
        }
        Ok(())
    }

    fn take_packet(&mut self, bytes: Vec<u8>) {
        let packet =
            Packet::of(bytes).filter(|packet| packet.payload_type() == self.video.payload_type);
        if let Some(packet) = packet {
            self.order.put(packet, self.patience.clock.now_s());
            self.take_ordered();
        }
    }

    fn take_ordered(&mut self) {
        let arrival_s = self.patience.clock.now_s();
        while let Some((packet, has_loss)) = self.order.next(arrival_s) {
            for Unit {
                timestamp,
                data,
                is_damaged,
            } in self.units.take(&packet, has_loss).into_iter().flatten()
            {
                let pts = self.times.advance(timestamp);
                let clues = Clues {
                    arrival_s,
                    timestamp_s: Some(pts as f64 / f64::from(self.video.clock_hz)),
                    sender_s: self.sender_s(pts),
                    report_delay_s: self.report_delay_s,
                    is_prompt: self.is_prompt,
                };
                self.ready.push_back(CodedImage {
                    pts,
                    data,
                    clues,
                    is_damaged,
                });
            }
        }
    }

    fn take_report(&mut self, bytes: &[u8]) {
        if let Some((utc_s, timestamp)) = sender_report(bytes) {
            let sender_s = self.patience.clock.since_start_s(utc_s);
            self.report_delay_s = Some(self.patience.clock.now_s() - sender_s);
            let report = Some((self.times.place(timestamp), sender_s));
            let [last, before] = self.reports;
            let is_near = |(_, before_s): &(i64, f64)| sender_s - before_s < 2.0 * MIN_SPAN_S;
            self.reports = [report, before.filter(is_near).or(last)];
        }
    }

    /// The sender's clock for a timestamp, at the rate of its reports: not all cameras send as many images as they announce.
    fn sender_s(&self, pts: i64) -> Option<f64> {
        let [last, before] = self.reports;
        let (of_pts, sender_s) = last?;
        let usual_s = 1.0 / f64::from(self.video.clock_hz);
        let before = before.filter(|(_, before_s)| sender_s - before_s >= MIN_SPAN_S);
        let measured_s =
            before.map(|(pts, before_s)| (sender_s - before_s) / (of_pts - pts) as f64);
        let is_plausible = |unit_s: &f64| (0.5..2.0).contains(&(unit_s / usual_s));
        let unit_s = measured_s.filter(is_plausible).unwrap_or(usual_s);
        Some(sender_s + (pts - of_pts) as f64 * unit_s)
    }
}

#[cfg(test)]
mod tests {
    use super::sdp::Coding;
    use super::*;

    #[test]
    fn no_bytes_of_a_peer_break_a_reader() {
        let mut random = 7_u32;
        let mut next = move || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 16) as usize
        };
        let description = "v=0\r\nm=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=fmtp:96 sprop-parameter-sets=Z0IA,aM4=\r\n";
        let answer = format!(
            "RTSP/1.0 200 OK\r\nContent-Length: {}\r\n\r\n{description}",
            description.len()
        );
        let packet = [
            0x80, 96, 0, 1, 0, 0, 0, 1, 0, 0, 0, 7, 24, 0, 2, 0x65, 1, 0, 1, 6, 28, 0x85, 0, 0,
            255, 0, 0, 64,
        ];
        let report = [
            0x80, 200, 0, 6, 0, 0, 0, 7, 1, 2, 3, 4, 5, 6, 7, 8, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 0,
        ];
        for coding in [Coding::H264, Coding::H265, Coding::Jpeg] {
            let (mut order, mut units) = (Order::new(0.0), Units::new(coding, Vec::new()));
            for _ in 0..20_000 {
                let mut changed = |bytes: &[u8]| {
                    let mut bytes = bytes[..bytes.len() - next() % 4 * (next() % 5)].to_vec();
                    for _ in 0..next() % 4 {
                        let at = next() % bytes.len();
                        bytes[at] = next() as u8;
                    }
                    bytes
                };
                let _ = link::first_message(&changed(answer.as_bytes()));
                let _ = sdp::video(&String::from_utf8_lossy(&changed(description.as_bytes())));
                let _ = sender_report(&changed(&report));
                if let Some(packet) = Packet::of(changed(&packet)) {
                    order.put(packet, 0.0);
                }
                while let Some((packet, has_loss)) = order.next(0.0) {
                    let _ = units.take(&packet, has_loss);
                }
            }
        }
    }
}
