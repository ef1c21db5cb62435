//! The stand-in's datarefs: names, types and values, with X-Plane's rules for reading and writing them over UDP.
//!
//! Input: a path such as `sim/time/zulu_time_sec` or `name[3]`, optionally a 32-bit value. Output: a 32-bit value, or why a write
//! is ignored. X-Plane ignores such writes silently; we log them.

pub(crate) mod known;

pub(crate) use known::FOREIGN_NAMES;

use std::collections::BTreeMap;

use xplane_bridge::datarefs::Generation;

/// Dataref type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 32-bit integer: fractions are truncated.
    Int,
    /// 32-bit float.
    Float,
    /// 64-bit float; UDP still carries 32 bits.
    Double,
    /// Bytes of text, always an array.
    Byte,
}

/// A dataref's name, type and first value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dataref {
    /// Path without index.
    pub name: &'static str,
    pub kind: Kind,
    /// Array length, `None` for a single value.
    pub length: Option<usize>,
    /// True if clients may set it.
    pub writable: bool,
    /// Initial value (of every element).
    pub initial: f64,
    /// X-Plane 12's reaction when a dataref of 11 is looked up.
    pub complaint: Option<Complaint>,
}

/// X-Plane's complaint about a deprecated dataref. It is written into its log in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Complaint {
    /// In the log.
    Logged,
    /// An error lies over the scene as well.
    Shown,
}

impl Complaint {
    /// The words of X-Plane's log.
    pub(crate) fn text(self, name: &str) -> String {
        match self {
            Self::Logged => {
                format!("Dataref '{name}' has been replaced. Please use the new name.")
            }
            Self::Shown => {
                format!("Dataref '{name}' is deprecated and will be removed in a future version.")
            }
        }
    }
}

/// Reason why a write has no effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Ignored {
    /// No such dataref.
    #[error("unknown dataref")]
    Unknown,
    /// It belongs to the simulator.
    #[error("read-only dataref")]
    ReadOnly,
    /// An array is written element by element.
    #[error("array without index: write name[i]")]
    NeedsIndex,
    /// The index is beyond the array's end, or invalid.
    #[error("index out of range")]
    BadIndex,
    /// The value is not a number.
    #[error("value is not finite")]
    NotFinite,
}

/// All datarefs with their values.
#[derive(Debug, Clone)]
pub(crate) struct Datarefs {
    cells: BTreeMap<&'static str, (Dataref, Vec<f64>)>,
}

impl Datarefs {
    /// All datarefs of a simulator generation, with their initial values.
    pub(crate) fn new(generation: Generation) -> Self {
        Self::of(known::datarefs(generation))
    }

    pub(crate) fn of(datarefs: impl IntoIterator<Item = Dataref>) -> Self {
        let cells = datarefs.into_iter().map(|dataref| {
            let values = vec![dataref.initial; dataref.length.unwrap_or(1)];
            (dataref.name, (dataref, values))
        });
        Self {
            cells: cells.collect(),
        }
    }

