//! Random streams.

use rand::SeedableRng;
use rand_chacha::ChaCha12Rng;

/// Independent random streams, so that a change to one part leaves the draws of the others alone.
#[derive(Clone, Copy)]
pub(crate) enum Stream {
    /// Calibration networks of `paper_lstm`.
    Calibration = 1,
    /// LSTM of `paper_lstm`.
    Estimator,
    /// `mono_network`.
    MonoSize,
    /// `mono_network_box`.
    MonoBox,
    /// `mono_network_position`.
    MonoPosition,
}

impl Stream {
    pub(crate) fn generator(self, seed: u64) -> ChaCha12Rng {
        let mut generator = ChaCha12Rng::seed_from_u64(seed);
        generator.set_stream(self as u64);
        generator
    }
}
