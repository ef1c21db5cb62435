//! Image rows to search: approaches cross a narrow band.

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use dataset::corpus::Corpus;
use dataset::corpus::splits::Side;
use dataset::tables::pixel_box::TruthBox;
use serde::{Deserialize, Serialize};

use crate::error::Result;

/// Margin above and below a band, as a part of its height: flights of the other sides differ a little.
const MARGIN: f64 = 0.1;
/// Wider aircraft are found as well in an image at half its scale, pixels.
const SMALL_PX: f64 = 48.0;
/// Maximum outside part for an uncut width.
const CUT_OFF: f64 = 0.01;

/// Image rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowBand {
    /// The first.
    pub top_px: u32,
    /// The one after the last.
    pub bottom_px: u32,
}

/// Row bands for aircraft of two sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SearchBands {
    /// For those that need the image as it is.
    pub small: RowBand,
    /// For those that are found at half its scale as well, which takes a quarter of the time.
    pub large: Option<RowBand>,
}

impl SearchBands {
    /// The rows of the training side's ground-truth boxes in all views, with a margin; `None` if that side has no labels.
    ///
    /// # Errors
    /// The split, or a training scenario, cannot be read.
    pub fn of_training_side(corpus: &Corpus) -> Result<Option<Self>> {
        let mut seen = RowsBySize::default();
        let splits = corpus.splits()?;
        let training: BTreeSet<&str> = splits.side(Side::Train).collect();
        for scenario in corpus.scenarios()? {
            if !training.contains(scenario.id().as_str()) {
                continue;
            }
            let boxes = scenario.open()?.truth_boxes_if_labelled()?;
            for real in boxes.unwrap_or_default() {
                seen.add(&real);
            }
        }
        Ok(seen.bands())
    }
}

#[derive(Default)]
struct RowsBySize {
    small: Option<[f64; 2]>,
    large: Option<[f64; 2]>,
}

impl RowsBySize {
    fn add(&mut self, real: &TruthBox) {
        // Narrow because cut off: still large.
        let is_small = real.pixel_box.width_px < SMALL_PX && real.truncation < CUT_OFF;
        let rows = if is_small {
            &mut self.small
        } else {
            &mut self.large
        };
        let [_, top, _, bottom] = real.pixel_box.edges();
        let [first, last] = rows.unwrap_or([top, bottom]);
        *rows = Some([first.min(top), last.max(bottom)]);
    }

    fn bands(self) -> Option<SearchBands> {
        match [self.small, self.large].map(|rows| rows.map(with_margin)) {
            [Some(small), large] => Some(SearchBands { small, large }),
            [None, only] => only.map(|small| SearchBands { small, large: None }),
        }
    }
}

/// The band of rows that boxes take, with its margin.
fn with_margin([top, bottom]: [f64; 2]) -> RowBand {
    let margin_px = MARGIN * (bottom - top);
    RowBand {
        top_px: (top - margin_px).max(0.0) as u32,
        bottom_px: (bottom + margin_px).ceil() as u32,
    }
}

impl RowBand {
    /// The band's part inside an image of this height.
    pub(crate) fn within(band: Option<Self>, height_px: u32) -> Range<u32> {
        let Self { top_px, bottom_px } = band.unwrap_or(Self {
            top_px: 0,
            bottom_px: height_px,
        });
        let bottom_px = bottom_px.min(height_px);
        top_px.min(bottom_px)..bottom_px
    }
}

impl fmt::Display for RowBand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.top_px, self.bottom_px)
    }
}

impl FromStr for RowBand {
    type Err = &'static str;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        let rows = text.split_once(':').and_then(|(top, bottom)| {
            Some(Self {
                top_px: top.parse().ok()?,
                bottom_px: bottom.parse().ok()?,
            })
        });
        rows.filter(|rows| rows.top_px < rows.bottom_px)
            .ok_or("expected TOP:BOTTOM, two rows with the upper one first")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::label::label_corpus;
    use dataset::corpus::splits::{Assignment, Splits};
    use dataset::tables::pixel_box::PixelBox;
    use dataset::work::watch::Silent;
    use testkit::short_corpus;

    #[test]
    fn the_band_of_the_training_side_holds_its_boxes_and_nothing_is_known_from_the_test_side() {
        let temporary = tempfile::tempdir().unwrap();
        let corpus = short_corpus::write(temporary.path(), &["0001-a"]);
        let put_on = |side| {
            let assignment = Assignment {
                side,
                trajectory: "t".into(),
            };
            let splits = Splits::new([("0001-a".to_owned(), assignment)].into()).unwrap();
            splits.write(&corpus.splits_path()).unwrap();
        };
        put_on(Side::Train);
        assert_eq!(
            SearchBands::of_training_side(&corpus).unwrap(),
            None,
            "no labels"
        );

        label_corpus(&corpus, &Silent).unwrap();
        let bands = SearchBands::of_training_side(&corpus).unwrap().unwrap();
        assert_eq!(bands.large, None, "all are far away");
        let band = bands.small;
        let scenario = corpus.scenario("0001-a").open().unwrap();
        let boxes = scenario.truth_boxes_if_labelled().unwrap().unwrap();
        let edges = boxes.iter().map(|real| real.pixel_box.edges());
        let (top, bottom) = edges.fold((f64::MAX, f64::MIN), |(top, bottom), edges| {
            (top.min(edges[1]), bottom.max(edges[3]))
        });
        assert!(f64::from(band.top_px) < top && bottom < f64::from(band.bottom_px));
        let height = f64::from(band.bottom_px - band.top_px);
        assert!(height < 1.2 * (bottom - top) + 2.0, "{band} {top} {bottom}");

        put_on(Side::Test);
        assert_eq!(SearchBands::of_training_side(&corpus).unwrap(), None);
    }

    #[test]
    fn large_aircraft_and_those_cut_off_by_the_border_are_in_a_band_of_their_own() {
        let bands = |boxes: &[(f64, f64, f64)]| {
            let mut seen = RowsBySize::default();
            for &(cy_px, width_px, truncation) in boxes {
                seen.add(&TruthBox {
                    tick: 0,
                    view: "left".into(),
                    class: "aircraft".into(),
                    pixel_box: PixelBox {
                        cx_px: 900.0,
                        cy_px,
                        width_px,
                        height_px: 20.0,
                    },
                    visible_fraction: 1.0,
                    truncation,
                    transmission: 1.0,
                    aircraft_number: None,
                    occluded_fraction: None,
                });
            }
            seen.bands().map(|bands| {
                (
                    bands.small.to_string(),
                    bands.large.map(|rows| rows.to_string()),
                )
            })
        };
        let far = [(600.0, 20.0, 0.0), (500.0, 47.0, 0.0)];
        let near = [(700.0, 49.0, 0.0), (1_000.0, 30.0, 0.5)];
        assert_eq!(bands(&[]), None);
        assert_eq!(
            bands(&[far, near].concat()),
            Some(("478:622".into(), Some("658:1042".into())))
        );
        assert_eq!(bands(&near), Some(("658:1042".into(), None)));
    }

    #[test]
    fn a_band_is_written_as_it_is_read_and_one_without_rows_is_refused() {
        let band: RowBand = "300:700".parse().unwrap();
        assert_eq!(band.to_string(), "300:700");
        for text in ["300", "700:300", "300:300", "-1:5", "a:b", ""] {
            assert!(text.parse::<RowBand>().is_err(), "{text}");
        }
    }
}
