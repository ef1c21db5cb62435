//! Available memory, checked before large allocations.
//!
//! A count in a file or in a setting may require more memory than a machine has; then the kernel or the allocator ends the process without
//! an explanation. So code that allocates by untrusted numbers first states the amount.

use std::fmt;
use std::fs;
use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::process::{Resource, getrlimit};

const KIB: u64 = 1 << 10;
const GIB: u64 = 1 << 30;
/// Memory that a process needs besides the estimate: code, stacks, buffers of codecs. Smaller needs are never rejected.
const SMALL_BYTES: u64 = 1 << 20;

/// The limit that `--max-memory` sets for the whole process; unlimited by default.
static LIMIT: AtomicU64 = AtomicU64::new(u64::MAX);

/// A number of bytes in human notation: `2G`, `512M`, `1.5GiB`, `100000000`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bytes(pub u64);

/// A text that is not a number of bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not an amount of memory; expected a number with K, M, G or T, e.g. 2G")]
pub struct BadBytes(String);

impl FromStr for Bytes {
    type Err = BadBytes;

    fn from_str(text: &str) -> Result<Self, BadBytes> {
        let bad = || BadBytes(text.to_owned());
        let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let factor = match text[digits.len()..].to_ascii_uppercase().as_str() {
            "" | "B" => 1.0,
            "K" | "KIB" => 1024.0,
            "M" | "MIB" => 1024.0 * 1024.0,
            "G" | "GIB" => GIB as f64,
            "T" | "TIB" => GIB as f64 * 1024.0,
            _ => return Err(bad()),
        };
        let bytes = digits.trim().parse::<f64>().map_err(|_| bad())? * factor;
        // The least that the process uses before it does any work.
        if bytes.is_finite() && (1.0..1e18).contains(&bytes) {
            Ok(Self(bytes as u64))
        } else {
            Err(bad())
        }
    }
}

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mut size, mut units) = (self.0 as f64, ["B", "KiB", "MiB", "GiB", "TiB"].iter());
        let mut unit = units.next().unwrap_or(&"B");
        while size >= 1024.0 {
            match units.next() {
                Some(larger) => (size, unit) = (size / 1024.0, larger),
                None => break,
            }
        }
        match *unit {
            "B" => write!(f, "{size} B"),
            unit => write!(f, "{size:.1} {unit}"),
        }
    }
}

/// Something that does not fit into memory.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} needs about {needed} of memory; there are {available} ({limited_by})")]
pub struct TooMuchMemory {
    /// Description of the data.
    pub what: String,
    /// Estimated need.
    pub needed: Bytes,
    /// Available memory.
    pub available: Bytes,
    /// The limit that applies.
    pub limited_by: &'static str,
}

/// Memory that is available to this process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// Amount.
    pub bytes: u64,
    /// The limit that applies.
    pub limited_by: &'static str,
}

/// Sets how much memory the process may use for its data.
pub fn set_limit(limit: Bytes) {
    LIMIT.store(limit.0, Ordering::Relaxed);
}

/// Rejects what needs more memory than available.
///
/// # Errors
/// Not enough memory, with both figures.
pub fn check(what: impl fmt::Display, needed_bytes: u64) -> Result<(), TooMuchMemory> {
    if needed_bytes <= SMALL_BYTES {
        return Ok(());
    }
    let Available { bytes, limited_by } = available();
    if needed_bytes <= bytes {
        return Ok(());
    }
    Err(TooMuchMemory {
        what: what.to_string(),
        needed: Bytes(needed_bytes),
        available: Bytes(bytes),
        limited_by,
    })
}

