//! The capture link, simulator's side: accepts requests, flies, draws, and answers in order.
//!
//! Images are drawn on separate threads, one per processor, while further requests are read. A queue of pending answers keeps their order
//! and, being short, limits the memory: when it is full, requests wait in the socket. One client at a time, see [`super::seat`]; it must
//! send a hello, with the token if there is one, before it is admitted.

use std::net::SocketAddr;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use dataset::geometry::camera::{Camera, CameraPose};
use dataset::geometry::distortion::Distortion;
use dataset::numbers::limits::Check;
use dataset::numbers::units::SimTime;
use doorway::Doorway;
use glam::DVec2;
use serde_json::Value;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, mpsc};
use tokio::task::{JoinError, JoinHandle, spawn_blocking};
use tokio::time::timeout;
use xplane_bridge::fly::FlyRequest;
use xplane_bridge::link::{
    Answer, CaptureRequest, Deliver, FLIGHT_COLUMNS, FrameHeader, Hello, LinkError, LinkToken,
    PixelKind, Request, encode_flight, exchange_greetings, read_request, write_message,
};
use xplane_bridge::pixels::{RgbPicture, check_pattern};

use super::engine::{Engine, Instants, OtherAircraft};
use super::faults::cameras::{Drawn, FaultyCameras};
use super::faults::outages::Outages;
use super::scenes::{SceneKey, Scenes};
use super::seat::{Activity, LinkPatience, Seat};
use super::world::traffic::MAX_DRAWN;
use super::{MockError, Shared};
use crate::render::displace;
use crate::render::overlay::Canvas;
use crate::window::DisplayWindow;

/// Maximum connections, most of which wait to say hello or for the seat.
const MAX_CONNECTIONS: usize = 32;
/// Maximum pending answers, drawn or being drawn.
const ANSWERS_AHEAD: usize = 4;
/// Maximum wait for the request that gives the camera of another view: clients request all views of a tick at once.
const CAMERA_TIMEOUT: Duration = Duration::from_secs(10);

/// The error for a client without the token.
pub(super) const WANTS_TOKEN: &str =
    "this capture link requires a token: set DTD_LINK_TOKEN to the same value on both sides";
/// Reason why a stand-in without a window cannot show anything.
const NO_WINDOW: &str = "the stand-in has no window: start it with --window";

/// A frame to be drawn.
#[derive(Debug, Clone, Copy)]
struct Frame {
    number: u64,
    /// True if X-Plane's error about a deprecated dataref lies over it.
    alert: bool,
}

/// Accepts clients forever.
pub(super) async fn run(
    listener: Arc<TcpListener>,
    world: Shared,
    engine: Arc<dyn Engine>,
    outages: Arc<Outages>,
    admission: Admission,
    stage: Option<Arc<dyn DisplayWindow>>,
    cameras: FaultyCameras,
) -> Result<(), MockError> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let service = Arc::new(CaptureService {
        world,
        engine,
        outages,
        admission,
        stage,
        cameras: Mutex::new(cameras),
        camera_known: Condvar::new(),
        scenes: Scenes::default(),
        painters: Arc::new(Semaphore::new(cores)),
        buffers: Mutex::default(),
        seat: Seat::default(),
        profile: Mutex::default(),
    });
    let doorway = Doorway::new("the capture link", MAX_CONNECTIONS);
    let serve = |stream, from| {
        let service = service.clone();
        async move { log_end(from, service.serve(stream, from).await) }
    };
    match doorway.serve(&listener, serve).await {}
}

/// Logs how a client's connection ended.
pub(super) fn log_end(from: SocketAddr, ended: Result<(), LinkError>) {
    match ended {
        Ok(()) => tracing::debug!(%from, "capture link closed"),
        Err(error) if error.is_hang_up() => tracing::info!(%from, "the client hung up"),
        Err(error) => tracing::warn!(%from, %error, "capture link closed"),
    }
}

/// Admission of clients.
#[derive(Debug, Clone)]
pub(super) struct Admission {
    /// The required token, if any.
    pub(super) token: Option<LinkToken>,
    /// Time limits.
    pub(super) patience: LinkPatience,
}

