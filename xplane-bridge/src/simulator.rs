//! The client: one connected simulator, by UDP and capture link.
//!
//! Goes in: conditions, flights to fly, poses and cameras to draw. Comes out: flight states and pictures. Everything has a
//! time limit; whatever may be lost (UDP) is asked again; whatever was set is read back.

mod conditions;
mod link_client;
mod udp;

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use dataset::conditions::Clock;
use dataset::pose::FlightState;
use dataset::runway::Runway;
use tokio::time::{Instant, timeout_at};

use crate::datarefs::{self, DatarefWrite, Generation};
use crate::error::BridgeError;
use crate::fly::FlyRequest;
use crate::link::{
    Answer, CaptureRequest, CapturedFrame, LINK_VERSION, MAX_OUTSTANDING_CAPTURES, Request,
    decode_flight,
};
use link_client::LinkClient;
use udp::UdpClient;

/// How long [`Simulator::connect`] may reasonably wait.
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// How long a picture may take: X-Plane loads scenery after a jump.
const FRAME_TIMEOUT: Duration = Duration::from_secs(60);
/// How long a freeze or a release may take.
const SWITCH_TIMEOUT: Duration = Duration::from_secs(30);
/// How long X-Plane's weather takes to show, if the plugin does not say, seconds.
const WEATHER_SETTLE_S: f32 = 15.0;
/// What is left of the time to connect for opening the capture link, once the simulator has answered.
const LINK_SHARE: f64 = 0.2;

/// Who is at the other end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SimulatorDescription {
    /// Name of the simulator.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Version of the capture link that both sides speak.
    pub capture_link: u32,
}

/// A connected simulator.
#[derive(Debug)]
pub struct Simulator {
    udp: UdpClient,
    link: LinkClient,
    description: SimulatorDescription,
    generation: Generation,
    weather_settle: Duration,
    /// The clock of the conditions, to be set again exactly once it stands still.
    clock: Option<Clock>,
    outstanding: VecDeque<CaptureRequest>,
    spare_buffers: Vec<Vec<u8>>,
}

impl Simulator {
    /// Connects to the simulator that takes UDP packets at `address`, and to its capture link.
    ///
    /// # Errors
    /// Within `timeout`: [`BridgeError::NobodyAnswers`], [`BridgeError::NoPlugin`] or [`BridgeError::CannotOpenLink`],
    /// which say what to do; [`BridgeError::Link`] if the other side is of another version.
    pub async fn connect(address: SocketAddr, timeout: Duration) -> Result<Self, BridgeError> {
        let deadline = Instant::now() + timeout;
        let mut udp = UdpClient::bind(address).await?;
        let waited = timeout.mul_f64(1.0 - LINK_SHARE);
        let names = [
            datarefs::VERSION,
            datarefs::CAPTURE_PORT,
            datarefs::WEATHER_SETTLE_S,
        ];
        let values = udp
            .read_until(
                &names,
                Instant::now() + waited,
                |values| matches!(values, [Some(_), Some(port), Some(_)] if *port > 0.0),
            )
            .await?;
        let [version, port, settle_s] = [values[0], values[1], values[2]];
        let version = version.ok_or(BridgeError::NobodyAnswers { address, waited })?;
        let port = match port {
            Some(port) if (1.0..=f32::from(u16::MAX)).contains(&port) => port as u16,
            _ => return Err(BridgeError::NoPlugin { address, waited }),
        };
        let mut link = LinkClient::open(SocketAddr::new(address.ip(), port), deadline).await?;
        let client = concat!("dtd ", env!("CARGO_PKG_VERSION")).to_owned();
        let limit = deadline.saturating_duration_since(Instant::now());
        let answer = link.ask("hello", &Request::Hello { client }, limit).await?;
        let Answer::Hello {
            name,
            version: simulator_version,
        } = answer
        else {
            return Err(wrong("hello", &answer));
        };
        let description = SimulatorDescription {
            name,
            version: simulator_version,
            capture_link: LINK_VERSION,
        };
        tracing::info!(%address, name = description.name, version = description.version, "connected");
        Ok(Self {
            udp,
            link,
            description,
            generation: Generation::of_version(version),
            weather_settle: Duration::from_secs_f32(
                settle_s.unwrap_or(WEATHER_SETTLE_S).clamp(0.0, 60.0),
            ),
            clock: None,
            outstanding: VecDeque::new(),
            spare_buffers: Vec::new(),
        })
    }