    /// All datarefs by name, with their values.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Dataref, &[f64])> {
        self.cells
            .values()
            .map(|(dataref, values)| (dataref, values.as_slice()))
    }

    /// Looks a dataref up by its name without index.
    pub(crate) fn find(&self, name: &str) -> Option<(&Dataref, &[f64])> {
        let (dataref, values) = self.cells.get(name)?;
        Some((dataref, values))
    }

    /// A dataref with its values, for the simulator itself, which may change any.
    pub(crate) fn values_mut(&mut self, name: &str) -> Option<(&Dataref, &mut Vec<f64>)> {
        let (dataref, values) = self.cells.get_mut(name)?;
        Some((&*dataref, values))
    }

    /// The value as carried by RREF. An unknown path, and an array without index, read as 0, as in X-Plane 12.
    pub(crate) fn read(&self, path: &str) -> f32 {
        self.locate(path)
            .map_or(0.0, |(name, at)| self.cells[name].1[at] as f32)
    }

    /// The value with full precision; 0 for an unknown path.
    pub(crate) fn get(&self, path: &str) -> f64 {
        self.locate(path)
            .map_or(0.0, |(name, at)| self.cells[name].1[at])
    }

    /// A client's write with full precision.
    ///
    /// # Errors
    /// The write has no effect, with the reason.
    pub(crate) fn write_exact(&mut self, path: &str, value: f64) -> Result<(), Ignored> {
        let (name, at) = self.locate(path)?;
        match self.cells.get_mut(name) {
            Some((dataref, values)) if dataref.writable => {
                // Values too large for 32 bits are rounded to infinity.
                let rounded = dataref.kind.rounded(value);
                if !(value.is_finite() && rounded.is_finite()) {
                    return Err(Ignored::NotFinite);
                }
                values[at] = rounded;
                Ok(())
            }
            _ => Err(Ignored::ReadOnly),
        }
    }

    /// The simulator's own write, also to read-only datarefs. An unknown path is a bug in this crate and is logged.
    pub(crate) fn set(&mut self, path: &str, value: f64) {
        match self
            .locate(path)
            .map(|(name, at)| (self.cells.get_mut(name), at))
        {
            Ok((Some((dataref, values)), at)) => values[at] = dataref.kind.rounded(value),
            _ => tracing::error!(
                path,
                "the stand-in publishes a dataref that it does not have"
            ),
        }
    }

    /// The simulator's own write of a text.
    pub(crate) fn set_text(&mut self, name: &str, text: &str) {
        let Some((_, values)) = self.cells.get_mut(name) else {
            tracing::error!(name, "the stand-in publishes a text that it does not have");
            return;
        };
        values.fill(0.0);
        // The last byte stays NUL.
        let room = values.len().saturating_sub(1);
        for (value, byte) in values.iter_mut().zip(text.bytes().take(room)) {
            *value = f64::from(byte);
        }
    }

    /// Restores the values that a dataref had elsewhere.
    pub(crate) fn restore(&mut self, name: &str, from: &[f64]) {
        if let Some((_, values)) = self.cells.get_mut(name) {
            values.copy_from_slice(from);
        }
    }

    /// Splits a path into name and element. Single values are also accessible as `name[0]`: clients were seen to do that.
    fn locate(&self, path: &str) -> Result<(&'static str, usize), Ignored> {
        let (name, index) = match path.strip_suffix(']').and_then(|path| path.split_once('[')) {
            Some((name, index)) => (
                name,
                Some(index.parse::<usize>().map_err(|_| Ignored::BadIndex)?),
            ),
            None => (path, None),
        };
        let (dataref, values) = self.cells.get(name).ok_or(Ignored::Unknown)?;
        match (dataref.length, index) {
            (Some(_), None) => Err(Ignored::NeedsIndex),
            (_, Some(index)) if index >= values.len() => Err(Ignored::BadIndex),
            (_, index) => Ok((dataref.name, index.unwrap_or(0))),
        }
    }
}

