//! Values of datarefs as JSON: numbers, lists of numbers, and texts in base 64.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

use crate::datarefs::{Dataref, Kind};

/// X-Plane's name for a dataref's type.
pub(super) fn type_word(dataref: &Dataref) -> &'static str {
    match (dataref.kind, dataref.length) {
        (Kind::Int, None) => "int",
        (Kind::Int, Some(_)) => "int_array",
        (Kind::Float, None) => "float",
        (Kind::Double, None) => "double",
        (Kind::Float | Kind::Double, Some(_)) => "float_array",
        (Kind::Byte, _) => "data",
    }
}

fn number(kind: Kind, value: f64) -> Value {
    match kind {
        Kind::Int | Kind::Byte => json!(value as i64),
        Kind::Float | Kind::Double => json!(value),
    }
}

pub(super) fn whole(dataref: &Dataref, values: &[f64]) -> Value {
    match dataref.kind {
        Kind::Byte => {
            let text: Vec<u8> = values
                .iter()
                .map(|&value| value as u8)
                .take_while(|&byte| byte != 0)
                .collect();
            json!(BASE64_STANDARD.encode(text))
        }
        kind if dataref.length.is_some() => {
            values.iter().map(|&value| number(kind, value)).collect()
        }
        kind => values
            .first()
            .map_or(Value::Null, |&value| number(kind, value)),
    }
}
