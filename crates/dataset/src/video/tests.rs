use std::ffi::OsStr;
use std::mem::MaybeUninit;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::process::Command;

use ffmpeg_next::color;
use rustix::fs::inotify::{self, CreateFlags, WatchFlags};

use super::*;
use crate::numbers::frame_rate::FrameRate;

const WIDTH: u32 = 256;
const HEIGHT: u32 = 128;
/// A dark target of 6 x 2 pixels, like an aircraft at 13 nautical miles.
const TARGET_CONTRAST: f64 = 40.0;

/// A sky that brightens downwards, with fixed fine grain, and a target with soft edges around `(cx, cy)`.
fn picture(cx: f64, cy: f64) -> Vec<u8> {
    let mut rgb = Vec::with_capacity((WIDTH * HEIGHT * 3) as usize);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let grain = f64::from((x * 7_919 + y * 104_729) % 5) - 2.0;
            let sky = 150.0 + f64::from(y) * 0.3 + grain;
            let coverage = cover(f64::from(x) - cx, 3.0) * cover(f64::from(y) - cy, 1.0);
            let grey = sky - TARGET_CONTRAST * coverage;
            rgb.extend([grey as u8, (grey + 8.0) as u8, (grey + 20.0) as u8]);
        }
    }
    rgb
}

/// Pixel coverage, 0 to 1, at distance `d` from the bar's centre.
fn cover(d: f64, half: f64) -> f64 {
    ((d + 0.5).min(half) - (d - 0.5).max(-half)).clamp(0.0, 1.0)
}

/// Centre and peak of the difference from the image without a target, by green.
fn centre(rgb: &[u8], near: (f64, f64)) -> (f64, f64, f64) {
    let background = picture(-100.0, -100.0);
    let (mut sum, mut sum_x, mut sum_y, mut peak) = (0.0, 0.0, 0.0, 0.0_f64);
    for y in (near.1 as i64 - 4)..=(near.1 as i64 + 4) {
        for x in (near.0 as i64 - 8)..=(near.0 as i64 + 8) {
            let at = ((y * i64::from(WIDTH) + x) * 3 + 1) as usize;
            let depth = f64::from(background[at]) - f64::from(rgb[at]);
            peak = peak.max(depth);
            if depth > 4.0 {
                sum += depth;
                sum_x += depth * x as f64;
                sum_y += depth * y as f64;
            }
        }
    }
    (sum_x / sum, sum_y / sum, peak)
}

fn place(tick: u32) -> (f64, f64) {
    (40.0 + 1.37 * f64::from(tick), 60.0 + 0.21 * f64::from(tick))
}

fn record(
    path: &std::path::Path,
    settings: &VideoSettings,
    rate: FrameRate,
    ticks: u32,
) -> Vec<i64> {
    let mut writer = VideoWriter::create(path, settings, WIDTH, HEIGHT, rate).unwrap();
    let pts = (0..ticks)
        .map(|tick| {
            writer
                .write(&picture(place(tick).0, place(tick).1))
                .unwrap()
        })
        .collect();
    writer.finish().unwrap();
    pts
}

fn temporary() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("view.mp4");
    (folder, path)
}

#[test]
fn every_timestamp_and_the_number_of_pictures_are_exact_at_any_rate() {
    let rates = [(1, 1), (1, 2), (2, 1), (25, 1), (30, 1), (30_000, 1_001)];
    for (numerator, denominator) in rates {
        let rate = FrameRate::new(numerator, denominator).unwrap();
        for ticks in [1, 2, 75] {
            let (_folder, path) = temporary();
            let written = record(&path, &VideoSettings::default(), rate, ticks);
            let mut reader = VideoReader::open(&path).unwrap();
            assert_eq!(
                reader.time_base(),
                TimeBase::of_ticks(rate),
                "time base at {rate}"
            );
            assert_eq!(reader.frames_announced, u64::from(ticks));
            let mut rgb = Vec::new();
            let mut read = Vec::new();
            while let Some(pts) = reader.next_frame(&mut rgb).unwrap() {
                read.push(pts);
            }
            let expected: Vec<i64> = (0..ticks).map(|tick| rate.pts_of_tick(tick)).collect();
            assert_eq!(written, expected, "written at {rate}");
            assert_eq!(read, expected, "read at {rate}");
        }
    }
}

