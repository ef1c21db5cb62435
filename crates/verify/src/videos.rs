//! The videos: every image can be decoded, and there is exactly one per tick at exactly its time.

use std::path::{Path, PathBuf};
use std::thread;

use super::pixels::{PairProof, Scenario, ViewProof, Watcher, judge_lags};
use crate::faults::Faults;
use dataset::corpus::ScenarioFolder;
use dataset::corpus::seal::sealed::Sealed;
use dataset::video::{TimeBase, VideoReader};
use dataset::work::watch::Watch;

/// Evidence from a scenario's videos.
#[derive(Default)]
pub(super) struct Proofs {
    /// Images decoded.
    pub(super) pictures: u64,
    pub(super) views: Vec<ViewProof>,
    pub(super) pairs: Vec<PairProof>,
}

/// Checks all videos, in parallel.
pub(super) fn check(
    folder: &ScenarioFolder,
    scenario: &Scenario,
    faults: &mut Faults,
    watch: &dyn Watch,
) -> Proofs {
    let sealed = Sealed::read(folder.root()).ok().flatten();
    let read: Vec<(&String, PathBuf, Decoded)> = thread::scope(|scope| {
        let threads: Vec<_> = scenario
            .record
            .views
            .iter()
            .map(|view| {
                // The sealed video, if the seal can be read; a stray file with a different extension is reported as such.
                let sealed = sealed.as_ref().and_then(|sealed| sealed.video_of(view));
                let path =
                    sealed.map_or_else(|| folder.video_path(view), |name| folder.root().join(name));
                let watcher = Watcher::new(view, scenario);
                let decoded = scope.spawn({
                    let path = path.clone();
                    move || decode(&path, watcher, watch)
                });
                (view, path, decoded)
            })
            .collect();
        threads
            .into_iter()
            .map(|(view, path, thread)| {
                let decoded = thread.join().unwrap_or_else(|_| Decoded {
                    fault: Some("the decoder broke down".into()),
                    ..Decoded::default()
                });
                (view, path, decoded)
            })
            .collect()
    });
    let mut proofs = Proofs::default();
    let mut measured = Vec::new();
    for (view, path, mut decoded) in read {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let file = format!("views/{name}");
        proofs.pictures += decoded.pts.len() as u64;
        let watcher = decoded.watcher.take();
        judge(view, &file, &decoded, scenario, faults);
        if let Some(watcher) = watcher.filter(Watcher::is_needed) {
            let (proof, lag) = watcher.judge(&file, faults);
            measured.extend(lag);
            proofs.views.push(ViewProof {
                scenario: folder.id(),
                ..proof
            });
        }
    }
    proofs.pairs = judge_lags(scenario, &measured, faults);
    proofs
}

/// Content of the video file.
#[derive(Default)]
struct Decoded<'a> {
    size_px: Option<(u32, u32)>,
    time_base: Option<TimeBase>,
    /// Timestamps, in units of the time base.
    pts: Vec<i64>,
    /// Reason why decoding stopped before the end.
    fault: Option<String>,
    watcher: Option<Watcher<'a>>,
}

/// Decodes a video, or a part if the watch stops the work: the caller then drops the result.
fn decode<'a>(path: &Path, mut watcher: Watcher<'a>, watch: &dyn Watch) -> Decoded<'a> {
    let mut decoded = Decoded::default();
    let mut rgb = Vec::new();
    let mut read = |watcher: &mut Watcher| -> dataset::error::Result<()> {
        let mut reader = VideoReader::open(path)?;
        let (width_px, height_px) = (reader.width(), reader.height());
        decoded.size_px = Some((width_px, height_px));
        decoded.time_base = Some(reader.time_base());
        while !watch.is_stopped() {
            let next = if watcher.is_needed() {
                reader.next_frame(&mut rgb)
            } else {
                reader.skip_frame()
            };
            let Some(pts) = next? else { return Ok(()) };
            decoded.pts.push(pts);
            if watcher.is_needed() {
                watcher.see(&rgb, width_px, height_px);
            }
        }
        Ok(())
    };
    let result = read(&mut watcher).and_then(|()| look_again(path, &mut watcher, watch));
    decoded.fault = result.err().map(|error| error.beside(path));
    decoded.watcher = Some(watcher);
    decoded
}

/// Compares images that seem to be of a different tick or view with all others.
fn look_again(path: &Path, watcher: &mut Watcher, watch: &dyn Watch) -> dataset::error::Result<()> {
    if !watcher.wants_second_look() {
        return Ok(());
    }
    let mut reader = VideoReader::open(path)?;
    let (width_px, height_px) = (reader.width(), reader.height());
    let mut rgb = Vec::new();
    let mut tick = 0;
    while !watch.is_stopped() && reader.next_frame(&mut rgb)?.is_some() {
        watcher.see_again(tick, &rgb, width_px, height_px);
        tick += 1;
    }
    Ok(())
}

fn judge(view: &str, file: &str, decoded: &Decoded, scenario: &Scenario, faults: &mut Faults) {
    let record = scenario.record;
    if let Some(fault) = &decoded.fault {
        faults.view(file, view, fault);
    }
    let cameras = scenario.calibration.map(|calibration| &calibration.cameras);
    let camera = cameras.and_then(|cameras| cameras.get(view));
    if let (Some(found), Some(camera)) = (decoded.size_px, camera)
        && found != (camera.width_px, camera.height_px)
    {
        let (width, height) = found;
        let expected = format!("{}x{}", camera.width_px, camera.height_px);
        faults.view(
            file,
            view,
            format!("images have {width}x{height} pixels, calibration.json says {expected}"),
        );
    }
    if decoded.fault.is_none() && decoded.pts.len() != record.ticks as usize {
        faults.view(
            file,
            view,
            format!(
                "has {} images, but scenario.json says {} ticks",
                decoded.pts.len(),
                record.ticks
            ),
        );
    }
    let unit = TimeBase::of_ticks(record.frame_rate);
    let time_base = decoded.time_base.unwrap_or(unit);
    for (tick, pts) in decoded.pts.iter().enumerate() {
        let expected = record.frame_rate.pts_of_tick(tick as u32);
        if time_base.convert(*pts, unit) != Some(expected) {
            faults.view_row(
                view,
                file,
                tick,
                "timestamp",
                format!("is {pts} in units of {time_base}, expected {expected} in units of {unit}"),
            );
        }
    }
}
