//! Memory of an export by the number of scenarios: more scenarios take far less additional memory than their images.

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::numbers::frame_rate::FrameRate;
use dataset::work::watch::Silent;
use exporter::{ExportRequest, Format, export};
use testkit::peak::peak_bytes;
use testkit::short_corpus;

const SIZE_PX: [u32; 2] = [640, 384];
const TICKS: u32 = 12;
const VIEWS: u32 = 2;
const MIB: f64 = (1 << 20) as f64;
/// Threads begin and end, and their allocators keep what they freed.
const MAX_GROWTH_MIB: f64 = 20.0;

/// Labelled flights, whose images are noise in their upper half: coded, they are nearly half as large as in memory.
fn corpus(root: &Path, scenarios: u32) -> Corpus {
    let mut state = 1_u32;
    for number in 0..scenarios {
        let noise = std::cell::Cell::new(state);
        let paint = |_: &str, _: u32, rgb: &mut [u8]| {
            let (upper, lower) = rgb.split_at_mut(rgb.len() / 2);
            lower.fill(128);
            for value in upper {
                let next = noise
                    .get()
                    .wrapping_mul(1_664_525)
                    .wrapping_add(1_013_904_223);
                noise.set(next);
                *value = (next >> 24) as u8;
            }
        };
        let rate = FrameRate::new(1, 1).unwrap();
        let id = format!("{number:04}-noise");
        short_corpus::write_flight(root, &id, SIZE_PX, rate, TICKS, &paint);
        state = noise.get();
    }
    let corpus = Corpus::open(root).unwrap();
    labeller::label_corpus(&corpus, &Silent).unwrap();
    corpus
}

/// The only test of this file: memory is measured for the whole process.
#[test]
fn more_scenarios_take_hardly_more_memory_in_any_format() {
    let folder = tempfile::tempdir().unwrap();
    let sizes = [1, 7];
    let corpora = sizes.map(|size| corpus(&folder.path().join(format!("corpus-{size}")), size));
    let picture_bytes = f64::from(SIZE_PX[0] * SIZE_PX[1] * 3);
    let added_mib = f64::from((sizes[1] - sizes[0]) * TICKS * VIEWS) * picture_bytes / MIB;
    assert!(
        added_mib > 5.0 * MAX_GROWTH_MIB,
        "{added_mib} MiB of images, about half of it when coded"
    );
    for format in [
        Format::Coco,
        Format::Yolo,
        Format::HuggingFace,
        Format::WebDataset,
        Format::Crops,
        Format::Mcap,
    ] {
        let mut peaks = Vec::new();
        for (size, corpus) in sizes.iter().zip(&corpora) {
            let out = folder.path().join(format!("{format:?}-{size}"));
            let run = || {
                export(corpus, &ExportRequest::whole(format), &out, &Silent).unwrap();
            };
            peaks.push(peak_bytes(run) / MIB);
            fs::remove_dir_all(&out).unwrap();
        }
        println!("{format:?}: {:.0} MiB, {:.0} MiB", peaks[0], peaks[1]);
        assert!(
            peaks[1] - peaks[0] < MAX_GROWTH_MIB,
            "{format:?}: {peaks:?} MiB, {added_mib:.0} MiB of images more"
        );
    }
}