#[test]
fn a_finer_unit_of_time_changes_neither_times_nor_coded_pictures() {
    for (numerator, denominator) in [(30, 1), (1, 2), (60, 2), (30_000, 1_001)] {
        let rate = FrameRate {
            numerator,
            denominator,
        };
        let (_folder, path) = temporary();
        record(&path, &VideoSettings::default(), rate, 65);
        let of_ticks = |path: &Path| {
            let mut packets = PacketReader::open(path, rate).unwrap();
            let mut all = Vec::new();
            while let Some(picture) = packets.next_picture().unwrap() {
                all.push(picture);
            }
            let mut reader = VideoReader::open_ticks(path, rate).unwrap();
            let mut pts = Vec::new();
            while let Some(time) = reader.skip_frame().unwrap() {
                pts.push(time);
            }
            reader.seek(rate.pts_of_tick(60)).unwrap();
            assert_eq!(reader.skip_frame().unwrap(), Some(rate.pts_of_tick(60)));
            (all, pts)
        };
        let before = of_ticks(&path);
        let fine = path.with_extension("fine.mp4");
        let copied = Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(&path)
            .args(["-c", "copy", "-video_track_timescale", "60000"])
            .arg(&fine)
            .status()
            .expect("the ffmpeg program, which scripts/setup.sh installs");
        assert!(copied.success());
        assert!(of_ticks(&fine) == before, "{rate}");
        let found = VideoReader::open(&fine).unwrap().time_base();
        assert_eq!((found.numerator, found.denominator), (1, 60_000));
    }
}

#[test]
fn a_picture_between_two_ticks_belongs_to_none() {
    let (_folder, path) = temporary();
    let rate = |hz| FrameRate::new(hz, 1).unwrap();
    record(&path, &VideoSettings::default(), rate(30), 3);
    let mut reader = VideoReader::open_ticks(&path, rate(20)).unwrap();
    assert_eq!(reader.skip_frame().unwrap(), Some(0));
    let message = reader.skip_frame().unwrap_err().to_string();
    let words = "its time is 1 units of 1/30 s, expected a multiple of 1/20 s";
    assert!(message.contains(words), "{message}");
}

#[test]
fn a_small_target_keeps_its_place_and_its_contrast() {
    let (_folder, path) = temporary();
    record(
        &path,
        &VideoSettings::default(),
        FrameRate::new(30, 1).unwrap(),
        60,
    );
    let mut reader = VideoReader::open(&path).unwrap();
    let mut rgb = Vec::new();
    for tick in 0..60 {
        reader.next_frame(&mut rgb).unwrap().unwrap();
        let (x, y) = place(tick);
        let original = centre(&picture(x, y), (x, y));
        let found = centre(&rgb, (x, y));
        assert!(
            (found.0 - original.0).abs() < 0.1,
            "tick {tick}: x moved from {} to {}",
            original.0,
            found.0
        );
        assert!(
            (found.1 - original.1).abs() < 0.1,
            "tick {tick}: y moved from {} to {}",
            original.1,
            found.1
        );
        assert!(
            found.2 > 0.9 * original.2,
            "tick {tick}: contrast fell from {} to {}",
            original.2,
            found.2
        );
    }
}

#[test]
fn colours_come_back_within_three_levels() {
    let (_folder, path) = temporary();
    let mut writer = VideoWriter::create(
        &path,
        &VideoSettings::default(),
        WIDTH,
        HEIGHT,
        FrameRate::new(30, 1).unwrap(),
    )
    .unwrap();
    let colours = [
        [200, 40, 40],
        [40, 200, 40],
        [40, 40, 200],
        [255, 255, 255],
        [0, 0, 0],
        [120, 160, 210],
    ];
    for colour in colours {
        writer
            .write(&colour.repeat((WIDTH * HEIGHT) as usize))
            .unwrap();
    }
    writer.finish().unwrap();
    let mut reader = VideoReader::open(&path).unwrap();
    let mut rgb = Vec::new();
    for colour in colours {
        reader.next_frame(&mut rgb).unwrap().unwrap();
        let middle = ((HEIGHT / 2 * WIDTH + WIDTH / 2) * 3) as usize;
        let found = &rgb[middle..middle + 3];
        let close = found.iter().zip(&colour).all(|(a, b)| a.abs_diff(*b) <= 3);
        assert!(close, "{colour:?} came back as {found:?}");
    }
}

