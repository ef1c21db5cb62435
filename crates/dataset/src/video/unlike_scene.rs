//! Videos that do not show the scene pixel by pixel: turned, stretched, interlaced. Simulators make none, cameras and phones do.

use ffmpeg_next::codec::packet::side_data::Type as PacketData;
use ffmpeg_next::util::frame::side_data::Type as FrameData;
use ffmpeg_next::{Stream, frame};

const TURNED: &str = "its images are to be shown turned or mirrored, which is not done here; turn them in the camera, or convert the file \
    with `ffmpeg -i FILE .. OUT.mp4`, which turns the images";

/// Reason why a stream's images cannot be taken as they are coded: they are to be shown turned or mirrored.
pub fn turned(stream: &Stream<'_>) -> Option<&'static str> {
    let mut data = stream.side_data();
    data.any(|data| data.kind() == PacketData::DisplayMatrix)
        .then_some(TURNED)
}

/// Reason why an image does not show the scene pixel by pixel.
pub fn unlike_the_scene(coded: &frame::Video) -> Option<&'static str> {
    let aspect = coded.aspect_ratio();
    if coded.side_data(FrameData::DisplayMatrix).is_some() {
        Some(TURNED)
    } else if aspect.numerator() != 0 && aspect.numerator() != aspect.denominator() {
        Some("its pixels are not square; set the camera to a size with the sensor's aspect ratio")
    } else if coded.is_interlaced() {
        Some("its images are interlaced; set the camera to progressive images")
    } else {
        None
    }
}
