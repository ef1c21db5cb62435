use std::collections::BTreeSet;
use std::fs;
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command};
use std::sync::mpsc::channel;
use std::thread;
use std::time::Duration;

use testkit::free_udp_port;

use super::*;
use crate::clock::RunClock;

const SIZE_PX: [u32; 2] = [320, 240];
const IMAGES: usize = 1_000;

fn ffmpeg(arguments: &[&str]) -> Child {
    let mut command = Command::new("ffmpeg");
    command
        .args(["-v", "error", "-y", "-nostdin"])
        .args(arguments)
        .spawn()
        .unwrap()
}

/// The content of all images of a source, until they end.
fn images(source: &Source) -> Vec<(InputImage, blake3::Hash)> {
    let patience = Patience::new(RunClock::start(), Arc::default());
    let mut input = Input::open(source, "left", SIZE_PX, patience, 4_000)
        .ok()
        .unwrap();
    let next = || input.next(1_000).ok();
    let hashed = |image: InputImage| {
        let mut hasher = blake3::Hasher::new();
        let luma = image.image.luma().unwrap();
        for row in 0..luma.height_px {
            hasher.update(luma.row(row));
        }
        (image, hasher.finalize())
    };
    std::iter::from_fn(next).map(hashed).collect()
}

/// What a camera sends of this video. Every packet whose number this says is lost.
fn sent(video: &Path, is_lost: fn(u32) -> bool) -> Vec<(InputImage, blake3::Hash)> {
    let description = video.with_extension("sdp");
    let relay = UdpSocket::bind("127.0.0.1:0").unwrap();
    let [from, to] = [relay.local_addr().unwrap().port(), free_udp_port()];
    let address = format!(
        "rtp://127.0.0.1:{from}?pkt_size=300&rtcpport={}",
        free_udp_port()
    );
    let video = [
        "-readrate",
        "4",
        "-i",
        video.to_str().unwrap(),
        "-c",
        "copy",
        "-f",
        "rtp",
    ];
    let mut sender = ffmpeg(
        &[
            &video[..],
            &["-sdp_file", description.to_str().unwrap(), &address],
        ]
        .concat(),
    );
    let text = loop {
        thread::sleep(Duration::from_millis(20));
        match fs::read_to_string(&description) {
            Ok(text) if text.contains("a=fmtp") => break text,
            _ => assert!(sender.try_wait().unwrap().is_none(), "it ended"),
        }
    };
    fs::write(
        &description,
        text.replace(&format!("video {from} "), &format!("video {to} ")),
    )
    .unwrap();
    let forward = relay.try_clone().unwrap();
    relay
        .set_read_timeout(Some(Duration::from_secs(2)))
        .unwrap();
    let (queue, packets) = channel();
    thread::spawn(move || {
        let mut packet = [0; 2_000];
        while let Ok(bytes) = relay.recv(&mut packet) {
            queue.send(packet[..bytes].to_vec()).unwrap();
        }
    });
    thread::spawn(move || {
        // The reader has a moment to open its socket, and its buffer is small.
        thread::sleep(Duration::from_millis(300));
        for (number, packet) in (0..).zip(packets) {
            if !is_lost(number) {
                forward.send_to(&packet, ("127.0.0.1", to)).unwrap();
            }
            thread::sleep(Duration::from_micros(100));
        }
    });
    let all = images(&Source::Description(description.clone()));
    sender.wait().unwrap();
    fs::remove_file(description).unwrap();
    all
}

fn video(folder: &Path, codec: &[&str]) -> std::path::PathBuf {
    let path = folder.join(format!("{}.mp4", codec[1]));
    let input = [
        "-f",
        "lavfi",
        "-i",
        &format!("testsrc2=s=320x240:r=30,trim=end_frame={IMAGES}"),
        "-pix_fmt",
        "yuv420p",
    ];
    let made = ffmpeg(&[&input[..], codec, &[path.to_str().unwrap()]].concat()).wait();
    assert!(made.unwrap().success());
    path
}

