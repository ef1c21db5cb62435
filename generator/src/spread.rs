//! A number, or a spread from which each scenario draws its own.

use std::fmt;

use rand::Rng;
use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize};

/// How a value varies from scenario to scenario: `10.0`, `{ min = 9.9, max = 10.1 }` or `{ mean = 10.0, sd = 0.05 }`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Spread {
    /// It does not.
    Fixed(f64),
    /// Evenly within an interval.
    Uniform {
        /// Least value.
        min: f64,
        /// Greatest value.
        max: f64,
    },
    /// Bell-shaped; never further than six standard deviations from the mean.
    Normal {
        /// Middle.
        mean: f64,
        /// Standard deviation.
        sd: f64,
    },
}

impl Spread {
    /// Draws a value. Only additions and multiplications are used: functions of the system's mathematics library differ in
    /// their last digit from machine to machine, and the same seed must give the same plan everywhere.
    pub fn draw(&self, rng: &mut impl Rng) -> f64 {
        match *self {
            Self::Fixed(value) => value,
            Self::Uniform { min, max } => min + (max - min) * unit(rng),
            Self::Normal { mean, sd } => {
                // The sum of twelve even draws has variance 1 (Irwin-Hall).
                let sum: f64 = (0..12).map(|_| unit(rng)).sum();
                mean + sd * (sum - 6.0)
            }
        }
    }

    /// The least and the greatest value that can be drawn.
    pub fn range(&self) -> (f64, f64) {
        match *self {
            Self::Fixed(value) => (value, value),
            Self::Uniform { min, max } => (min, max),
            Self::Normal { mean, sd } => (mean - 6.0 * sd, mean + 6.0 * sd),
        }
    }
}

/// A number in [0, 1) with 53 random bits.
fn unit(rng: &mut impl Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

const EXPECTED: &str = "a number, { min = .., max = .. } or { mean = .., sd = .. }";

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
            Err(E::custom(format!("{value} is no usable number")))
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Spread, A::Error> {
        match Table::deserialize(MapAccessDeserializer::new(map))? {
            Table {
                min: Some(min),
                max: Some(max),
                mean: None,
                sd: None,
            } if min <= max => Ok(Spread::Uniform { min, max }),
            Table {
                mean: Some(mean),
                sd: Some(sd),
                min: None,
                max: None,
            } if sd >= 0.0 && mean.is_finite() => Ok(Spread::Normal { mean, sd }),
            _ => Err(A::Error::custom(format!(
                "expected {EXPECTED}, with min <= max and sd >= 0"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
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
    fn the_three_forms_are_read_and_others_are_explained() {
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
                sd: 0.5
            })
        );
        for wrong in [
            "{ min = 2, max = 1 }",
            "{ mean = 1 }",
            "{ mean = 1, sd = -1 }",
            "{ min = 0, sd = 1 }",
            "nan",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert!(
            parse("{ min = 0, maximum = 1 }")
                .unwrap_err()
                .contains("unknown field `maximum`")
        );
    }

    #[test]
    fn draws_have_the_asked_mean_and_deviation_and_stay_in_range() {
        let mut rng = seed::generator(7);
        let spread = Spread::Normal {
            mean: 10.0,
            sd: 2.0,
        };
        let draws: Vec<f64> = (0..20_000).map(|_| spread.draw(&mut rng)).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let sd =
            (draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / draws.len() as f64).sqrt();
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
}
