//! Tables of the settings that a JSON Schema describes: a section per TOML table, required keys first.

use std::ptr;

use serde_json::{Map, Value};

use super::markdown::{item, paragraph, table};

/// Numbers from this size on are written with separators of thousands.
const LONG: f64 = 1_000.0;

/// The tables of a settings file.
pub(super) fn sections(schema: &Value) -> String {
    let mut tables = Tables {
        schema,
        found: Vec::new(),
    };
    tables.add(String::new(), "", schema, "");
    let text = tables.found.iter().map(|found| found.text(schema));
    required_tables(schema) + &text.collect::<String>()
}

fn required_tables(schema: &Value) -> String {
    let required = required(schema);
    if required.is_empty() {
        return String::new();
    }
    let names: Vec<_> = required.iter().map(|name| format!("`{name}`")).collect();
    paragraph(&format!("Required tables: {}.", names.join(", ")))
}

/// A TOML table.
struct Found<'a> {
    /// Its place in the file: `[weather.NAME]`.
    headings: Vec<String>,
    introduction: String,
    table: &'a Value,
}

struct Tables<'a> {
    schema: &'a Value,
    found: Vec<Found<'a>>,
}

impl<'a> Tables<'a> {
    /// Adds a table and those in it. `introduction` belongs to the tables above it that have no keys of their own.
    fn add(&mut self, heading: String, path: &str, table: &'a Value, introduction: &str) {
        if let Some(found) = self
            .found
            .iter_mut()
            .find(|found| ptr::eq(found.table, table))
        {
            found.headings.push(heading);
            return;
        }
        let own = without_path(description(table));
        let is_in_map = path.contains(char::is_uppercase);
        let introduction = if path.is_empty() {
            String::new()
        } else if own.is_empty() || is_in_map {
            format!("{introduction} {own}")
        } else {
            own
        };
        let has_keys = properties(table).any(|(_, value)| row_of(value, self.schema))
            || variants(table).is_some();
        if has_keys {
            self.found.push(Found {
                headings: vec![heading],
                introduction: introduction.clone(),
                table,
            });
        }
        let carried = if has_keys { "" } else { &introduction };
        for (key, value) in required_first(table) {
            let path = [path, key].join(if path.is_empty() { "" } else { "." });
            self.add_value(&path, value, &format!("{carried} {}", description(value)));
        }
    }

    fn add_value(&mut self, path: &str, value: &'a Value, introduction: &str) {
        let value = resolved(value, self.schema);
        if let Some(each) = value
            .get("additionalProperties")
            .filter(|each| each.is_object())
        {
            let name = if path == "airport" { "ICAO" } else { "NAME" };
            self.add_value(&format!("{path}.{name}"), each, introduction);
        } else if let Some(each) = value
            .get("items")
            .map(|items| resolved(items, self.schema))
            .filter(|each| is_table(each))
        {
            self.add(format!("[[{path}]]"), path, each, introduction);
        } else if is_table(value) {
            self.add(format!("[{path}]"), path, value, introduction);
        }
    }
}

impl Found<'_> {
    fn text(&self, schema: &Value) -> String {
        let mut text = String::new();
        if !self.headings[0].is_empty() {
            let names: Vec<_> = self
                .headings
                .iter()
                .map(|name| format!("`{name}`"))
                .collect();
            text += &format!("## {}\n\n", names.join(", "));
            if !self.introduction.trim().is_empty() {
                text += &paragraph(&self.introduction);
            }
        }
        match variants(self.table) {
            None => text + &keys(self.table, schema),
            Some(variants) => {
                for variant in variants {
                    let (key, name) = properties(variant)
                        .find_map(|(key, value)| Some((key, value.get("const")?)))
                        .unwrap();
                    text += &paragraph(&format!("`{key} = {name}`: {}", description(variant)));
                    text += &keys(variant, schema);
                }
                text
            }
        }
    }
}

