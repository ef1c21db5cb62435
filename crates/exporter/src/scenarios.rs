//! The scenarios to export, as they were sealed: selection, boxes and decoded images.

mod labelled_box;
mod pictures;
mod selection;
mod source;
mod tick_values;

pub(crate) use labelled_box::{LabelledBox, TruthFigures};
pub(crate) use pictures::ViewPictures;
pub use selection::LostScenario;
pub(crate) use selection::{Selected, select, some_of};
pub(crate) use source::{Source, is_searched};
pub(crate) use tick_values::{FLOWN, LABELLED};