/// The video's colour tags, as its header has them.
fn tags(path: &Path) -> (color::Space, color::Range) {
    let input = ffmpeg_next::format::input(&ffmpeg_path(path).unwrap()).unwrap();
    let stream = input
        .streams()
        .best(ffmpeg_next::media::Type::Video)
        .unwrap();
    let context = ffmpeg_next::codec::Context::from_parameters(stream.parameters()).unwrap();
    let decoder = context.decoder().video().unwrap();
    (decoder.color_space(), decoder.color_range())
}

#[test]
fn lossy_videos_use_the_full_range_and_say_so() {
    for codec in VideoCodec::ALL {
        if codec.is_lossless() {
            continue;
        }
        let (_folder, path) = temporary();
        let rate = FrameRate::new(2, 1).unwrap();
        record(&path, &VideoSettings::of(codec), rate, 2);
        let expected = (color::Space::BT709, color::Range::JPEG);
        assert_eq!(tags(&path), expected, "{codec:?}");
    }
}

#[test]
fn videos_of_either_range_come_back_in_the_same_colours() {
    let (_folder, path) = temporary();
    for (range, expected) in [("tv", color::Range::MPEG), ("pc", color::Range::JPEG)] {
        let conversion = format!("scale=out_color_matrix=bt709:out_range={range},format=yuv420p");
        let made = Command::new("ffmpeg")
            .args(["-v", "error", "-y", "-f", "lavfi", "-i"])
            .args(["color=c=0x28C828:s=64x64:d=0.1,format=rgb24"])
            .args(["-vf", &conversion, "-c:v", "libx264", "-crf", "1"])
            .args(["-colorspace", "bt709", "-color_range", range])
            .arg(&path)
            .status()
            .expect("the ffmpeg program, which scripts/setup.sh installs");
        assert!(made.success());
        assert_eq!(tags(&path), (color::Space::BT709, expected));
        let mut rgb = Vec::new();
        let mut reader = VideoReader::open(&path).unwrap();
        reader.next_frame(&mut rgb).unwrap().unwrap();
        let close = rgb.chunks_exact(3).all(|found| {
            found
                .iter()
                .zip([40, 200, 40])
                .all(|(a, b)| a.abs_diff(b) <= 3)
        });
        assert!(close, "range {range}: {:?}", &rgb[..3]);
    }
}

#[test]
fn lossless_videos_give_back_every_byte() {
    for codec in VideoCodec::ALL
        .into_iter()
        .filter(|codec| codec.is_lossless())
    {
        let (_folder, path) = temporary();
        record(
            &path,
            &VideoSettings::of(codec),
            FrameRate::new(2, 1).unwrap(),
            5,
        );
        let mut reader = VideoReader::open(&path).unwrap();
        let mut rgb = Vec::new();
        for tick in 0..5 {
            reader.next_frame(&mut rgb).unwrap().unwrap();
            assert!(
                rgb == picture(place(tick).0, place(tick).1),
                "{codec:?}: tick {tick} differs"
            );
        }
    }
}

