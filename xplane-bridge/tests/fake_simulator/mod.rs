//! A simulator for the client's tests: records received packets, sends subscribed datarefs, and accepts everything.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::task::AbortHandle;
use tokio::time::{Instant, interval};
use xplane_bridge::datarefs::{
    AIRCRAFT_ICAO, CAPTURE_PORT, CLOUD_COVER, CLOUD_COVER_AT_AIRCRAFT, COMMAND_TOGGLE_MAIN_MENU,
    FLIGHT_TIME_S, METERS_PER_STATUTE_MILE, PAUSED, RAIN, RAIN_AT_AIRCRAFT, RUNNING_TIME_S,
    SCENERY_LOADING, TEMPERATURE_C, VERSION, VISIBILITY_EFFECTIVE_M, VISIBILITY_SM,
    WEATHER_SETTLE_S, WIND_DIRECTION_AT_AIRCRAFT, WIND_SPEED_AT_AIRCRAFT,
};
use xplane_bridge::link::{
    Answer, FLIGHT_COLUMNS, Hello, PixelKind, Request, exchange_greetings, read_header,
    write_message,
};
use xplane_bridge::packet::{
    DatarefValue, DatarefValues, FromSimulator, LoadAircraft, PlaceAtStart, Position, ToSimulator,
};
use xplane_bridge::{CONNECT_TIMEOUT, ConnectOptions, Simulator};

/// State of the fake simulator, and everything that it received, in order.
#[derive(Debug, Default)]
pub(crate) struct FakeState {
    pub(crate) datarefs: BTreeMap<String, f32>,
    pub(crate) writes: Vec<(String, f32)>,
    pub(crate) commands: Vec<String>,
    pub(crate) starts: Vec<PlaceAtStart>,
    pub(crate) loads: Vec<LoadAircraft>,
    /// Position of the aircraft before a flight starts.
    pub(crate) parked: Option<PlaceAtStart>,
    pub(crate) requests: Vec<Request>,
    /// X-Plane 12's habit: clouds keep their old values in all slots until this long after they were last written, by the
    /// simulator's clock.
    pub(crate) clouds_take_s: f32,
    /// Habit after real weather: until then, by the simulator's clock, the temperature differs from the written one.
    pub(crate) temperature_slides_until_s: f32,
    pending_clouds: Vec<(String, f32)>,
    clouds_from_s: f32,
    /// A second habit: until then the temperature takes a written value, and slides away.
    pub(crate) temperature_drifts_until_s: f32,
    /// Time during which it neither draws nor answers after a `PREL`, and time during which it loads scenery after that.
    pub(crate) start_takes: Option<(Duration, Duration)>,
    silent_until: Option<Instant>,
    loading_until: Option<Instant>,
    /// Writes and commands that it was sent while it loaded.
    pub(crate) hasty: Vec<String>,
    /// True if commands have no effect.
    pub(crate) ignores_commands: bool,
    /// Set while a menu is open, in which simulated time stands still; true if toggling helps.
    pub(crate) menu: Option<bool>,
    frames: u32,
    /// Start of the clock, and its speed relative to ours; without it, the running time stands still.
    clock: Option<(Instant, f32)>,
    subscribed: BTreeMap<(SocketAddr, i32), String>,
}

impl FakeState {
    pub(crate) fn wrote(&self, name: &str) -> Option<f32> {
        let last = self
            .writes
            .iter()
            .rev()
            .find(|(written, _)| written == name);
        last.map(|(_, value)| *value)
    }

    pub(crate) fn set(&mut self, name: &str, value: f32) {
        self.datarefs.insert(name.to_owned(), value);
    }

    /// Runs its clock this many times as fast as ours.
    pub(crate) fn run_clock(&mut self, rate: f32) {
        self.clock = Some((Instant::now(), rate));
    }

    fn now_s(&self) -> f32 {
        self.clock
            .map_or(0.0, |(began, rate)| began.elapsed().as_secs_f32() * rate)
    }