/// Shared by all connections.
struct CaptureService {
    world: Shared,
    engine: Arc<dyn Engine>,
    outages: Arc<Outages>,
    admission: Admission,
    stage: Option<Arc<dyn DisplayWindow>>,
    /// They decide what an image shows.
    cameras: Mutex<FaultyCameras>,
    /// Notified when a request gives the camera of another view.
    camera_known: Condvar,
    scenes: Scenes,
    painters: Arc<Semaphore>,
    /// Buffers of sent images, for reuse.
    buffers: Mutex<Vec<Vec<u8>>>,
    seat: Seat,
    /// The profile that a client measured.
    profile: Mutex<Option<Value>>,
}

/// An answer and its payload.
type Reply = (Answer, Vec<u8>);

/// An answer in its place of the order.
enum Pending {
    Ready(Box<Reply>),
    Drawing(JoinHandle<Reply>),
}

impl CaptureService {
    async fn serve(
        self: Arc<Self>,
        mut stream: TcpStream,
        from: SocketAddr,
    ) -> Result<(), LinkError> {
        stream.set_nodelay(true)?;
        self.outages.over().await;
        let hello = timeout(self.admission.patience.hello, self.admit(&mut stream)).await;
        let late = LinkError::ended("the time for a hello");
        let Some(hello) = hello.unwrap_or(Err(late))? else {
            return Ok(());
        };
        let Some(seated) = self.seat.take(self.admission.patience).await else {
            let busy = Answer::refusal("another client holds the capture link");
            return write_message(&mut stream, &busy, &[]).await;
        };
        let activity = &seated.activity;
        let (from_client, to_client) = stream.into_split();
        let (order, answers) = mpsc::channel(ANSWERS_AHEAD);
        // When no more requests come, the writer finishes the pending answers and ends with the queue. If the client reads no more
        // answers, reading its requests is pointless.
        let read_then_wait = async {
            if let Err(error) = self
                .read_requests(hello, from_client, activity, order)
                .await
                && !error.is_hang_up()
            {
                tracing::warn!(%from, %error, "no more requests are taken");
            }
            std::future::pending().await
        };
        let ended = tokio::select! {
            ended = self.write_answers(to_client, activity, answers) => ended,
            never = read_then_wait => never,
            () = activity.has_to_leave() => Ok(()),
        };
        if self.world.lock().check_pattern.is_some() {
            self.check_pattern(None).await;
        }
        self.world.lock().release();
        ended
    }

    /// Exchanges greetings and reads the hello; `None` if the client is rejected, after an answer with the reason.
    async fn admit(&self, stream: &mut TcpStream) -> Result<Option<Request>, LinkError> {
        exchange_greetings(stream).await?;
        let text = match read_request(stream).await {
            Ok(None) => return Ok(None),
            Ok(Some(request)) => match (&request, &self.admission.token) {
                (Request::Hello { .. }, None) => return Ok(Some(request)),
                (Request::Hello { token, .. }, Some(ours)) if ours.is(token.as_deref()) => {
                    return Ok(Some(request));
                }
                (Request::Hello { .. }, Some(_)) => WANTS_TOKEN.to_owned(),
                _ => "the first request is not hello".to_owned(),
            },
            Err(error) => error.to_string(),
        };
        write_message(stream, &Answer::lasting_refusal(text), &[]).await?;
        Ok(None)
    }

    async fn read_requests(
        self: &Arc<Self>,
        hello: Request,
        mut stream: impl AsyncRead + Unpin,
        activity: &Arc<Activity>,
        order: mpsc::Sender<Pending>,
    ) -> Result<(), LinkError> {
        let mut next = Some(hello);
        loop {
            let request = match next.take() {
                Some(request) => Ok(Some(request)),
                None => read_request(&mut stream).await,
            };
            let work = activity.work();
            let pending = match request {
                Ok(None) => return Ok(()),
                Ok(Some(request)) => self.answer(activity, request).await,
                // The whole request was read: the next one can be parsed.
                Err(error @ LinkError::BadHeader(_)) => refusal(error.to_string()),
                // Sent to the client as well; the rest of the stream cannot be parsed any more.
                Err(error) => {
                    let _ = order.send(refusal(error.to_string())).await;
                    return Err(error);
                }
            };
            // Only the client, by not reading, keeps the answer from being sent now.
            drop(work);
            if order.send(pending).await.is_err() {
                return Ok(());
            }
        }
    }

