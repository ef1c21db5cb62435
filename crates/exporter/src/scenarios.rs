//! The scenarios to export, as they were sealed: which of them, their boxes and their decoded images.

mod labelled_box;
mod pictures;
mod selection;
mod source;

pub(crate) use labelled_box::{LabelledBox, TruthFigures};
pub(crate) use pictures::ViewPictures;
pub use selection::LostScenario;
pub(crate) use selection::{Selected, select, sides, some_of};
pub(crate) use source::{Source, is_searched};