    /// Who is at the other end.
    pub fn description(&self) -> &SimulatorDescription {
        &self.description
    }

    /// Flies an approach with the simulator's own flight model and the weather it has; the states at its own rate.
    ///
    /// Tunes the instrument landing system and engages the autopilot first.
    ///
    /// # Errors
    /// If the radios or the autopilot do not take their settings, or the simulator gives up.
    pub async fn fly(&mut self, request: &FlyRequest) -> Result<Vec<FlightState>, BridgeError> {
        self.udp.command(datarefs::COMMAND_PAUSE_OFF).await?;
        let radios = datarefs::approach_writes(&request.runway);
        self.write_until_read_back(&radios).await?;
        self.engage_autopilot().await?;
        // X-Plane flies in real time; the margin is for loading scenery around the start.
        let limit = Duration::try_from_secs_f64(request.time_limit_s.clamp(0.0, 86_400.0))
            .unwrap_or_default()
            .mul_f64(1.5)
            + FRAME_TIMEOUT;
        let answer = self
            .link
            .ask("a flight", &Request::Fly(request.clone()), limit)
            .await?;
        let Answer::Flown { columns, rows } = answer else {
            return Err(wrong("flown", &answer));
        };
        let mut payload = Vec::new();
        self.link
            .take_payload("a flight", &mut payload, FRAME_TIMEOUT)
            .await?;
        decode_flight(&columns, rows, &payload).map_err(|found| BridgeError::WrongAnswer {
            expected: "a flight".into(),
            found,
        })
    }

    /// Stops flight model, clock and clouds around `runway`: the simulator is ready to be posed. The clock of the last
    /// [`Simulator::set_conditions`] is set once more, now that it stands still.
    ///
    /// # Errors
    /// If the simulator refuses, or its clock does not take the time.
    pub async fn freeze(&mut self, runway: &Runway) -> Result<(), BridgeError> {
        let request = Request::Freeze {
            runway: runway.clone(),
        };
        match self.link.ask("freezing", &request, SWITCH_TIMEOUT).await? {
            Answer::Frozen => {}
            other => return Err(wrong("frozen", &other)),
        }
        match self.clock {
            Some(clock) => {
                self.write_until_read_back(&datarefs::clock_writes(&clock))
                    .await
            }
            None => Ok(()),
        }
    }

    /// Asks for one view of one tick. Several may be outstanding; [`Simulator::receive_frame`] returns them in this order.
    ///
    /// # Errors
    /// If 64 are outstanding, or the link is broken.
    pub async fn send_capture(&mut self, request: &CaptureRequest) -> Result<(), BridgeError> {
        if self.outstanding.len() >= MAX_OUTSTANDING_CAPTURES {
            return Err(BridgeError::TooManyOutstanding {
                outstanding: self.outstanding.len(),
            });
        }
        if let Err(reason) = request.check() {
            return Err(BridgeError::Refused {
                doing: "a capture",
                text: reason,
            });
        }
        self.link
            .send("a capture", &Request::Capture(*request), SWITCH_TIMEOUT)
            .await?;
        self.outstanding.push_back(*request);
        Ok(())
    }

