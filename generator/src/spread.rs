//! A number, or a spread to draw from per scenario.

use std::fmt;

use rand::Rng;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer};

use crate::seed;

/// Variation between scenarios.
#[derive(Debug, Clone, PartialEq)]
pub enum Spread {
    /// Constant: `10.0`.
    Fixed(f64),
    /// Uniform: `{ min = 9.9, max = 10.1 }`.
    Uniform {
        /// Least value.
        min: f64,
        /// Greatest value.
        max: f64,
    },
    /// Normal, truncated at six standard deviations: `{ mean = 10.0, sd = 0.05 }`; or redrawn until it is within an interval:
    /// `{ mean = 0.9, sd = 0.1, min = 0.5, max = 1 }`.
    Normal {
        /// Mean; within the interval.
        mean: f64,
        /// Standard deviation of the untruncated distribution.
        sd: f64,
        /// Least value; infinite without an interval.
        min: f64,
        /// Greatest value; infinite without an interval.
        max: f64,
    },
    /// Choice between values, all equally likely: `{ one_of = [5, 7.5, 10] }`.
    OneOf(Vec<f64>),
}

impl Default for Spread {
    fn default() -> Self {
        Self::Fixed(0.0)
    }
}

/// Minimum width of truncated normal distributions, standard deviations: a narrower one is almost uniform anyway, and would be hit too
/// seldom.
const NARROWEST_TRUNCATION_SD: f64 = 0.1;

impl Spread {
    /// Key of the standard deviation: the only number exempt from the value's limits.
    pub(crate) const DEVIATION: &str = "sd";

    /// Draws a scenario's value by name from a generator of its own, so that no value depends on which others are drawn.
    pub(crate) fn value(&self, scenario_seed: u64, name: &str) -> f64 {
        self.draw(&mut seed::of_value(scenario_seed, name))
    }

    /// Draws a value. Uses only additions and multiplications: functions of the system's mathematics library differ in their last
    /// digit between machines, and the same seed must give the same plan everywhere.
    pub fn draw(&self, rng: &mut impl Rng) -> f64 {
        match self {
            Self::Fixed(value) => *value,
            Self::Uniform { min, max } => min + (max - min) * unit(rng),
            Self::Normal { mean, sd, min, max } => loop {
                // The mean is within, and the interval is no narrower than 0.1 standard deviations: at worst one in 26 draws is accepted.
                let value = mean + sd * bell(rng);
                if (*min..=*max).contains(&value) {
                    return value;
                }
            },
            // A plain remainder: its bias is below 1e-18.
            Self::OneOf(values) => values[(rng.next_u64() % values.len() as u64) as usize],
        }
    }

    /// The spread, shifted upwards.
    #[must_use]
    pub(crate) fn higher_by(&self, more: f64) -> Self {
        match self {
            Self::Fixed(value) => Self::Fixed(value + more),
            Self::Uniform { min, max } => Self::Uniform {
                min: min + more,
                max: max + more,
            },
            Self::Normal { mean, sd, min, max } => Self::Normal {
                mean: mean + more,
                sd: *sd,
                min: min + more,
                max: max + more,
            },
            Self::OneOf(values) => Self::OneOf(values.iter().map(|value| value + more).collect()),
        }
    }

    /// The minimum and maximum that can be drawn.
    pub fn range(&self) -> (f64, f64) {
        match self {
            Self::Fixed(value) => (*value, *value),
            Self::Uniform { min, max } => (*min, *max),
            Self::Normal { mean, sd, min, max } => {
                (min.max(mean - 6.0 * sd), max.min(mean + 6.0 * sd))
            }
            Self::OneOf(values) => values.iter().fold(
                (f64::INFINITY, f64::NEG_INFINITY),
                |(least, most), value| (least.min(*value), most.max(*value)),
            ),
        }
    }
}

/// The notation used in a sweep.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(value) => write!(f, "{value}"),
            Self::Uniform { min, max } => write!(f, "{{ min = {min}, max = {max} }}"),
            Self::Normal { mean, sd, min, .. } if min.is_infinite() => {
                write!(f, "{{ mean = {mean}, sd = {sd} }}")
            }
            Self::Normal { mean, sd, min, max } => write!(
                f,
                "{{ mean = {mean}, sd = {sd}, min = {min}, max = {max} }}"
            ),
            Self::OneOf(values) => write!(f, "{{ one_of = {values:?} }}"),
        }
    }
}