/// A table's keys.
fn keys(table_schema: &Value, schema: &Value) -> String {
    let required = required(table_schema);
    let shown: Vec<_> = required_first(table_schema)
        .into_iter()
        .filter(|(_, value)| row_of(value, schema))
        .collect();
    let rows: Vec<_> = shown
        .iter()
        .map(|(key, value)| {
            let default = match value.get("default") {
                _ if required.contains(key) => "required".into(),
                None => String::new(),
                Some(default) => format!("`{}`", toml(default)),
            };
            let default = if default == "`none`" || default == "`[]`" {
                "none".into()
            } else {
                default
            };
            [
                format!("`{key}`"),
                type_of(value, schema),
                default,
                limits_of(value, schema),
                description(value).to_owned(),
            ]
        })
        .collect();
    let values: String = shown
        .iter()
        .map(|(key, value)| described_values(key, value, schema))
        .collect();
    table(["key", "type", "default", "limits", "meaning"], &rows) + &values
}

/// The words that a key or column may have, if each has a description.
pub(super) fn described_values(key: &str, value: &Value, schema: &Value) -> String {
    let Some(words) = resolved(value, schema)["oneOf"].as_array() else {
        return String::new();
    };
    let words: Vec<String> = words
        .iter()
        .map(|word| resolved(word, schema))
        .flat_map(|word| {
            let errors = word
                .pointer("/properties/Err")
                .map(|error| resolved(error, schema));
            let inner = errors.and_then(|errors| errors["oneOf"].as_array());
            inner.map_or(vec![word], |words| words.iter().collect())
        })
        .filter_map(|word| {
            let name = match word.get("const") {
                Some(name) => name.as_str()?,
                None => word["required"].as_array()?.first()?.as_str()?,
            };
            (!description(word).is_empty())
                .then(|| item(&format!("`{name}`: {}", description(word))))
        })
        .collect();
    if words.is_empty() {
        return String::new();
    }
    format!("Values of `{key}`:\n\n{}\n", words.concat())
}

fn required(schema: &Value) -> Vec<&str> {
    let keys = schema["required"].as_array().into_iter().flatten();
    keys.filter_map(Value::as_str).collect()
}

fn description(schema: &Value) -> &str {
    schema["description"].as_str().unwrap_or_default()
}

