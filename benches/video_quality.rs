//! The effect of video settings on an aircraft at 10 nautical miles: how far its centre moves and how much of its contrast remains.
//!
//! `cargo bench --bench video_quality` prints the table of `docs/video.md`. Images of the stand-in in full size are encoded and
//! decoded. What the aircraft adds to the backdrop, in the raw image and in the decoded one, is compared by least squares:
//! `decoded(p) = contrast * raw(p - shift)`, to first order in the shift (Lucas and Kanade 1981), on brightness.
//!
//! Before our settings come the pixel formats without any codec, and settings that we do not offer, encoded by the `ffmpeg` program
//! (scripts/setup.sh installs it) and decoded by our reader.

#[path = "video/ffmpeg_program.rs"]
mod ffmpeg_program;
#[path = "video/rounding.rs"]
mod rounding;
#[path = "video/scenery.rs"]
mod scenery;

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{VideoCodec, VideoReader, VideoSettings, VideoWriter};
use glam::{DMat3, DVec2, DVec3};
use rounding::{LUMA, Levels, there_and_back};
use scenery::{HEIGHT_PX, Scenery, WIDTH_PX, clear, cloudy};
use testkit::processor_time;

const PICTURES: u32 = 30;
/// Half the size of the piece of image around the aircraft, pixels: it is 20 wide.
const HALF_PX: (i64, i64) = (16, 10);
const RATE: FrameRate = FrameRate {
    numerator: 30,
    denominator: 1,
};

fn main() {
    let sceneries = [
        ("clear noon", Scenery::new(&clear(), 12.0)),
        ("clear evening", Scenery::new(&clear(), 18.0)),
        ("cloudy noon", Scenery::new(&cloudy(), 12.0)),
    ];
    let folder = tempfile::tempdir().expect("a folder for images and videos");
    let recordings: Vec<Recording> = sceneries
        .into_iter()
        .map(|(name, scenery)| Recording::new(name, &scenery, folder.path()))
        .collect();
    for recording in &recordings {
        println!(
            "{}: the aircraft differs by up to {:.0} grey levels",
            recording.name, recording.peak
        );
    }
    println!(
        "\n| setting | {} | Mbit/s at 30/s | encode, CPU ms | decode, CPU ms |",
        recordings
            .iter()
            .map(|r| format!("{}: centre moves, contrast kept", r.name))
            .collect::<Vec<_>>()
            .join(" | ")
    );
    println!("|---|{}---|---|---|", "---|".repeat(recordings.len()));
    for (name, levels) in PIXEL_FORMATS {
        println!("{}", floor(name, levels, &recordings));
    }
    for variant in VARIANTS {
        println!(
            "{}",
            measure(&Way::Program(variant), &recordings, folder.path())
        );
    }
    for settings in candidates() {
        println!(
            "{}",
            measure(&Way::Ours(settings), &recordings, folder.path())
        );
    }
}

const fn levels(luma: f64, chroma: f64, shared: bool) -> Levels {
    Levels {
        luma,
        chroma,
        shared,
    }
}

const PIXEL_FORMATS: [(&str, Levels); 6] = [
    ("8 bits 4:2:0 limited range", levels(219.0, 224.0, true)),
    ("8 bits 4:4:4 limited range", levels(219.0, 224.0, false)),
    ("8 bits 4:2:0 full range", levels(255.0, 255.0, true)),
    ("8 bits 4:4:4 full range", levels(255.0, 255.0, false)),
    ("10 bits 4:2:0 limited range", levels(876.0, 896.0, true)),
    ("10 bits 4:4:4 limited range", levels(876.0, 896.0, false)),
];

/// Settings that we do not offer: pixel format, range, x264's parameters, rate factor.
struct Variant(&'static str, &'static str, &'static str, &'static str);

const NEAREST: &str = "deadzone-inter=0:deadzone-intra=0";

