//! What video settings leave of an aircraft at 10 nautical miles: how far its centre moves and how much of its contrast stays.
//!
//! `cargo bench --bench video_quality` prints the table of `docs/video.md`. Pictures of the stand-in in full size are encoded and
//! decoded. What the aircraft adds to the backdrop, in the raw picture and in the decoded one, is compared by least squares:
//! `decoded(p) = contrast * raw(p - shift)`, to first order in the shift (Lucas and Kanade 1981), on brightness.

#[path = "video/scenery.rs"]
mod scenery;

use std::path::Path;
use std::time::Instant;

use dataset::frame_rate::FrameRate;
use dataset::video::{VideoCodec, VideoReader, VideoSettings, VideoWriter};
use glam::{DMat3, DVec2, DVec3};
use scenery::{HEIGHT_PX, Scenery, WIDTH_PX, clear, cloudy};

const PICTURES: u32 = 30;
/// Half the size of the piece of picture around the aircraft, pixels: it is 20 wide.
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
    let recordings: Vec<Recording> = sceneries
        .into_iter()
        .map(|(name, scenery)| Recording::new(name, &scenery))
        .collect();
    for recording in &recordings {
        println!(
            "{}: the aircraft differs by up to {:.0} grey levels",
            recording.name, recording.peak
        );
    }
    println!(
        "\n| setting | {} | Mbit/s at 30/s | encode ms | decode ms |",
        recordings
            .iter()
            .map(|r| format!("{}: centre moves, contrast kept", r.name))
            .collect::<Vec<_>>()
            .join(" | ")
    );
    println!("|---|{}---|---|---|", "---|".repeat(recordings.len()));
    let folder = tempfile::tempdir().expect("a folder for the videos");
    for settings in candidates() {
        let row = measure(&settings, &recordings, folder.path());
        println!("{row}");
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
    let lossless = [VideoCodec::H264Lossless, VideoCodec::Ffv1].map(VideoSettings::of);
    lossy(VideoCodec::H264, "superfast", &[0, 8, 10, 12, 15, 18, 23])
        .chain(lossy(VideoCodec::H264, "ultrafast", &[12]))
        .chain(lossy(VideoCodec::H264, "veryfast", &[12]))
        .chain(lossy(VideoCodec::H265, "ultrafast", &[2, 4]))
        .chain(lossy(VideoCodec::H265, "superfast", &[2, 4, 8, 12, 18]))
        .chain(lossy(VideoCodec::Av1, "8", &[2, 4, 8, 15, 30]))
        .chain(lossless)
        .collect()
}

/// Raw pictures, and what the aircraft adds to each.
struct Recording {
    name: &'static str,
    pictures: Vec<Vec<u8>>,
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
    fn new(name: &'static str, scenery: &Scenery) -> Self {
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
        Self {
            name,
            pictures,
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
            // BT.709.
            grey.push(
                0.2126 * f64::from(rgb[at])
                    + 0.7152 * f64::from(rgb[at + 1])
                    + 0.0722 * f64::from(rgb[at + 2]),
            );
        }
    }
    grey
}

fn difference(a: &Patch, b: &Patch) -> Patch {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Contrast kept and shift of the aircraft in pixels.
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

/// A row of the table: root mean square and largest shift, mean and least contrast.
fn measure(settings: &VideoSettings, recordings: &[Recording], folder: &Path) -> String {
    let path = folder.join(format!("view.{}", settings.codec.extension()));
    let mut cells = Vec::new();
    let (mut bytes, mut encode_s, mut decode_s) = (0, 0.0, 0.0);
    for recording in recordings {
        let began = Instant::now();
        let mut writer = VideoWriter::create(&path, settings, WIDTH_PX, HEIGHT_PX, RATE)
            .expect("the encoder starts");
        for picture in &recording.pictures {
            writer.write(picture).expect("a picture is encoded");
        }
        writer.finish().expect("the video is finished");
        encode_s += began.elapsed().as_secs_f64();
        bytes += std::fs::metadata(&path).expect("the video is there").len();

        let mut reader = VideoReader::open(&path).expect("the video opens");
        let mut rgb = Vec::new();
        let (mut farthest_px, mut squares, mut sum, mut least) = (0.0_f64, 0.0, 0.0, f64::INFINITY);
        for number in 0..PICTURES as usize {
            let began = Instant::now();
            reader
                .next_frame(&mut rgb)
                .expect("a picture is decoded")
                .expect("as many pictures as were written");
            decode_s += began.elapsed().as_secs_f64();
            let seen = patch(&rgb, recording.places[number]);
            let added = difference(&seen, &recording.backdrops[number]);
            let (contrast, shift_px) = compare(&recording.raw[number], &added);
            farthest_px = farthest_px.max(shift_px.length());
            squares += shift_px.length_squared();
            sum += contrast;
            least = least.min(contrast);
        }
        cells.push(format!(
            "{:.3} px (most {farthest_px:.3}), {:.0} % (least {:.0})",
            (squares / f64::from(PICTURES)).sqrt(),
            100.0 * sum / f64::from(PICTURES),
            100.0 * least
        ));
    }
    let pictures = f64::from(PICTURES) * recordings.len() as f64;
    format!(
        "| {} {} {} | {} | {:.1} | {:.0} | {:.0} |",
        serde_json::to_string(&settings.codec)
            .unwrap_or_default()
            .replace('"', ""),
        settings.preset,
        if settings.codec.is_lossless() {
            String::new()
        } else {
            format!("crf {}", settings.crf)
        },
        cells.join(" | "),
        8e-6 * bytes as f64 / pictures * 30.0,
        1e3 * encode_s / pictures,
        1e3 * decode_s / pictures
    )
}
