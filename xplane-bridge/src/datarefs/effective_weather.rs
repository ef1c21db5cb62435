//! The datarefs of the weather at the aircraft, and their values in SI.

use dataset::conditions::Weather;
use dataset::corpus::effective_weather::{EffectiveQuantity, EffectiveWeather, has_direction};

use super::{
    CLOUD_COVER_AT_AIRCRAFT, CLOUD_LAYERS, RAIN_AT_AIRCRAFT, VISIBILITY_EFFECTIVE_M,
    WIND_DIRECTION_AT_AIRCRAFT, WIND_SPEED_AT_AIRCRAFT,
};

/// A dataref for the weather at the aircraft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Gauge {
    Visibility,
    WindSpeed,
    WindDirection,
    Rain,
    Cover(usize),
}

impl Gauge {
    /// Gauges to read under a planned weather, in the order of the requests: a light wind has no direction.
    fn under(planned: &Weather, reads_wind_speed: bool) -> Vec<Self> {
        let single = [
            Some(Self::Visibility),
            reads_wind_speed.then_some(Self::WindSpeed),
            has_direction(planned).then_some(Self::WindDirection),
            Some(Self::Rain),
        ];
        let covers = (0..CLOUD_LAYERS).map(Self::Cover);
        single.into_iter().flatten().chain(covers).collect()
    }

    fn dataref(self) -> String {
        match self {
            Self::Visibility => VISIBILITY_EFFECTIVE_M.into(),
            Self::WindSpeed => WIND_SPEED_AT_AIRCRAFT.into(),
            Self::WindDirection => WIND_DIRECTION_AT_AIRCRAFT.into(),
            Self::Rain => RAIN_AT_AIRCRAFT.into(),
            Self::Cover(layer) => format!("{CLOUD_COVER_AT_AIRCRAFT}[{layer}]"),
        }
    }
}

pub(crate) fn effective_weather_datarefs(planned: &Weather, reads_wind_speed: bool) -> Vec<String> {
    let gauges = Gauge::under(planned, reads_wind_speed).into_iter();
    gauges.map(Gauge::dataref).collect()
}

/// The weather at the aircraft by the values of those datarefs, compared with the plan. A value that cannot be one is not kept, and
/// differs from any plan.
pub(crate) fn effective_weather_of(
    planned: &Weather,
    reads_wind_speed: bool,
    values: &[Option<f32>],
) -> EffectiveWeather {
    let mut found = EffectiveWeather::default();
    for (gauge, value) in Gauge::under(planned, reads_wind_speed)
        .into_iter()
        .zip(values)
    {
        let value = value.map(f64::from);
        let (place, quantity) = match gauge {
            Gauge::Visibility => (&mut found.visibility_m, EffectiveQuantity::Visibility),
            Gauge::WindSpeed => (&mut found.wind_speed_mps, EffectiveQuantity::WindSpeed),
            Gauge::WindDirection => (
                &mut found.wind_from_true_deg,
                EffectiveQuantity::WindDirection,
            ),
            Gauge::Rain => (&mut found.rain_ratio, EffectiveQuantity::Rain),
            Gauge::Cover(layer) => (
                &mut found.cloud_cover_ratios[layer],
                EffectiveQuantity::CloudCover,
            ),
        };
        *place = value.filter(|value| quantity.can_be(*value));
        if value.is_some() && place.is_none() {
            found.differing.insert(quantity);
        }
    }
    let differing = found.differences(planned).into_iter();
    let differing: Vec<_> = differing.map(|difference| difference.quantity).collect();
    found.differing.extend(differing);
    found
}

#[cfg(test)]
mod tests {
    use testkit::scenario::calm;

    use super::*;

    fn windy() -> Weather {
        Weather {
            rain_ratio: 0.5,
            wind_speed_mps: 7.0,
            wind_from_true_deg: 45.0,
            ..calm(8_000.0)
        }
    }

    #[test]
    fn values_land_in_their_quantities_in_the_order_of_the_datarefs() {
        let names = effective_weather_datarefs(&windy(), true);
        assert_eq!(names.len(), 4 + CLOUD_LAYERS);
        let values = [8_500.0, 8.0, 50.0, 0.4975, 0.0, 0.1, 0.0].map(Some);
        let found = effective_weather_of(&windy(), true, &values);
        assert_eq!(found.visibility_m, Some(8_500.0));
        assert_eq!(found.wind_from_true_deg, Some(50.0));
        assert!(!found.is_marked(), "{found:?}");
        let calm = Weather {
            wind_speed_mps: 0.5,
            ..windy()
        };
        assert_eq!(
            effective_weather_datarefs(&calm, false).len(),
            2 + CLOUD_LAYERS
        );
    }

    #[test]
    fn a_reading_that_cannot_be_is_not_kept_and_differs() {
        for impossible in [f32::NAN, f32::INFINITY, -1.0, 1e30] {
            let values = [impossible, 8.0, 50.0, 0.5, 0.0, 0.0, 0.0].map(Some);
            let found = effective_weather_of(&windy(), true, &values);
            assert_eq!(found.visibility_m, None);
            assert_eq!(
                found.differing.into_iter().collect::<Vec<_>>(),
                [EffectiveQuantity::Visibility]
            );
        }
    }
}