/// A number in [0, 1) with 53 random bits.
fn unit(rng: &mut impl Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// A number with mean 0 and variance 1: the sum of twelve uniform draws (Irwin-Hall).
fn bell(rng: &mut impl Rng) -> f64 {
    let sum: f64 = (0..12).map(|_| unit(rng)).sum();
    sum - 6.0
}

const EXPECTED: &str = "a number, { min = .., max = .. }, { mean = .., sd = .. }, { mean = .., sd = .., min = .., max = .. } or { one_of = [..] }";

impl<'de> Deserialize<'de> for Spread {
    fn deserialize<D: Deserializer<'de>>(input: D) -> Result<Self, D::Error> {
        input.deserialize_any(SpreadVisitor)
    }
}

struct SpreadVisitor;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    min: Option<f64>,
    max: Option<f64>,
    mean: Option<f64>,
    sd: Option<f64>,
    one_of: Option<Vec<f64>>,
}

impl Table {
    fn spread(self) -> Result<Spread, String> {
        let Self {
            min,
            max,
            mean,
            sd,
            one_of,
        } = self;
        let numbers = [min, max, mean, sd];
        let mut all = numbers.iter().flatten().chain(one_of.iter().flatten());
        if let Some(wrong) = all.find(|value| !value.is_finite()) {
            return Err(format!("{wrong} is not a usable number"));
        }
        if let (Some(min), Some(max)) = (min, max)
            && min > max
        {
            return Err(format!("min {min} is above max {max}"));
        }
        match (min, max, mean, sd, one_of) {
            (Some(min), Some(max), None, None, None) => Ok(Spread::Uniform { min, max }),
            (None, None, Some(mean), Some(sd), None) if sd >= 0.0 => {
                let [min, max] = [f64::NEG_INFINITY, f64::INFINITY];
                Ok(Spread::Normal { mean, sd, min, max })
            }
            (Some(min), Some(max), Some(mean), Some(sd), None) => {
                if !(sd >= 0.0 && min <= mean && mean <= max) {
                    return Err("expected min <= mean <= max and sd >= 0".into());
                }
                if max - min < NARROWEST_TRUNCATION_SD * sd {
                    return Err(format!(
                        "min and max are less than {NARROWEST_TRUNCATION_SD} sd apart; expected a wider interval, or {{ min = {min}, max = {max} }} without mean and sd: over so little a bell is flat"
                    ));
                }
                Ok(Spread::Normal { mean, sd, min, max })
            }
            (None, None, None, None, Some(values)) if !values.is_empty() => {
                Ok(Spread::OneOf(values))
            }
            _ => Err(format!(
                "expected {EXPECTED}, with sd >= 0 and at least one value"
            )),
        }
    }
}