#[test]
fn all_images_that_losses_damage_are_known_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let h265 = "log-level=error:bframes=0:keyint=30";
    let h265 = [
        "-c:v",
        "libx265",
        "-preset",
        "ultrafast",
        "-x265-params",
        h265,
    ];
    let h264 = [
        "-c:v",
        "libx264",
        "-preset",
        "ultrafast",
        "-bf",
        "0",
        "-g",
        "30",
    ];
    // After losses, FFmpeg 5.1 decodes some intact key images of H.264 to other pixels, and says nothing.
    for (codec, has_exact_keys) in [(&h265[..], true), (&h264, false)] {
        let video = video(folder.path(), codec);
        let whole = images(&Source::File(video.clone()));
        assert_eq!(whole.len(), IMAGES);
        let contents: BTreeSet<_> = whole.iter().map(|(_, content)| content.to_hex()).collect();
        let is_sound = |content: &blake3::Hash| contents.contains(&content.to_hex());
        let without_loss = sent(&video, |_| false);
        assert_eq!(without_loss.len(), IMAGES);
        assert!(
            without_loss
                .iter()
                .all(|(image, content)| !image.is_damaged && is_sound(content))
        );
        if !has_exact_keys {
            continue;
        }
        // 3 %, unevenly.
        let with_losses = sent(&video, |number| {
            number.wrapping_mul(2_654_435_761) % 1_000 < 30
        });
        let damaged = with_losses.iter().filter(|(_, content)| !is_sound(content));
        assert!(damaged.clone().count() > 150, "{}", damaged.count());
        for (image, content) in &with_losses {
            assert!(
                image.is_damaged || is_sound(content),
                "{:?}",
                image.clues.timestamp_s
            );
        }
        assert!(with_losses.iter().any(|(image, _)| !image.is_damaged));
    }
}

#[test]
fn images_that_refer_to_later_ones_come_in_their_order_with_their_arrivals() {
    let folder = tempfile::tempdir().unwrap();
    let h264 = [
        "-c:v",
        "libx264",
        "-bf",
        "2",
        "-g",
        "30",
        "-x264-params",
        "b-adapt=0",
    ];
    let all = sent(&video(folder.path(), &h264), |_| false);
    assert!(all.len() > IMAGES - 4, "{}", all.len());
    for pair in all.windows(2) {
        let [before, after] = [pair[0].0.clues, pair[1].0.clues];
        assert!(after.timestamp_s > before.timestamp_s);
        // At four times the speed, out of order by at most three images.
        assert!((after.arrival_s - before.arrival_s).abs() < 0.1);
    }
}

#[test]
fn images_that_are_not_to_be_shown_as_they_are_stored_are_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let plain = video(folder.path(), &["-c:v", "libx264", "-preset", "ultrafast"]);
    let turned = folder.path().join("turned.mp4");
    let arguments = [
        "-i",
        plain.to_str().unwrap(),
        "-metadata:s:v",
        "rotate=180",
        "-c",
        "copy",
    ];
    let made = ffmpeg(&[&arguments[..], &[turned.to_str().unwrap()]].concat()).wait();
    assert!(made.unwrap().success());
    let wide = video(folder.path(), &["-aspect:v", "2:1", "-c:v", "libx264"]);
    let interlaced = video(folder.path(), &["-flags", "+ilme+ildct", "-c:v", "libx264"]);
    for (path, expected) in [
        (turned, "turn them"),
        (wide, "not square"),
        (interlaced, "progressive"),
    ] {
        let patience = Patience::new(RunClock::start(), Arc::default());
        let opened = Input::open(&Source::File(path), "left", SIZE_PX, patience, 4_000);
        let said = match opened.map(|mut input| input.next(2_000)) {
            Ok(Err(End::Useless(why))) | Err(OpenFault::Wrong(why)) => why,
            _ => panic!("{expected}"),
        };
        assert!(said.contains(expected), "{said}");
    }
}