    async fn write_answers(
        &self,
        mut stream: impl AsyncWrite + Unpin,
        activity: &Arc<Activity>,
        mut answers: mpsc::Receiver<Pending>,
    ) -> Result<(), LinkError> {
        while let Some(pending) = answers.recv().await {
            let (answer, payload) = match pending {
                Pending::Ready(reply) => *reply,
                Pending::Drawing(drawn) => drawn.await.unwrap_or_else(failed),
            };
            let outage = activity.work();
            self.outages.over().await;
            drop(outage);
            write_message(&mut stream, &answer, &payload).await?;
            activity.heard();
            if payload.capacity() > 0 && matches!(answer, Answer::Frame(_)) {
                lock(&self.buffers).push(payload);
            }
        }
        Ok(())
    }

    async fn answer(self: &Arc<Self>, activity: &Arc<Activity>, request: Request) -> Pending {
        if matches!(request, Request::Capture(_)) {
            self.outages.count_capture();
        }
        self.outages.over().await;
        if let Err(error) = request.check() {
            return refusal(error.to_string());
        }
        match request {
            Request::Hello { client, .. } => {
                tracing::info!(client, "client of the capture link");
                let window = match self.stage.as_ref().map(|stage| stage.describe()) {
                    Some(Err(error)) => return refusal(error.to_string()),
                    Some(Ok(window)) => Some(window),
                    None => None,
                };
                let mut pixels = vec![PixelKind::Link];
                pixels.extend(window.is_some().then_some(PixelKind::Screen));
                ready(Answer::Hello(Hello {
                    name: "mock-xplane".into(),
                    version: self.world.lock().version_text(),
                    pixels,
                    window,
                    imaging: true,
                    traffic: MAX_DRAWN,
                    profile: lock(&self.profile).clone(),
                    ..Hello::default()
                }))
            }
            // Drawing takes effect at once here: no frame needs to settle.
            Request::Freeze {
                runway, imaging, ..
            } => {
                let faulty = (0..).zip(&imaging).find_map(|(view, imaging): (u32, _)| {
                    let mut check = Check::default();
                    imaging.check(&mut check);
                    check.first().map(|fault| format!("view {view}: {fault}"))
                });
                if let Some(text) = faulty {
                    return refusal(text);
                }
                lock(&self.cameras).begin_flight();
                let mut world = self.world.lock();
                world.freeze(runway);
                world.imaging = imaging;
                ready(Answer::Frozen)
            }
            Request::Traffic(part) => {
                let mut world = self.world.lock();
                if world.frozen.is_none() {
                    return refusal(
                        "other aircraft need a frozen simulator: send freeze first".into(),
                    );
                }
                match world.traffic.add(part) {
                    Ok(()) => ready(Answer::TrafficKept),
                    Err(text) => ready(Answer::lasting_refusal(text)),
                }
            }
            Request::CheckPattern { code, .. } => self.check_pattern(code).await,
            Request::Travel { .. } => {
                refusal("the stand-in is started by PREL, or by its Web API".into())
            }
            Request::Command { path } => {
                if self.world.lock().command(&path) {
                    ready(Answer::Commanded)
                } else {
                    refusal(format!("the stand-in has no command {path}"))
                }
            }
            Request::KeepProfile { profile } => {
                *lock(&self.profile) = Some(profile);
                ready(Answer::ProfileKept)
            }
            // Its camera is never taken away, and it draws only on request.
            Request::StillShown => ready(Answer::Shown { still: true }),
            Request::Installation => {
                refusal("the stand-in draws without drivers and plugins".into())
            }
            Request::Release => {
                self.world.lock().release();
                ready(Answer::Released)
            }
            Request::Fly(request) => self.fly(request).await,
            Request::Capture(request) => self.capture(activity, request).await,
        }
    }

