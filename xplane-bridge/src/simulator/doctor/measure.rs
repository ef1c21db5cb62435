//! Measures what reports disagree on, once per installation; the plugin stores the result.

pub(crate) mod following;

use chrono::{SecondsFormat, Utc};
use dataset::geometry::pose::Pose;
use futures_util::future::LocalBoxFuture;
use serde_json::json;

use super::eyes::{Eyes, noon_zulu_s};
use super::talk::PlaceOnGround;
use super::{Check, DoctorOptions, Measuring, Verdict, pace, pictures, sky};
use crate::Simulator;
use crate::datarefs::{DatarefWrite, Generation, USE_SYSTEM_TIME, ZULU_TIME_S};
use crate::error::BridgeError;
use crate::link::{Answer, Request};
use crate::profile::{Finding, KnownProfile, PROFILE_FORMAT, PacedBy, Profile};
use crate::simulator::SWITCH_TIMEOUT;

const NAME: &str = "profile";

/// Measures, if requested, and stores the profile. It takes minutes, so each point is reported as it is known.
pub(super) async fn measure(
    simulator: &mut Simulator,
    place: PlaceOnGround,
    options: &DoctorOptions,
    note: &mut (dyn FnMut(Check) + Send),
) {
    match (options.measuring, simulator.profile().current()) {
        (Measuring::Never, _) => {
            let known = simulator.profile();
            return note(Check::skipped(
                NAME,
                format!("not measured; this simulator {known}"),
            ));
        }
        (Measuring::Once, Some(profile)) => {
            let found = format!(
                "measured at {} with {}; --measure measures again",
                profile.measured_at, profile.simulator
            );
            let profile = profile.clone();
            note(Check::ok(NAME, found));
            return pace_of_this_sweep(simulator, &place, profile, options, note).await;
        }
        _ => {}
    }
    if let Err(error) = simulator.forget_profile().await {
        let hint = "Nothing is measured that the plugin cannot keep; `dtd generate` works without a profile. Free space on the \
                    simulator's disk, make the plugin's folder writable, or install the plugin of this release: `dtd install-plugin XPLANE_DIR`";
        return note(Check::warning(NAME, error.to_string(), hint));
    }
    // A clock that follows the computer's continues in a pause, and the sun with it.
    let clock = simulator.take_clock(place.longitude_deg).await;
    let mut profile = unmeasured(simulator);
    pictures::measure(&mut Eyes::at(simulator, place), &mut profile).await;
    pictures::checks(&profile).into_iter().for_each(&mut *note);
    // Weather changes while time runs.
    if let Err(error) = simulator.go_on().await {
        tracing::warn!(%error, "the simulator does not continue");
    }
    let weather_took_s = sky::measure(simulator, &mut profile).await;
    sky::checks(&profile).into_iter().for_each(&mut *note);
    // As a recording does: with the frames to settle that were just measured.
    simulator.profile = KnownProfile::Current(Box::new(profile.clone()));
    let intent = options.intent.as_ref();
    let (pace, why_settled) = pace::measure(simulator, &place, &options.screen, intent).await;
    profile.pace = pace;
    if let Finding::Found(pace) = &mut profile.pace {
        pace.weather_s = match simulator.generation {
            // Its weather is given a fixed time.
            Generation::XPlane11 => Some(simulator.weather_settle.as_secs_f64()),
            Generation::XPlane12 => weather_took_s,
        };
    }
    note(pace::check(&profile.pace, why_settled));
    simulator.give_clock_back(clock).await;
    note(keep(simulator, profile).await);
}

/// Reports how, and how fast, images of this sweep are taken. Measures it if the profile has the pace of other images.
async fn pace_of_this_sweep(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    mut profile: Profile,
    options: &DoctorOptions,
    note: &mut (dyn FnMut(Check) + Send),
) {
    let Some(intent) = &options.intent else {
        return;
    };
    let known = profile.pace.found().copied();
    let in_blocks = pace::size_in_blocks(simulator, intent).is_some();
    let is_known = known.is_some_and(|pace| {
        pace.in_blocks == in_blocks && (!in_blocks || pace.size == intent.pictures)
    });
    if is_known {
        return note(pace::check(&profile.pace, None));
    }
    let clock = simulator.take_clock(place.longitude_deg).await;
    let (pace, why_settled) = pace::measure(simulator, place, &options.screen, Some(intent)).await;
    note(pace::check(&pace, why_settled));
    simulator.give_clock_back(clock).await;
    // A night's pace is nearer to the next night's.
    let is_of_a_night = known.is_some_and(|known| {
        known.measured_by == PacedBy::Generate && known.size == intent.pictures
    });
    if let (Finding::Found(mut pace), false) = (pace, is_of_a_night) {
        pace.weather_s = known.and_then(|known| known.weather_s);
        pace.loading_s = known.and_then(|known| known.loading_s);
        profile.pace = Finding::Found(pace);
        let kept = keep(simulator, profile).await;
        if kept.verdict != Verdict::Ok {
            note(kept);
        }
    }
}

