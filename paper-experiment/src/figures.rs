//! The figures of the paper, from our corpus and run: `images/paper/`.

mod drawing;
mod frame;
mod profile;

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::files::json_file::write_atomically;
use trainer::{Metrics, RunFolder};

use crate::error::Result;
use crate::page::{CONCEPT, CONVERGENCE, ERRORS, FRAME, IMAGES, PROFILE, SEGMENTATION};
use frame::Shown;

const CONCEPT_SVG: &str = include_str!("figures/concept.svg");

/// Writes all figures into `folder`. `detections` names the detector whose boxes are drawn; `charted` are estimators of the box plot.
///
/// # Errors
/// The corpus or the run cannot be read, or shows no aircraft near 6 NM.
pub fn write_figures(
    folder: &Path,
    corpus: &Corpus,
    detections: &str,
    (run, metrics): (&RunFolder, &Metrics),
    charted: &[&str],
) -> Result<()> {
    let images = folder.join(IMAGES);
    fs::create_dir_all(&images).map_err(dataset::Error::io("create", &images))?;
    let write = |name: &str, content: &[u8]| write_atomically(&images.join(name), content);
    let shown = Shown::choose(corpus, detections)?;
    write(CONCEPT, CONCEPT_SVG.as_bytes())?;
    write(FRAME, &shown.with_trajectory()?)?;
    let profile = profile::chart(&shown.rows, shown.to_threshold_m);
    write(PROFILE, profile.as_bytes())?;
    write(SEGMENTATION, &shown.with_tiles()?)?;
    write(CONVERGENCE, trainer::figures::convergence(run)?.as_bytes())?;
    let errors = trainer::figures::errors_by_distance(metrics, charted);
    write(ERRORS, errors.as_bytes())?;
    Ok(())
}