    fn write(&mut self, path: String, value: f32) {
        if self.clouds_take_s > 0.0 && path.contains("/region/cloud_") {
            self.pending_clouds.push((path.clone(), value));
            self.clouds_from_s = self.now_s() + self.clouds_take_s;
        } else if path == TEMPERATURE_C && self.now_s() < self.temperature_slides_until_s {
            self.set(&path, value + 10.0);
        } else {
            self.set(&path, value);
        }
        if let Some(layer) = path.strip_prefix(CLOUD_COVER) {
            self.set(&format!("{CLOUD_COVER_AT_AIRCRAFT}{layer}"), value);
        }
        let effect = match path.as_str() {
            VISIBILITY_SM => Some((
                VISIBILITY_EFFECTIVE_M,
                value * METERS_PER_STATUTE_MILE as f32,
            )),
            RAIN => Some((RAIN_AT_AIRCRAFT, value)),
            "sim/weather/region/wind_speed_msc[0]" => Some((WIND_SPEED_AT_AIRCRAFT, value)),
            "sim/weather/region/wind_direction_degt[0]" => {
                Some((WIND_DIRECTION_AT_AIRCRAFT, value))
            }
            _ => None,
        };
        if let Some((name, value)) = effect {
            self.set(name, value);
        }
        self.writes.push((path, value));
    }

    fn is_silent(&self) -> bool {
        self.silent_until
            .is_some_and(|until| Instant::now() < until)
    }

    fn is_loading(&self) -> bool {
        self.loading_until
            .is_some_and(|until| Instant::now() < until)
    }

    /// Lets time pass.
    fn pass(&mut self) {
        let loading = f32::from(u8::from(self.is_loading()));
        self.set(SCENERY_LOADING, loading);
        if self.now_s() < self.temperature_drifts_until_s {
            *self.datarefs.entry(TEMPERATURE_C.to_owned()).or_default() += 0.05;
        }
        let is_paused = self.datarefs.get(PAUSED).is_some_and(|value| *value != 0.0);
        if self.menu.is_none() && !is_paused {
            self.frames += 1;
            self.set(FLIGHT_TIME_S, self.frames as f32 * 0.02);
        }
        if self.clock.is_some() {
            self.set(RUNNING_TIME_S, self.now_s());
        }
        if self.now_s() >= self.clouds_from_s {
            for (path, value) in std::mem::take(&mut self.pending_clouds) {
                self.set(&path, value);
            }
        }
    }

    fn set_icao(&mut self, icao: &str) {
        for (at, character) in icao.bytes().enumerate() {
            self.set(&format!("{AIRCRAFT_ICAO}[{at}]"), f32::from(character));
        }
    }

    /// Number of subscribed datarefs.
    pub(crate) fn subscriptions(&self) -> usize {
        self.subscribed.len()
    }
}

pub(crate) struct Fake {
    pub(crate) address: SocketAddr,
    told: Arc<Mutex<FakeState>>,
    servers: [AbortHandle; 2],
}

impl Fake {
    /// A simulator of this version, with this aircraft loaded, whose link is served by a plugin or by the simulator itself.
    pub(crate) async fn start(version: f32, icao: &str, plugin: Option<&str>) -> Self {
        let udp = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let link = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = udp.local_addr().unwrap();
        let mut told = FakeState::default();
        told.set(VERSION, version);
        told.set(CAPTURE_PORT, f32::from(link.local_addr().unwrap().port()));
        told.set(WEATHER_SETTLE_S, 0.0);
        told.set_icao(icao);
        let told = Arc::new(Mutex::new(told));
        let servers = [
            tokio::spawn(serve_udp(udp, told.clone())),
            tokio::spawn(serve_link(link, told.clone(), plugin.map(str::to_owned))),
        ];
        Self {
            address,
            told,
            servers: servers.map(|server| server.abort_handle()),
        }
    }

    /// Ends, like a crashed simulator.
    pub(crate) fn end(&self) {
        self.servers.iter().for_each(AbortHandle::abort);
    }

    pub(crate) fn told(&self) -> MutexGuard<'_, FakeState> {
        self.told.lock().unwrap()
    }

    pub(crate) async fn connect(&self) -> Simulator {
        Simulator::connect_with(self.address, CONNECT_TIMEOUT, ConnectOptions::default())
            .await
            .unwrap()
    }
}

async fn serve_udp(socket: UdpSocket, told: Arc<Mutex<FakeState>>) {
    let mut frames = interval(Duration::from_millis(20));
    let mut buffer = [0; 2048];
    loop {
        let replies = tokio::select! {
            _ = frames.tick() => {
                let mut told = told.lock().unwrap();
                told.pass();
                if told.is_silent() { Vec::new() } else { due(&told) }
            }
            received = socket.recv_from(&mut buffer) => match received {
                Ok((length, from)) => obey(&mut told.lock().unwrap(), &buffer[..length], from),
                Err(_) => Vec::new(),
            },
        };
        for (to, packet) in replies {
            let _ = socket.send_to(&packet.encode().unwrap(), to).await;
        }
    }
}