const VARIANTS: [Variant; 19] = [
    Variant("yuv420p", "tv", "", "0"),
    Variant("yuv420p", "tv", "", "4"),
    Variant("yuv420p", "tv", "", "12"),
    Variant("yuv420p", "tv", "aq-mode=0", "12"),
    Variant("yuv420p", "tv", "no-deblock=1", "12"),
    Variant("yuv420p", "tv", "no-dct-decimate=1:no-fast-pskip=1", "12"),
    Variant("yuv420p", "tv", NEAREST, "8"),
    Variant("yuv420p", "tv", NEAREST, "12"),
    Variant("yuv420p", "pc", "", "0"),
    Variant("yuv420p", "pc", "", "8"),
    Variant("yuv420p", "pc", "", "12"),
    Variant(
        "yuv420p",
        "pc",
        "deadzone-inter=0:deadzone-intra=0:aq-mode=0",
        "12",
    ),
    Variant(
        "yuv420p",
        "pc",
        "deadzone-inter=0:deadzone-intra=0:no-dct-decimate=1",
        "12",
    ),
    Variant("yuv444p", "pc", NEAREST, "12"),
    Variant("yuv420p10le", "tv", "", "12"),
    Variant("yuv420p10le", "tv", NEAREST, "12"),
    Variant("yuv422p10le", "tv", NEAREST, "12"),
    Variant("yuv444p10le", "tv", NEAREST, "12"),
    Variant("yuv420p10le", "pc", NEAREST, "12"),
];

/// Encoders.
enum Way {
    Ours(VideoSettings),
    Program(Variant),
}

impl Way {
    fn name(&self) -> String {
        match self {
            Self::Ours(settings) => format!(
                "{} {}{}",
                serde_json::to_string(&settings.codec)
                    .unwrap_or_default()
                    .replace('"', ""),
                settings.preset,
                if settings.codec.is_lossless() {
                    String::new()
                } else {
                    format!(" crf {}", settings.crf)
                }
            ),
            Self::Program(Variant(pixel_format, range, parameters, crf)) => {
                format!("{pixel_format} {range} crf {crf} {parameters}")
            }
        }
    }

    fn encode(&self, recording: &Recording, path: &Path) {
        match self {
            Self::Ours(settings) => {
                let mut writer = VideoWriter::create(path, settings, WIDTH_PX, HEIGHT_PX, RATE)
                    .expect("the encoder starts");
                for picture in &recording.pictures {
                    writer.write(picture).expect("an image is encoded");
                }
                writer.finish().expect("the video is finished");
            }
            Self::Program(Variant(pixel_format, range, parameters, crf)) => {
                let mut encoder = vec!["-c:v", "libx264", "-preset", "superfast"];
                encoder.extend(["-tune", "zerolatency", "-crf", crf]);
                if !parameters.is_empty() {
                    encoder.extend(["-x264-params", parameters]);
                }
                let yuv = Some((*pixel_format, *range));
                let status = ffmpeg_program::encode(&recording.raw_file, yuv, &encoder, path)
                    .status()
                    .expect("the ffmpeg program (apt-get install ffmpeg)");
                assert!(status.success(), "ffmpeg ended with {status}");
            }
        }
    }
}

fn candidates() -> Vec<VideoSettings> {
    let lossy = |codec, preset: &'static str, crfs: &'static [u32]| {
        crfs.iter().map(move |&crf| VideoSettings {
            codec,
            preset: preset.into(),
            crf,
            threads: 1,
        })
    };
    let lossless = [VideoSettings::of(VideoCodec::H264Lossless)];
    lossy(
        VideoCodec::H264,
        "superfast",
        &[4, 8, 10, 12, 14, 16, 18, 23],
    )
    .chain(lossy(VideoCodec::H264, "ultrafast", &[12]))
    .chain(lossy(VideoCodec::H264, "veryfast", &[12]))
    .chain(lossless)
    .collect()
}

/// Raw images, and what the aircraft adds to each.
struct Recording {
    name: &'static str,
    pictures: Vec<Vec<u8>>,
    /// The raw images for the program.
    raw_file: PathBuf,
    backdrops: Vec<Patch>,
    raw: Vec<Patch>,
    places: Vec<(i64, i64)>,
    peak: f64,
}

