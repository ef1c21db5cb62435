//! X-Plane's own files: complaints about our plugin, graphics, and who else draws.
//!
//! X-Plane 12 logs deprecated datarefs and misplaced calls, and shows some complaints over the scene, where they would be in the images.
//! The plugin reads the files, on any computer.

use std::time::Duration;

use super::Check;
use crate::Simulator;
use crate::error::BridgeError;
use crate::link::{Answer, Installation, PixelKind, Request};
use crate::simulator::wrong;

/// Names of the checks, for reporting them as skipped.
pub(super) const NAMES: [&str; 3] = ["complaints", "graphics", "other plugins"];
/// A log of many megabytes on a slow disk.
const TIMEOUT: Duration = Duration::from_secs(20);
/// Parts of signatures of plugins that draw aircraft or hold their slots (xpilot#255, XPMP2), lower case.
const TRAFFIC: [&str; 8] = [
    "xpilot",
    "livetraffic",
    "xpmp",
    "swift",
    "ivao",
    "ivap",
    "squawkbox",
    "traffic",
];
/// What belongs to X-Plane, or runs our plugin.
const OWN: [&str; 2] = ["xpsdk.examples.pluginadmin", "xppython3"];

/// Has the plugin read the files.
pub(super) async fn checks(simulator: &mut Simulator) -> Vec<Check> {
    let all = |reason: &str| NAMES.map(|name| Check::skipped(name, reason)).to_vec();
    if simulator.description().plugin.is_none() {
        return all("the simulator serves its link without a plugin");
    }
    let grabs = simulator.description().pixels.first() == Some(&PixelKind::Screen);
    match simulator.installation().await {
        Ok(found) => verdicts(&found, grabs),
        // An older plugin, or a log that cannot be read.
        Err(error) => all(&error.to_string()),
    }
}

impl Simulator {
    /// What X-Plane draws with. A simulator without a plugin does not know.
    ///
    /// # Errors
    /// X-Plane's log cannot be read, or the plugin is an older one.
    pub async fn installation(&mut self) -> Result<Installation, BridgeError> {
        let request = Request::Installation;
        match self.link.ask("X-Plane's files", &request, TIMEOUT).await? {
            Answer::Installation(found) => Ok(found),
            other => Err(wrong("installation", &other)),
        }
    }
}

fn verdicts(found: &Installation, grabs: bool) -> Vec<Check> {
    vec![
        complaints(&found.complaints),
        graphics(found, grabs),
        others(found),
    ]
}

fn complaints(lines: &[String]) -> Check {
    if lines.is_empty() {
        return Check::ok(NAMES[0], "X-Plane's Log.txt has no complaint about us");
    }
    Check::warning(
        NAMES[0],
        format!(
            "X-Plane's Log.txt complains about us: {}",
            lines.join(" | ")
        ),
        "Look whether X-Plane shows an error over the scene, and close it: it would be in the images. Please report these lines, with the \
         version of X-Plane",
    )
}

fn graphics(found: &Installation, grabs: bool) -> Check {
    let of = |name: &str| found.settings.get(name).map(String::as_str);
    let settings = found.settings.iter();
    let settings: Vec<String> = settings
        .map(|(name, value)| format!("{name} {value}"))
        .collect();
    let text = if settings.is_empty() {
        "X-Plane's files name none".to_owned()
    } else {
        settings.join(", ")
    };
    let is_wayland =
        of("Desktop session type").is_some_and(|it| it.eq_ignore_ascii_case("wayland"));
    let draws_elsewhere =
        of("plugins' renderer").is_some_and(|it| !it.to_ascii_lowercase().contains("zink"));
    let is_vulkan = of("Vulkan Device").is_some();
    let hint = if grabs && is_wayland {
        "This is a Wayland session, in which grabs of the screen are black: log in with an X11 session (\"Xorg\")"
    } else if grabs && is_vulkan && draws_elsewhere {
        "Switch on Settings > Graphics > \"Use Zink\" in X-Plane 12: without it, what plugins draw flickers or is missing on some drivers"
    } else {
        return Check::ok(NAMES[1], text);
    };
    Check::warning(NAMES[1], text, hint)
}

fn others(found: &Installation) -> Check {
    let has = |parts: &[&str], name: &str| {
        let name = name.to_ascii_lowercase();
        parts.iter().any(|part| name.contains(part))
    };
    let others = found.plugins.iter().filter(|name| !has(&OWN, name));
    let others: Vec<&str> = others.map(String::as_str).collect();
    let traffic: Vec<&str> = (others.iter().copied())
        .filter(|name| has(&TRAFFIC, name))
        .collect();
    let text = match others.as_slice() {
        [] => "none but ours".to_owned(),
        others => others.join(", "),
    };
    if traffic.is_empty() {
        return Check::ok(NAMES[2], text);
    }
    let hint = format!(
        "{} may hold the aircraft or draw ones that no label has: disable it in X-Plane's Plugin Admin, or take it out of \
         Resources/plugins",
        traffic.join(", ")
    );
    Check::warning(NAMES[2], text, hint)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::doctor::Verdict;

    fn installation(settings: &[(&str, &str)], plugins: &[&str]) -> Installation {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        Installation {
            settings: settings.iter().map(owned).collect(),
            plugins: plugins.iter().map(|name| (*name).to_owned()).collect(),
            ..Installation::default()
        }
    }

    #[test]
    fn each_complaint_is_quoted_with_what_to_do() {
        let line = "[XPPython3]: Dataref 'sim/cockpit2/controls/flap_ratio' has been replaced. Please use the new name.";
        let check = complaints(&[line.into()]);
        assert_eq!(check.verdict, Verdict::Warning);
        assert!(check.found.contains(line), "{}", check.found);
        assert!(check.hint.unwrap().contains("over the scene"));
        assert_eq!(complaints(&[]).verdict, Verdict::Ok);
    }

    #[test]
    fn a_session_and_a_renderer_that_spoil_grabs_are_named_and_only_where_images_are_grabbed() {
        let vulkan = ("Vulkan Device", "NVIDIA GeForce RTX 3060");
        let wayland = ("Desktop session type", "wayland");
        let driver = ("plugins' renderer", "NVIDIA GeForce RTX 3060/PCIe/SSE2");
        let zink = ("plugins' renderer", "zink Vulkan 1.3 (NVIDIA)");
        let cases: [(&[(&str, &str)], &str); 4] = [
            (&[vulkan, wayland, zink], "Wayland"),
            (&[vulkan, driver], "Zink"),
            (&[vulkan, zink], ""),
            (&[], ""),
        ];
        for (settings, words) in cases {
            let hint = graphics(&installation(settings, &[]), true).hint;
            assert_eq!(hint.is_some(), !words.is_empty(), "{hint:?}");
            assert!(hint.unwrap_or_default().contains(words));
        }
        let far = graphics(&installation(&[vulkan, wayland, driver], &[]), false);
        assert_eq!(far.verdict, Verdict::Ok);
    }

    #[test]
    fn plugins_that_draw_aircraft_are_named_and_our_own_are_no_others() {
        let own = ["xpsdk.examples.pluginadmin", "xppython3.main"];
        let check = others(&installation(&[], &own));
        assert_eq!(check, Check::ok(NAMES[2], "none but ours"));
        let traffic = "TwinFan.plugin.LiveTraffic";
        let check = others(&installation(
            &[],
            &[own[1], "org.solhost.folko.avitab", traffic],
        ));
        assert!(check.found.contains("avitab") && !check.found.contains("python"));
        let hint = check.hint.unwrap();
        assert!(hint.contains(traffic) && !hint.contains("avitab"), "{hint}");
    }
}