impl Simulator {
    /// Checks the images of an unmeasured X-Plane: some seconds, for this run alone. An X-Plane that freezes its image in a pause, or whose
    /// exposure settles slowly, would give wrong ones. Before freezing, with the aircraft at this height.
    ///
    /// # Errors
    /// The simulator does not continue afterwards. Properties that cannot be seen are marked in the profile.
    pub fn look_at_pictures<'a>(
        &'a mut self,
        aircraft: &'a Pose,
    ) -> LocalBoxFuture<'a, Result<(), BridgeError>> {
        Box::pin(async move {
            if self.description.plugin.is_none() || self.profile.current().is_some() {
                return Ok(());
            }
            let place = PlaceOnGround {
                latitude_deg: aircraft.latitude_deg,
                longitude_deg: aircraft.longitude_deg,
                altitude_msl_m: aircraft.altitude_msl_m,
                ground_msl_m: 0.0,
            };
            tracing::info!("no profile of this simulator: its images are checked first");
            // At night the scene is not visible.
            self.write_surely(USE_SYSTEM_TIME, 0.0).await?;
            self.write_surely(ZULU_TIME_S, noon_zulu_s(aircraft.longitude_deg) as f32)
                .await?;
            let mut profile = unmeasured(self);
            pictures::measure(&mut Eyes::at(self, place), &mut profile).await;
            self.go_on().await?;
            self.profile = KnownProfile::PicturesOnly(Box::new(profile));
            Ok(())
        })
    }
}

/// Profile of the connected simulator before anything was measured.
fn unmeasured(simulator: &Simulator) -> Profile {
    const WEATHER: &str = "only `dtd doctor` measures the weather";
    const NOTHING_NEW: &str = "nothing new shows";
    let description = simulator.description();
    Profile {
        format: PROFILE_FORMAT,
        measured_at: Utc::now().to_rfc3339_opts(SecondsFormat::Secs, true),
        simulator: format!("{} {}", description.name, description.version),
        plugin: description.plugin.clone(),
        wind_unit: Finding::not_measured(WEATHER),
        weather_follows: following::nothing(WEATHER),
        pause_shows_poses: Finding::not_measured(NOTHING_NEW),
        frames_until_settled: Finding::not_measured(NOTHING_NEW),
        still_pictures_move: Finding::not_measured(NOTHING_NEW),
        pace: Finding::not_measured("only `dtd doctor` and `dtd generate` measure it"),
    }
}

async fn keep(simulator: &mut Simulator, profile: Profile) -> Check {
    match simulator.keep_profile(profile).await {
        Ok(()) => Check::ok(
            NAME,
            "kept by the plugin, beside itself (dtd_profile.json); dtd generate uses it",
        ),
        Err(error) => Check::warning(
            NAME,
            format!("measured, but not kept: {error}"),
            "dtd generate continues without it, and follows the majority of the sources where they disagree",
        ),
    }
}

impl Simulator {
    /// Measures without earlier measurements, on both sides. If this examination is aborted there is no profile.
    async fn forget_profile(&mut self) -> Result<(), BridgeError> {
        self.profile = KnownProfile::None;
        let request = Request::KeepProfile { profile: json!({}) };
        let doing = "forgetting the profile";
        self.link
            .tell(doing, &request, SWITCH_TIMEOUT, &Answer::ProfileKept)
            .await
    }

    /// Stops the clock from following the computer's, and sets it to noon, since the scene is not visible at night. Returns the writes that
    /// restore it.
    async fn take_clock(&mut self, longitude_deg: f64) -> Result<Vec<DatarefWrite>, BridgeError> {
        let names = [ZULU_TIME_S, USE_SYSTEM_TIME].map(|name| DatarefWrite::new(name, 0.0));
        let before = self.values_now(&names).await?;
        self.write_until_read_back(&names[1..]).await?;
        self.write_surely(ZULU_TIME_S, noon_zulu_s(longitude_deg) as f32)
            .await?;
        Ok(before)
    }

    /// Restores the time of day, and the setting that the clock follows the computer's.
    async fn give_clock_back(&mut self, taken: Result<Vec<DatarefWrite>, BridgeError>) {
        let given_back = async {
            for write in &taken? {
                // The time runs on: it does not read back.
                self.write_surely(&write.name, write.value).await?;
            }
            Ok::<_, BridgeError>(())
        };
        if let Err(error) = given_back.await {
            tracing::warn!(%error, "the clock was not given back");
        }
    }
}
