//! Whether flaps and gear are drawn as they are written: with the flight model off, one user's ailerons moved and flaps did not
//! (XPlaneConnect#213).

use dataset::conditions::Clock;
use dataset::geometry::pose::Controls;

use crate::Simulator;
use crate::error::BridgeError;
use crate::simulator::block::changed_pixels;
use crate::simulator::doctor::Check;
use crate::simulator::doctor::eyes::{Eyes, Shot};
use crate::simulator::doctor::talk::PlaceOnGround;

pub(in crate::simulator::doctor) const NAME: &str = "flaps and gear";
/// A pixel differs if a colour does by more than this, levels: film grain and compression stay below.
const LEVELS: u8 = 16;
/// Fewer pixels are noise; and twice as many as between two images of the same.
const MIN_PIXELS: usize = 3;

/// Compares a settled image of the aircraft with one with flaps, and one with the gear down.
pub(in crate::simulator::doctor) async fn check(
    simulator: &mut Simulator,
    place: &PlaceOnGround,
    running_at: Option<Clock>,
) -> Check {
    let mut eyes = Eyes::at(simulator, *place);
    if let Some(reason) = eyes.blind() {
        return Check::skipped(NAME, reason);
    }
    let hint = "Boxes and recorded flaps and gear are those that were written. Load X-Plane's own 737-800, whose parts plugins can move, and \
                run no plugin that animates it";
    match not_drawn(&mut eyes, running_at).await {
        Err(error) => Check::skipped(NAME, error.to_string()),
        Ok(parts) if parts.is_empty() => Check::ok(NAME, "both are drawn as they are written"),
        Ok(parts) => {
            let found = format!(
                "{} written, but the image stays the same",
                parts.join(" and ")
            );
            Check::warning(NAME, found, hint)
        }
    }
}

async fn not_drawn(
    eyes: &mut Eyes<'_>,
    running_at: Option<Clock>,
) -> Result<Vec<&'static str>, BridgeError> {
    let with = |flap_ratio, gear_ratio| Shot {
        controls: Controls {
            flap_ratio,
            gear_ratio,
        },
        ..Shot::BEHIND
    };
    let settle_frames = eyes.simulator.frames_to_settle();
    eyes.hold_at(settle_frames, running_at).await?;
    let [up, again, flaps, gear] = eyes
        .take([Shot::BEHIND, Shot::BEHIND, with(1.0, 0.0), with(0.0, 1.0)])
        .await?;
    let least = MIN_PIXELS + 2 * changed_pixels(&up.rgb, &again.rgb, LEVELS);
    let parts = [("flaps", flaps), ("gear", gear)].into_iter();
    Ok(parts
        .filter(|(_, other)| changed_pixels(&up.rgb, &other.rgb, LEVELS) < least)
        .map(|(part, _)| part)
        .collect())
}