    /// Flies before reading any further request: those concern the world after the flight.
    async fn fly(self: &Arc<Self>, request: FlyRequest) -> Pending {
        let (weather, aircraft) = {
            let mut world = self.world.lock();
            if let Err(text) = world.engage_autopilot(&request) {
                return refusal(text);
            }
            // A flight needs a flight model.
            world.release();
            (world.weather(), world.aircraft_type())
        };
        let service = self.clone();
        let flown = spawn_blocking(move || service.engine.fly(&request, aircraft, &weather)).await;
        let states = match flown {
            Ok(Ok(states)) => states,
            // The flight model is a pure function: it would fly the same again.
            Ok(Err(not_flown)) => return ready(Answer::lasting_refusal(not_flown.to_string())),
            Err(error) => return Pending::Ready(Box::new(failed(error))),
        };
        if let Some(&last) = states.last() {
            self.world.lock().show(last);
        }
        let columns = FLIGHT_COLUMNS.map(str::to_owned).to_vec();
        let answer = Answer::Flown {
            columns,
            rows: states.len(),
        };
        Pending::Ready(Box::new((answer, encode_flight(&states))))
    }

    /// Starts drawing. The content is fixed here, in the order of the requests; drawing takes its time.
    async fn capture(
        self: &Arc<Self>,
        activity: &Arc<Activity>,
        request: CaptureRequest,
    ) -> Pending {
        if let Err(bad) = request.check() {
            return refusal(bad.to_string());
        }
        match request.deliver {
            Deliver::Coded | Deliver::Probe => {
                return refusal("only the plugin numbers its frames: ask for the image".into());
            }
            Deliver::Picture | Deliver::Drawn => {}
        }
        let drawn = {
            let mut cameras = lock(&self.cameras);
            if let Some(text) = cameras.fault_of_no_view(&request) {
                return ready(Answer::lasting_refusal(text));
            }
            self.camera_known.notify_all();
            cameras.drawn_for(&request)
        };
        let (key, frame, others) = {
            let mut world = self.world.lock();
            let Some(runway) = world.frozen.clone() else {
                return refusal("a capture needs a frozen simulator: send freeze first".into());
            };
            if world.check_pattern.is_some() {
                return refusal(
                    "the check pattern covers the window: take it away before capturing".into(),
                );
            }
            let imaging = world.imaging(request.view);
            let camera = Camera::from_pose(&request.camera, request.width_px, request.height_px);
            let bad_lens = |lens: Distortion| lens.fault(camera.corner());
            if let Some(bad_lens) = imaging.distortion.and_then(bad_lens) {
                return refusal(format!("view {}: {bad_lens}", request.view));
            }
            let key = SceneKey {
                camera: request.camera,
                imaging: world.imaging(drawn.source),
                width_px: request.width_px,
                height_px: request.height_px,
                runway,
                weather: world.weather(),
                clock: world.clock(),
                aircraft: world.aircraft_type(),
            };
            let frame = Frame {
                number: world.pose_for_frame(request.pose, request.controls),
                alert: world.shows_alert,
            };
            // As late as the rest of the image, if the camera is.
            let others = world.traffic.at(drawn.request.time_ns);
            (key, frame, others)
        };
        let permit = self.painters.clone().acquire_owned().await;
        let service = self.clone();
        let work = activity.work();
        let drawing = spawn_blocking(move || {
            let _in_work = (permit, work);
            service.draw((&request, &drawn), key, frame, &others)
        });
        if request.deliver != Deliver::Drawn {
            return Pending::Drawing(drawing);
        }
        // The window shows one image: the next one is not started before this one is visible.
        let (answer, rgb) = drawing.await.unwrap_or_else(failed);
        if matches!(answer, Answer::Error { .. }) {
            return ready(answer);
        }
        let picture = RgbPicture {
            width_px: request.width_px,
            height_px: request.height_px,
            rgb,
        };
        match self.show(picture).await {
            Ok(()) => ready(answer),
            Err(text) => refusal(text),
        }
    }