/// Brightness around the aircraft, row by row.
type Patch = Vec<f64>;

const PATCH_WIDTH: i64 = 2 * HALF_PX.0 + 1;
const PATCH_HEIGHT: i64 = 2 * HALF_PX.1 + 1;

impl Recording {
    fn new(name: &'static str, scenery: &Scenery, folder: &Path) -> Self {
        let places: Vec<_> = (0..PICTURES)
            .map(|number| scenery.place_px(number))
            .map(|(x, y)| (x.round() as i64, y.round() as i64))
            .collect();
        let pictures: Vec<_> = (0..PICTURES)
            .map(|number| scenery.picture(number))
            .collect();
        let backdrops: Vec<_> = (0..PICTURES)
            .zip(&places)
            .map(|(number, place)| patch(&scenery.backdrop(number), *place))
            .collect();
        let raw: Vec<Patch> = pictures
            .iter()
            .zip(&backdrops)
            .zip(&places)
            .map(|((picture, backdrop), place)| difference(&patch(picture, *place), backdrop))
            .collect();
        let peak = raw
            .iter()
            .flatten()
            .map(|added| added.abs())
            .fold(0.0, f64::max);
        let raw_file = folder.join(format!("{name}.rgb"));
        let mut file = File::create(&raw_file).expect("the images' file");
        for picture in &pictures {
            file.write_all(picture).expect("an image is written");
        }
        Self {
            name,
            pictures,
            raw_file,
            backdrops,
            raw,
            places,
            peak,
        }
    }
}

fn patch(rgb: &[u8], (cx, cy): (i64, i64)) -> Patch {
    let mut grey = Vec::with_capacity((PATCH_WIDTH * PATCH_HEIGHT) as usize);
    for y in cy - HALF_PX.1..=cy + HALF_PX.1 {
        for x in cx - HALF_PX.0..=cx + HALF_PX.0 {
            let at = ((y * i64::from(WIDTH_PX) + x) * 3) as usize;
            let colours = [0, 1, 2].map(|colour| LUMA[colour] * f64::from(rgb[at + colour]));
            grey.push(colours.iter().sum());
        }
    }
    grey
}

