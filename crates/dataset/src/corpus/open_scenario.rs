//! The only place that opens a sealed scenario's files.
//!
//! Records and tables are read completely, checked against the sealed hash, and decoded from those very bytes, all in one state of the
//! folder: a concurrent change is seen completely or not at all. A video is hashed before it is opened for decoding. Only `dtd verify`,
//! which must name every fault, reads files unchecked.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::corpus::calibration::Calibration;
use crate::corpus::detections::{self, Detections, FoundTable, Provenance, Row};
use crate::corpus::scenario::ScenarioRecord;
use crate::corpus::seal::sealed::{ATTEMPTS, Sealed};
use crate::corpus::seal::{DONE, Seal, hash_file, view_of};
use crate::corpus::{PARTIAL_SUFFIX, ScenarioFolder};
use crate::error::{Error, Result};
use crate::files::corpus_names::{CALIBRATION, FILES, RECORD};
use crate::files::json_file::parse_json;
use crate::files::outside_file::FileKind;
use crate::tables::aircraft::AircraftRow;
use crate::tables::backgrounds::ViewBackground;
use crate::tables::frames::Frames;
use crate::tables::health::ViewHealth;
use crate::tables::image_rows::ImageRow;
use crate::tables::pixel_box::TruthBox;
use crate::tables::registrations::Registration;
use crate::video::{PacketReader, RgbPicture, VideoReader};

/// The identity in a scenario's record.
#[derive(Deserialize)]
struct Identity {
    id: String,
    config_hash: String,
}

/// Rejects a different scenario's files, or a renamed copy: `content` is the sealed `scenario.json`.
///
/// # Errors
/// Its identifier or parameters differ from the seal's, or it is not a record.
pub fn check_identity(id: &str, seal: &Seal, content: &[u8], path: &Path) -> Result<()> {
    let said: Identity = parse_json(content, path, "scenario record")?;
    let fault = if said.id != id {
        format!(
            "has the id {:?}, expected {id:?}, the name of its folder",
            said.id
        )
    } else if said.config_hash != seal.config_hash {
        format!(
            "has the config_hash {:?}, expected {:?} as in {DONE}",
            said.config_hash, seal.config_hash
        )
    } else {
        return Ok(());
    };
    Err(Error::corpus(
        path,
        format!("{fault}: it is another scenario's; put the right one there, or generate it again"),
    ))
}

/// A consistent state of a scenario's folder.
#[derive(Debug)]
pub struct OpenScenario {
    folder: ScenarioFolder,
    sealed: Sealed,
    /// Records and tables by name.
    contents: BTreeMap<&'static str, Vec<u8>>,
}

impl ScenarioFolder {
    /// Rejects a sealed folder with a different scenario's files, or a renamed copy.
    ///
    /// # Errors
    /// See [`check_identity`]; also fails if the record does not match the seal.
    pub fn check_identity(&self, sealed: &Sealed) -> Result<()> {
        match sealed.content(RECORD, kind_of(RECORD))? {
            Some(record) => self.check_record(sealed, &record),
            None => Ok(()),
        }
    }

    fn check_record(&self, sealed: &Sealed, record: &[u8]) -> Result<()> {
        // A scenario is opened before it is renamed to its final name.
        let folder = self.id();
        let id = folder.strip_suffix(PARTIAL_SUFFIX).unwrap_or(&folder);
        check_identity(id, sealed.seal(), record, &self.record_path())
    }

    /// Opens the scenario as it was sealed.
    ///
    /// # Errors
    /// It has no seal, a record or table does not match the seal, or some part is a symbolic link.
    pub fn open(&self) -> Result<OpenScenario> {
        for _ in 0..ATTEMPTS {
            match self.open_at_once() {
                // A writer was faster.
                Err(Error::Changing { .. }) => {}
                opened => return opened,
            }
        }
        Err(Error::Changing {
            path: self.root().to_owned(),
        })
    }

    fn open_at_once(&self) -> Result<OpenScenario> {
        let sealed = Sealed::read(self.root())?.ok_or_else(|| {
            Error::corpus(
                self.root(),
                format!("has no {DONE}: it was never finished, or its seal was lost"),
            )
        })?;
        let mut contents = BTreeMap::new();
        for name in FILES {
            if let Some(content) = sealed.content(name, kind_of(name))? {
                contents.insert(name, content);
            }
        }
        if let Some(record) = contents.get(RECORD) {
            self.check_record(&sealed, record)?;
        }
        Ok(OpenScenario {
            folder: self.clone(),
            sealed,
            contents,
        })
    }
}

