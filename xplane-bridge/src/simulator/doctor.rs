//! Examines a live connection point by point, to show the user what to fix.
//!
//! Input: the expected address of the simulator. Output: one [`Check`] after the other, each with the finding and, if it is not ok,
//! a remedy. A check that depends on an earlier one that failed is reported as skipped. Once per installation it also measures what reports
//! disagree on, and stores it as a [`Profile`]. Every change is undone: one course, the pause, the weather, and the aircraft's place during
//! the images.
//!
//! It is part of this crate because it measures with private functions of the client, such as writing a dataref until it holds.

mod eyes;
mod installation;
mod lockstep;
mod measure;
mod next;
mod pace;
mod pictures;
mod sky;
mod talk;
mod window;

use std::fmt;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use dataset::conditions::Clock;
use dataset::geometry::runway::Runway;
use futures_util::future::LocalBoxFuture;
use serde::Serialize;

use self::talk::Talk;
use crate::datarefs::Generation;
use crate::error::{BridgeError, Silence};
use crate::link::{Hello, LINK_VERSION, PictureSize};
use crate::pixels::{FfmpegScreen, Screen};
use crate::profile::Finding;
use crate::udp::discovery::DISCOVERY_TIMEOUT;
use crate::udp::simulator_address::reachable;
use crate::udp::socket::LocalUdp;
use crate::{ConnectOptions, Simulator, WebApiPlace};

/// X-Plane's default address.
const USUAL_ADDRESS: (Ipv4Addr, u16) = (Ipv4Addr::LOCALHOST, 49_000);
/// Timeout for opening the capture link.
const LINK_TIMEOUT: Duration = Duration::from_secs(5);

/// Check result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Well.
    Ok,
    /// Recording is possible, but the user should look at it.
    Warning,
    /// Recording is impossible or would be wrong.
    Failed,
    /// Skipped, for the given reason.
    Skipped,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
        })
    }
}

/// A point of the examination.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Check {
    /// Name of the check.
    pub name: &'static str,
    /// Result.
    pub verdict: Verdict,
    /// Details of the result.
    pub found: String,
    /// The remedy, unless it is ok.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

impl Check {
    /// Nothing to do.
    pub fn ok(name: &'static str, found: impl Into<String>) -> Self {
        Self {
            name,
            verdict: Verdict::Ok,
            found: found.into(),
            hint: None,
        }
    }

    fn bad(
        name: &'static str,
        verdict: Verdict,
        found: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        Self {
            name,
            verdict,
            found: found.into(),
            hint: Some(hint.into()),
        }
    }

    fn failed(name: &'static str, found: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::bad(name, Verdict::Failed, found, hint)
    }

    /// Something to know, with a remedy.
    pub fn warning(name: &'static str, found: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::bad(name, Verdict::Warning, found, hint)
    }

    /// A measurement; if it was not made, the reason as text.
    fn measured<T>(
        name: &'static str,
        finding: &Finding<T>,
        say: impl FnOnce(&T) -> String,
    ) -> Self {
        match finding {
            Finding::Found(value) => Self::ok(name, say(value)),
            Finding::NotMeasured(reason) => Self::skipped(name, reason.clone()),
        }
    }

    fn skipped(name: &'static str, reason: impl Into<String>) -> Self {
        Self {
            name,
            verdict: Verdict::Skipped,
            found: reason.into(),
            hint: None,
        }
    }
}

/// Choice of when to measure what reports disagree on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Measuring {
    /// If this installation has no profile.
    #[default]
    Once,
    /// Always.
    Again,
    /// Never.
    Never,
}

/// The recording that is planned afterwards.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Intent {
    /// File of the sweep, as the user names it.
    pub sweep: String,
    /// Image size.
    pub pictures: PictureSize,
}

/// Examination settings.
#[derive(Debug, Clone)]
pub struct DoctorOptions {
    /// The simulator's UDP address; by default the one in the beacon, or X-Plane's default.
    pub address: Option<SocketAddr>,
    /// Web API address.
    pub web_api: WebApiPlace,
    /// The screen that it draws on, if images come off it.
    pub screen: Arc<dyn Screen>,
    /// Time to listen for the beacon. X-Plane sends one per second.
    pub listen: Duration,
    /// Time to wait for values over UDP.
    pub wait: Duration,
    /// The local side of UDP.
    pub local_udp: LocalUdp,
    /// Port of the simulator's own capture link, if a recorder's stands in its place.
    pub own_link_port: Option<u16>,
    /// When to measure.
    pub measuring: Measuring,
    /// The planned recording, if known.
    pub intent: Option<Intent>,
    /// Runway for the landing of the first hour, which is measured if there is one.
    pub first_hour: Option<Runway>,
}