impl Kind {
    /// Converts a number to this type.
    pub(crate) fn rounded(self, value: f64) -> f64 {
        match self {
            Self::Int => f64::from(value as i32),
            Self::Byte => f64::from(value as u8),
            Self::Float => f64::from(value as f32),
            Self::Double => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use testkit::scenario::calm;

    use super::*;

    const CLOUDS: &str = "sim/weather/region/cloud_base_msl_m";
    const ZULU: &str = "sim/time/zulu_time_sec";
    const LATITUDE: &str = "sim/flightmodel/position/latitude";

    #[test]
    fn elements_of_an_array_are_written_and_read_one_by_one() {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        assert_eq!(
            datarefs.write_exact(&format!("{CLOUDS}[1]"), 1_500.0),
            Ok(())
        );
        assert_eq!(datarefs.read(&format!("{CLOUDS}[1]")), 1_500.0);
        assert_eq!(datarefs.read(&format!("{CLOUDS}[2]")), 0.0);
        assert_eq!(datarefs.write_exact(CLOUDS, 7.0), Err(Ignored::NeedsIndex));
        assert_eq!(datarefs.read(CLOUDS), 0.0);
        assert_eq!(
            datarefs.write_exact(&format!("{CLOUDS}[3]"), 7.0),
            Err(Ignored::BadIndex)
        );
        assert_eq!(
            datarefs.write_exact(&format!("{CLOUDS}[x]"), 7.0),
            Err(Ignored::BadIndex)
        );
    }

    #[test]
    fn a_single_value_also_goes_by_element_zero() {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        assert_eq!(datarefs.write_exact(&format!("{ZULU}[0]"), 60.5), Ok(()));
        assert_eq!(datarefs.read(ZULU), 60.5);
        assert_eq!(
            datarefs.write_exact(&format!("{ZULU}[1]"), 60.5),
            Err(Ignored::BadIndex)
        );
    }

    #[test]
    fn what_belongs_to_the_simulator_is_not_written_by_clients() {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        datarefs.set(LATITUDE, 1.348_971_96);
        assert_eq!(datarefs.write_exact(LATITUDE, 50.0), Err(Ignored::ReadOnly));
        assert_eq!(datarefs.get(LATITUDE), 1.348_971_96);
        assert_eq!(datarefs.read(LATITUDE), 1.348_971_96_f64 as f32);
        assert_eq!(
            datarefs.write_exact("sim/no/such/thing", 1.0),
            Err(Ignored::Unknown)
        );
        assert_eq!(datarefs.read("sim/no/such/thing"), 0.0);
    }

    #[test]
    fn integers_lose_their_fraction_and_nothing_takes_nan() {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        datarefs
            .write_exact("sim/time/local_date_days", 79.9)
            .unwrap();
        assert_eq!(datarefs.read("sim/time/local_date_days"), 79.0);
        assert_eq!(
            datarefs.write_exact(ZULU, f64::NAN),
            Err(Ignored::NotFinite)
        );
        assert_eq!(datarefs.write_exact(ZULU, 1e40), Err(Ignored::NotFinite));
    }

    #[test]
    fn everything_that_the_bridge_writes_is_known_here_and_taken() {
        use dataset::conditions::{Clock, Conditions, Weather};
        let conditions = Conditions {
            time_of_day: "12:00".into(),
            clock: Clock {
                day_of_year: 200,
                zulu_time_s: 14_400.0,
            },
            weather_name: "clear".into(),
            weather: Weather {
                wind_speed_mps: 3.0,
                wind_from_true_deg: 30.0,
                turbulence_ratio: 0.1,
                ..calm(30_000.0)
            },
        };
        for generation in [Generation::XPlane11, Generation::XPlane12] {
            let mut datarefs = Datarefs::new(generation);
            for write in xplane_bridge::datarefs::condition_writes(&conditions, generation).unwrap()
            {
                let taken = datarefs.write_exact(&write.name, f64::from(write.value));
                assert_eq!(taken, Ok(()), "{}", write.name);
                let back = datarefs.read(&write.name);
                assert!(write.is_met_by(back), "{} is {back}", write.name);
            }
        }
    }

    #[test]
    fn each_generation_has_its_own_weather_and_version() {
        let [eleven, twelve] = [Generation::XPlane11, Generation::XPlane12].map(Datarefs::new);
        let version = xplane_bridge::datarefs::VERSION;
        assert_eq!(
            (eleven.read(version), twelve.read(version)),
            (115_501.0, 124_009.0)
        );
        assert!(eleven.find("sim/weather/visibility_reported_m").is_some());
        assert!(
            eleven
                .find("sim/weather/region/visibility_reported_sm")
                .is_none()
        );
    }

    #[test]
    fn x_plane_12_keeps_the_names_of_11_and_complains_about_them() {
        let [eleven, mut twelve] = [Generation::XPlane11, Generation::XPlane12].map(Datarefs::new);
        let complaint = |datarefs: &Datarefs, name: &str| datarefs.find(name).unwrap().0.complaint;
        let real = "sim/weather/use_real_weather_bool";
        assert_eq!(complaint(&twelve, real), Some(Complaint::Shown));
        let flaps = "sim/cockpit2/controls/flap_ratio";
        assert_eq!(complaint(&twelve, flaps), Some(Complaint::Logged));
        let mut names = eleven.iter().map(|(dataref, _)| dataref.name);
        assert!(names.all(|name| complaint(&eleven, name).is_none()));
        assert_eq!(twelve.write_exact(real, 1.0), Err(Ignored::ReadOnly));
        assert_eq!(twelve.write_exact(flaps, 0.5), Ok(()));
        // That one is gone.
        assert!(twelve.find("sim/weather/thunderstorm_percent").is_none());
    }

    #[test]
    fn a_text_is_read_byte_by_byte_and_ends_with_nul() {
        let mut datarefs = Datarefs::new(Generation::XPlane12);
        let name = "sim/aircraft/view/acf_relative_path";
        datarefs.set_text(name, "Aircraft/a.acf");
        assert_eq!(datarefs.read(&format!("{name}[0]")), f32::from(b'A'));
        assert_eq!(datarefs.read(&format!("{name}[14]")), 0.0);
        datarefs.set_text(name, &"x".repeat(1_000));
        let (dataref, values) = datarefs.find(name).unwrap();
        assert_eq!(dataref.length, Some(values.len()));
        assert_eq!(values.last(), Some(&0.0));
    }
}
