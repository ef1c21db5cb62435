//! Memory while grabbing a screen.
#![cfg(target_os = "linux")]

use testkit::peak::peak_bytes;
use testkit_simulator::Xvfb;
use xplane_bridge::pixels::{FfmpegScreen, RgbPicture, Screen};

#[test]
fn grabbing_a_screen_for_long_takes_no_more_memory_than_a_few_pictures() {
    let xvfb = Xvfb::start("640x480x24");
    let screen = FfmpegScreen::of_display(xvfb.display());
    let mut grab = screen.open(None).unwrap();
    let mut picture = RgbPicture::default();
    let mut peak_of = |grabs| {
        peak_bytes(|| {
            for _ in 0..grabs {
                grab.grab(&mut picture).unwrap();
            }
        })
    };
    let (few, many) = (peak_of(10), peak_of(300));
    let picture_bytes = 640.0 * 480.0 * 4.0;
    assert!(
        many < few + 10.0 * picture_bytes,
        "{few} bytes, then {many}"
    );
}
