//! The paper's own experiment, as far as no other crate has it: the share of ticks that one view alone sees, the paper's figures, and the
//! page that compares all of it with the paper.
//!
//! Input: the corpus of `paper.toml` with detections, and evaluations of detectors and estimators on it. Output: [`Results`]
//! (`results/paper.json`), figures (`images/paper/`), and a page in Markdown (`paper.md`). The page follows from the results alone.

#![forbid(unsafe_code)]

mod error;
mod figures;
mod page;
mod published;
mod results;
mod single_views;

pub use error::{Error, Result};
pub use figures::write_figures;
pub use page::markdown;
pub use published::SINGLE_VIEW_SHARE;
pub use results::{CorpusFigures, Range, Results, Search, StageTime, WeakerDetector};
pub use single_views::{SeenTicks, Share, SingleViews};
