//! Any numbers in any shape as a model's output: no panic, valid boxes, and suppression that terminates.

#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;

/// A model output made up by the fuzzer.
#[derive(Debug, Arbitrary)]
struct Made {
    /// The layout in a profile; none if it is beyond the last.
    layout: u8,
    shape: Vec<u16>,
    /// Repeated until the count matches the shape.
    numbers: Vec<f32>,
    windows: u8,
    window_px: [u16; 2],
    class: u8,
    corner: bool,
    /// In 255ths.
    floor: u8,
    /// Whether there is one number too many.
    surplus: bool,
}

fuzz_target!(|made: Made| detector::decode(&made));

/// The labeller's decoder alone, from its sources: with the whole crate the fuzzer would have to load ONNX Runtime.
#[path = "../../labeller/src/detector"]
#[allow(dead_code, reason = "only the decoders are called")]
mod detector {
    mod answer;
    mod layout;
    mod model_file;
    mod profile;

    use super::Made;
    use answer::{Answer, numbers_of};
    use layout::boxes_and_scores::PairAnswer;
    use layout::efficient_nms::NmsAnswer;
    use layout::meaning::{ProbedModel, Meaning};
    use layout::suppression;
    use layout::{Decoding, Layout};
    use profile::{BoxOrigin, ModelProfile};

    /// More would be slow and teach nothing.
    const MAX_NUMBERS: usize = 1 << 16;
    const LAYOUTS: [Layout; 10] = [
        Layout::Rows,
        Layout::AnchorRows,
        Layout::Yolox,
        Layout::YoloxDecoded,
        Layout::ClassRows,
        Layout::BoxesAndScores,
        Layout::Columns,
        Layout::Corners,
        Layout::BatchCorners,
        Layout::EfficientNms,
    ];

    /// As in the labeller.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct ScoredBox {
        pub pixel_box: dataset::tables::pixel_box::PixelBox,
        pub score: f64,
    }

    /// The same numbers as four outputs: joined to one, or refused.
    fn join(batch: usize, boxes: usize, numbers: &[f32]) {
        let of = |count: usize| -> Vec<f32> {
            let endless = numbers.iter().chain([&1.0]).copied().cycle();
            endless.take(count).collect()
        };
        let (counts, scores, corners) = (of(batch), of(batch * boxes), of(batch * boxes * 4));
        let (each, room) = ([batch, boxes], [batch, boxes, 4]);
        let answers = [
            Answer::new(&each[..1], &counts),
            Answer::new(&room, &corners),
            Answer::new(&each, &scores),
        ];
        if let [Ok(counts), Ok(corners), Ok(scores)] = answers {
            let classes = scores;
            let nms = NmsAnswer {
                counts,
                corners,
                scores,
                classes,
            };
            if let Ok((shape, joined)) = nms.joined() {
                assert_eq!(shape.iter().product::<usize>(), joined.len());
            }
            let pair = PairAnswer {
                boxes: corners,
                scores: corners,
            };
            if let Ok((shape, joined)) = pair.joined() {
                assert_eq!(shape.iter().product::<usize>(), joined.len());
            }
        }
    }

    pub(super) fn decode(made: &Made) {
        let shape: Vec<usize> = made.shape.iter().map(|side| usize::from(*side)).collect();
        let window_px = made.window_px.map(u32::from);
        let said = LAYOUTS.get(usize::from(made.layout)).copied();
        let Some(layout) = said.or_else(|| Layout::of_shape(&shape, window_px, made.corner, None))
        else {
            return;
        };
        let count = match numbers_of(&shape) {
            Some(count) if count <= MAX_NUMBERS => count,
            _ => made.numbers.len(),
        };
        let endless = made.numbers.iter().chain([&1.0]).copied().cycle();
        let numbers: Vec<f32> = endless.take(count + usize::from(made.surplus)).collect();
        let Ok(answer) = Answer::new(&shape, &numbers) else {
            return;
        };
        let known = ProbedModel {
            window_px,
            profile: &ModelProfile {
                layout: said,
                ..ModelProfile::default()
            },
            head: None,
            named: None,
        };
        let meaning = Meaning::of_probe(layout, answer, &known);
        let decoding = Decoding {
            meaning,
            class: made.class.into(),
            origin: if made.corner {
                BoxOrigin::PixelCorner
            } else {
                meaning.layout.usual_origin()
            },
            window_px,
            score_floor: f64::from(made.floor) / 255.0,
        };
        if let &[batch, boxes, _] = &shape[..] {
            join(batch.min(8), boxes.min(64), &made.numbers);
        }
        let windows = usize::from(made.windows % 8);
        let Ok(found) = decoding.decode(answer, windows) else {
            return;
        };
        assert_eq!(found.len(), windows);
        for boxes in found {
            for scored in &boxes {
                let edges = scored.pixel_box.edges();
                assert!(edges.iter().all(|edge| edge.is_finite()), "{scored:?}");
                assert!((0.0..=1.0).contains(&scored.score), "{scored:?}");
            }
            let kept = suppression::keep_best(boxes, 0.5, 100, |scored| *scored);
            assert!(kept.len() <= 100);
        }
    }
}

/// As far as the decoder names it.
#[allow(dead_code, reason = "only profiles of files fail so")]
mod error {
    use std::path::Path;

    #[derive(Debug)]
    pub struct Error(String);

    #[derive(Debug, Clone, PartialEq, Eq)]
    pub(crate) struct ModelFault(String);

    pub type Result<T> = std::result::Result<T, Error>;

    impl ModelFault {
        pub(crate) fn new(message: impl ToString) -> Self {
            Self(message.to_string())
        }
    }

    impl Error {
        pub(crate) fn model(path: &Path, message: impl ToString) -> Self {
            Self(format!("{}: {}", path.display(), message.to_string()))
        }
    }
}