fn difference(a: &Patch, b: &Patch) -> Patch {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Remaining contrast and shift of the aircraft in pixels.
fn compare(raw: &Patch, decoded: &Patch) -> (f64, DVec2) {
    let at = |x: i64, y: i64| raw[(y * PATCH_WIDTH + x) as usize];
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for y in 1..PATCH_HEIGHT - 1 {
        for x in 1..PATCH_WIDTH - 1 {
            let slope_x = (at(x + 1, y) - at(x - 1, y)) / 2.0;
            let slope_y = (at(x, y + 1) - at(x, y - 1)) / 2.0;
            let base = DVec3::new(at(x, y), -slope_x, -slope_y);
            normal += DMat3::from_cols(base * base.x, base * base.y, base * base.z);
            right += base * decoded[(y * PATCH_WIDTH + x) as usize];
        }
    }
    let found = normal.inverse() * right;
    (found.x, DVec2::new(found.y, found.z) / found.x)
}

/// The result for a scene's images.
#[derive(Default)]
struct Comparison {
    shifts_px: Vec<f64>,
    contrasts: Vec<f64>,
}

impl Comparison {
    fn add(&mut self, recording: &Recording, number: usize, seen: &Patch) {
        let added = difference(seen, &recording.backdrops[number]);
        let (contrast, shift_px) = compare(&recording.raw[number], &added);
        self.shifts_px.push(shift_px.length());
        self.contrasts.push(contrast);
    }

    /// A cell of the table: root mean square and largest shift, mean and least contrast.
    fn cell(&self) -> String {
        let count = self.shifts_px.len() as f64;
        let squares: f64 = self.shifts_px.iter().map(|px| px * px).sum();
        let sum: f64 = self.contrasts.iter().sum();
        format!(
            "{:.3} px (most {:.3}), {:.0} % (least {:.0})",
            (squares / count).sqrt(),
            self.shifts_px.iter().fold(0.0_f64, |a, b| a.max(*b)),
            100.0 * sum / count,
            100.0 * self.contrasts.iter().fold(f64::INFINITY, |a, b| a.min(*b))
        )
    }
}

/// A row of the table: a pixel format without any codec.
fn floor(name: &str, levels: Levels, recordings: &[Recording]) -> String {
    let cell = |recording: &Recording| {
        let mut comparison = Comparison::default();
        for (number, picture) in recording.pictures.iter().enumerate() {
            let seen = rounded_patch(picture, recording.places[number], levels);
            comparison.add(recording, number, &seen);
        }
        comparison.cell()
    };
    let cells: Vec<String> = recordings.iter().map(cell).collect();
    format!("| no codec, {name} | {} | | | |", cells.join(" | "))
}

/// Brightness around the aircraft after conversion to a pixel format and back.
fn rounded_patch(rgb: &[u8], (cx, cy): (i64, i64), levels: Levels) -> Patch {
    // Even, because of the chroma subsampling, and a little larger than the patch.
    let (left, top) = ((cx - HALF_PX.0 - 2) & !1, (cy - HALF_PX.1 - 2) & !1);
    let (width, height) = (PATCH_WIDTH + 7, PATCH_HEIGHT + 7);
    let piece: Vec<[f64; 3]> = (0..height)
        .flat_map(|y| (0..width).map(move |x| (left + x, top + y)))
        .map(|(x, y)| {
            let at = ((y * i64::from(WIDTH_PX) + x) * 3) as usize;
            [0, 1, 2].map(|colour| f64::from(rgb[at + colour]))
        })
        .collect();
    let back = there_and_back(&piece, width as usize, levels);
    let mut grey = Vec::with_capacity((PATCH_WIDTH * PATCH_HEIGHT) as usize);
    for y in cy - HALF_PX.1..=cy + HALF_PX.1 {
        for x in cx - HALF_PX.0..=cx + HALF_PX.0 {
            let pixel = back[((y - top) * width + x - left) as usize];
            grey.push(
                LUMA.iter()
                    .zip(pixel)
                    .map(|(share, value)| share * value)
                    .sum(),
            );
        }
    }
    grey
}

/// Processor time of this process and its children.
fn processor() -> Duration {
    processor_time::own_and_children().iter().sum()
}

/// A row of the table: encoded and decoded.
fn measure(way: &Way, recordings: &[Recording], folder: &Path) -> String {
    let path = folder.join("view.mp4");
    let mut cells = Vec::new();
    let (mut bytes, mut encode_s, mut decode_s) = (0, 0.0, 0.0);
    for recording in recordings {
        let began = processor();
        way.encode(recording, &path);
        encode_s += (processor() - began).as_secs_f64();
        bytes += std::fs::metadata(&path).expect("the video is there").len();

        let mut reader = VideoReader::open(&path).expect("the video opens");
        let mut rgb = Vec::new();
        let mut comparison = Comparison::default();
        let began = processor();
        for number in 0..PICTURES as usize {
            reader
                .next_frame(&mut rgb)
                .expect("an image is decoded")
                .expect("as many images as were written");
            // Of the order of a hundredth of a decoded image.
            comparison.add(recording, number, &patch(&rgb, recording.places[number]));
        }
        decode_s += (processor() - began).as_secs_f64();
        cells.push(comparison.cell());
    }
    let pictures = f64::from(PICTURES) * recordings.len() as f64;
    format!(
        "| {} | {} | {:.1} | {:.0} | {:.0} |",
        way.name(),
        cells.join(" | "),
        8e-6 * bytes as f64 / pictures * 30.0,
        1e3 * encode_s / pictures,
        1e3 * decode_s / pictures
    )
}
