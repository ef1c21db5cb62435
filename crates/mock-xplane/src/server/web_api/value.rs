//! Values of datarefs as JSON: numbers, lists of numbers, and texts in base 64.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use serde_json::{Value, json};

use super::super::world::World;
use super::refusal::Refusal;
use crate::datarefs::{Dataref, Ignored, Kind};

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

/// An element of a dataref, if it exists.
pub(super) fn element(dataref: &Dataref, values: &[f64], index: usize) -> Option<Value> {
    values.get(index).map(|&value| number(dataref.kind, value))
}

/// Sets a dataref for a client: a number, a list element, or a whole list.
pub(super) fn write(
    world: &mut World,
    name: &'static str,
    index: Option<usize>,
    value: &Value,
) -> Result<(), Refusal> {
    let Some((&dataref, values)) = world.datarefs().find(name) else {
        return Err(Refusal::not_found("invalid_dataref_id", "no such dataref"));
    };
    if !dataref.writable {
        return Err(Refusal::forbidden(
            "dataref_is_readonly",
            format!("{name} is read-only"),
        ));
    }
    let writes: Vec<(String, f64)> = match (value, index, dataref.length) {
        (Value::Number(number), None, None) => vec![(name.into(), float(number))],
        (Value::Number(number), Some(index), Some(_)) => {
            vec![(format!("{name}[{index}]"), float(number))]
        }
        (Value::Array(list), None, Some(_)) if list.len() <= values.len() => list
            .iter()
            .enumerate()
            .map(|(at, element)| match element {
                Value::Number(number) => Ok((format!("{name}[{at}]"), float(number))),
                other => Err(mistyped(&dataref, other)),
            })
            .collect::<Result<_, _>>()?,
        (other, ..) => return Err(mistyped(&dataref, other)),
    };
    for (path, value) in writes {
        world
            .write_exact(&path, value)
            .map_err(|reason| match reason {
                Ignored::BadIndex => {
                    Refusal::bad_request("invalid_index", format!("{path}: {reason}"))
                }
                reason => Refusal::bad_request("invalid_value", format!("{path}: {reason}")),
            })?;
    }
    Ok(())
}

fn float(number: &serde_json::Number) -> f64 {
    number.as_f64().unwrap_or(f64::NAN)
}

fn mistyped(dataref: &Dataref, found: &Value) -> Refusal {
    let (name, expected) = (dataref.name, type_word(dataref));
    Refusal::bad_request(
        "invalid_value",
        format!("{name} is of type {expected} and cannot take {found} like this"),
    )
}
