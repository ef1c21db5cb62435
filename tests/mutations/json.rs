//! Mutations of JSON: of the values in it, and of the text.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;
use serde_json::{Value, json};

use super::text;

/// Changes one value of a document, or its text. Returns the change.
pub(super) fn mutate(bytes: &[u8], random: &mut ChaCha12Rng) -> (Vec<u8>, String) {
    let Ok(mut document) = serde_json::from_slice::<Value>(bytes) else {
        return text::mutate(bytes, random);
    };
    match random.random_range(0..10) {
        0 => text::mutate(bytes, random),
        1 => nested(&mut document, random),
        _ => {
            let what = value(&mut document, random);
            (serde_json::to_vec_pretty(&document).unwrap(), what)
        }
    }
}

/// Changes a value somewhere in the document.
fn value(document: &mut Value, random: &mut ChaCha12Rng) -> String {
    let place = some_place(document, random);
    let strange = strange_value(document.pointer(&place).unwrap(), random);
    let (parent, key) = place.rsplit_once('/').unwrap_or(("", ""));
    let container = if place.is_empty() {
        None
    } else {
        document.pointer_mut(parent)
    };
    match (random.random_range(0..6), container) {
        (0, Some(Value::Object(object))) => {
            object.remove(&unescaped(key));
            format!("{place} is removed")
        }
        (1, Some(Value::Object(object))) => {
            object.insert("unheard_of".into(), strange.clone());
            format!("{parent}/unheard_of = {} is added", shown(&strange))
        }
        (0 | 1, Some(Value::Array(array))) => {
            let index: usize = key.parse().unwrap();
            let element = array.remove(index);
            if random.random_bool(0.5) {
                return format!("{place} is removed");
            }
            let times = *pick(&[2, 3, 5_000], random);
            array.extend(std::iter::repeat_n(element, times));
            format!("{place} is there {times} times")
        }
        _ => {
            let what = format!("{place} = {}", shown(&strange));
            *document.pointer_mut(&place).unwrap() = strange;
            what
        }
    }
}

/// Arrays in arrays, deeper than a parser may follow.
fn nested(document: &mut Value, random: &mut ChaCha12Rng) -> (Vec<u8>, String) {
    let place = some_place(document, random);
    let mark = "a mark that is nowhere else";
    *document.pointer_mut(&place).unwrap() = mark.into();
    let depth = *pick(&[100, 200, 100_000], random);
    let deep = format!("{}{}", "[".repeat(depth), "]".repeat(depth));
    let text = document.to_string().replace(&format!("\"{mark}\""), &deep);
    (
        text.into_bytes(),
        format!("{place} = {depth} arrays in one another"),
    )
}

fn strange_value(old: &Value, random: &mut ChaCha12Rng) -> Value {
    let numbers = [
        json!(-1),
        json!(0),
        json!(1e308),
        json!(-1e308),
        json!(1e17),
        json!(5e-324),
        json!(-0.5),
        json!(179.0),
        json!(4_294_967_296_u64),
        json!(9_007_199_254_740_993_u64),
        json!(u64::MAX),
        json!(i64::MIN),
        json!(1_000_000_000),
    ];
    match (random.random_range(0..10), old) {
        (0..6, Value::Number(number)) => match random.random_range(0..4) {
            // Near the original, within all limits.
            0 => json!(number.as_f64().unwrap_or(1.0) * 0.5),
            1 => number
                .as_i64()
                .map_or(json!(1e9), |number| json!(number.wrapping_add(1))),
            _ => pick(&numbers, random).clone(),
        },
        (0..4, Value::String(text)) if text.len() > 1 => {
            // A hash's digit, a name's letter.
            let mut letters: Vec<char> = text.chars().collect();
            let at = random.random_range(0..letters.len());
            letters[at] = if letters[at] == '0' { '1' } else { '0' };
            json!(letters.into_iter().collect::<String>())
        }
        (0..8, Value::String(_)) => json!(pick(&text::STRANGE_WORDS, random)),
        (8, _) => json!("x".repeat(1 << 20)),
        _ => pick(
            &[
                Value::Null,
                json!(true),
                json!([]),
                json!({}),
                json!("NaN"),
                json!([null]),
                json!({"": 0}),
                json!(-1),
                json!(1e300),
            ],
            random,
        )
        .clone(),
    }
}

/// Any value of the document, containers included, as a JSON pointer. Descends from the top, so that long lists do not hide their
/// neighbours.
fn some_place(document: &Value, random: &mut ChaCha12Rng) -> String {
    let (mut place, mut here) = (String::new(), document);
    loop {
        let below: Vec<(String, &Value)> = match here {
            Value::Object(object) => object
                .iter()
                .map(|(key, value)| (escaped(key), value))
                .collect(),
            Value::Array(array) => array
                .iter()
                .enumerate()
                .map(|(index, value)| (index.to_string(), value))
                .collect(),
            _ => Vec::new(),
        };
        if below.is_empty() || !place.is_empty() && random.random_bool(0.1) {
            return place;
        }
        let (key, next) = pick(&below, random);
        place = format!("{place}/{key}");
        here = next;
    }
}

fn escaped(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

fn unescaped(key: &str) -> String {
    key.replace("~1", "/").replace("~0", "~")
}

fn shown(value: &Value) -> String {
    let text = value.to_string();
    match text.len() {
        0..80 => text,
        length => format!("{length} bytes of JSON"),
    }
}

pub(super) fn pick<'a, T>(all: &'a [T], random: &mut ChaCha12Rng) -> &'a T {
    &all[random.random_range(0..all.len())]
}
