//! A scenario's samples: at each tick an image per view, and a JSON file with their metadata.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use dataset::geometry::pose::Pose;
use dataset::tables::frames::TickRow;
use serde::Serialize;

use super::archive::{self, SampleFile};
use crate::about::split_of;
use crate::error::Result;
use crate::file_format::Writing;
use crate::scenarios::{LabelledBox, Source, TruthFigures, ViewPictures};

/// Tick metadata.
#[derive(Serialize)]
struct Sample<'a, V> {
    scenario: &'a str,
    tick: u32,
    time_ns: i64,
    weather: &'a str,
    time_of_day: &'a str,
    split: &'static str,
    dtd_m: Option<f64>,
    along_track_m: Option<f64>,
    cross_track_m: Option<f64>,
    height_over_target_m: Option<f64>,
    time_to_touchdown_s: Option<f64>,
    pose: Pose,
    views: BTreeMap<&'a str, V>,
}

impl<'a, V> Sample<'a, V> {
    fn of(source: &'a Source<'_>, row: &TickRow, views: BTreeMap<&'a str, V>) -> Self {
        let labels = row.labels.as_ref();
        Self {
            scenario: &source.record.id,
            tick: row.tick,
            time_ns: row.time_ns,
            weather: source.record.weather_name(),
            time_of_day: source.record.time_of_day(),
            split: split_of(source.selected.side),
            dtd_m: labels.map(|labels| labels.dtd_m),
            along_track_m: labels.map(|labels| labels.along_track_m),
            cross_track_m: labels.map(|labels| labels.cross_track_m),
            height_over_target_m: labels.map(|labels| labels.height_over_target_m),
            time_to_touchdown_s: labels.and_then(|labels| labels.time_to_touchdown_s),
            pose: row.pose,
            views,
        }
    }
}

/// A box as left, top, width and height from the outer corner of the top-left pixel.
#[derive(Serialize)]
pub(super) struct LabelledCorners {
    bbox: [f64; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    truth: Option<TruthFigures>,
}

impl LabelledCorners {
    /// The box relative to a crop's top-left pixel.
    pub(super) fn within([left_px, top_px]: [u32; 2], labelled: &LabelledBox) -> Self {
        let [left, top, width, height] = labelled.corner_and_size();
        Self {
            bbox: [
                left - f64::from(left_px),
                top - f64::from(top_px),
                width,
                height,
            ],
            score: labelled.score,
            truth: labelled.truth,
        }
    }
}

/// A view's image in a sample.
pub(super) struct Decoded {
    /// Rows from top to bottom without gaps.
    pub(super) rgb: Vec<u8>,
    /// Width and height.
    pub(super) size_px: [u32; 2],
}

/// Makes a scenario's samples in tick order, and passes each to `append` as archive entries. `show` returns the metadata of a view at a
/// tick, and may cut its image. `path` names their file in messages.
pub(super) fn each_sample<V: Serialize>(
    scenario: &Writing<'_>,
    path: &Path,
    show: impl Fn(&str, u32, &mut Decoded) -> Result<V>,
    mut append: impl FnMut(u32, Vec<u8>) -> Result<()>,
) -> Result<()> {
    let source = &scenario.source;
    let stills = scenario.export.request.stills();
    let views = &source.selected.views;
    let mut decoded = Vec::with_capacity(views.len());
    for view in views {
        decoded.push(ViewPictures::open(source, view)?);
    }
    let mut picture = Decoded {
        rgb: Vec::new(),
        size_px: [0, 0],
    };
    for row in source.rows().filter(|row| source.has_sample(row.tick)) {
        let mut files = Vec::new();
        let mut known = BTreeMap::new();
        for (view, pictures) in views.iter().zip(&mut decoded) {
            scenario.watch.check()?;
            pictures.decode(row)?;
            pictures.convert(&mut picture.rgb)?;
            picture.size_px = pictures.size_px();
            let of_view = show(view, row.tick, &mut picture)?;
            let mut bytes = Vec::new();
            stills.encode(&mut bytes, path, &picture.rgb, picture.size_px)?;
            files.push((format!("{view}.{}", stills.extension()), bytes));
            known.insert(view.as_str(), of_view);
            scenario.pictures_done(1);
        }
        let entries = entries_of(&Sample::of(source, row, known), files);
        append(
            row.tick,
            entries.map_err(dataset::Error::io("write", path))?,
        )?;
    }
    Ok(())
}

fn entries_of<V: Serialize>(
    sample: &Sample<'_, V>,
    mut files: Vec<SampleFile>,
) -> io::Result<Vec<u8>> {
    files.push(("json".into(), serde_json::to_vec(sample)?));
    let key = format!("{}_{:06}", sample.scenario, sample.tick);
    archive::entries(&key, &files)
}
