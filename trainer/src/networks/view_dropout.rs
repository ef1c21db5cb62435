//! View dropout: the views that a mini-batch of the estimator's training may use, so that it also learns to work without the others.
//!
//! With N views, each is used alone in 1 / (N + 1) of the batches and all together in the rest: thirds for the paper's two views.

use rand::RngExt;
use rand_chacha::ChaCha12Rng;

use crate::networks::encoded::Encoded;

/// Views of one mini-batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewSelection {
    /// Only this view.
    Only(usize),
    /// All views that saw the aircraft.
    All,
}

/// One kind of mini-batch.
pub(crate) struct BatchKind {
    /// The views that it uses.
    pub selection: ViewSelection,
    /// Samples that it may draw.
    pub from: Vec<usize>,
}

/// The kinds of mini-batches.
pub(crate) struct ViewDropout {
    kinds: Vec<BatchKind>,
}

impl ViewDropout {
    /// Single views draw from the samples that they saw, all views together from those that two or more saw. Kinds without samples are
    /// left out.
    pub(crate) fn new(samples: &Encoded) -> Self {
        let one = |view| BatchKind {
            selection: ViewSelection::Only(view),
            from: samples.seen_by(view),
        };
        let from = (0..samples.len())
            .filter(|&sample| samples.detections(sample) >= 2)
            .collect();
        let all = BatchKind {
            selection: ViewSelection::All,
            from,
        };
        let kinds = (0..samples.views())
            .map(one)
            .chain([all])
            .filter(|kind| !kind.from.is_empty())
            .collect();
        Self { kinds }
    }

    /// The kind that uses all views, if any sample was seen by two or more.
    pub(crate) fn together(&self) -> Option<&BatchKind> {
        self.kinds
            .iter()
            .find(|kind| kind.selection == ViewSelection::All)
    }

    /// Draws the kind of the next batch. There must be samples.
    pub(crate) fn draw(&self, random: &mut ChaCha12Rng) -> &BatchKind {
        &self.kinds[random.random_range(0..self.kinds.len())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networks::normalisation::Normalisation;
    use crate::samples::Samples;
    use rand::SeedableRng;
    use testkit::synthetic::SyntheticCorpus;

    #[test]
    fn each_of_two_views_is_alone_in_a_third_of_the_batches() {
        let samples = Samples::synthetic(
            &SyntheticCorpus {
                miss_ratio: 0.3,
                ..SyntheticCorpus::tiny()
            },
            0.0,
        );
        let all: Vec<_> = samples.samples.iter().collect();
        let encoded = Encoded::new(
            all.iter().copied(),
            &Normalisation::fit(&samples.views, &all, &all),
        );
        let dropout = ViewDropout::new(&encoded);
        let mut random = ChaCha12Rng::seed_from_u64(0);
        let mut counts = [0_usize; 3];
        for _ in 0..3_000 {
            let BatchKind { selection, from } = dropout.draw(&mut random);
            match *selection {
                ViewSelection::Only(view) => {
                    counts[view] += 1;
                    assert!(from.iter().all(|&sample| encoded.seen(sample, view)));
                }
                ViewSelection::All => {
                    counts[2] += 1;
                    assert!(from.iter().all(|&sample| encoded.detections(sample) == 2));
                }
            }
        }
        // Three standard deviations of a third of 3000 draws are 77.
        assert!(
            counts.iter().all(|count| count.abs_diff(1_000) < 80),
            "{counts:?}"
        );
    }
}