impl OpenScenario {
    /// Folder of the scenario.
    pub fn folder(&self) -> &ScenarioFolder {
        &self.folder
    }

    /// Identifier of the scenario.
    pub fn id(&self) -> String {
        self.folder.id()
    }

    /// The seal of the opened state.
    pub fn seal(&self) -> &Seal {
        self.sealed.seal()
    }

    /// `scenario.json`.
    pub fn record(&self) -> Result<ScenarioRecord> {
        ScenarioRecord::parse(self.content(RECORD)?, &self.folder.record_path())
    }

    /// `calibration.json`.
    pub fn calibration(&self) -> Result<Calibration> {
        Calibration::parse(self.content(CALIBRATION)?, &self.folder.calibration_path())
    }

    /// `frames.parquet`.
    pub fn frames(&self) -> Result<Frames> {
        let content = self.content(ScenarioFolder::FRAMES)?;
        Frames::parse(content.to_vec(), &self.folder.frames_path())
    }

    /// `aircraft.parquet`: a row for each tick and, within it, each aircraft by number; `None` if the scenario has no traffic.
    pub fn aircraft(&self) -> Result<Option<Vec<AircraftRow>>> {
        let record = self.record()?;
        if record.traffic.is_empty() {
            return Ok(None);
        }
        let count = record.aircraft_count();
        let content = self.content(ScenarioFolder::AIRCRAFT)?.to_vec();
        let path = self.folder.aircraft_path();
        let expected = u64::from(record.ticks) * u64::from(count);
        let rows = AircraftRow::parse(content, &path, expected)?;
        match AircraftRow::out_of_place(&rows, record.ticks, count) {
            None => Ok(Some(rows)),
            Some(fault) => Err(Error::corpus(
                &path,
                format!("{fault}; generate the scenario again"),
            )),
        }
    }

    /// `boxes_truth.parquet`, if the scenario was labelled: with traffic, the boxes of all aircraft.
    pub fn truth_boxes_if_labelled(&self) -> Result<Option<Vec<TruthBox>>> {
        let most = self.record()?.max_truth_boxes();
        let path = self.folder.truth_boxes_path();
        let content = self.contents.get(ScenarioFolder::TRUTH_BOXES);
        content
            .map(|content| TruthBox::parse(content.clone(), &path, most))
            .transpose()
    }

    /// `boxes_truth.parquet`.
    pub fn truth_boxes(&self) -> Result<Vec<TruthBox>> {
        self.truth_boxes_if_labelled()?.ok_or_else(|| {
            Error::corpus(
                &self.folder.truth_boxes_path(),
                "is missing: run `dtd label` on the corpus first",
            )
        })
    }

    /// A model's detections, made from the videos that this scenario has.
    ///
    /// # Errors
    /// There are none, they were made from other videos or do not record which, or the table is not the one that was written.
    pub fn detections(&self, model: &str) -> Result<Detections> {
        let (path, content) = self.detections_table(model)?;
        let record = self.record()?;
        let rows = Row::parse(content, &path, record.pictures())?;
        let faults = rows
            .iter()
            .map(|row| fault_of(row.tick(), row.view(), &record));
        refuse_faults(&path, faults)?;
        Ok(rows.into())
    }

    /// Shifts of the aircraft between each view and the reference view, tick by tick, for a model's detections; `None` if these have no
    /// registrations: the scenario has one view, or `dtd detect` was run before it registered.
    ///
    /// # Errors
    /// They were made from other videos, or the table is not the one that was written.
    pub fn registrations(&self, model: &str) -> Result<Option<Vec<Registration>>> {
        self.rows(detections::REGISTRATIONS, model, fault_of_registration)
    }

    /// The condition of the cameras, tick by tick, from the images that a model's detections were made from; `None` if `dtd detect` was run
    /// before it measured this.
    ///
    /// # Errors
    /// It was measured in other videos, or the table is not the one that was written.
    pub fn health(&self, model: &str) -> Result<Option<Vec<ViewHealth>>> {
        let fault = |row: &ViewHealth, record: &_| fault_of(row.tick, &row.view, record);
        self.rows(detections::HEALTH, model, fault)
    }

