//! Single images as files.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use dataset::video::jpeg;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The form of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StillFormat {
    /// Exactly the decoded pixels.
    #[default]
    Png,
    /// A fifth of the size, with losses.
    Jpeg,
}

impl StillFormat {
    /// File suffix.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg => "jpg",
        }
    }

    /// Writes an image; `rgb` has rows from top to bottom without gaps.
    pub(crate) fn write(self, path: &Path, rgb: &[u8], size_px: [u32; 2]) -> Result<()> {
        let file = File::create(path).map_err(dataset::Error::io("create", path))?;
        let mut file = BufWriter::new(file);
        self.encode(&mut file, path, rgb, size_px)?;
        Ok(file.flush().map_err(dataset::Error::io("write", path))?)
    }

    /// Encodes an image for the file at `path`.
    pub(crate) fn encode(
        self,
        to: &mut impl Write,
        path: &Path,
        rgb: &[u8],
        [width, height]: [u32; 2],
    ) -> Result<()> {
        match self {
            Self::Png => PngEncoder::new_with_quality(to, CompressionType::Fast, FilterType::Up)
                .write_image(rgb, width, height, ExtendedColorType::Rgb8)
                .map_err(|source| Error::Encode {
                    path: path.to_owned(),
                    source,
                }),
            Self::Jpeg => {
                let bytes = jpeg(path, rgb, [width, height])?;
                Ok(to
                    .write_all(&bytes)
                    .map_err(dataset::Error::io("write", path))?)
            }
        }
    }
}