    /// Draws the check pattern over the window, or removes it.
    async fn check_pattern(&self, code: Option<u32>) -> Pending {
        let window = match self.stage.as_ref().map(|stage| stage.describe()) {
            Some(Ok(window)) => window,
            Some(Err(error)) => return refusal(error.to_string()),
            None => return refusal(NO_WINDOW.into()),
        };
        let picture = match code {
            Some(code) => check_pattern::draw(code, window.width_px, window.height_px),
            None => RgbPicture::black(window.width_px, window.height_px),
        };
        if let Err(text) = self.show(picture).await {
            return refusal(text);
        }
        let sim_frame = self.world.lock().set_check_pattern(code);
        ready(Answer::CheckPatternShown { sim_frame })
    }

    /// Shows an image in the window, and returns its buffer to the others.
    async fn show(&self, picture: RgbPicture) -> Result<(), String> {
        let stage = self.stage.clone().ok_or(NO_WINDOW)?;
        let shown = spawn_blocking(move || {
            let result = stage.show(&picture);
            (picture, result)
        });
        let (picture, result) = shown.await.map_err(|error| error.to_string())?;
        lock(&self.buffers).push(picture.rgb);
        result.map_err(|error| error.to_string())
    }

    /// The camera that sees an image, as soon as its view has been requested.
    fn camera_of(&self, drawn: &Drawn) -> Option<CameraPose> {
        let unknown = |cameras: &mut FaultyCameras| cameras.camera_of(drawn).is_none();
        let cameras = lock(&self.cameras);
        let waited = self
            .camera_known
            .wait_timeout_while(cameras, CAMERA_TIMEOUT, unknown);
        let (cameras, _) = waited.unwrap_or_else(PoisonError::into_inner);
        cameras.camera_of(drawn)
    }

    /// Draws the payload. The answer is to the request, whatever is drawn.
    fn draw(
        &self,
        (request, drawn): (&CaptureRequest, &Drawn),
        key: SceneKey,
        frame: Frame,
        others: &[OtherAircraft],
    ) -> Reply {
        let Some(camera) = self.camera_of(drawn) else {
            return (
                Answer::lasting_refusal(format!(
                    "view {} shows the camera of view {}, which was not requested within {} s: request all views of a tick at once",
                    request.view,
                    drawn.source,
                    CAMERA_TIMEOUT.as_secs()
                )),
                Vec::new(),
            );
        };
        let key = SceneKey { camera, ..key };
        let mut rgb = lock(&self.buffers).pop().unwrap_or_default();
        rgb.resize(request.rgb_bytes(), 0);
        let content = &drawn.request;
        let instants = Instants::all(SimTime(content.time_ns).seconds());
        self.scenes.with(self.engine.as_ref(), &key, |picture| {
            let first = (&content.pose, &content.controls);
            picture.draw(first, others, instants, &mut rgb);
        });
        let (width_px, height_px) = (key.width_px as usize, key.height_px as usize);
        if drawn.shift_px != DVec2::ZERO {
            displace(&mut rgb, (width_px, height_px), drawn.shift_px);
        }
        if frame.alert {
            let mut canvas = Canvas {
                rgb: &mut rgb,
                width_px,
                height_px,
            };
            canvas.draw_alert();
        }
        let header = FrameHeader {
            tick: request.tick,
            view: request.view,
            sim_frame: frame.number,
            pose: request.pose,
            camera: request.camera,
            width_px: key.width_px,
            height_px: key.height_px,
        };
        (Answer::Frame(header), rgb)
    }
}

/// A panic elsewhere leaves these values usable.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn ready(answer: Answer) -> Pending {
    Pending::Ready(Box::new((answer, Vec::new())))
}

fn refusal(text: String) -> Pending {
    ready(Answer::refusal(text))
}

/// A panic while flying or drawing is a bug in this crate; the client gets an error and the server lives on.
fn failed(error: JoinError) -> Reply {
    let text = format!("the stand-in failed: {error}");
    (Answer::refusal(text), Vec::new())
}