    /// The background of each camera in the images that a model's detections were made from; `None` if an earlier version of `dtd detect`
    /// made them.
    ///
    /// # Errors
    /// It was made from other videos, or the table is not the one that was written.
    pub fn backgrounds(&self, model: &str) -> Result<Option<Vec<ViewBackground>>> {
        let fault = |row: &ViewBackground, record: &_| fault_of(row.tick, &row.view, record);
        self.rows(detections::BACKGROUNDS, model, fault)
    }

    /// The rows of a table of the model's detections; `None` if their record names none.
    fn rows<R: ImageRow>(
        &self,
        folder: &str,
        model: &str,
        fault: impl Fn(&R, &ScenarioRecord) -> Option<RowFault>,
    ) -> Result<Option<Vec<R>>> {
        let Some((path, content)) = self.table(folder, model)? else {
            return Ok(None);
        };
        let record = self.record()?;
        // It is as it was sealed, and still not a table of this version.
        let rows = R::parse(content, &path, record.pictures()).map_err(|error| match error {
            Error::Table { .. } => Error::corpus(
                &path,
                format!(
                    "{}; run `dtd detect` with this version again",
                    error.beside(&path)
                ),
            ),
            error => error,
        })?;
        refuse_faults(&path, rows.iter().map(|row| fault(row, &record)))?;
        Ok(Some(rows))
    }

    /// Current path and content of the table of the model's detections.
    ///
    /// # Errors
    /// There is none, or see [`Self::table`].
    pub fn detections_table(&self, model: &str) -> Result<FoundTable> {
        self.table(detections::FOLDER, model)?.ok_or_else(|| {
            Error::corpus(
                &detections::record_path(&self.folder, model),
                "is missing: run `dtd detect` on the corpus with that model first",
            )
        })
    }

    /// Current path and content of the model's table in one of [`detections::FOLDERS`]; `None` if the model's record names none.
    ///
    /// # Errors
    /// It was made from other videos, or is not the table that was written.
    pub fn table(&self, parent: &str, model: &str) -> Result<Option<FoundTable>> {
        detections::table(&self.folder, model, parent, |provenance| {
            self.is_source_of(provenance)
        })
    }

    /// True if detections were made from the sealed state of this scenario.
    fn is_source_of(&self, provenance: &Provenance) -> bool {
        provenance.config_hash == self.seal().config_hash
            && provenance.videos_blake3 == self.videos_blake3()
    }

    /// The sealed hashes of the videos, by view.
    pub fn videos_blake3(&self) -> BTreeMap<String, String> {
        let files = self.sealed.files().iter();
        files
            .filter_map(|file| Some((view_of(&file.name)?.to_owned(), file.blake3.clone())))
            .collect()
    }

    /// Reads the whole video of the view, checks it against the seal, and opens it. Timestamps are in the unit of the tables' `pts`.
    ///
    /// # Errors
    /// There is none, it does not match the seal, it cannot be decoded, or its images differ in size from the calibrated camera's.
    pub fn open_video(&self, view: &str) -> Result<VideoReader> {
        let path = self.video_path(view)?;
        let reader = VideoReader::open_ticks(&path, self.record()?.frame_rate)?;
        let found = [reader.width(), reader.height()];
        let calibration = self.calibration()?;
        let camera = calibration.cameras.get(view).ok_or_else(|| {
            Error::corpus(
                &self.folder.calibration_path(),
                format!("has no camera {view}"),
            )
        })?;
        let expected = [camera.width_px, camera.height_px];
        if found == expected {
            return Ok(reader);
        }
        let size = |[width_px, height_px]: [u32; 2]| format!("{width_px} x {height_px}");
        Err(Error::corpus(
            &path,
            format!(
                "has images of {} px, expected {} px as in {CALIBRATION}; generate the scenario again",
                size(found),
                size(expected)
            ),
        ))
    }

    /// A view's image at a tick, from its sealed video.
    ///
    /// # Errors
    /// The video cannot be opened or decoded, or has no such image.
    pub fn picture(&self, view: &str, tick: u32) -> Result<RgbPicture> {
        let pts = self.record()?.frame_rate.pts_of_tick(tick);
        self.open_video(view)?.picture_at(pts)?.ok_or_else(|| {
            Error::corpus(
                self.folder.root(),
                format!("the video of view {view} has no image of tick {tick}"),
            )
        })
    }