/// The minimum that the machine, the container, `ulimit -v` and `--max-memory` leave.
pub fn available() -> Available {
    let used = Used::now();
    let limit = match LIMIT.load(Ordering::Relaxed) {
        u64::MAX => None,
        limit => Some(limit.saturating_sub(used.resident_bytes)),
    };
    let address_space = getrlimit(Resource::As).current;
    [
        (limit, "by --max-memory"),
        (
            address_space.map(|most| most.saturating_sub(used.virtual_bytes)),
            "by `ulimit -v`",
        ),
        (container_bytes(), "by the container's limit"),
        (machine_bytes(), "free on this machine"),
    ]
    .into_iter()
    .filter_map(|(bytes, limited_by)| {
        Some(Available {
            bytes: bytes?,
            limited_by,
        })
    })
    .min_by_key(|available| available.bytes)
    .unwrap_or(Available {
        bytes: u64::MAX,
        limited_by: "nobody knows",
    })
}

/// The current memory use of this process.
#[derive(Default)]
struct Used {
    virtual_bytes: u64,
    resident_bytes: u64,
}

impl Used {
    fn now() -> Self {
        let pages = fs::read_to_string("/proc/self/statm").unwrap_or_default();
        let mut pages = pages
            .split_ascii_whitespace()
            .map(|n| n.parse().unwrap_or(0));
        let mut next = || pages.next().unwrap_or(0) * rustix::param::page_size() as u64;
        Self {
            virtual_bytes: next(),
            resident_bytes: next(),
        }
    }
}

/// Linux's own estimate of available memory without swapping.
fn machine_bytes() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kib: u64 = line.trim().strip_suffix(" kB")?.trim().parse().ok()?;
    Some(kib * KIB)
}

/// Memory that the control group of this process has left; page cache counts as free.
fn container_bytes() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    let group = groups.lines().find_map(|line| line.strip_prefix("0::"))?;
    let mut least = None;
    // The limit of every parent group applies as well.
    for folder in std::path::Path::new(group.trim_start_matches('/')).ancestors() {
        let folder = std::path::Path::new("/sys/fs/cgroup").join(folder);
        let number = |name: &str| -> Option<u64> {
            fs::read_to_string(folder.join(name))
                .ok()?
                .trim()
                .parse()
                .ok()
        };
        let (Some(most), Some(current)) = (number("memory.max"), number("memory.current")) else {
            continue;
        };
        let stat = fs::read_to_string(folder.join("memory.stat")).unwrap_or_default();
        let cached: u64 = stat
            .lines()
            .filter_map(|line| line.strip_prefix("inactive_file ")?.parse::<u64>().ok())
            .sum();
        let left = most.saturating_sub(current.saturating_sub(cached));
        least = Some(least.map_or(left, |least: u64| least.min(left)));
    }
    least
}

/// Runs something under a different limit. Tests run in parallel, so only rejections may rely on it.
#[cfg(test)]
pub(crate) fn with_limit<T>(limit: Bytes, work: impl FnOnce() -> T) -> T {
    static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _alone = ALONE.lock();
    set_limit(limit);
    let done = work();
    LIMIT.store(u64::MAX, Ordering::Relaxed);
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_are_read_as_people_write_them() {
        for (text, bytes) in [
            ("1000", 1_000),
            ("64K", 64 << 10),
            ("512M", 512 << 20),
            ("1.5GiB", 3 << 29),
            ("2 T", 2 << 40),
        ] {
            assert_eq!(text.parse(), Ok(Bytes(bytes)), "{text}");
        }
        for text in ["", "G", "-1G", "0", "1e400", "2X", "nan", "inf"] {
            assert!(text.parse::<Bytes>().is_err(), "{text}");
        }
        assert_eq!(Bytes(3 << 29).to_string(), "1.5 GiB");
    }

    #[test]
    fn what_no_machine_has_is_refused_with_both_figures() {
        check("a table", 10 << 20).unwrap();
        let message = check("a table of stars", 1 << 60).unwrap_err().to_string();
        assert!(
            message.starts_with("a table of stars needs about 1048576.0 TiB of memory; there are "),
            "{message}"
        );
    }
}
