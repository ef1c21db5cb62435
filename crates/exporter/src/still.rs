//! Single images as files.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Quality of JPEG images, of 100: 40x3 px of aircraft stay within two grey levels.
const JPEG_QUALITY: u8 = 95;
/// Colours at half the columns and rows, as the videos have them.
const JPEG_COLOURS: SamplingFactor = SamplingFactor::R_4_2_0;

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
        let failed = |cause| Error::Encode {
            path: path.to_owned(),
            cause,
        };
        match self {
            Self::Png => PngEncoder::new_with_quality(to, CompressionType::Fast, FilterType::Up)
                .write_image(rgb, width, height, ExtendedColorType::Rgb8)
                .map_err(|e| failed(e.into())),
            Self::Jpeg => {
                let side = |pixels: u32| u16::try_from(pixels).map_err(|e| failed(e.into()));
                let mut encoder = Encoder::new(to, JPEG_QUALITY);
                encoder.set_sampling_factor(JPEG_COLOURS);
                encoder
                    .encode(rgb, side(width)?, side(height)?, ColorType::Rgb)
                    .map_err(|e| failed(e.into()))
            }
        }
    }
}
