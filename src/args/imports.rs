//! Arguments of the verbs that import runways and tracks.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use generator::tracks::NamedColumn;

use crate::args::detector::RuntimeArgs;
use crate::args::shared::output::Output;
use crate::help;

/// The list, or drawings.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct AircraftArgs {
    #[command(subcommand)]
    pub(crate) command: Option<AircraftCommand>,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum AircraftCommand {
    /// Draw types from ahead, from the left and from above, at one scale, ready to land
    #[command(after_help = help::AIRCRAFT_SHOW)]
    Show(AircraftShowArgs),
}

#[derive(Debug, Args)]
pub(crate) struct AircraftShowArgs {
    /// Types by name or ICAO designator, a row of the drawing each
    #[arg(required = true, value_name = "TYPE")]
    pub(crate) types: Vec<String>,
    /// The image to write
    #[arg(long, value_name = "FILE", value_parser = Output::NewFile.parser())]
    pub(crate) png: PathBuf,
}

#[derive(Debug, Subcommand)]
pub(crate) enum AirportCommand {
    /// Print `[airport.ICAO.runway.NAME]` with the source of each figure, and where the tables differ
    #[command(after_help = help::AIRPORT_IMPORT)]
    Import(AirportImportArgs),
}

#[derive(Debug, Args)]
pub(crate) struct AirportImportArgs {
    /// The airport, e.g. EDDM
    #[arg(value_name = "ICAO")]
    pub(crate) airport: String,
    /// The runway in the landing direction, e.g. 26L
    pub(crate) runway: String,
    /// X-Plane's `apt.dat` and `earth_nav.dat`, or `runways.csv` of OurAirports; several are better than one
    #[arg(long, required = true, num_args = 1.., value_name = "FILE")]
    pub(crate) from: Vec<PathBuf>,
    /// Take the recommended figures where the files differ
    #[arg(long)]
    pub(crate) accept: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The recording's description: runway, cameras, videos or tables of boxes, tracks (docs/recordings.md)
    #[arg(value_name = "RECORDING.toml")]
    pub(crate) recording: PathBuf,
    /// New folder for the corpus
    #[arg(long, value_name = "CORPUS", value_parser = Output::Corpus.parser())]
    pub(crate) out: PathBuf,
    /// The detector, an ONNX file [default: the bundled one]
    ///
    /// It searches videos. The bundled one was not trained on photographs (docs/detectors.md).
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum TracksCommand {
    /// Smooth the arrivals in files of tracks, and fill them in to complete recordings
    #[command(after_help = help::TRACKS_IMPORT)]
    Import(TracksImportArgs),
}

#[derive(Debug, Args)]
pub(crate) struct TracksImportArgs {
    /// Tracks: tables (CSV, Parquet), `trace_full` of readsb, JSON lines of jet1090, or X-Plane's `Data.txt`; also gzipped
    ///
    /// Tables as `traffic`, OpenSky, Flightradar24 and TartanAviation write them, or any other with --columns.
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// The runway on which they land, e.g. LFPG/09R
    #[arg(long, value_name = "ICAO/RUNWAY")]
    pub(crate) runway: String,
    /// A file with the runway's `[airport]` table: a sweep, or the output of `dtd airport import` [default: the built-in runways]
    #[arg(long, value_name = "FILE.toml")]
    pub(crate) airports: Option<PathBuf>,
    /// Columns of a table with names of its own, separated by commas, e.g. time=Timestamp,altitude_m=Height
    ///
    /// Names: time, date, latitude, longitude, position (both with a comma between them), altitude, geometric_altitude and speed (feet and
    /// knots, or with _m, _mps or _kmh at the end), track, roll, on_ground, aircraft.
    #[arg(long, value_name = "NAME=COLUMN,..", value_delimiter = ',')]
    pub(crate) columns: Vec<NamedColumn>,
    /// Folder for the recordings, one CSV file per arrival
    #[arg(long, value_name = "FOLDER", value_parser = Output::Folder.parser())]
    pub(crate) out: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
