//! Trial of the user's encoder, before a night depends on it.

use std::time::Instant;

use dataset::plan::Common;
use dataset::video::{TRIAL_PICTURES, VideoEncoder, try_encoder};
use tokio::task::spawn_blocking;

use crate::generate::error::GenerateError;
use crate::generate::event::Reporter;

/// Tries an encoder with the sweep's images, in a temporary folder.
///
/// # Errors
/// [`GenerateError::BadInput`] with the fault and what to do.
pub(crate) async fn pass(
    common: &Common,
    encoder: VideoEncoder,
    reporter: &Reporter<'_>,
) -> Result<(), GenerateError> {
    let began = Instant::now();
    let (picture, video) = (common.picture, common.video.clone());
    let name = encoder.of_codec(video.codec).unwrap_or(encoder.name());
    let tried = spawn_blocking(move || {
        let folder = tempfile::tempdir().map_err(|source| dataset::Error::Io {
            action: "create",
            path: std::env::temp_dir(),
            source,
        })?;
        let size_px = (picture.width_px, picture.height_px);
        try_encoder(folder.path(), &video, encoder, size_px, picture.frame_rate)
    });
    match tried.await {
        Ok(Ok(())) => {
            reporter.say(&format!(
                "encoder {name}: {TRIAL_PICTURES} images, and again without an end, in {:.1} s; order, timestamps, colours and what a kill \
                 leaves are right",
                began.elapsed().as_secs_f64()
            ));
            Ok(())
        }
        Ok(Err(fault)) => Err(GenerateError::BadInput(format!(
            "encoder {name} was tried with {TRIAL_PICTURES} images and is not used: {fault}. It needs {}. Nothing was recorded; record \
             without --encoder, which encodes on the processor, or choose another",
            encoder.needs()
        ))),
        Err(panic) => Err(GenerateError::EncoderTrial(panic)),
    }
}
