//! The random streams of a training.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

/// Independent random streams, so that changing one part of a training leaves the others' draws alone.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    /// The calibration networks of `paper_lstm`.
    Calibration = 1,
    /// Its LSTM.
    Estimator,
    /// `mono_network`.
    MonoSize,
    /// `mono_network_box`.
    MonoBox,
    /// `mono_network_position`.
    MonoPosition,
}

impl Stream {
    /// Its generator.
    pub(crate) fn generator(self, seed: u64) -> ChaCha12Rng {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        generator.set_stream(self as u64);
        generator
    }
}
