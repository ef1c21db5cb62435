//! Mutations of bytes and of lines: damage by a bad disk, a bad editor or an attacker.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use super::json::pick;

/// Words that are not names, not paths within a folder, and unsafe to print.
pub(super) const STRANGE_WORDS: [&str; 9] = [
    "",
    "../../outside",
    "/etc/hostname",
    "a\u{0}b",
    "\u{1b}[31mred\u{1b}[0m\r\n",
    "NaN",
    "%s%n{}",
    "\u{202e}desrever",
    "1700-foggy-r9999999999999999999999",
];

/// Values for the right side of a `key = ` of TOML.
const STRANGE_TOML: [&str; 26] = [
    "-1",
    "0",
    "1",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e9",
    "20000",
    "4294967296",
    "1000000000",
    "9223372036854775807",
    "\"\"",
    "\"../../outside\"",
    "\"\\u001b[31mred\"",
    "[]",
    "[0]",
    "{}",
    "true",
    "1979-05-27",
    "\"1/4294967295\"",
    "\"4294967295/1\"",
    "\"0/0\"",
    "{ mean = 0, sd = inf }",
    "{ min = 1e308, max = -1e308 }",
];

/// Changes bytes anywhere. Returns the change.
pub(super) fn mutate(bytes: &[u8], random: &mut ChaCha12Rng) -> (Vec<u8>, String) {
    let mut bytes = bytes.to_vec();
    let at = random.random_range(0..=bytes.len());
    match random.random_range(0..8) {
        0 => {
            bytes.truncate(at);
            (bytes, format!("ends after {at} bytes"))
        }
        1 if at < bytes.len() => {
            bytes[at] ^= 1 << random.random_range(0..8);
            (bytes, format!("a bit of byte {at} is turned"))
        }
        2 => {
            let garbage: Vec<u8> = (0..random.random_range(1..64))
                .map(|_| random.random_range(0..=255))
                .collect();
            let what = format!("{} bytes of noise at {at}", garbage.len());
            bytes.splice(at..at, garbage);
            (bytes, what)
        }
        3 => {
            let end = (at + random.random_range(1..256)).min(bytes.len());
            bytes.drain(at..end);
            (bytes, format!("bytes {at} to {end} are gone"))
        }
        4 => {
            let end = (at + 16).min(bytes.len());
            bytes[at..end].fill(0xff);
            (bytes, format!("bytes {at} to {end} are 0xff"))
        }
        5 => (Vec::new(), "is empty".into()),
        6 => {
            let whole = bytes.clone();
            bytes.extend(whole);
            (bytes, "is there twice".into())
        }
        _ => {
            let word = *pick(&["null", "[]", "{}", "\u{feff}", "\u{0}", "[["], random);
            let whole = random.random_bool(0.5);
            if whole {
                bytes.clear();
            }
            bytes.splice(0..0, word.bytes());
            (
                bytes,
                format!(
                    "{word:?} {}",
                    if whole { "in its place" } else { "before it" }
                ),
            )
        }
    }
}

/// Changes a TOML file's line.
pub(super) fn mutate_toml(bytes: &[u8], random: &mut ChaCha12Rng) -> (Vec<u8>, String) {
    let text = String::from_utf8_lossy(bytes);
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let settings: Vec<usize> = (0..lines.len())
        .filter(|line| lines[*line].contains(" = "))
        .collect();
    if settings.is_empty() || random.random_bool(0.1) {
        return mutate(bytes, random);
    }
    let line = *pick(&settings, random);
    let what = match random.random_range(0..10) {
        0 => format!("without {:?}", lines.remove(line)),
        1 => {
            let again = lines[line].clone();
            lines.insert(line, again);
            format!("{:?} twice", lines[line])
        }
        2 => {
            let depth = *pick(&[100, 10_000], random);
            let key = lines[line].split(" = ").next().unwrap().to_owned();
            lines[line] = format!("{key} = {}{}", "[".repeat(depth), "]".repeat(depth));
            format!("{key} = {depth} arrays in one another")
        }
        _ => {
            let key = lines[line].split(" = ").next().unwrap().to_owned();
            lines[line] = format!("{key} = {}", pick(&STRANGE_TOML, random));
            format!("{:?}", lines[line])
        }
    };
    (lines.join("\n").into_bytes(), what)
}

/// Changes a CSV file's cell, line or heading.
pub(super) fn mutate_csv(bytes: &[u8], random: &mut ChaCha12Rng) -> (Vec<u8>, String) {
    let text = String::from_utf8_lossy(bytes);
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    if random.random_bool(0.1) {
        return mutate(bytes, random);
    }
    let line = random.random_range(0..lines.len());
    let what = match random.random_range(0..10) {
        0 => format!("without line {line}: {:?}", lines.remove(line)),
        1 => {
            let other = random.random_range(0..lines.len());
            lines.swap(line, other);
            format!("lines {line} and {other} change places")
        }
        _ => {
            let mut cells: Vec<&str> = lines[line].split(',').collect();
            let column = random.random_range(0..cells.len());
            cells[column] = *pick(
                &[
                    "NaN",
                    "inf",
                    "-inf",
                    "1e308",
                    "-1e17",
                    "",
                    "x",
                    "-5",
                    "179",
                    "91",
                    "1e400",
                    "0x10",
                    "\"",
                    "\u{1b}[31m",
                ],
                random,
            );
            let what = format!("line {line}, column {column} = {:?}", cells[column]);
            lines[line] = cells.join(",");
            what
        }
    };
    (lines.join("\n").into_bytes(), what)
}