impl<'de> Visitor<'de> for SpreadVisitor {
    type Value = Spread;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(EXPECTED)
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Spread, E> {
        Ok(Spread::Fixed(value as f64))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Spread, E> {
        Ok(Spread::Fixed(value as f64))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Spread, E> {
        if value.is_finite() {
            Ok(Spread::Fixed(value))
        } else {
            Err(E::custom(format!(
                "{value} is not a usable number; expected {EXPECTED}"
            )))
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Spread, A::Error> {
        Table::deserialize(MapAccessDeserializer::new(map))?
            .spread()
            .map_err(A::Error::custom)
    }
}

impl JsonSchema for Spread {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Spread".into()
    }

    /// Inlined, because every use has its own limits.
    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let number = || json_schema!({ "type": "number" });
        let table = |keys: &[&str]| {
            let properties: serde_json::Map<String, serde_json::Value> = keys
                .iter()
                .map(|key| {
                    let mut value = number();
                    if *key == Self::DEVIATION {
                        value.insert("minimum".into(), 0.into());
                    }
                    ((*key).to_owned(), value.into())
                })
                .collect();
            json_schema!({
                "type": "object",
                "properties": properties,
                "required": keys,
                "additionalProperties": false,
            })
        };
        json_schema!({
            "anyOf": [
                number(),
                table(&["min", "max"]),
                table(&["mean", "sd"]),
                table(&["mean", "sd", "min", "max"]),
                {
                    "type": "object",
                    "properties": {
                        "one_of": { "type": "array", "items": number(), "minItems": 1 },
                    },
                    "required": ["one_of"],
                    "additionalProperties": false,
                },
            ],
        })
    }
}

#[cfg(test)]
mod tests {
    use dataset::numbers::spread::mean_and_deviation;

    use super::*;
    use crate::seed;

    #[derive(Debug, Deserialize)]
    struct Holder {
        value: Spread,
    }

    fn parse(text: &str) -> Result<Spread, String> {
        toml::from_str::<Holder>(&format!("value = {text}"))
            .map(|h| h.value)
            .map_err(|e| e.message().to_owned())
    }

    #[test]
    fn the_five_forms_are_read_and_others_are_explained() {
        assert_eq!(parse("10"), Ok(Spread::Fixed(10.0)));
        assert_eq!(
            parse("{ min = -1, max = 1.5 }"),
            Ok(Spread::Uniform {
                min: -1.0,
                max: 1.5
            })
        );
        assert_eq!(
            parse("{ mean = 10.0, sd = 0.5 }"),
            Ok(Spread::Normal {
                mean: 10.0,
                sd: 0.5,
                min: f64::NEG_INFINITY,
                max: f64::INFINITY
            })
        );
        assert_eq!(
            parse("{ mean = 0.9, sd = 0.1, min = 0.5, max = 1 }"),
            Ok(Spread::Normal {
                mean: 0.9,
                sd: 0.1,
                min: 0.5,
                max: 1.0
            })
        );
        assert_eq!(
            parse("{ one_of = [1, 2.5] }"),
            Ok(Spread::OneOf(vec![1.0, 2.5]))
        );
        for wrong in [
            "{ one_of = [] }",
            "{ one_of = [nan] }",
            "{ one_of = [1], sd = 0 }",
            "{ mean = 2, sd = 1, min = 0, max = 1 }",
            "{ mean = 0, sd = 100, min = 0, max = 1 }",
            "{ min = 0, max = inf }",
            "{ min = 2, max = 1 }",
            "{ mean = 1 }",
            "{ mean = 1, sd = -1 }",
            "{ min = 0, sd = 1 }",
            "nan",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            parse("{ min = 20000, max = 12000 }"),
            Err("min 20000 is above max 12000".into())
        );
        assert!(
            parse("{ min = 0, maximum = 1 }")
                .unwrap_err()
                .contains("unknown field `maximum`")
        );
    }

    #[test]
    fn draws_have_the_asked_mean_and_deviation_and_stay_in_range() {
        let mut rng = seed::generator(7);
        let spread = parse("{ mean = 10, sd = 2 }").unwrap();
        let draws: Vec<f64> = (0..20_000).map(|_| spread.draw(&mut rng)).collect();
        let [mean, sd] = mean_and_deviation(draws.into_iter());
        assert!(
            (mean - 10.0).abs() < 0.05 && (sd - 2.0).abs() < 0.05,
            "mean {mean}, sd {sd}"
        );

        let spread = Spread::Uniform {
            min: -3.0,
            max: 5.0,
        };
        let draws: Vec<f64> = (0..20_000).map(|_| spread.draw(&mut rng)).collect();
        assert!(draws.iter().all(|x| (-3.0..=5.0).contains(x)));
        assert!(draws.iter().any(|x| *x < -2.9) && draws.iter().any(|x| *x > 4.9));
    }

    #[test]
    fn a_truncated_bell_keeps_its_shape_within_its_interval() {
        let mut rng = seed::generator(7);
        let spread = parse("{ mean = 0.9, sd = 0.1, min = 0.6, max = 1 }").unwrap();
        let draws: Vec<f64> = (0..20_000).map(|_| spread.draw(&mut rng)).collect();
        assert!(draws.iter().all(|x| (0.6..=1.0).contains(x)));
        // A standard normal distribution truncated to [-3, 1] has the mean (f(-3) - f(1)) / (F(1) - F(-3)) = -0.2828.
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        assert!((mean - (0.9 - 0.028_28)).abs() < 0.002, "mean {mean}");
        assert_eq!(spread.range(), (0.6, 1.0));
    }

    #[test]
    fn one_of_several_is_drawn_and_each_about_equally_often() {
        let mut rng = seed::generator(7);
        let spread = parse("{ one_of = [3, 1, 2] }").unwrap();
        let draws: Vec<f64> = (0..9_000).map(|_| spread.draw(&mut rng)).collect();
        for value in [1.0, 2.0, 3.0] {
            let share = draws.iter().filter(|x| **x == value).count();
            assert!((2_800..3_200).contains(&share), "{value}: {share}");
        }
        assert_eq!(spread.range(), (1.0, 3.0));
    }

    #[test]
    fn a_spread_prints_as_it_is_written() {
        for text in [
            "10",
            "{ min = -1, max = 1.5 }",
            "{ mean = 10, sd = 0.5 }",
            "{ mean = 10, sd = 0.5, min = 9, max = 11 }",
        ] {
            assert_eq!(parse(text).unwrap().to_string(), text);
        }
    }
}
