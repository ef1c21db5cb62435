//! The client: one connected simulator, by UDP and capture link.
//!
//! Input: conditions, flights to fly, poses and cameras to draw. Output: flight states and images. Everything has a timeout; requests
//! that may be lost (UDP) are repeated; every setting is read back.

mod block;
mod commands;
mod conditions;
mod connect_options;
pub mod doctor;
mod flight_start;
mod link_client;
mod pictures;
mod profile;
mod settings_watch;
mod traffic;
mod udp;

use std::collections::{BTreeSet, VecDeque};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use dataset::conditions::{Clock, Conditions};
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather};
use dataset::geometry::imaging::Imaging;
use dataset::geometry::pose::FlightState;
use dataset::geometry::runway::Runway;
use futures_util::future::{BoxFuture, LocalBoxFuture};
use tokio::time::Instant;

use crate::datarefs::{self, Generation};
use crate::error::peer_text::quoted;
use crate::error::{BridgeError, HELLO, Silence};
use crate::fly::{FlightStart, FlyRequest};
use crate::link::{
    Answer, CaptureRequest, CapturedFrame, Deliver, Hello, MAX_OUTSTANDING_CAPTURES, PictureBytes,
    PixelKind, Request, decode_flight,
};
use crate::pixels::{CodedGrabs, PixelSource};
use crate::profile::{KnownProfile, Profile};
use crate::udp::socket::SimulatorSocket;
use crate::web_api::WebApi;
pub use block::{
    BlockOfTicks, BlockRecording, BlockReport, BlockTrial, KnownBlocks, block_bytes,
    pictures_waiting,
};
use connect_options::main_menu::{self, Left};
pub use connect_options::{
    BadWebApiPlace, ConnectOptions, LINK_TOKEN_VARIABLE, WEB_API_VARIABLE, WebApiPlace,
};
use link_client::{LinkClient, wrong};
use pictures::DrawnOn;
use settings_watch::SettingsWatch;
pub use traffic::TrafficPath;
pub(crate) use udp::running_since;
pub use udp::{announced_link_port, somebody_answers};

/// A reasonable timeout for [`Simulator::connect`].
pub const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Timeout per image: X-Plane loads scenery after a jump.
const FRAME_TIMEOUT: Duration = Duration::from_secs(60);
/// Timeout for freezing and releasing.
const SWITCH_TIMEOUT: Duration = Duration::from_secs(30);
/// Time until X-Plane's weather shows, if the plugin does not report it.
pub const WEATHER_SETTLE: Duration = Duration::from_secs(15);
/// Attempts at grabbing a frame off the screen, which may be replaced meanwhile.
const MAX_GRABS: u32 = 5;
/// Time reserved for opening the capture link once the simulator has answered.
const LINK_SHARE: f64 = 0.2;
/// A simulator that has run for a shorter time, by its own clock, may not have started its plugins yet.
const STARTING: Duration = Duration::from_secs(60);

/// Pause between two looks whether a simulator without a plugin shows its main menu. Twice as long after each refusal to start a flight.
const MENU_LOOK: Duration = Duration::from_secs(1);

/// Default number of frames that X-Plane draws with a new pose and camera before the one that counts: writes in one frame are drawn in the
/// next, and shadows and effects follow one later.
const SETTLE_FRAMES: u32 = 3;
/// [`SETTLE_FRAMES`] for images off the screen. An image that the plugin reads back is proven by its content; here frames are only counted,
/// and clients of a live X-Plane were seen to wait for up to four.
const SETTLE_FRAMES_ON_SCREEN: u32 = 5;

