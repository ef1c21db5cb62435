//! Predictions of the estimators of evaluated runs.

use std::collections::BTreeMap;
use std::path::Path;

use dataset::corpus::scenario::other_flight::other_flight;
use dataset::corpus::seal::sealed::Sealed;
use dataset::files::outside_file::{self, FileKind};
use dataset::tables::columns::{Table, TableWriter};

use crate::about::split_of;
use crate::error::{Error, Result};
use crate::scenarios::Source;

const FILE: &str = "predictions.parquet";

/// A run's predictions.
pub(crate) struct Predictions {
    run: String,
    blake3: String,
    /// Rows by scenario.
    scenarios: BTreeMap<String, Vec<usize>>,
    ticks: Vec<u32>,
    /// True distances; missing if the run answered without knowing them.
    true_dtd_m: Vec<Option<f64>>,
    estimators: Vec<Estimator>,
}

/// Answers with their stated accuracy.
struct Estimator {
    name: String,
    dtd_m: Vec<Option<f64>>,
    sd_m: Vec<Option<f64>>,
    from_m: Vec<Option<f64>>,
    to_m: Vec<Option<f64>>,
}

impl Predictions {
    /// Reads the predictions of the run in a folder, and checks them against its seal.
    pub(crate) fn read(run: &Path) -> Result<Self> {
        let none = || {
            Error::Request(format!(
                "{} has no predictions; expected an evaluated run: run `dtd evaluate` on it first",
                run.display()
            ))
        };
        let sealed = Sealed::read(run)?.ok_or_else(none)?;
        let expected = sealed.hash_of(FILE).ok_or_else(none)?;
        let path = run.join(FILE);
        let bytes = outside_file::read(&path, FileKind::TABLE)?;
        if blake3::hash(&bytes).to_string() != expected {
            let fault = "does not match the seal of its run; evaluate it again";
            return Err(dataset::Error::corpus(&path, fault).into());
        }
        let table = Table::parse(bytes, &path, u64::from(u32::MAX))?;
        let mut scenarios: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (row, scenario) in table.text("scenario")?.into_iter().enumerate() {
            scenarios.entry(scenario).or_default().push(row);
        }
        let optional = |column: String| {
            if table.has(&column) {
                table.optional_f64(&column)
            } else {
                Ok(vec![None; table.rows()])
            }
        };
        let mut estimators = Vec::new();
        for column in table.column_names() {
            if let Some(name) = column.strip_suffix("_dtd_m") {
                estimators.push(Estimator {
                    name: name.to_owned(),
                    dtd_m: table.optional_f64(column)?,
                    sd_m: optional(format!("{column}_sd"))?,
                    from_m: optional(format!("{column}_from"))?,
                    to_m: optional(format!("{column}_to"))?,
                });
            }
        }
        let name = run.canonicalize().ok();
        let name = name.as_deref().unwrap_or(run).file_name();
        Ok(Self {
            run: name.unwrap_or(run.as_os_str()).to_string_lossy().into(),
            blake3: expected.to_owned(),
            scenarios,
            ticks: table.u32("tick")?,
            true_dtd_m: optional("dtd_m".to_owned())?,
            estimators,
        })
    }

    /// Name of the run.
    pub(crate) fn run(&self) -> &str {
        &self.run
    }

    /// Adds the run's name and content to an export's identity.
    pub(crate) fn hash(&self, hasher: &mut blake3::Hasher) {
        hasher.update(self.run.as_bytes());
        hasher.update(self.blake3.as_bytes());
    }

    /// Rejects predictions for a different scenario with the same name, as from a second sweep. Returns true if there are predictions.
    pub(crate) fn check(&self, source: &Source<'_>) -> Result<bool> {
        let scenario = &source.record.id;
        let Some(rows) = self.scenarios.get(scenario) else {
            return Ok(false);
        };
        let answered = rows
            .iter()
            .map(|&row| (self.ticks[row], self.true_dtd_m[row]));
        match other_flight(scenario, answered, &source.frames.rows) {
            None => Ok(true),
            Some(other) => Err(Error::Request(format!("run {} {other}", self.run))),
        }
    }

    /// Identifiers of the scenarios that it answers for.
    pub(crate) fn scenarios(&self) -> impl Iterator<Item = &str> {
        self.scenarios.keys().map(String::as_str)
    }

    /// The predictions for a scenario at the requested ticks, in the form of the Python package's `predictions`.
    pub(crate) fn of(&self, source: &Source<'_>) -> TableWriter {
        let scenario = source.record.id.as_str();
        let rows = self.scenarios.get(scenario).map_or(&[][..], Vec::as_slice);
        let all = || {
            rows.iter()
                .filter(|row| source.is_asked_for(self.ticks[**row]))
                .flat_map(|row| self.estimators.iter().map(move |one| (one, *row)))
        };
        TableWriter::new()
            .text("run", all().map(|_| &self.run))
            .text("scenario", all().map(|_| scenario))
            .u32("tick", all().map(|(_, row)| self.ticks[row]))
            .text("estimator", all().map(|(one, _)| &one.name))
            .optional_f64("predicted_dtd_m", all().map(|(one, row)| one.dtd_m[row]))
            .optional_f64("predicted_dtd_sd_m", all().map(|(one, row)| one.sd_m[row]))
            .optional_f64(
                "predicted_dtd_from_m",
                all().map(|(one, row)| one.from_m[row]),
            )
            .optional_f64("predicted_dtd_to_m", all().map(|(one, row)| one.to_m[row]))
            .optional_f64("dtd_m", all().map(|(_, row)| self.true_dtd_m[row]))
            .text("weather", all().map(|_| source.record.weather_name()))
            .optional_text(
                "side",
                all().map(|_| source.selected.side.map(|side| split_of(Some(side)))),
            )
    }
}