impl DoctorOptions {
    /// The simulator there, or any, with its Web API at the default address.
    pub fn at(address: Option<SocketAddr>) -> Self {
        Self {
            address,
            web_api: WebApiPlace::Usual,
            screen: Arc::new(FfmpegScreen::here()),
            listen: DISCOVERY_TIMEOUT,
            wait: Duration::from_secs(4),
            local_udp: LocalUdp::default(),
            own_link_port: None,
            measuring: Measuring::Once,
            intent: None,
            first_hour: None,
        }
    }
}

/// Names of the checks that need UDP answers, for reporting them as skipped.
const OVER_UDP: [&str; 4] = ["version", "web api", "datarefs writable", "menus"];
/// Names of the checks that need a capture link.
const OVER_LINK: [&str; 8] = [
    "window",
    installation::NAMES[0],
    installation::NAMES[1],
    installation::NAMES[2],
    "profile",
    "lockstep",
    pictures::controls::NAME,
    "release",
];

/// Examines everything, and calls `on_check` with each point as it is known.
pub fn examine<'a>(
    options: &'a DoctorOptions,
    on_check: &'a mut (dyn FnMut(&Check) + Send),
) -> LocalBoxFuture<'a, Vec<Check>> {
    Box::pin(async move {
        let mut examination = Examination {
            checks: Vec::new(),
            on_check,
        };
        let address = examination.run(options).await;
        let next = next::check(&examination.checks, address, options);
        examination.note(next);
        examination.checks
    })
}

struct Examination<'a> {
    checks: Vec<Check>,
    on_check: &'a mut (dyn FnMut(&Check) + Send),
}

impl Examination<'_> {
    fn note(&mut self, check: Check) {
        (self.on_check)(&check);
        self.checks.push(check);
    }

    fn skip(&mut self, names: &[&'static str], reason: &str) {
        for name in names {
            self.note(Check::skipped(name, reason));
        }
    }

    /// Returns the simulator's address, if known.
    async fn run(&mut self, options: &DoctorOptions) -> Option<SocketAddr> {
        let (check, announced) = talk::announcement::listen(options).await;
        let heard = check.verdict == Verdict::Ok;
        let undecided = check.verdict == Verdict::Failed;
        self.note(check);
        if undecided {
            let reason = "it is not known which simulator is meant";
            self.skip(&["udp"], reason);
            self.skip_all(reason);
            return None;
        }
        let usual = options
            .address
            .or(announced)
            .unwrap_or(USUAL_ADDRESS.into());
        let usual = reachable(usual);
        let mut talk = match Talk::begin(usual, options).await {
            Ok(talk) => talk,
            Err(error) => {
                let hint = match error {
                    BridgeError::LocalPort { .. } => "Choose another --udp-port, or none",
                    _ => "Is this the simulator's address, and is a network there?",
                };
                self.note(Check::failed("udp", error.to_string(), hint));
                self.skip_all("there is no UDP socket");
                return Some(usual);
            }
        };
        let web_api = options.web_api.of(usual);
        let version = match talk.version().await {
            Ok(version) => version,
            Err(silence) => {
                talk.end().await;
                self.note(silent(usual, &silence, options, heard, web_api).await);
                self.skip_all("the simulator does not answer over UDP");
                return Some(usual);
            }
        };
        self.note(Check::ok("udp", format!("{usual} answers")));
        let generation = Generation::of_version(version);
        self.note(talk::version_check(version));
        self.note(match generation {
            Generation::XPlane11 => Check::skipped("web api", "X-Plane 11 has none"),
            Generation::XPlane12 => {
                let port = talk.capture_port().await;
                talk::web::check(web_api, options.own_link_port.or(port)).await
            }
        });
        self.note(talk.writable().await);
        self.note(talk.menus().await);
        let (place, clock) = (talk.place().await, talk.clock().await);
        talk.end().await;
        match connect(usual, options).await {
            Err(error) => {
                self.note(no_link(&error));
                self.skip(&OVER_LINK, "there is no capture link");
            }
            Ok(simulator) => self.over_link(simulator, place.zip(clock), options).await,
        }
        Some(usual)
    }

    fn skip_all(&mut self, reason: &str) {
        self.skip(&OVER_UDP, reason);
        self.skip(&["plugin"], reason);
        self.skip(&OVER_LINK, reason);
    }

    async fn over_link(
        &mut self,
        mut simulator: Simulator,
        here: Option<(talk::PlaceOnGround, Clock)>,
        options: &DoctorOptions,
    ) {
        let description = simulator.description().clone();
        self.note(plugin(&description));
        let intent = options.intent.as_ref();
        let window = window::check(&mut simulator, &options.screen, intent).await;
        self.note(window);
        // After the check pattern: the plugin then knows who draws for it.
        for check in installation::checks(&mut simulator).await {
            self.note(check);
        }
        let Some((place, clock)) = here else {
            self.skip(
                &["profile", "lockstep", pictures::controls::NAME],
                "the simulator does not say where its aircraft is",
            );
            let released = simulator.release().await;
            self.note(release(released));
            return;
        };
        let note = &mut |check| self.note(check);
        measure::measure(&mut simulator, place, options, note).await;
        let running_at = simulator.time_has_to_run().then_some(clock);
        self.note(lockstep::lockstep(&mut simulator, &place, running_at).await);
        let drawn = pictures::controls::check(&mut simulator, &place, running_at).await;
        self.note(drawn);
        if let Some(runway) = &options.first_hour {
            let note = &mut |check| self.note(check);
            pace::first_hour::measure(&mut simulator, &place, runway, options, note).await;
        }
        let released = simulator.release().await;
        self.note(release(released));
    }
}

