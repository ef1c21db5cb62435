//! Our encoder compared with the `ffmpeg` program: the same raw images, the same settings, alternating in one run.
//!
//! `benches/encoder.sh` runs it. It compares wall-clock rates, best of all rounds, and processor time, which is also valid on a
//! busy machine. Both read the same file of raw images from the page cache, convert them to BT.709 with the same switches of
//! swscale, encode on one thread and write the same fragments; ours adds the index at the end. Rounds alternate, so that a busy
//! machine is busy for both.

#[path = "video/ffmpeg_program.rs"]
mod ffmpeg_program;
#[path = "video/scenery.rs"]
mod scenery;

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{VideoCodec, VideoReader, VideoSettings, VideoWriter};
use scenery::{HEIGHT_PX, Scenery, WIDTH_PX, cloudy};
use testkit::processor_time;

const ROUNDS: usize = 5;
/// Target of the ratio.
const GOAL: f64 = 0.95;
/// Equal to `crates/dataset/src/video/writer.rs`.
const X264_PARAMETERS: &str = "deadzone-inter=0:deadzone-intra=0";
const RATE: FrameRate = FrameRate {
    numerator: 30,
    denominator: 1,
};

fn main() {
    let folder = tempfile::tempdir().expect("a folder for images and videos");
    let raw = folder.path().join("pictures.rgb");
    let pictures = 120;
    write_pictures(&raw, pictures);
    println!("{pictures} images of {WIDTH_PX}x{HEIGHT_PX}, {ROUNDS} rounds, best of each");
    println!(
        "| codec | ours, images/s | ffmpeg, images/s | ratio of the bests | ratios of the rounds | CPU ms per image, ours and ffmpeg's | ratio | bytes, ours and ffmpeg's |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for codec in [VideoCodec::H264, VideoCodec::H264Lossless] {
        let settings = VideoSettings::of(codec);
        let ours = folder.path().join("ours.mp4");
        let theirs = folder.path().join("theirs.mp4");
        let (mut best_ours, mut best_theirs) = (0.0_f64, 0.0_f64);
        let mut ratios = Vec::new();
        let mut cpu = [Duration::ZERO; 2];
        for round in 0..ROUNDS {
            let ours = || encode(&raw, pictures, &settings, &ours);
            let theirs = || run_ffmpeg(&raw, pictures, &settings, &theirs);
            // The order alternates from round to round.
            let (a, b) = if round % 2 == 0 {
                let a = counted(&mut cpu, 0, ours);
                (a, counted(&mut cpu, 1, theirs))
            } else {
                let b = counted(&mut cpu, 1, theirs);
                (counted(&mut cpu, 0, ours), b)
            };
            best_ours = best_ours.max(a);
            best_theirs = best_theirs.max(b);
            ratios.push(format!("{:.2}", a / b));
        }
        check_same(&ours, &theirs);
        let cpu_ms =
            |cpu: Duration| cpu.as_secs_f64() * 1e3 / (ROUNDS as f64 * f64::from(pictures));
        let bytes = |path: &Path| std::fs::metadata(path).expect("the video is there").len();
        let ratio = best_ours / best_theirs;
        println!(
            "| {codec:?} {} | {best_ours:.1} | {best_theirs:.1} | {ratio:.3} | {} | {:.1}, {:.1} | {:.3} | {}, {} |",
            settings.preset,
            ratios.join(" "),
            cpu_ms(cpu[0]),
            cpu_ms(cpu[1]),
            cpu[1].as_secs_f64() / cpu[0].as_secs_f64(),
            bytes(&ours),
            bytes(&theirs)
        );
        assert!(
            ratio >= GOAL,
            "{codec:?}: {ratio:.3} of the ffmpeg program's rate, expected at least {GOAL}"
        );
    }
}

/// Does the work, and adds its processor time to that of one of both: 0 is this process, 1 its children.
fn counted(cpu: &mut [Duration; 2], whose: usize, work: impl FnOnce() -> f64) -> f64 {
    let before = processor_time::own_and_children()[whose];
    let rate = work();
    cpu[whose] += processor_time::own_and_children()[whose] - before;
    rate
}

fn write_pictures(path: &Path, pictures: u32) {
    let scenery = Scenery::new(&cloudy(), 12.0);
    let mut file = File::create(path).expect("the images' file");
    for number in 0..pictures {
        file.write_all(&scenery.picture(number))
            .expect("an image is written");
    }
}

/// Images per second of our encoder.
fn encode(raw: &Path, pictures: u32, settings: &VideoSettings, path: &Path) -> f64 {
    let began = Instant::now();
    let mut file = BufReader::with_capacity(1 << 20, File::open(raw).expect("the images"));
    let mut rgb = vec![0; WIDTH_PX as usize * HEIGHT_PX as usize * 3];
    let mut writer =
        VideoWriter::create(path, settings, WIDTH_PX, HEIGHT_PX, RATE).expect("the encoder");
    for _ in 0..pictures {
        file.read_exact(&mut rgb).expect("an image");
        writer.write(&rgb).expect("an image is encoded");
    }
    writer.finish().expect("the video is finished");
    f64::from(pictures) / began.elapsed().as_secs_f64()
}

/// Images per second of the `ffmpeg` program.
fn run_ffmpeg(raw: &Path, pictures: u32, settings: &VideoSettings, path: &Path) -> f64 {
    let crf = settings.crf.to_string();
    let (yuv, encoder) = if settings.codec == VideoCodec::H264 {
        let encoder = ["libx264", "-x264-params", X264_PARAMETERS, "-crf", &crf];
        (Some(("yuv420p", "pc")), encoder.to_vec())
    } else {
        (None, vec!["libx264rgb", "-qp", "0"])
    };
    let common = ["-preset", &settings.preset, "-tune", "zerolatency", "-c:v"];
    let arguments = [&common[..], &encoder].concat();
    let mut command = ffmpeg_program::encode(raw, yuv, &arguments, path);
    let began = Instant::now();
    let status = command
        .status()
        .expect("the ffmpeg program (apt-get install ffmpeg)");
    let elapsed_s = began.elapsed().as_secs_f64();
    assert!(status.success(), "ffmpeg ended with {status}");
    f64::from(pictures) / elapsed_s
}

/// The comparison is fair only if both made the same images.
fn check_same(ours: &Path, theirs: &Path) {
    let mut readers = [ours, theirs].map(|path| VideoReader::open(path).expect("the video opens"));
    let mut pictures = [Vec::new(), Vec::new()];
    loop {
        let [a, b] = [0, 1].map(|side| {
            readers[side]
                .next_frame(&mut pictures[side])
                .expect("an image")
        });
        assert_eq!(a, b, "timestamps differ");
        if a.is_none() {
            return;
        }
        assert!(
            pictures[0] == pictures[1],
            "the images at {a:?} differ: the settings are not the same"
        );
    }
}