#[test]
fn a_part_of_a_picture_is_the_same_part_of_the_whole_picture() {
    let part = |left_px, top_px, width_px, height_px| PicturePart {
        left_px,
        top_px,
        width_px,
        height_px,
    };
    let parts = [
        part(0, 0, WIDTH, HEIGHT),
        part(0, 0, 32, 16),
        part(37, 41, 51, 33),
        part(WIDTH - 64, HEIGHT - 32, 64, 32),
        part(WIDTH - 1, HEIGHT - 1, 1, 1),
        part(100, 3, 150, 120),
    ];
    for codec in VideoCodec::ALL {
        let (_folder, path) = temporary();
        let rate = FrameRate::new(30, 1).unwrap();
        record(&path, &VideoSettings::of(codec), rate, 2);
        let mut reader = VideoReader::open(&path).unwrap();
        let (mut whole, mut found) = (Vec::new(), Vec::new());
        while reader.next_frame(&mut whole).unwrap().is_some() {
            for part in parts {
                reader.convert_part(part, &mut found).unwrap();
                let rows = part.top_px..part.top_px + part.height_px;
                let expected: Vec<u8> = rows
                    .flat_map(|row| {
                        let at = 3 * (row * WIDTH + part.left_px) as usize;
                        &whole[at..at + 3 * part.width_px as usize]
                    })
                    .copied()
                    .collect();
                assert!(found == expected, "{codec:?}: {part:?}");
            }
            for outside in [
                part(WIDTH - 8, 0, 9, 1),
                part(0, u32::MAX, 8, 8),
                part(0, 0, 0, 4),
            ] {
                assert!(reader.convert_part(outside, &mut found).is_err());
            }
        }
    }
}

#[test]
fn every_codec_keeps_timestamps_and_the_number_of_pictures_exactly() {
    for codec in VideoCodec::ALL {
        for (numerator, denominator, ticks) in [(30, 1, 12), (30_000, 1_001, 12), (1, 2, 3)] {
            let (_folder, path) = temporary();
            let rate = FrameRate::new(numerator, denominator).unwrap();
            record(&path, &VideoSettings::of(codec), rate, ticks);
            let mut reader = VideoReader::open(&path).unwrap();
            assert_eq!(
                reader.time_base(),
                TimeBase::of_ticks(rate),
                "{codec:?} at {rate}"
            );
            assert_eq!(
                reader.frames_announced,
                u64::from(ticks),
                "{codec:?} at {rate}"
            );
            let mut read = Vec::new();
            while let Some(pts) = reader.skip_frame().unwrap() {
                read.push(pts);
            }
            let expected: Vec<i64> = (0..ticks).map(|tick| rate.pts_of_tick(tick)).collect();
            assert_eq!(read, expected, "{codec:?} at {rate}");
        }
    }
}

#[test]
fn settings_that_are_not_given_are_those_of_the_codec() {
    fn given(json: &str) -> serde_json::Result<VideoSettings> {
        serde_json::from_str(json)
    }
    assert_eq!(given("{}").unwrap(), VideoSettings::default());
    for codec in VideoCodec::ALL {
        let name = serde_json::to_string(&codec).unwrap();
        let settings = given(&format!("{{\"codec\": {name}}}")).unwrap();
        assert_eq!(settings, VideoSettings::of(codec));
        assert_eq!(settings.fault(), None);
        let back = given(&serde_json::to_string(&settings).unwrap()).unwrap();
        assert_eq!(back, settings);
    }
    assert_eq!(given("{\"crf\": 9}").unwrap().crf, 9);
    assert!(given("{\"quality\": 9}").is_err());
}

#[test]
fn any_path_is_a_path_and_no_protocol() {
    let folder = tempfile::tempdir().unwrap();
    let rate = FrameRate::new(30, 1).unwrap();
    for name in [
        "a:b/view.mp4",
        "http:/view.mp4",
        "pipe:1",
        "file:view.mp4",
        "50% of 100 %d, \u{e4}#?.mp4",
    ] {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        record(&path, &VideoSettings::default(), rate, 3);
        assert!(path.is_file(), "{name}");
        let mut reader = VideoReader::open(&path).unwrap();
        let mut pictures = 0;
        while reader.skip_frame().unwrap().is_some() {
            pictures += 1;
        }
        assert_eq!(pictures, 3, "{name}");
    }
}

