//! A process is killed while it records: what it had written can be read.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use dataset::numbers::frame_rate::FrameRate;
use dataset::video::{VideoCodec, VideoReader, VideoSettings, VideoWriter};

const SIZE_PX: u32 = 64;
const RATE: FrameRate = FrameRate {
    numerator: 30_000,
    denominator: 1_001,
};
/// Passes the file and the codec to the process that will be killed.
const FILE: &str = "DTD_TEST_RECORD_INTO";
const CODEC: &str = "DTD_TEST_RECORD_AS";
/// Images before the kill.
const PICTURES: u32 = 100;
/// An encoder holds one, and the muxer derives an image's duration from the next one.
const MAY_BE_LOST: u32 = 2;

fn picture(tick: u32) -> Vec<u8> {
    (0..SIZE_PX * SIZE_PX)
        .flat_map(|pixel| {
            let grey = 100 + (pixel * 7_919 + tick * 31) % 13;
            [grey as u8; 3]
        })
        .collect()
}

#[test]
#[ignore = "is run by the test below in a process of its own, and ends only when that is killed"]
fn record_until_killed() {
    let [path, codec] = [FILE, CODEC].map(|variable| {
        let value = std::env::var(variable);
        value.unwrap_or_else(|_| panic!("the test below runs this one, and sets {variable}"))
    });
    let settings = VideoSettings::of(serde_json::from_str(&codec).unwrap());
    let mut writer =
        VideoWriter::create(Path::new(&path), &settings, SIZE_PX, SIZE_PX, RATE).unwrap();
    for tick in 0..PICTURES {
        writer.write(&picture(tick)).unwrap();
    }
    // Not println: the test harness may capture it.
    writeln!(std::io::stderr(), "written").unwrap();
    loop {
        std::thread::park();
    }
}

#[test]
fn after_a_kill_all_but_the_last_two_pictures_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    for codec in VideoCodec::ALL {
        let path = folder.path().join("view.mp4");
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "record_until_killed", "--ignored", "--nocapture"])
            .env(FILE, &path)
            .env(CODEC, serde_json::to_string(&codec).unwrap())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(child.stderr.take().unwrap())
            .lines()
            .map_while(Result::ok)
            .any(|line| line == "written");
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(said, "{codec:?}: the process ended before it was killed");

        let mut reader = VideoReader::open(&path).unwrap();
        let mut read = 0;
        while let Ok(Some(pts)) = reader.skip_frame() {
            assert_eq!(pts, RATE.pts_of_tick(read), "{codec:?}");
            read += 1;
        }
        println!("{codec:?}: {read} of {PICTURES} images can be read");
        assert!(
            read + MAY_BE_LOST >= PICTURES,
            "{codec:?}: {read} of {PICTURES} images can be read"
        );
    }
}
