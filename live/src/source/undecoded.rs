//! Packets that give no image: their codec may have other parameters than the source announces.

use crate::view_state::MAX_KEY_FRAME_INTERVAL_S;

/// Packets without an image, over [`MAX_KEY_FRAME_INTERVAL_S`], after which none is expected.
const MIN_PACKETS: u32 = 30;

/// Packets since the last image.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Undecoded {
    since_s: f64,
    packets: u32,
}

impl Undecoded {
    /// A packet was sent to the decoder.
    pub(crate) fn sent(&mut self, now_s: f64) {
        if self.packets == 0 {
            self.since_s = now_s;
        }
        self.packets = self.packets.saturating_add(1);
    }

    pub(crate) fn fault(&self, now_s: f64) -> Option<String> {
        let is_hopeless =
            self.packets >= MIN_PACKETS && now_s - self.since_s >= MAX_KEY_FRAME_INTERVAL_S;
        is_hopeless.then(|| {
            format!(
                "no packet of the last {MAX_KEY_FRAME_INTERVAL_S} s gave an image; set the camera to a key frame each second, and check its codec"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packets_without_an_image_are_a_fault_after_the_longest_wait_for_a_key_frame() {
        let mut undecoded = Undecoded::default();
        for packet in 0..75 {
            undecoded.sent(f64::from(packet) / 5.0);
            assert_eq!(undecoded.fault(f64::from(packet) / 5.0), None);
        }
        let fault = undecoded.fault(15.0).unwrap();
        assert!(fault.contains("last 15 s"), "{fault}");
        // An image was decoded.
        undecoded = Undecoded::default();
        undecoded.sent(15.0);
        assert_eq!(undecoded.fault(15.0), None);
        // A camera with an image every ten seconds.
        let mut slow = Undecoded::default();
        (0..3).for_each(|packet| slow.sent(10.0 * f64::from(packet)));
        assert_eq!(slow.fault(25.0), None);
    }
}