#[test]
fn a_playlist_with_the_name_of_a_video_is_refused_and_nothing_that_it_names_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("other.mp4");
    let rate = FrameRate::new(30, 1).unwrap();
    record(&other, &VideoSettings::default(), rate, 3);
    std::fs::copy(&other, folder.path().join("image-1.png")).unwrap();
    let dash = "<?xml version=\"1.0\"?>\n<MPD xmlns=\"urn:mpeg:dash:schema:mpd:2011\" type=\"static\" mediaPresentationDuration=\"PT1S\" \
                profiles=\"urn:mpeg:dash:profile:isoff-on-demand:2011\"><Period><AdaptationSet contentType=\"video\">\
                <Representation id=\"1\" bandwidth=\"1\" mimeType=\"video/mp4\"><BaseURL>other.mp4</BaseURL></Representation>\
                </AdaptationSet></Period></MPD>\n";
    let hls = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nother.mp4\n#EXT-X-ENDLIST\n";
    let sdp =
        "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 26\n";
    let playlists = [
        ("concat.mp4", "ffconcat version 1.0\nfile other.mp4\n"),
        ("hls.mp4", hls),
        ("hls.m3u8", hls),
        ("dash.mp4", dash),
        ("sdp.mp4", sdp),
        ("image-%d.png", "as many images as there are"),
    ];
    for (name, text) in playlists {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let opened = inotify::init(CreateFlags::NONBLOCK).unwrap();
    inotify::add_watch(&opened, folder.path(), WatchFlags::OPEN).unwrap();
    let opened_names = || {
        let mut buffer = [MaybeUninit::uninit(); 8_192];
        let mut events = inotify::Reader::new(&opened, &mut buffer);
        let mut names = std::collections::BTreeSet::new();
        while let Ok(event) = events.next() {
            let name = event.file_name().and_then(|name| name.to_str().ok());
            names.extend(name.map(str::to_owned));
        }
        names
    };
    for (name, _) in playlists {
        let error = VideoReader::open(&folder.path().join(name)).err();
        let message = error.map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains("playlists are not"), "{name}: {message}");
        assert_eq!(opened_names(), [name.to_owned()].into());
    }
    VideoReader::open(&other).unwrap();
    assert_eq!(opened_names(), ["other.mp4".to_owned()].into());
}

#[test]
fn a_relative_path_with_a_colon_names_no_protocol_and_one_that_is_not_utf_8_is_refused() {
    // If the folder is missing, FFmpeg's error is about the folder and does not mention protocols.
    let path = Path::new("no:such/view.mp4");
    let settings = VideoSettings::default();
    let rate = FrameRate::new(30, 1).unwrap();
    let create =
        |path: &Path| VideoWriter::create(path, &settings, WIDTH, HEIGHT, rate).map(|_| ());
    let open = |path: &Path| VideoReader::open(path).map(|_| ());
    for message in [create(path), open(path)].map(|result| result.unwrap_err().to_string()) {
        assert!(message.contains("No such file"), "{message}");
    }
    let path = Path::new(OsStr::from_bytes(b"view\xff.mp4"));
    for message in [create(path), open(path)].map(|result| result.unwrap_err().to_string()) {
        assert!(message.contains("UTF-8"), "{message}");
    }
}

#[test]
fn a_truncated_video_is_refused_by_name() {
    let (_folder, path) = temporary();
    record(
        &path,
        &VideoSettings::default(),
        FrameRate::new(30, 1).unwrap(),
        30,
    );
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let error = VideoReader::open(&path)
        .and_then(|mut reader| {
            while reader.skip_frame()?.is_some() {}
            Ok(())
        })
        .unwrap_err();
    assert!(error.to_string().contains("view.mp4"), "{error}");
}

/// Overwrites the second half of a coded image.
fn damage(path: &Path, image: usize) {
    let mut input = ffmpeg_next::format::input(path).unwrap();
    let (_, packet) = input.packets().nth(image).unwrap();
    let begins = packet.position() as usize;
    let mut file = std::fs::read(path).unwrap();
    for byte in &mut file[begins + packet.size() / 2..begins + packet.size()] {
        *byte ^= 0x5a;
    }
    std::fs::write(path, file).unwrap();
}

