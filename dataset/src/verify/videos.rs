//! The videos: every picture can be decoded, and there is exactly one per tick at exactly its time.

use std::path::Path;
use std::thread;

use super::Faults;
use crate::calibration::Calibration;
use crate::corpus::ScenarioFolder;
use crate::scenario::ScenarioRecord;
use crate::video::VideoReader;

/// Checks all videos of a scenario, side by side; returns how many pictures were decoded.
pub(super) fn check(
    folder: &ScenarioFolder,
    record: &ScenarioRecord,
    calibration: Option<&Calibration>,
    faults: &mut Faults,
) -> u64 {
    let read: Vec<(&String, Decoded)> = thread::scope(|scope| {
        let threads: Vec<_> = record
            .views
            .iter()
            .map(|view| {
                let path = folder.video_path(view);
                (view, scope.spawn(move || decode(&path)))
            })
            .collect();
        let join = |(view, thread): (_, thread::ScopedJoinHandle<'_, Decoded>)| {
            let broke_down = || Decoded {
                fault: Some("the decoder broke down".into()),
                ..Decoded::default()
            };
            (view, thread.join().unwrap_or_else(|_| broke_down()))
        };
        threads.into_iter().map(join).collect()
    });
    let mut pictures = 0;
    for (view, decoded) in read {
        pictures += decoded.pts.len() as u64;
        judge(view, &decoded, record, calibration, faults);
    }
    pictures
}

/// What is in a video file.
#[derive(Default)]
struct Decoded {
    size_px: Option<(u32, u32)>,
    time_base: Option<(u32, u32)>,
    pts: Vec<i64>,
    /// Why decoding stopped before the end.
    fault: Option<String>,
}

fn decode(path: &Path) -> Decoded {
    let mut decoded = Decoded::default();
    let mut read = || -> crate::Result<()> {
        let mut reader = VideoReader::open(path)?;
        decoded.size_px = Some((reader.width(), reader.height()));
        decoded.time_base = Some(reader.time_base());
        while let Some(pts) = reader.skip_frame()? {
            decoded.pts.push(pts);
        }
        Ok(())
    };
    let result = read();
    decoded.fault = result.err().map(|error| error.to_string());
    decoded
}

fn judge(
    view: &str,
    decoded: &Decoded,
    record: &ScenarioRecord,
    calibration: Option<&Calibration>,
    faults: &mut Faults,
) {
    let file = format!("views/{view}.mp4");
    if let Some(fault) = &decoded.fault {
        faults.file(&file, fault);
    }
    let camera = calibration.and_then(|calibration| calibration.cameras.get(view));
    if let (Some(found), Some(camera)) = (decoded.size_px, camera)
        && found != (camera.width_px, camera.height_px)
    {
        let (width, height) = found;
        let expected = format!("{}x{}", camera.width_px, camera.height_px);
        faults.file(
            &file,
            format!("pictures have {width}x{height} pixels, calibration.json says {expected}"),
        );
    }
    let expected = (1, record.frame_rate.time_scale());
    if let Some(found) = decoded.time_base.filter(|found| *found != expected) {
        faults.file(
            &file,
            format!(
                "time base is {}/{}, expected {}/{}",
                found.0, found.1, expected.0, expected.1
            ),
        );
    }
    if decoded.fault.is_none() && decoded.pts.len() != record.ticks as usize {
        faults.file(
            &file,
            format!(
                "has {} pictures, but scenario.json says {} ticks",
                decoded.pts.len(),
                record.ticks
            ),
        );
    }
    for (tick, pts) in decoded.pts.iter().enumerate() {
        let expected = record.frame_rate.pts_of_tick(tick as u32);
        if *pts != expected {
            faults.row(
                &file,
                tick,
                "timestamp",
                format!("is {pts}, expected {expected}"),
            );
        }
    }
}