    /// The file of the view's video, after reading and checking it against the seal.
    ///
    /// # Errors
    /// There is none, or it does not match the seal.
    pub fn video_path(&self, view: &str) -> Result<PathBuf> {
        self.sealed.check(self.video_name(view)?)
    }

    /// Rejects a scenario whose video of the view is missing or differs in size from the sealed one, without reading it.
    ///
    /// # Errors
    /// There is none, or it differs.
    pub fn check_video_unread(&self, view: &str) -> Result<()> {
        self.sealed.check_unread(self.video_name(view)?).map(drop)
    }

    /// Opens a view's video for its packets, after checking it against the seal.
    ///
    /// # Errors
    /// There is none, it does not match the seal, it is not H.264, or it cannot be read.
    pub fn open_packets(&self, view: &str) -> Result<PacketReader> {
        PacketReader::open(&self.video_path(view)?, self.record()?.frame_rate)
    }

    /// Copies a view's video, and checks the copy against the seal.
    ///
    /// # Errors
    /// There is none, it does not match the seal, or the copy cannot be written.
    pub fn copy_video(&self, view: &str, to: &Path) -> Result<()> {
        let name = self.video_name(view)?;
        let from = self.sealed.check(name)?;
        fs::copy(&from, to).map_err(Error::io("copy to", to))?;
        if self.sealed.hash_of(name) == Some(&hash_file(to)?) {
            return Ok(());
        }
        Err(Error::corpus(&from, "changed while it was copied"))
    }

    /// Name of the view's video within the scenario.
    ///
    /// # Errors
    /// There is none.
    pub fn video_name(&self, view: &str) -> Result<&str> {
        self.sealed.video_of(view).ok_or_else(|| {
            let is_recorded = self.record().is_ok_and(|record| record.recorded.is_some());
            let fault = if is_recorded {
                format!("has no video of view {view}: it was imported from tables")
            } else {
                format!("has no sealed video of view {view}; generate the scenario again")
            };
            Error::corpus(self.folder.root(), fault)
        })
    }

    fn content(&self, name: &'static str) -> Result<&[u8]> {
        self.contents.get(name).map(Vec::as_slice).ok_or_else(|| {
            Error::corpus(
                self.folder.root(),
                format!("has no sealed {name}; generate the scenario again"),
            )
        })
    }
}

fn kind_of(name: &'static str) -> FileKind {
    let kind = if name.ends_with(".json") {
        FileKind::json(name)
    } else {
        FileKind::TABLE
    };
    kind.unlinked()
}

/// Column and text of a row fault.
pub type RowFault = (&'static str, String);

fn refuse_faults(path: &Path, faults: impl Iterator<Item = Option<RowFault>>) -> Result<()> {
    let mut rows = faults.enumerate();
    match rows.find_map(|(row, fault)| Some((row, fault?))) {
        None => Ok(()),
        Some((row, (column, fault))) => Err(Error::corpus(
            path,
            format!(
                "row {row}: {column} {fault}; run `dtd detect` on the corpus with that model again"
            ),
        )),
    }
}

/// Fault of rows outside the scenario's images.
pub fn fault_of(tick: u32, view: &String, record: &ScenarioRecord) -> Option<RowFault> {
    fault_of_picture(tick, "view", view, record)
}

/// Fault of registrations outside the scenario's images, or between a view and itself.
pub fn fault_of_registration(
    registration: &Registration,
    record: &ScenarioRecord,
) -> Option<RowFault> {
    let Registration {
        tick,
        view,
        reference,
        ..
    } = registration;
    fault_of_picture(*tick, "view", view, record)
        .or_else(|| fault_of_picture(*tick, "reference", reference, record))
        .or_else(|| {
            let message = || format!("{reference} is the view itself, expected another one");
            (view == reference).then(|| ("reference", message()))
        })
}

fn fault_of_picture(
    tick: u32,
    column: &'static str,
    view: &String,
    record: &ScenarioRecord,
) -> Option<RowFault> {
    if tick >= record.ticks {
        let message = format!("is {tick}, expected below {}", record.ticks);
        return Some(("tick", message));
    }
    (!record.views.contains(view))
        .then(|| (column, format!("{view} is not a view of the scenario")))
}