/// A description that begins with the table's name, which is in the heading.
fn without_path(description: &str) -> String {
    let Some((_, rest)) = description
        .strip_prefix("`[")
        .and_then(|rest| rest.split_once("]`"))
    else {
        return description.to_owned();
    };
    let rest = rest.trim_start_matches([':', ' ']);
    let mut letters = rest.chars();
    letters.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

fn properties(schema: &Value) -> impl Iterator<Item = (&str, &Value)> {
    let properties = schema["properties"]
        .as_object()
        .into_iter()
        .flat_map(Map::iter);
    properties.map(|(key, value)| (key.as_str(), value))
}

fn required_first(schema: &Value) -> Vec<(&str, &Value)> {
    let required = required(schema);
    let mut sorted: Vec<_> = properties(schema).collect();
    sorted.sort_by_key(|(key, _)| !required.contains(key));
    sorted
}

/// The alternatives of a table that one of its keys distinguishes.
fn variants(schema: &Value) -> Option<&Vec<Value>> {
    let variants = schema["oneOf"].as_array()?;
    let has_kind = |variant| properties(variant).any(|(_, value)| value.get("const").is_some());
    variants.iter().all(has_kind).then_some(variants)
}

fn is_table(schema: &Value) -> bool {
    properties(schema).next().is_some() || variants(schema).is_some()
}

/// What a schema refers to; an optional value is the value.
fn resolved<'a>(value: &'a Value, schema: &'a Value) -> &'a Value {
    let null = |part: &&Value| part["type"] != "null";
    let inner = if let Some(reference) = value["$ref"].as_str() {
        schema.pointer(&reference[1..])
    } else if let Some([part]) = value["allOf"].as_array().map(Vec::as_slice) {
        Some(part)
    } else {
        let parts = value["anyOf"].as_array();
        let parts: Vec<&Value> = parts.into_iter().flatten().filter(null).collect();
        <[&Value; 1]>::try_from(parts).ok().map(|[part]| part)
    };
    inner.map_or(value, |inner| resolved(inner, schema))
}

/// Whether a value is a line of its table: not if it is a table with defaults, which has a section.
fn row_of(value: &Value, schema: &Value) -> bool {
    let inner = resolved(value, schema);
    let is_kind = inner.get("const").is_some();
    let is_map = inner
        .get("additionalProperties")
        .is_some_and(Value::is_object);
    let in_list = inner
        .get("items")
        .is_some_and(|items| is_table(resolved(items, schema)));
    let has_default = value.get("default").is_some() && inner["required"].is_array();
    !is_kind && !is_map && !in_list && (!is_table(inner) || has_default)
}

fn type_of(value: &Value, schema: &Value) -> String {
    let value = resolved(value, schema);
    let words = |values: &Vec<Value>| {
        let words: Vec<_> = values.iter().map(|word| format!("`{word}`")).collect();
        words.join(", ")
    };
    if let Some(values) = value["enum"].as_array() {
        return words(values);
    }
    if let Some(parts) = value["anyOf"].as_array() {
        if is_spread(value) {
            return "number or [spread](../sweeps.md#spreads)".into();
        }
        let mut types: Vec<_> = parts.iter().map(|part| type_of(part, schema)).collect();
        types.dedup();
        return types.join(" or ");
    }
    if let Some(parts) = value["oneOf"].as_array() {
        let constants: Vec<Value> = parts
            .iter()
            .filter_map(|part| part.get("const").cloned())
            .collect();
        if !constants.is_empty() {
            return words(&constants);
        }
        let tables = parts.iter().flat_map(properties);
        let tables =
            tables.map(|(key, value)| format!("`{{ {key} = {} }}`", type_of(value, schema)));
        return tables.collect::<Vec<_>>().join(" or ");
    }
    let name = match &value["type"] {
        Value::Array(types) => types.iter().find(|name| *name != "null").unwrap(),
        name => name,
    };
    match name.as_str().unwrap_or_default() {
        "array" => {
            let each = type_of(&value["items"], schema);
            let plain = ["integer", "number", "string"].contains(&each.as_str());
            let each = if plain {
                format!("{each}s")
            } else {
                format!("({each})")
            };
            match value["minItems"]
                .as_u64()
                .filter(|least| value["maxItems"] == *least)
            {
                Some(length) => format!("array of {length} {each}"),
                None => format!("array of {each}"),
            }
        }
        "object" => "table".into(),
        name => name.to_owned(),
    }
}

fn is_spread(value: &Value) -> bool {
    let mut forms = value["anyOf"].as_array().into_iter().flatten();
    forms.any(|form| form.pointer("/properties/one_of").is_some())
}

fn limits_of(value: &Value, schema: &Value) -> String {
    let value = resolved(value, schema);
    // A spread's limits are the limits of its first form, a number.
    let first = value.pointer("/anyOf/0").filter(|_| is_spread(value));
    let part = first.or(value.get("items")).unwrap_or(value);
    let number = |key: &str| part[key].as_f64();
    let least = number("minimum").filter(|least| *least != 0.0 || part.get("maximum").is_some());
    limits(least, number("maximum"))
}

/// A range.
pub(super) fn limits(least: Option<f64>, most: Option<f64>) -> String {
    match (least.map(number), most.map(number)) {
        (Some(least), Some(most)) => format!("{least} to {most}"),
        (Some(least), None) => format!("from {least}"),
        (None, Some(most)) => format!("to {most}"),
        (None, None) => String::new(),
    }
}

fn number(value: f64) -> String {
    let digits = value.abs().to_string();
    if value.abs() < LONG || value.fract() != 0.0 {
        return value.to_string();
    }
    let groups: Vec<String> = digits
        .as_bytes()
        .rchunks(3)
        .rev()
        .map(|group| String::from_utf8_lossy(group).into_owned())
        .collect();
    format!("{}{}", if value < 0.0 { "-" } else { "" }, groups.join(","))
}

/// A default as TOML has it.
fn toml(value: &Value) -> String {
    match value {
        Value::Null => "none".into(),
        Value::Array(values) => {
            let values: Vec<_> = values.iter().map(toml).collect();
            format!("[{}]", values.join(", "))
        }
        Value::Object(keys) => {
            let keys: Vec<_> = keys
                .iter()
                .map(|(key, value)| format!("{key} = {}", toml(value)))
                .collect();
            format!("{{ {} }}", keys.join(", "))
        }
        // 0.3 in single precision is 0.30000001192092896 in double precision, and feet are not whole metres.
        Value::Number(number) => match number.as_f64().filter(|_| number.is_f64()) {
            Some(double) if f64::from(double as f32) == double => format!("{:?}", double as f32),
            Some(double) => format!("{:?}", (double * 1e9).round() / 1e9),
            None => number.to_string(),
        },
        other => other.to_string(),
    }
}
