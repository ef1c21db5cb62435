//! The window that X-Plane draws into: its size, and whether its images can be grabbed where necessary.

use std::sync::Arc;

use super::{Check, Intent, Verdict};
use crate::Simulator;
use crate::link::{Hello, PictureSize, PixelKind, SimulatorWindow};
use crate::pixels::{Lag, PixelChoice, PixelSource, Screen};

pub(super) const NAME: &str = "window";

/// The required image size; `None` if the simulator draws any.
pub(super) fn picture_size(description: &Hello) -> Option<PictureSize> {
    let of_window = description.window.as_ref().map(SimulatorWindow::size);
    description.drawn_size.or(of_window)
}

/// Remedy for a window in which the sweep's images cannot be taken.
fn misfit(size: PictureSize, may_have_margins: bool, intent: Option<&Intent>) -> Option<String> {
    let Intent { sweep, pictures } =
        intent.filter(|intent| !intent.pictures.fits(size, may_have_margins))?;
    Some(format!(
        "Images of {sweep} have {pictures} pixels, which this window does not fit. {}, or give the sweep's [picture] width_px = {} and \
         height_px = {}",
        pictures.window_advice(may_have_margins),
        size.width_px,
        size.height_px
    ))
}

/// Checks the window. If images come only off the screen, it is located there by its check pattern, and images come from there
/// from now on.
pub(super) async fn check(
    simulator: &mut Simulator,
    screen: &Arc<dyn Screen>,
    intent: Option<&Intent>,
) -> Check {
    let check = look(simulator, screen).await;
    let source = simulator.description().pixels.first();
    let may_have_margins = source.is_some_and(|source| simulator.may_have_margins(*source));
    let size = picture_size(simulator.description());
    let misfit = size.and_then(|size| misfit(size, may_have_margins, intent));
    match (check.verdict, misfit) {
        (Verdict::Ok | Verdict::Skipped, Some(hint)) => Check::warning(NAME, check.found, hint),
        _ => check,
    }
}

async fn look(simulator: &mut Simulator, screen: &Arc<dyn Screen>) -> Check {
    let description = simulator.description().clone();
    let first = description.pixels.first();
    let Some(size) = picture_size(&description) else {
        return match first {
            Some(PixelKind::Link) => Check::skipped(NAME, "images do not come from a window"),
            _ => Check::warning(
                NAME,
                "the plugin does not say how large it is",
                "Install the plugin of this release: dtd install-plugin XPLANE_DIR",
            ),
        };
    };
    if size.width_px == 0 || size.height_px == 0 {
        let hint = "Is it minimised? Bring it up: nothing is drawn until then";
        return Check::failed(NAME, format!("{size} pixels"), hint);
    }
    if first == Some(&PixelKind::Screen) {
        return grabbed(simulator, size, screen).await;
    }
    let Some(window) = &description.window else {
        let found = format!(
            "{size} pixels; its position is unknown, and not needed: the plugin reads the frame back"
        );
        return Check::ok(NAME, found);
    };
    let found = format!("{window}, scale {}", window.scale);
    if window.scale == 1.0 {
        Check::ok(NAME, found)
    } else {
        let hint = "The desktop is scaled: images are resampled. Set its scale to 100 %, or check sizes with care";
        Check::warning(NAME, found, hint)
    }
}

async fn grabbed(simulator: &mut Simulator, size: PictureSize, screen: &Arc<dyn Screen>) -> Check {
    let choice = PixelChoice::Only(PixelKind::Screen);
    let picture_px = (size.width_px, size.height_px);
    match simulator.use_pixels(choice, picture_px, screen).await {
        Ok(_) => {
            let lag = match &simulator.pixels {
                PixelSource::Screen(source) => source.lag(),
                _ => Lag::default(),
            };
            let name = simulator.screen(screen).map(|screen| screen.name());
            let found = format!(
                "{size} pixels, found on the screen {} by its check pattern, whole and unscaled, {} grabs and {:.0} ms late at most",
                name.unwrap_or_default(),
                lag.grabs,
                lag.time.as_secs_f64() * 1e3
            );
            Check::ok(NAME, found)
        }
        Err(error) => Check::warning(
            NAME,
            format!("{size} pixels, but not to be seen from here: {error}"),
            "Images of this simulator come off the screen: run dtd on its computer, in its desktop session, or have its plugin grab there \
             (docs/x-plane.md, \"X-Plane on another computer\"), with its window uncovered and the desktop's scale at 100 %",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_with_margins_fits_only_where_frames_are_numbered_and_the_remedy_names_no_other() {
        let pictures = PictureSize {
            width_px: 1920,
            height_px: 1280,
        };
        let sweep = "night.toml".into();
        let intent = Intent { sweep, pictures };
        let remedy = |size, may_have_margins| misfit(size, may_have_margins, Some(&intent));
        for may_have_margins in [true, false] {
            assert_eq!(remedy(pictures, may_have_margins), None);
        }
        let with_margins = pictures.with_margins();
        assert_eq!(remedy(with_margins, true), None);
        let far = remedy(with_margins, false).unwrap();
        let (exact, larger) = ("--window=1920x1280", "--window=1952x1312");
        assert!(far.contains(exact) && !far.contains(larger), "{far}");
        let near = PictureSize {
            width_px: 1930,
            height_px: 1290,
        };
        let near = remedy(near, true).unwrap();
        assert!(near.contains(exact) && near.contains(larger), "{near}");
    }
}