#[test]
fn a_recording_is_read_without_its_damaged_images_up_to_the_next_key_frame() {
    let (_folder, path) = temporary();
    let rate = FrameRate::new(30, 1).unwrap();
    record(&path, &VideoSettings::default(), rate, 150);
    let images = |mut reader: VideoReader| -> Result<(Vec<_>, u64)> {
        let (mut found, mut rgb) = (Vec::new(), Vec::new());
        while let Some(pts) = reader.next_frame(&mut rgb)? {
            found.push((pts, blake3::hash(&rgb)));
        }
        Ok((found, reader.damaged_images()))
    };
    let (sound, none) = images(VideoReader::open_recording(&path).unwrap()).unwrap();
    assert_eq!((sound.len(), none), (150, 0));
    damage(&path, 70);
    assert!(images(VideoReader::open(&path).unwrap()).is_err());
    let (left, damaged) = images(VideoReader::open_recording(&path).unwrap()).unwrap();
    // Key frames are 0, 60 and 120.
    assert_eq!(left, [&sound[..70], &sound[120..]].concat());
    assert_eq!(damaged, 50);
    // The beginning is known although it is damaged.
    damage(&path, 0);
    let mut reader = VideoReader::open_recording(&path).unwrap();
    assert_eq!(reader.skip_frame().unwrap(), Some(sound[60].0));
    assert_eq!(reader.first_damaged_pts(), Some(sound[0].0));
}

#[test]
fn a_jump_leads_to_every_picture_of_every_codec() {
    for codec in VideoCodec::ALL {
        let (_folder, path) = temporary();
        let rate = FrameRate::new(30_000, 1001).unwrap();
        record(&path, &VideoSettings::of(codec), rate, 70);
        assert_eq!(recorded_pictures(&path).unwrap(), None, "{codec:?}");
        let mut sequential = VideoReader::open(&path).unwrap();
        let mut expected = Vec::new();
        let mut rgb = Vec::new();
        while let Some(pts) = sequential.next_frame(&mut rgb).unwrap() {
            expected.push((pts, blake3::hash(&rgb)));
        }
        let mut reader = VideoReader::open(&path).unwrap();
        for tick in [69, 0, 61, 60, 59, 30] {
            let (wanted, picture) = expected[tick];
            reader.seek(wanted).unwrap();
            let mut decoded = 0;
            while reader.next_frame(&mut rgb).unwrap().unwrap() < wanted {
                decoded += 1;
            }
            assert!(decoded < 60, "{codec:?} tick {tick}: {decoded}");
            assert_eq!(blake3::hash(&rgb), picture, "{codec:?} tick {tick}");
        }
    }
}

#[test]
fn an_unfinished_video_holds_its_pictures_but_announces_none() {
    for codec in VideoCodec::ALL {
        let (_folder, path) = temporary();
        let rate = FrameRate::new(30, 1).unwrap();
        let settings = VideoSettings::of(codec);
        let mut writer = VideoWriter::create(&path, &settings, WIDTH, HEIGHT, rate).unwrap();
        for tick in 0..10 {
            let (x, y) = place(tick);
            writer.write(&picture(x, y)).unwrap();
        }
        drop(writer);
        let pictures = recorded_pictures(&path).unwrap().unwrap();
        assert!((9..=10).contains(&pictures), "{codec:?}: {pictures}");
        let mut reader = VideoReader::open(&path).unwrap();
        assert_eq!(reader.frames_announced, 0);
        let mut rgb = Vec::new();
        for tick in 0..9 {
            let pts = reader.next_frame(&mut rgb).unwrap();
            assert_eq!(pts, Some(i64::from(tick)), "{codec:?}");
        }
    }
}

#[test]
fn a_picture_of_the_wrong_size_and_odd_sizes_are_refused() {
    let (_folder, path) = temporary();
    let rate = FrameRate::new(30, 1).unwrap();
    let mut writer =
        VideoWriter::create(&path, &VideoSettings::default(), WIDTH, HEIGHT, rate).unwrap();
    let message = writer.write(&[0; 12]).unwrap_err().to_string();
    assert!(
        message.contains("12 bytes") && message.contains("98304"),
        "{message}"
    );
    assert!(VideoWriter::create(&path, &VideoSettings::default(), 255, 128, rate).is_err());
}

#[test]
fn unknown_presets_are_refused_with_the_known_ones() {
    let settings = VideoSettings {
        preset: "warp".into(),
        ..Default::default()
    };
    assert!(settings.fault().unwrap().1.contains("superfast"));
    let coarse = VideoSettings {
        crf: 52,
        ..Default::default()
    };
    assert!(coarse.fault().unwrap().1.contains("0 (best) to 51"));
}