/// A connected simulator.
///
/// Its larger methods return boxed futures. An `async fn` is compiled by every program that awaits it, with all that it awaits: that took
/// 20 to 50 seconds for each test, and two minutes for `dtd`. A box is compiled once, here.
#[derive(Debug)]
pub struct Simulator {
    udp: Arc<SimulatorSocket>,
    link: LinkClient,
    web_api: Option<WebApi>,
    address: SocketAddr,
    description: Hello,
    profile: KnownProfile,
    generation: Generation,
    weather_settle: Duration,
    settle_frames: u32,
    pixels: PixelSource,
    /// The screen that shows them.
    drawn_on: DrawnOn,
    /// The last settings. The clock is set again exactly once it stands still.
    conditions: Option<Conditions>,
    /// Height of the ground around the runway of the last freeze.
    ground_msl_m: Option<f64>,
    /// Checks that they stay set.
    settings_watch: Option<SettingsWatch>,
    /// The weather at the aircraft under those settings.
    effective_weather: Option<EffectiveWeather>,
    /// Quantities that are known not to follow the written weather.
    not_followed: BTreeSet<EffectiveQuantity>,
    /// The aircraft in use, by its name in sweeps.
    aircraft: Option<String>,
    /// The started flight that is still to be flown, and true if it is in the air.
    begun: Option<(FlightStart, bool)>,
    outstanding: VecDeque<CaptureRequest>,
    spare_buffers: Vec<Vec<u8>>,
    known_blocks: KnownBlocks,
    /// The grabs of numbered frames, from the first block after a registration until the last image is confirmed.
    grabs: CodedGrabs,
}

impl Simulator {
    /// Connects to the simulator that takes UDP packets at `address`, and to its capture link, with
    /// [`ConnectOptions::from_environment`].
    ///
    /// # Errors
    /// As [`Simulator::connect_with`], and [`BridgeError::BadVariable`].
    pub async fn connect(address: SocketAddr, timeout: Duration) -> Result<Self, BridgeError> {
        Self::connect_with(address, timeout, ConnectOptions::from_environment(address)?).await
    }

