//! Inspects an X-Plane folder: X-Plane's version, and XPPython3's.

use std::fmt;
use std::fs;
use std::path::Path;

use dataset::files::outside_file::{self, FileKind};

use super::InstallError;

/// Version numbers, compared from the left.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(Vec<u32>);

impl Version {
    /// Parses the version at the start of a text, e.g. `12.4.0` from `12.4.0-r2-9b69b91a`.
    pub(crate) fn at_start_of(text: &str) -> Option<Self> {
        let end = text
            .find(|c: char| !c.is_ascii_digit() && c != '.')
            .unwrap_or(text.len());
        let numbers = text[..end].trim_end_matches('.').split('.');
        let numbers: Option<Vec<u32>> = numbers.map(|number| number.parse().ok()).collect();
        numbers.filter(|numbers| numbers.len() > 1).map(Self)
    }

    fn major(&self) -> u32 {
        self.0[0]
    }

    fn is_below(&self, numbers: &[u32]) -> bool {
        self.0.as_slice() < numbers
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&numbers.join("."))
    }
}

/// A suitable X-Plane installation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Installation {
    /// Version of X-Plane.
    pub xplane: Version,
    /// The result from XPPython3's log.
    pub xppython3: XpPython3,
}

/// The result from XPPython3's log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum XpPython3 {
    /// The version that ran.
    Version(Version),
    /// There is a log, but no version in it.
    Unsaid,
    /// There is none: it has never run.
    NeverRan,
}

impl XpPython3 {
    /// The version, if known.
    pub fn version(&self) -> Option<&Version> {
        match self {
            Self::Version(version) => Some(version),
            Self::Unsaid | Self::NeverRan => None,
        }
    }
}

impl Installation {
    /// X-Plane's log, rewritten at each start. Its first line contains the version.
    pub(super) const LOG: &str = "Log.txt";
    /// XPPython3's log, next to X-Plane's.
    const XPPYTHON3_LOG: &str = "XPPython3Log.txt";
    /// The text before its version in the log.
    const XPPYTHON3_WORDS: &str = "[XPPython3] Version ";
    pub(super) const XPPYTHON3: &str = "Resources/plugins/XPPython3";
    /// The oldest X-Plane that any supported XPPython3 runs in.
    pub(super) const OLDEST_XPLANE: &str = "11.52";

    /// Inspects a folder.
    ///
    /// # Errors
    /// It is not X-Plane's, or the plugin cannot work there.
    pub fn look(folder: &Path) -> Result<Self, InstallError> {
        let place = folder.display();
        for missing in ["Resources/plugins", "Resources/default scenery"] {
            if !folder.join(missing).is_dir() {
                return Err(InstallError::Unsuitable(format!(
                    "{place} is not X-Plane's folder: it has no {missing}. Give the folder that X-Plane was installed into"
                )));
            }
        }
        let xplane = version_in(&folder.join(Self::LOG), "for X-Plane ").ok_or_else(|| {
            InstallError::Unsuitable(format!(
                "cannot tell the version of X-Plane in {place}: {} does not begin with \"Log.txt for X-Plane ...\". Start X-Plane once, \
                 then try again",
                Self::LOG
            ))
        })?;
        if xplane.is_below(&[11, 52]) {
            return Err(InstallError::Unsuitable(format!(
                "X-Plane {xplane} is too old: the plugin needs XPPython3, which needs X-Plane {} or newer",
                Self::OLDEST_XPLANE
            )));
        }
        let wanted = wanted(&xplane);
        if !holds_a_plugin(&folder.join(Self::XPPYTHON3)) {
            return Err(InstallError::Unsuitable(format!(
                "X-Plane {xplane} in {place} has no XPPython3, in which the plugin runs: {} is missing, or has no .xpl file. Install XPPython3 \
                 {wanted} (https://xppython3.readthedocs.io), start X-Plane once, then try again",
                Self::XPPYTHON3
            )));
        }
        let log = folder.join(Self::XPPYTHON3_LOG);
        let xppython3 = match version_in(&log, Self::XPPYTHON3_WORDS) {
            Some(version) => XpPython3::Version(version),
            None if log.is_file() => XpPython3::Unsaid,
            None => XpPython3::NeverRan,
        };
        if let Some(found) = xppython3.version() {
            // The module `xp` came with 3.1; 4.7 dropped X-Plane 11.
            let too_old = found.is_below(&[3, 1]);
            let too_new = xplane.major() == 11 && !found.is_below(&[4, 7]);
            if too_old || too_new {
                return Err(InstallError::Unsuitable(format!(
                    "XPPython3 {found} is not compatible with X-Plane {xplane}: install XPPython3 {wanted}"
                )));
            }
        }
        Ok(Self { xplane, xppython3 })
    }