    /// The picture of the oldest outstanding capture.
    ///
    /// # Errors
    /// If nothing is outstanding, nothing comes for a minute, the simulator refuses, or what comes is no answer to that
    /// capture. Whether the drawn pose is the asked one is left to the caller, who records it.
    pub async fn receive_frame(&mut self) -> Result<CapturedFrame, BridgeError> {
        let request = self
            .outstanding
            .pop_front()
            .ok_or(BridgeError::NothingOutstanding)?;
        let answer = self.link.receive("a frame", FRAME_TIMEOUT).await?;
        let Answer::Frame(header) = answer else {
            return Err(wrong("frame", &answer));
        };
        let asked = (
            request.tick,
            request.view,
            request.width_px,
            request.height_px,
        );
        let found = (header.tick, header.view, header.width_px, header.height_px);
        let bytes = self.link.payload_bytes();
        if asked != found || bytes != request.rgb_bytes() {
            let (tick, view, width, height) = asked;
            self.link.close();
            return Err(BridgeError::WrongAnswer {
                expected: format!(
                    "a frame of tick {tick}, view {view}, {width}x{height}, {} bytes",
                    request.rgb_bytes()
                ),
                found: format!(
                    "tick {}, view {}, {}x{}, {bytes} bytes",
                    found.0, found.1, found.2, found.3
                ),
            });
        }
        let mut rgb = self.spare_buffers.pop().unwrap_or_default();
        self.link
            .take_payload("a frame", &mut rgb, FRAME_TIMEOUT)
            .await?;
        Ok(CapturedFrame::new(header, rgb))
    }

    /// Gives a picture's memory back for the next frames. Optional: fresh memory costs milliseconds a frame.
    pub fn recycle(&mut self, rgb: Vec<u8>) {
        if self.spare_buffers.len() < MAX_OUTSTANDING_CAPTURES {
            self.spare_buffers.push(rgb);
        }
    }

    /// Lets the simulator run again and takes leave: nothing stays subscribed.
    ///
    /// # Errors
    /// If the simulator does not confirm. What can be undone is undone nevertheless.
    pub async fn release(mut self) -> Result<(), BridgeError> {
        let discarded = self.discard_outstanding().await;
        let released = match discarded {
            Ok(()) => {
                self.link
                    .ask("releasing", &Request::Release, SWITCH_TIMEOUT)
                    .await
            }
            Err(error) => Err(error),
        };
        self.udp.unsubscribe_all().await;
        match released? {
            Answer::Released => Ok(()),
            other => Err(wrong("released", &other)),
        }
    }

    async fn discard_outstanding(&mut self) -> Result<(), BridgeError> {
        while !self.outstanding.is_empty() {
            let frame = self.receive_frame().await?;
            self.recycle(frame.rgb);
        }
        Ok(())
    }

    /// Commands have no answer and may be lost, so the autopilot's state is read back and the commands are repeated.
    async fn engage_autopilot(&mut self) -> Result<(), BridgeError> {
        const ATTEMPTS: u32 = 4;
        let engaged = DatarefWrite::new(datarefs::AUTOPILOT_MODE, 2.0);
        let mut found = None;
        for _ in 0..ATTEMPTS {
            for command in datarefs::COMMANDS_APPROACH {
                self.udp.command(command).await?;
            }
            let deadline = Instant::now() + Duration::from_secs(1);
            let values = self
                .udp
                .read_until(&[&engaged.name], deadline, |values| {
                    values[0].is_some_and(|mode| engaged.is_met_by(mode))
                })
                .await?;
            found = values[0];
            if found.is_some_and(|mode| engaged.is_met_by(mode)) {
                return Ok(());
            }
        }
        Err(BridgeError::NotTaken {
            name: engaged.name,
            attempts: ATTEMPTS,
            wanted: engaged.value,
            found,
        })
    }
}

/// An answer that does not belong to its question.
fn wrong(expected: &str, found: &Answer) -> BridgeError {
    BridgeError::WrongAnswer {
        expected: expected.to_owned(),
        found: found.name().to_owned(),
    }
}

/// Waits for something of the link until a moment.
async fn before<T>(
    doing: &'static str,
    limit: Duration,
    work: impl Future<Output = Result<T, crate::link::LinkError>>,
) -> Result<T, BridgeError> {
    match timeout_at(Instant::now() + limit, work).await {
        Ok(Ok(done)) => Ok(done),
        Ok(Err(source)) => Err(BridgeError::Link { doing, source }),
        Err(_) => Err(BridgeError::LinkTimeout {
            doing,
            waited: limit,
        }),
    }
}
