//! The `ffmpeg` program as an encoder of raw images: for settings that ours does not offer, and for comparing rates.

use std::path::Path;
use std::process::Command;

use super::scenery::{HEIGHT_PX, WIDTH_PX};

/// A command that encodes a file of raw RGB images on one thread, in the same groups and fragments as our encoder. `yuv`: pixel format
/// and range (`tv` or `pc`) to which BT.709 is converted first, with the same switches of swscale; without it RGB is encoded.
pub(crate) fn encode(
    raw: &Path,
    yuv: Option<(&str, &str)>,
    encoder: &[&str],
    to: &Path,
) -> Command {
    let size = format!("{WIDTH_PX}x{HEIGHT_PX}");
    let mut command = Command::new("ffmpeg");
    command
        .args(["-v", "error", "-nostdin", "-y", "-f", "rawvideo"])
        .args(["-pixel_format", "rgb24", "-video_size", &size])
        .args(["-framerate", "30", "-i"])
        .arg(raw)
        .args(["-threads", "1", "-filter_threads", "1", "-g", "60"])
        .args(["-bf", "0"]);
    if let Some((pixel_format, range)) = yuv {
        let conversion = format!(
            "scale=out_color_matrix=bt709:out_range={range}:flags=bilinear+accurate_rnd+full_chroma_int+full_chroma_inp,format={pixel_format}"
        );
        command
            .args(["-vf", &conversion])
            .args(["-colorspace", "bt709", "-color_range", range]);
    }
    command
        .args(encoder)
        .args(["-color_primaries", "bt709", "-color_trc", "bt709"])
        .args(["-video_track_timescale", "30", "-use_editlist", "0"])
        .args(["-movflags", "frag_every_frame+empty_moov+default_base_moof"])
        .args(["-flush_packets", "1", "-f", "mp4"])
        .arg(to);
    command
}