    /// [`Simulator::connect`] with other options.
    ///
    /// # Errors Within `timeout`: [`BridgeError::NobodyAnswers`], [`BridgeError::NoPlugin`] or [`BridgeError::CannotOpenLink`], which say
    /// what to do; [`BridgeError::Link`] if the versions differ; [`BridgeError::Refused`] if the token is wrong. A simulator that has run
    /// for less than a minute is given the rest of it to start the plugin.
    pub fn connect_with(
        address: SocketAddr,
        timeout: Duration,
        options: ConnectOptions,
    ) -> BoxFuture<'static, Result<Self, BridgeError>> {
        Box::pin(async move {
            let udp = SimulatorSocket::open(address, &options.local_udp).await?;
            let socket = udp.clone();
            let connected = Self::connect_on(udp, timeout, options).await;
            if connected.is_err() {
                socket.close().await;
            }
            connected
        })
    }

    fn connect_on(
        udp: Arc<SimulatorSocket>,
        timeout: Duration,
        options: ConnectOptions,
    ) -> BoxFuture<'static, Result<Self, BridgeError>> {
        Box::pin(async move {
            let ConnectOptions {
                token,
                web_api,
                own_link_port,
                local_udp: _,
            } = options;
            let deadline = Instant::now() + timeout;
            let address = udp.simulator();
            let waited = timeout.mul_f64(1.0 - LINK_SHARE);
            let names = [
                datarefs::VERSION,
                datarefs::CAPTURE_PORT,
                datarefs::WEATHER_SETTLE_S,
                datarefs::RUNNING_TIME_S,
            ];
            let began = Instant::now();
            let has_plugin = |values: &[Option<f32>]| match values {
                [Some(_), Some(port), Some(_), _] => *port > 0.0,
                _ => false,
            };
            let (mut until, mut is_begun) = (began + waited, false);
            let (mut next_try, mut pause) = (began, MENU_LOOK);
            let mut values = vec![None; names.len()];
            loop {
                let look = until.min(Instant::now() + MENU_LOOK);
                let read = udp.read_until(&names, look, has_plugin).await?;
                for (value, read) in values.iter_mut().zip(read) {
                    *value = read.or(*value);
                }
                if has_plugin(&values) {
                    break;
                }
                // Asked again and again: a Web API may answer later than UDP, and a menu may show only then.
                if let (false, Some(version), Some(place)) = (is_begun, values[0], web_api)
                    && Generation::of_version(version) == Generation::XPlane12
                    && Instant::now() >= next_try
                {
                    match main_menu::leave(place).await {
                        Left::Begun => {
                            is_begun = true;
                            until = Instant::now() + STARTING;
                        }
                        Left::Refused => {
                            pause *= 2;
                            next_try = Instant::now() + pause;
                        }
                        Left::NoMenu => {}
                    }
                }
                if let (false, Some(running_s)) = (is_begun, values[3]) {
                    let running = Duration::try_from_secs_f32(running_s).unwrap_or(STARTING);
                    let started = Instant::now() + STARTING.saturating_sub(running);
                    // Its clock may stand still.
                    until = until.max(started.min(began + STARTING));
                }
                if Instant::now() >= until {
                    break;
                }
                tracing::debug!(%address, running_s = values[3], "no plugin yet: the simulator may be starting it");
            }
            let deadline = deadline.max(Instant::now() + timeout.mul_f64(LINK_SHARE));
            let [version, port, settle_s] = [values[0], values[1], values[2]];
            let version = version.ok_or(BridgeError::NobodyAnswers {
                address,
                waited,
                silence: Silence::Nothing,
            })?;
            let port = match port {
                Some(port) if (1.0..=f32::from(u16::MAX)).contains(&port) => port as u16,
                _ => {
                    let waited = began.elapsed();
                    return Err(BridgeError::NoPlugin { address, waited });
                }
            };
            let link_address = SocketAddr::new(address.ip(), port);
            let mut link = LinkClient::open(link_address, deadline).await?;
            let client = concat!("dtd ", env!("CARGO_PKG_VERSION")).to_owned();
            let limit = deadline.saturating_duration_since(Instant::now());
            let hello = Request::Hello {
                client,
                token: token.clone(),
            };
            let answer = link.ask(HELLO, &hello, limit).await?;
            let Answer::Hello(mut hello) = answer else {
                return Err(wrong(HELLO, &answer));
            };
            let texts = [&mut hello.name, &mut hello.version].into_iter();
            for text in texts.chain(&mut hello.plugin) {
                *text = quoted(text);
            }
            link.patterns_under = hello.patterns_under;
            let profile = KnownProfile::of(
                hello.profile.take(),
                &format!("{} {}", hello.name, hello.version),
                hello.plugin.as_deref(),
            );
            let generation = Generation::of_version(version);
            let web_api = match (generation, web_api) {
                (Generation::XPlane12, Some(place)) => {
                    let own_port = own_link_port.unwrap_or(port);
                    connect_options::find_web_api::usable(place, own_port).await
                }
                _ => None,
            };
            tracing::info!(
                %address, name = hello.name, version = hello.version, web_api = web_api.is_some(), "connected"
            );
            Ok(Self {
                udp,
                link,
                web_api,
                address,
                drawn_on: DrawnOn::offered(hello.screen.take(), link_address, token),
                // A tape's weather has settled.
                weather_settle: if hello.replayed {
                    Duration::ZERO
                } else {
                    settle_s.map_or(WEATHER_SETTLE, |settle_s| {
                        Duration::from_secs_f32(settle_s.clamp(0.0, 60.0))
                    })
                },
                description: hello,
                profile,
                generation,
                settle_frames: SETTLE_FRAMES,
                pixels: PixelSource::Payload(PixelKind::Link),
                conditions: None,
                ground_msl_m: None,
                settings_watch: None,
                effective_weather: None,
                not_followed: BTreeSet::new(),
                aircraft: None,
                begun: None,
                outstanding: VecDeque::new(),
                spare_buffers: Vec::new(),
                known_blocks: KnownBlocks::default(),
                grabs: CodedGrabs::default(),
            })
        })
    }

    /// The simulator, which answered before, did not answer over UDP within a time.
    fn silent(&self, waited: Duration) -> BridgeError {
        BridgeError::NobodyAnswers {
            address: self.address,
            waited,
            silence: if self.link.has_ended() {
                Silence::Ended
            } else {
                Silence::Nothing
            },
        }
    }

    /// The connected simulator's description of itself. Its profile and its screen are kept elsewhere.
    pub fn description(&self) -> &Hello {
        &self.description
    }

    /// Measured profile of the connected simulator.
    pub fn profile(&self) -> &KnownProfile {
        &self.profile
    }

    /// Sets the aircraft, by its name in sweeps. It is loaded when a flight begins.
    pub fn set_aircraft(&mut self, name: &str) {
        self.aircraft = Some(name.to_owned());
    }

    /// Flies an approach with the simulator's own flight model in its current weather; returns the states at its own rate.
    ///
    /// Starts the flight and tunes the instrument landing system first. The other end of the link engages the autopilot once the aircraft
    /// is in the air: two sides that press its buttons would switch it off again.
    ///
    /// # Errors
    /// The aircraft or the radios do not accept their settings, the simulator gives up, or its conditions have changed.
    pub fn fly<'a>(
        &'a mut self,
        request: &'a FlyRequest,
    ) -> LocalBoxFuture<'a, Result<Vec<FlightState>, BridgeError>> {
        Box::pin(async move {
            let already_started = match self.begun.take() {
                Some((start, in_the_air)) if start == request.start => in_the_air,
                _ => {
                    let conditions = self.conditions.clone();
                    let begun = self.begin_flight(&request.start, conditions.as_ref());
                    let in_the_air = begun.await?;
                    self.await_weather_of(conditions.as_ref()).await?;
                    in_the_air
                }
            };
            self.resume().await?;
            let radios = datarefs::approach_writes(&request.runway);
            self.write_until_read_back(&radios).await?;
            // A plugin holds the aircraft until it releases it with a velocity. The bundled simulator needs no such write, but
            // recordings of it match only with the same writes before a flight.
            if self.description.plugin.is_none() {
                self.let_aircraft_go().await?;
            }
            let request = FlyRequest {
                already_started,
                ..request.clone()
            };
            // X-Plane flies in real time; the margin is for loading scenery around the start.
            let limit = Duration::try_from_secs_f64(request.time_limit_s.clamp(0.0, 86_400.0))
                .unwrap_or_default()
                .mul_f64(1.5)
                + FRAME_TIMEOUT;
            let answer = self
                .link
                .ask("a flight", &Request::Fly(request), limit)
                .await?;
            let Answer::Flown { columns, rows } = answer else {
                return Err(wrong("flown", &answer));
            };
            let mut payload = Vec::new();
            self.link
                .take_payload("a flight", &mut payload, FRAME_TIMEOUT)
                .await?;
            self.check_settings()?;
            decode_flight(&columns, rows, &payload)
                .map_err(|bad| BridgeError::wrong_answer("a flight", bad))
        })
    }

    /// Stops flight model, clock and clouds around `runway`: the simulator is ready to be posed. The clock of the last
    /// [`Simulator::set_conditions`] is set once more, now that it stands still.
    ///
    /// # Errors
    /// The simulator rejects it, or its clock does not accept the time.
    pub async fn freeze(&mut self, runway: &Runway) -> Result<(), BridgeError> {
        self.freeze_with_imaging(runway, &[]).await
    }

    /// [`Simulator::freeze`] with lenses, air and sensors, in the order of the views.
    ///
    /// # Errors
    /// As [`Simulator::freeze`], and [`BridgeError::Setup`] if this simulator draws ideal images only.
    pub fn freeze_with_imaging<'a>(
        &'a mut self,
        runway: &'a Runway,
        views: &'a [Imaging],
    ) -> LocalBoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            self.check_imaging(views)?;
            let ideal = views.iter().all(Imaging::is_ideal);
            let imaging: &[Imaging] = if ideal { &[] } else { views };
            self.freeze_raw(runway, self.frames_to_settle(), imaging, self.running_at())
                .await?;
            self.set_clock_exactly().await
        })
    }

    /// Freezes with exactly this number of settle frames, in a pause or with a clock that runs on.
    async fn freeze_raw(
        &mut self,
        runway: &Runway,
        settle_frames: u32,
        imaging: &[Imaging],
        running_at: Option<Clock>,
    ) -> Result<(), BridgeError> {
        self.ground_msl_m = Some(runway.threshold.altitude_msl_m);
        let request = Request::Freeze {
            runway: runway.clone(),
            settle_frames,
            imaging: imaging.to_vec(),
            running_at,
            margins_px: self.margins_px(),
        };
        self.link
            .tell("freezing", &request, SWITCH_TIMEOUT, &Answer::Frozen)
            .await
    }

    /// The clock, if time must run while images are taken: X-Plane's rain and snow fall only then.
    fn running_at(&self) -> Option<Clock> {
        self.description.plugin.as_ref()?;
        let conditions = self.conditions.as_ref()?;
        let needed = conditions.weather.rain_ratio > 0.0 || self.time_has_to_run();
        needed.then_some(conditions.clock)
    }

    /// True if a pause was measured not to show new poses.
    fn time_has_to_run(&self) -> bool {
        let profile = self.profile.current();
        profile.is_some_and(Profile::time_has_to_run)
    }

    /// Margins of the window around the images, if there are any.
    fn margins_px(&self) -> Option<[u32; 2]> {
        self.pixels.coded_window().map(|window| window.margins_px)
    }

    /// Settle frames: as many as were set, or were measured to be needed.
    fn frames_to_settle(&self) -> u32 {
        match self.profile.current() {
            Some(profile) => profile.settle_frames(self.settle_frames),
            None => self.settle_frames,
        }
    }

    /// Checks that this simulator can draw such views; sends no request.
    ///
    /// # Errors
    /// [`BridgeError::Setup`] if it draws ideal images only and a view is none.
    pub fn check_imaging(&self, views: &[Imaging]) -> Result<(), BridgeError> {
        match views.iter().position(|view| !view.is_ideal()) {
            Some(view) if !self.description.imaging => Err(BridgeError::Setup(format!(
                "{} draws images of ideal pinholes along straight lines, but view {view} is to have {}. Only the bundled simulator (--sim \
                 mock) can: take [imaging] and the cameras' distortion out of the sweep",
                self.description.name,
                serde_json::to_string(&views[view]).unwrap_or_default()
            ))),
            _ => Ok(()),
        }
    }

    /// Requests a view at a tick. Several may be outstanding; [`Simulator::receive_frame`] returns them in this order.
    ///
    /// # Errors
    /// If 64 are outstanding, or the link is broken.
    pub fn send_capture<'a>(
        &'a mut self,
        request: &'a CaptureRequest,
    ) -> BoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            if self.outstanding.len() >= MAX_OUTSTANDING_CAPTURES {
                return Err(BridgeError::Failed(format!(
                    "{} captures are outstanding, which is the most the capture link holds: receive a frame first",
                    self.outstanding.len()
                )));
            }
            if let Err(reason) = request.check() {
                return Err(BridgeError::Refused {
                    doing: "a capture",
                    text: reason.to_string(),
                    repeats: true,
                });
            }
            self.link
                .send("a capture", &Request::Capture(*request), SWITCH_TIMEOUT)
                .await?;
            self.outstanding.push_back(*request);
            Ok(())
        })
    }

    /// The image of the oldest outstanding capture.
    ///
    /// # Errors
    /// No capture is outstanding, no answer comes for a minute, the simulator rejects it, its conditions have changed, or the answer does
    /// not belong to that capture; or the frame never stays on the screen while it is grabbed. The caller checks whether the drawn pose is
    /// the requested one.
    pub fn receive_frame(&mut self) -> BoxFuture<'_, Result<CapturedFrame, BridgeError>> {
        Box::pin(async move {
            let request = self
                .outstanding
                .pop_front()
                .ok_or(BridgeError::NothingOutstanding)?;
            let is_grabbed = request.deliver == Deliver::Drawn && request.deliver == self.deliver();
            let mut frame = self.receive_answer(&request).await?;
            let mut grabs = 1;
            while is_grabbed && !self.is_still_shown().await? {
                if grabs == MAX_GRABS {
                    return Err(BridgeError::Failed(format!(
                        "another view appeared in X-Plane each of the {grabs} times that a frame was grabbed off its window. Leave its keys \
                         and mouse alone, switch off other plugins that move the camera, and run the same command again"
                    )));
                }
                grabs += 1;
                self.recycle(frame.rgb);
                let again = Request::Capture(request);
                self.link.send("a capture", &again, SWITCH_TIMEOUT).await?;
                frame = self.receive_answer(&request).await?;
            }
            Ok(frame)
        })
    }

    /// True if the frame that was just grabbed has been on the screen since the simulator reported it.
    async fn is_still_shown(&mut self) -> Result<bool, BridgeError> {
        let doing = "asking for the grabbed frame";
        match self
            .link
            .ask(doing, &Request::StillShown, SWITCH_TIMEOUT)
            .await?
        {
            Answer::Shown { still } => Ok(still),
            other => Err(wrong("shown", &other)),
        }
    }

    async fn receive_answer(
        &mut self,
        request: &CaptureRequest,
    ) -> Result<CapturedFrame, BridgeError> {
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
        if asked != found || bytes != request.payload_bytes() {
            let (tick, view, width, height) = asked;
            self.link.close();
            return Err(BridgeError::wrong_answer(
                format_args!(
                    "a frame of tick {tick}, view {view}, {width}x{height}, {} bytes",
                    request.payload_bytes()
                ),
                format_args!(
                    "tick {}, view {}, {}x{}, {bytes} bytes",
                    found.0, found.1, found.2, found.3
                ),
            ));
        }
        let mut rgb = self.spare_buffers.pop().unwrap_or_default();
        self.link
            .take_payload("a frame", &mut rgb, FRAME_TIMEOUT)
            .await?;
        if request.deliver == self.deliver() {
            rgb = self.pixels.picture(rgb).await?;
        }
        self.check_settings()?;
        Ok(CapturedFrame {
            header,
            rgb: rgb.into(),
        })
    }

    /// Returns an image's memory for the next frames. Optional: fresh memory costs milliseconds per frame.
    pub fn recycle(&mut self, rgb: PictureBytes) {
        // Pooled memory returns to its pool when it is dropped.
        if let PictureBytes::Own(rgb) = rgb
            && self.spare_buffers.len() < MAX_OUTSTANDING_CAPTURES
        {
            self.spare_buffers.push(rgb);
        }
    }

    /// Lets the simulator run again and disconnects: no subscription remains.
    ///
    /// # Errors
    /// The simulator does not confirm. Everything that can be undone is undone nevertheless.
    pub fn release(mut self) -> BoxFuture<'static, Result<(), BridgeError>> {
        Box::pin(async move {
            let released = match self.discard_outstanding().await {
                Ok(()) => self.let_go().await,
                Err(error) => Err(error),
            };
            self.settings_watch = None;
            self.udp.close().await;
            released
        })
    }

    async fn discard_outstanding(&mut self) -> Result<(), BridgeError> {
        while !self.outstanding.is_empty() {
            let frame = self.receive_frame().await?;
            self.recycle(frame.rgb);
        }
        Ok(())
    }
}
