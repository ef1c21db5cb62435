//! Formats of other tools, a file per format: what each can express, and its files.

mod coco;
mod huggingface;
mod mcap_files;
mod picture_files;
mod webdataset;
mod yolo;

use crate::file_format::FileFormat;
use crate::request::{BoxUse, Format};

pub(crate) fn implementation(format: Format) -> Box<dyn FileFormat> {
    match format {
        Format::Coco => Box::new(coco::Coco),
        Format::Yolo => Box::new(yolo::Yolo),
        Format::HuggingFace => Box::<huggingface::HuggingFace>::default(),
        Format::WebDataset => Box::new(webdataset::WebDataset),
        Format::Crops => Box::new(webdataset::crops::Crops),
        Format::Mcap => Box::new(mcap_files::Mcap),
    }
}

impl Format {
    /// The reason why images of the selection are left out, as a clause about them.
    pub fn left_out(self) -> &'static str {
        if implementation(self).abilities().boxes == BoxUse::Crops {
            "of ticks at which a view has no box"
        } else {
            "whose aircraft may be hidden by a cloud or is mostly outside, which the format cannot say"
        }
    }
}