async fn connect(address: SocketAddr, options: &DoctorOptions) -> Result<Simulator, BridgeError> {
    let options = ConnectOptions {
        web_api: options.web_api.of(address),
        own_link_port: options.own_link_port,
        local_udp: options.local_udp.clone(),
        ..ConnectOptions::from_environment(address)?
    };
    Simulator::connect_with(address, LINK_TIMEOUT, options).await
}

/// Explains why no values come over UDP. Incoming connections that are switched off show elsewhere: the beacon is sent nevertheless, and
/// the Web API says so in its answer.
async fn silent(
    address: SocketAddr,
    silence: &Silence,
    options: &DoctorOptions,
    heard: bool,
    web_api: Option<SocketAddr>,
) -> Check {
    let refusing = match web_api {
        Some(place) if talk::web::refuses(place).await => Some(place),
        _ => None,
    };
    let mut found = match silence {
        Silence::Refused => format!("no program listens on {address}: its computer says so"),
        Silence::Nothing | Silence::Ended => {
            format!("nothing from {address} within {:.1?}", options.wait)
        }
    };
    let hint = match (refusing, heard) {
        (Some(place), _) => {
            found += &format!(", and the Web API at {place} refuses (403)");
            "It is there, but takes nothing: switch on Settings > Network > \"Accept incoming connections\" in X-Plane (a fresh X-Plane 12 has \
             it off)"
        }
        (None, true) => {
            "It is there, since its beacon is heard, but takes nothing: switch on Settings > Network > \"Accept incoming connections\" \
             in X-Plane (a fresh X-Plane 12 has it off), and look at firewalls: the answers come from another port than 49000 (docs/x-plane.md)"
        }
        (None, false) => {
            "Start X-Plane and load a flight; switch on Settings > Network > \"Accept incoming connections\"; name the right \
             address with --sim HOST:PORT; look at firewalls: the answers come from another port than 49000 (docs/x-plane.md). Without \
             X-Plane: dtd mock-xplane"
        }
    };
    Check::failed("udp", found, hint)
}

fn no_link(error: &BridgeError) -> Check {
    let hint = match error {
        BridgeError::NoPlugin { .. } => {
            "Put the plugin in place with `dtd install-plugin XPLANE_DIR`, restart X-Plane, and look for dtd in its Log.txt and \
             XPPython3Log.txt"
        }
        BridgeError::CannotOpenLink { .. } => {
            "A firewall may be between, or the plugin listens on its own machine only: run dtd there, or give the plugin a token and an \
             address (docs/x-plane.md)"
        }
        BridgeError::BadVariable(_) => "Set the variable right, or leave it out",
        BridgeError::Refused { .. } => "Set DTD_LINK_TOKEN to the secret that the plugin was given",
        _ => "Install plugin and program of the same release: `dtd install-plugin XPLANE_DIR`",
    };
    Check::failed("plugin", error.to_string(), hint)
}

fn plugin(description: &Hello) -> Check {
    let Hello { name, version, .. } = description;
    let served_by = description.plugin.as_deref();
    let served_by = served_by.unwrap_or("the simulator itself");
    let found =
        format!("capture link version {LINK_VERSION} of {name} {version}, served by {served_by}");
    let kinds: Vec<&str> = description.pixels.iter().map(|kind| kind.name()).collect();
    if kinds.is_empty() {
        return Check::failed(
            "plugin",
            format!("{found}; it can neither send images nor show them on a screen"),
            "Look for dtd's reason in XPPython3Log.txt, and let the simulator draw on a screen that the plugin can name (docs/x-plane.md)",
        );
    }
    Check::ok(
        "plugin",
        format!("{found}; images come by {}", kinds.join(", ")),
    )
}

fn release(released: Result<(), BridgeError>) -> Check {
    match released {
        Ok(()) => Check::ok("release", "the simulator runs again"),
        Err(error) => Check::failed(
            "release",
            error.to_string(),
            "Restart the flight in X-Plane: it may still be frozen",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::PixelKind;

    #[test]
    fn a_plugin_without_any_source_of_images_is_not_well() {
        let with = |pixels: Vec<PixelKind>| {
            let check = plugin(&Hello {
                pixels,
                ..Hello::default()
            });
            check.verdict
        };
        assert_eq!(with(vec![PixelKind::Screen]), Verdict::Ok);
        assert_eq!(with(Vec::new()), Verdict::Failed);
    }
}