/// Every subscribed value, every frame.
fn due(told: &FakeState) -> Vec<(SocketAddr, FromSimulator)> {
    let value = |(&(client, index), name): (&(SocketAddr, i32), &String)| {
        let value = told.datarefs.get(name).copied().unwrap_or_default();
        let values = vec![DatarefValue { index, value }];
        (
            client,
            FromSimulator::DatarefValues(DatarefValues { values }),
        )
    };
    told.subscribed.iter().map(value).collect()
}

fn obey(
    told: &mut FakeState,
    datagram: &[u8],
    from: SocketAddr,
) -> Vec<(SocketAddr, FromSimulator)> {
    let packet = ToSimulator::decode(datagram).unwrap();
    if told.is_loading() {
        match &packet {
            ToSimulator::WriteDataref(write) => told.hasty.push(write.path.clone()),
            ToSimulator::Command(command) => told.hasty.push(command.path.clone()),
            _ => {}
        }
    }
    if told.is_silent() {
        return Vec::new();
    }
    match packet {
        ToSimulator::SubscribeDataref(request) if request.is_end() => {
            told.subscribed.remove(&(from, request.index));
        }
        ToSimulator::SubscribeDataref(request) => {
            told.subscribed.insert((from, request.index), request.path);
        }
        ToSimulator::WriteDataref(write) => {
            told.write(write.path, write.value);
        }
        ToSimulator::Command(command) => {
            match command.path.as_str() {
                _ if told.ignores_commands => {}
                "sim/operation/pause_on" => told.set(PAUSED, 1.0),
                "sim/operation/pause_off" => told.set(PAUSED, 0.0),
                _ => {}
            }
            told.commands.push(command.path);
        }
        ToSimulator::PlaceAtStart(start) => {
            told.starts.push(start);
            if let Some((silent, loading)) = told.start_takes {
                let now = Instant::now();
                told.silent_until = Some(now + silent);
                told.loading_until = Some(now + silent + loading);
            }
        }
        ToSimulator::LoadAircraft(load) => {
            told.set_icao("B738");
            told.loads.push(load);
        }
        ToSimulator::SubscribePosition(request) if request.frequency_hz > 0 => {
            let at = told.starts.last().cloned().or_else(|| told.parked.clone());
            let at = at.map(|start| (from, FromSimulator::Position(position(&start))));
            return at.into_iter().collect();
        }
        _ => {}
    }
    Vec::new()
}

fn position(start: &PlaceAtStart) -> Position {
    Position {
        longitude_deg: start.longitude_deg,
        latitude_deg: start.latitude_deg,
        elevation_msl_m: start.elevation_msl_m,
        height_agl_m: 0.0,
        pitch_deg: 0.0,
        heading_true_deg: start.heading_true_deg as f32,
        roll_deg: 0.0,
        velocity_east_mps: 0.0,
        velocity_up_mps: 0.0,
        velocity_south_mps: 0.0,
        roll_rate_rad_s: 0.0,
        pitch_rate_rad_s: 0.0,
        yaw_rate_rad_s: 0.0,
    }
}

async fn serve_link(listener: TcpListener, told: Arc<Mutex<FakeState>>, plugin: Option<String>) {
    while let Ok((stream, _)) = listener.accept().await {
        let _ = talk(stream, &told, plugin.as_ref()).await;
    }
}

async fn talk(
    mut stream: TcpStream,
    told: &Mutex<FakeState>,
    plugin: Option<&String>,
) -> Result<(), xplane_bridge::link::LinkError> {
    exchange_greetings(&mut stream).await?;
    while let Some((request, _)) = read_header::<Request>(&mut stream).await? {
        let answer = match &request {
            Request::Hello { .. } => Answer::Hello(Hello {
                name: "fake".into(),
                version: "0".into(),
                plugin: plugin.cloned(),
                pixels: vec![PixelKind::Link],
                ..Hello::default()
            }),
            Request::Freeze { .. } => Answer::Frozen,
            Request::Release => Answer::Released,
            Request::Travel { .. } => Answer::Arrived,
            Request::Command { path } => {
                let mut told = told.lock().unwrap();
                if path == COMMAND_TOGGLE_MAIN_MENU {
                    told.menu = told.menu.filter(|helps| !helps);
                }
                told.commands.push(path.clone());
                Answer::Commanded
            }
            Request::Fly(_) => Answer::Flown {
                columns: FLIGHT_COLUMNS.map(str::to_owned).to_vec(),
                rows: 0,
            },
            other => Answer::refusal(format!("{other:?} is not part of this test")),
        };
        told.lock().unwrap().requests.push(request);
        write_message(&mut stream, &answer, &[]).await?;
    }
    Ok(())
}
