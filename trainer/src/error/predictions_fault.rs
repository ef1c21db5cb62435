//! Reasons why a table of predictions cannot be judged.

/// Fault of a prediction table, with its remedy.
#[derive(Debug, thiserror::Error)]
#[expect(
    missing_docs,
    reason = "the messages describe the variants and their fields"
)]
pub enum PredictionsFault {
    #[error(
        "is not there; expected a table of `dtd predict`, or a Parquet or CSV file with the columns scenario, tick and NAME_dtd_m"
    )]
    NotThere,
    #[error(
        "is not a Parquet file: it does not begin with PAR1; write it as Parquet, or give a CSV file a name that ends in .csv"
    )]
    NotParquet,
    #[error(
        "is not a CSV table: {0}; expected a line of column names, then a line per tick with as many fields, separated by commas"
    )]
    NotCsv(csv::Error),
    #[error("has no rows, expected one for each scenario and tick")]
    Empty,
    #[error(
        "has no column {column}; its columns are {found}; expected scenario, tick, and for each estimator NAME a column NAME_dtd_m, in metres"
    )]
    NoColumn { column: &'static str, found: String },
    #[error(
        "has no column whose name ends in _dtd_m; its columns are {found}; name the distances of an estimator NAME, in metres, NAME_dtd_m"
    )]
    NoEstimator { found: String },
    #[error("has two columns named {0}; rename one of them")]
    ColumnTwice(String),
    #[error(
        "has a column {column:?}; expected a name of an estimator of up to {most} letters, digits, _, - and . before _dtd_m"
    )]
    EstimatorName { column: String, most: usize },
    #[error(
        "has column {there} but no column {missing}; an interval has both ends: add the other, or rename this one"
    )]
    HalfInterval { there: String, missing: String },
    #[error("line {line}: {column} is {found:?}, expected a number, or an empty field for none")]
    NotANumber {
        line: usize,
        column: String,
        found: String,
    },
    #[error(
        "row {row} has no {column}; every row needs a scenario and a tick, for a tick without a prediction as well"
    )]
    NoKey { row: usize, column: &'static str },
    #[error("row {row}: {column} is {found:?}, expected a whole number from 0 to {most}")]
    NotWhole {
        row: usize,
        column: &'static str,
        found: f64,
        most: u32,
    },
    #[error(
        "has {} that the corpus does not have: {first}; the corpus has {known}; judge it with the corpus that it was made from",
        if *count == 1 { "1 scenario".to_owned() } else { format!("{count} scenarios") }
    )]
    UnknownScenarios {
        count: usize,
        first: String,
        known: String,
    },
    #[error(
        "scenario {scenario} has tick {tick}, but in the corpus its ticks are 0 to {last}; count ticks from 0, as frames.parquet does"
    )]
    NoSuchTick {
        scenario: String,
        tick: u32,
        last: usize,
    },
    #[error(
        "scenario {scenario} has tick {tick} more than once; expected one row for each scenario and tick"
    )]
    TickTwice { scenario: String, tick: u32 },
    #[error(
        "scenario {scenario}, tick {tick}: {column} is {found:?}, expected a finite number of metres; where there is no prediction, leave the \
         value out (null in Parquet, an empty field in CSV)"
    )]
    NotFinite {
        scenario: String,
        tick: u32,
        column: String,
        found: f64,
    },
    #[error(
        "the distances in {column} have the opposite sign: their median is {median_ratio:.3} of the true distance; expected distances to \
         touchdown, which fall to 0 m along the approach; change their sign"
    )]
    Negative { column: String, median_ratio: f64 },
    #[error(
        "scenario {scenario}, tick {tick}: {from_column} is {} and {to_column} is {}, expected two finite distances in this order, or \
         none where there is no prediction",
        shown(*from_m), shown(*to_m)
    )]
    NotAnInterval {
        scenario: String,
        tick: u32,
        from_column: String,
        to_column: String,
        from_m: Option<f64>,
        to_m: Option<f64>,
    },
    #[error(
        "the distances in {column} are probably in {unit}: their median is {median_ratio:.3e} of the true distance in metres, and {unit} \
         would give {expected_ratio:.3e}; convert them to metres"
    )]
    OtherUnit {
        column: String,
        unit: &'static str,
        median_ratio: f64,
        expected_ratio: f64,
    },
    #[error(
        "none of its {rows} rows is of a tick that counts, with the aircraft in an image, {min_dtd_nm} to {max_dtd_nm} NM away; {elsewhere} \
         rows are of scenarios outside the judged side: predict the test side, or judge all scenarios with --side all"
    )]
    NoneJudged {
        rows: usize,
        /// Rows of scenarios without a tick that counts.
        elsewhere: usize,
        min_dtd_nm: f64,
        max_dtd_nm: f64,
    },
}

fn shown(end_m: Option<f64>) -> String {
    end_m.map_or_else(|| "missing".into(), |end_m| format!("{end_m:?}"))
}
