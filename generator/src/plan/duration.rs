//! Duration of recording, part by part: images, flights that are flown live, loading, weather.
//!
//! Every part has a source: an X-Plane's profile, a measurement with the stand-in, or a stated assumption.

use dataset::corpus::scenario::Flight;
use dataset::plan::{Common, PlannedScenario};
use serde::Serialize;
use xplane_bridge::profile::Profile;

/// Images per second that the stand-in draws and this program encodes, all views together, on two otherwise idle cores: 1920 x 1280, 30
/// images per second, the default `[video]`. `docs/plan.md` has the measurement.
const STAND_IN_PICTURES_PER_S: f64 = 45.0;
/// Image size of that figure; cost grows with the number of pixels.
const MEASURED_PIXELS: f64 = 1_920.0 * 1_280.0;

/// Assumed durations for an X-Plane without measurements, seconds: loading a flight's scenery (20 s measured by others, and the terrain
/// settles), and showing written clouds (55 s measured by others).
const ASSUMED_LOADING_S: f64 = 30.0;
const ASSUMED_WEATHER_S: f64 = 60.0;
/// A replay starts no flight; only the aircraft moves there.
const ASSUMED_TRAVEL_S: f64 = 5.0;
/// A flight is flown on for this long after touchdown, which no scenario shows, seconds.
const ROLL_OUT_S: f64 = 3.0;
/// Images per second that X-Plane is assumed to deliver.
const ASSUMED_PICTURES_PER_S: f64 = 8.0;

/// Source of an estimate's figures.
#[derive(Debug, Clone, PartialEq)]
pub enum Pacing {
    /// Stand-in's figures on the reference machine.
    StandIn,
    /// An X-Plane, with its profile if it has one.
    XPlane(Option<Box<Profile>>),
}

/// Durations of the parts, hours, and the source of each figure.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Durations {
    /// Drawing, grabbing and encoding images.
    pub pictures_h: f64,
    /// Source of that figure.
    pub pictures_basis: String,
    /// Flying live flights.
    pub live_flying_h: f64,
    /// Source of that figure.
    pub live_flying_basis: String,
    /// Starting flights and loading scenery, and all that a scenario takes besides its images.
    pub loading_h: f64,
    /// Source of that figure.
    pub loading_basis: String,
    /// Waiting until the weather is there.
    pub weather_h: f64,
    /// Source of that figure.
    pub weather_basis: String,
}

impl Durations {
    /// All parts together, hours.
    pub(crate) fn total_h(&self) -> f64 {
        self.pictures_h + self.live_flying_h + self.loading_h + self.weather_h
    }

    /// Durations for planned scenarios.
    pub(super) fn new(common: &Common, scenarios: &[&PlannedScenario], pacing: &Pacing) -> Self {
        let count = Count::of(common, scenarios);
        match pacing {
            Pacing::StandIn => count.with_the_stand_in(common),
            Pacing::XPlane(profile) => count.with_x_plane(common, profile.as_deref()),
        }
    }
}

struct Count {
    scenarios: usize,
    live: usize,
    live_flying_s: f64,
    pictures: f64,
}

impl Count {
    fn of(common: &Common, scenarios: &[&PlannedScenario]) -> Self {
        let period_s = common.picture.frame_rate.period_s();
        let live = scenarios
            .iter()
            .filter(|scenario| scenario.parameters.flight == Flight::Live);
        let ticks = scenarios.iter().map(|scenario| f64::from(scenario.ticks));
        Self {
            scenarios: scenarios.len(),
            live: live.clone().count(),
            live_flying_s: live
                .map(|scenario| f64::from(scenario.ticks) * period_s + ROLL_OUT_S)
                .sum::<f64>()
                + 0.0,
            // The sum of none is -0.
            pictures: (ticks.sum::<f64>() + 0.0) * common.cameras.len() as f64,
        }
    }

    fn with_the_stand_in(&self, common: &Common) -> Durations {
        let per_s = STAND_IN_PICTURES_PER_S / relative_size(common);
        Durations {
            pictures_h: self.pictures / per_s / 3_600.0,
            pictures_basis: format!(
                "{per_s:.0} per second, measured with the bundled simulator on two cores at 30 images per second of flight"
            ),
            live_flying_basis: "the bundled simulator does not fly in real time".into(),
            loading_basis: "not counted".into(),
            weather_basis: "the bundled simulator changes its weather at once".into(),
            ..Durations::default()
        }
    }

    fn with_x_plane(&self, common: &Common, profile: Option<&Profile>) -> Durations {
        let pace = profile.and_then(|profile| profile.pace.found());
        let (pictures_per_s, pictures_basis) = match pace {
            Some(pace) => {
                let pixels = f64::from(pace.size.width_px) * f64::from(pace.size.height_px)
                    / MEASURED_PIXELS;
                // Frames a second fall less than pixels grow: the same is assumed for any size, and said.
                let other = if (pixels - relative_size(common)).abs() > 1e-9 {
                    format!(", at {}", pace.size)
                } else {
                    String::new()
                };
                (
                    pace.pictures_per_s,
                    format!(
                        "{:.1} per second, measured by {}{other}, {}",
                        pace.pictures_per_s,
                        pace.measured_by,
                        pace.procedure()
                    ),
                )
            }
            None => (
                ASSUMED_PICTURES_PER_S,
                format!(
                    "{ASSUMED_PICTURES_PER_S:.0} per second, assumed; `dtd doctor` measures it"
                ),
            ),
        };
        let (loading_s, loading_basis) =
            measured_or(pace.and_then(|pace| pace.loading_s), ASSUMED_LOADING_S);
        let (weather_s, weather_basis) =
            measured_or(pace.and_then(|pace| pace.weather_s), ASSUMED_WEATHER_S);
        let replayed = (self.scenarios - self.live) as f64;
        Durations {
            pictures_h: self.pictures / pictures_per_s / 3_600.0,
            pictures_basis,
            live_flying_h: self.live_flying_s / 3_600.0,
            live_flying_basis: format!(
                "{}, in real time; [start] fly = \"computed\" saves it",
                counted(self.live, "live flight")
            ),
            loading_h: (self.live as f64 * loading_s + replayed * ASSUMED_TRAVEL_S) / 3_600.0,
            loading_basis: match self.scenarios - self.live {
                0 => loading_basis,
                replayed => format!(
                    "{}, {loading_basis}; {}, {ASSUMED_TRAVEL_S:.0} s each, assumed",
                    counted(self.live, "live flight"),
                    counted(replayed, "replayed flight")
                ),
            },
            weather_h: self.scenarios as f64 * weather_s / 3_600.0,
            weather_basis,
        }
    }
}

/// Duration per item, seconds, and the figure's source.
fn measured_or(measured_s: Option<f64>, assumed_s: f64) -> (f64, String) {
    match measured_s {
        Some(took_s) => (took_s, format!("{took_s:.0} s each, measured")),
        None => (assumed_s, format!("{assumed_s:.0} s each, assumed")),
    }
}

/// A number of things: `1 scenario`, `2 scenarios`.
pub(crate) fn counted(number: usize, thing: &str) -> String {
    match number {
        1 => format!("1 {thing}"),
        _ => format!("{number} {thing}s"),
    }
}

/// Image size relative to the measured one.
pub(super) fn relative_size(common: &Common) -> f64 {
    let picture = common.picture;
    f64::from(picture.width_px) * f64::from(picture.height_px) / MEASURED_PIXELS
}