    /// Conditions that may prevent the plugin from working there, in untested combinations.
    pub(super) fn warnings(&self) -> Vec<String> {
        let wanted = wanted(&self.xplane);
        let warning = match &self.xppython3 {
            XpPython3::NeverRan => None,
            XpPython3::Unsaid => Some(format!(
                "{} does not say which XPPython3 wrote it (expected \"{}...\" in its first {LOG_LINES} lines): see to it that it is {wanted}",
                Self::XPPYTHON3_LOG,
                Self::XPPYTHON3_WORDS
            )),
            // 3.1.x is made for X-Plane 11; there is no report about 4.0 to 4.6 there.
            XpPython3::Version(found) if self.xplane.major() == 11 && !found.is_below(&[4]) => {
                Some(format!(
                    "XPPython3 {found} is not known to work with X-Plane {}: install XPPython3 {wanted} if the plugin does not start",
                    self.xplane
                ))
            }
            // 3.1.5 runs in X-Plane 11.52 and newer, 12 included, but with an external Python.
            XpPython3::Version(found) if self.xplane.major() >= 12 && found.is_below(&[4, 7]) => {
                Some(format!(
                    "XPPython3 {found} is older than what X-Plane {} should have: install XPPython3 {wanted} (3.x also needs a Python 3.10 of its own)",
                    self.xplane
                ))
            }
            XpPython3::Version(_) => None,
        };
        warning.into_iter().collect()
    }

    /// The user's remaining steps, after files have `changed` or not.
    pub(super) fn next_steps(&self, changed: bool) -> Vec<String> {
        let mut steps = Vec::new();
        if changed {
            steps.push("Restart X-Plane, or use Plugins > XPPython3 > Reload scripts.".to_owned());
        }
        if self.xppython3 == XpPython3::NeverRan {
            steps.push(format!(
                "XPPython3 has never run here ({} is missing): look there after the start for the line \"capture link on ...\".",
                Self::XPPYTHON3_LOG
            ));
        }
        match self.xplane.major() {
            11 => {
                steps.push("Settings > Network: leave the UDP port at 49000, or give yours to dtd as HOST:PORT.".into());
                steps.push(
                    "Settings > Graphics: switch the Vulkan/Metal driver off to have pixels read back (gl); with it, images \
                     come off the screen."
                        .into(),
                );
            }
            _ => steps.push(
                "Settings > Network: switch \"Accept incoming connections\" on. X-Plane 12 comes with it off and is silent until then."
                    .into(),
            ),
        }
        steps.push(
            "Start X-Plane with a window of the size of your images, e.g. --window=1920x1280, at a display scale of 100 %. If dtd runs on \
             this computer and grabs its screen, a window of 32 pixels more each way (--window=1952x1312) is several times as fast."
                .into(),
        );
        steps.push(
            "Load any flight, and run: dtd doctor --sim 127.0.0.1:49000. It examines the connection point by point and says what to mend."
                .into(),
        );
        steps.push("Then: dtd generate SWEEP.toml --out CORPUS --sim 127.0.0.1:49000".into());
        steps
    }
}

/// Version of XPPython3 known to work with an X-Plane.
fn wanted(xplane: &Version) -> &'static str {
    match xplane.major() {
        11 => "3.1.5",
        _ => "4.7 or newer",
    }
}

/// True if X-Plane finds a plugin there: a file `*.xpl` in a platform's folder, e.g. `lin_x64`.
fn holds_a_plugin(folder: &Path) -> bool {
    let files_in = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
    files_in(folder)
        .flat_map(|platform| files_in(&platform.path()))
        .any(|file| file.path().extension() == Some("xpl".as_ref()))
}

/// Number of first log lines that may contain the version.
const LOG_LINES: usize = 10;
/// Limit for logs, into which plugins may write a lot during a long session.
const MAX_LOG_BYTES: u64 = 1 << 30;

/// Finds the version after these words in the first log lines.
fn version_in(log: &Path, words: &str) -> Option<Version> {
    let bytes = outside_file::read(log, FileKind::new("log", MAX_LOG_BYTES)).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let found = text
        .lines()
        .take(LOG_LINES)
        .find_map(|line| line.split_once(words));
    found.and_then(|(_, behind)| Version::at_start_of(behind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read_and_compared_number_by_number() {
        let version = |text: &str| Version::at_start_of(text).unwrap();
        assert_eq!(
            version("12.4.0-r2-9b69b91a (build 124210)").to_string(),
            "12.4.0"
        );
        assert_eq!(version("11.55r2 (build 115502)").to_string(), "11.55");
        assert_eq!(version("4.0.0 - for Python 3.11").to_string(), "4.0.0");
        assert!(version("11.9.1") < version("11.52") && version("4.10") > version("4.7.3"));
        for none in ["", "twelve", "12", ".", "r2"] {
            assert_eq!(Version::at_start_of(none), None, "{none}");
        }
    }
}
