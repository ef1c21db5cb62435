//! Gradients of the calibration networks, by hand.
//!
//! burn's autodiff computes the same on one core. Here the rows of a batch are divided into parts that cores share, and a part goes through
//! all networks and back. Networks must be without autodiff.

use std::ops::Range;

use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor};
use rayon::prelude::*;

use super::CalibrationNetworks;
use crate::networks::dense::{DenseTrace, LinearGradients};
use crate::networks::encoded::Encoded;
use crate::networks::row_parts::row_parts;

/// A batch that went through the networks, ready to go back.
pub(super) struct Traced<'a> {
    networks: &'a CalibrationNetworks,
    parts: Vec<Part<'a>>,
}

/// Some rows of it.
struct Part<'a> {
    rows: Range<usize>,
    views: Vec<TracedView<'a>>,
}

struct TracedView<'a> {
    prediction: Tensor<2>,
    /// `None` if the view is not optimised.
    back: Option<WayBack<'a>>,
}

struct WayBack<'a> {
    layers: DenseTrace<'a>,
    head: DenseTrace<'a>,
}

/// Gradients of the networks of one view: of its layers, and of the head.
struct ViewGradients {
    layers: Vec<LinearGradients>,
    head: Vec<LinearGradients>,
}

impl CalibrationNetworks {
    /// Predictions from each view of a batch, and what gradients of the optimised ones need.
    pub(super) fn trace(
        &self,
        samples: &Encoded,
        batch: &[usize],
        optimised: &[bool],
        device: &Device,
    ) -> Traced<'_> {
        let part = |rows: Range<usize>| {
            let batch = &batch[rows.clone()];
            let views = (optimised.iter().enumerate())
                .map(|(view, &optimised)| {
                    let boxes = samples.inputs(batch, view, device);
                    if optimised {
                        self.trace_view(view, boxes)
                    } else {
                        TracedView {
                            prediction: self.predict(view, boxes),
                            back: None,
                        }
                    }
                })
                .collect();
            Part { rows, views }
        };
        Traced {
            networks: self,
            parts: row_parts(batch.len()).into_par_iter().map(part).collect(),
        }
    }

    fn trace_view(&self, view: usize, boxes: Tensor<2>) -> TracedView<'_> {
        let (features, layers) = self.views[view].trace(boxes);
        let (prediction, head) = self.head.trace(features);
        TracedView {
            prediction,
            back: Some(WayBack { layers, head }),
        }
    }
}

impl Traced<'_> {
    /// Of each view, `[batch, 1]`.
    pub(super) fn predictions(&self) -> Vec<Tensor<2>> {
        let of_view = |view: usize| {
            let parts = self.parts.iter();
            Tensor::cat(parts.map(|p| p.views[view].prediction.clone()).collect(), 0)
        };
        (0..self.networks.views.len()).map(of_view).collect()
    }

    /// Gradients of the networks of all optimised views, and of the head if it trains, for these gradients of their predictions.
    pub(super) fn gradients(
        self,
        predictions: &[Option<Tensor<2>>],
        head_trains: bool,
    ) -> GradientsParams {
        let parts = self.parts.into_par_iter();
        let parts: Vec<Vec<Option<ViewGradients>>> =
            parts.map(|part| part.back(predictions)).collect();
        // In their order: sums of floats depend on it.
        let total = parts.into_iter().reduce(|sum, part| {
            let pairs = sum.into_iter().zip(part);
            pairs
                .map(|(a, b)| a.zip(b).map(|(a, b)| a.plus(b)))
                .collect()
        });
        let mut gradients = GradientsParams::new();
        let mut of_head: Option<Vec<LinearGradients>> = None;
        let total = total.into_iter().flatten();
        for (network, of_view) in self.networks.views.iter().zip(total) {
            let Some(of_view) = of_view else {
                continue;
            };
            network.register(of_view.layers, &mut gradients);
            of_head = Some(match of_head {
                Some(others) => sum(others, of_view.head),
                None => of_view.head,
            });
        }
        if let Some(of_head) = of_head.filter(|_| head_trains) {
            self.networks.head.register(of_head, &mut gradients);
        }
        gradients
    }
}

impl Part<'_> {
    fn back(self, predictions: &[Option<Tensor<2>>]) -> Vec<Option<ViewGradients>> {
        let rows = self.rows;
        let views = self.views.into_iter().zip(predictions);
        views
            .map(|(view, prediction)| {
                let (back, prediction) = view.back.zip(prediction.clone())?;
                let (head, features) = back.head.back(prediction.slice([rows.clone()]));
                let (layers, _) = back.layers.back(features);
                Some(ViewGradients { layers, head })
            })
            .collect()
    }
}

impl ViewGradients {
    fn plus(self, other: Self) -> Self {
        Self {
            layers: sum(self.layers, other.layers),
            head: sum(self.head, other.head),
        }
    }
}

/// Of layer by layer.
fn sum(a: Vec<LinearGradients>, b: Vec<LinearGradients>) -> Vec<LinearGradients> {
    a.into_iter().zip(b).map(|(a, b)| a.plus(b)).collect()
}

#[cfg(test)]
mod tests {
    use burn::module::{Module, ModuleVisitor, Param};

    use super::super::{batch_loss, traced_gradients};
    use super::*;
    use crate::config::{Loss, Target};
    use crate::estimators::paper_lstm::gap_balance::GapBalance;
    use crate::networks::encoded::boxes_of_two_views;

    /// Counts the parameters of which both have the same gradient, or neither has one.
    struct Compared<'a> {
        found: &'a GradientsParams,
        expected: &'a GradientsParams,
        trained: usize,
    }

    impl ModuleVisitor for Compared<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let of = |all: &GradientsParams| {
                let gradient = all.get::<D>(param.id)?;
                Some(gradient.into_data().try_into_vec::<f32>().unwrap())
            };
            match (of(self.found), of(self.expected)) {
                (None, None) => {}
                (Some(found), Some(expected)) => {
                    let largest = expected.iter().fold(0.0_f32, |most, e| most.max(e.abs()));
                    let mut pairs = found.iter().zip(&expected);
                    assert!(largest > 0.0 && found.len() == expected.len());
                    assert!(pairs.all(|(f, e)| (f - e).abs() <= 1e-5 * largest));
                    self.trained += 1;
                }
                (found, expected) => panic!("{found:?} {expected:?}"),
            }
        }
    }

    #[test]
    fn gradients_are_those_of_autodiff_with_boxes_missing_and_a_view_that_lags() {
        let samples = boxes_of_two_views();
        let batch: Vec<usize> = (0..samples.len()).cycle().take(600).collect();
        let device = Device::flex().autodiff();
        let networks = CalibrationNetworks::narrow(&device);
        let mut balance = GapBalance::new(2, 0, 0.1, 0.2);
        for lags in [false, true] {
            if lags {
                (0..20).for_each(|_| balance.observe(100, &[Some(1.0), Some(3.0)]));
            }
            assert_eq!(balance.all_optimised(), !lags);
            for loss in [Loss::Squared, Loss::Relative] {
                let loss = Target {
                    loss,
                    per_10_nm: 2.0,
                };
                let optimised = balance.optimised();
                let total = batch_loss(&networks, &samples, &batch, optimised, loss, &device);
                let expected_value: f32 = total.clone().into_scalar();
                let expected = networks.gradients(total.backward(), &balance);
                let plain = networks.valid();
                let (_, value, found) =
                    traced_gradients(&plain, &samples, &batch, &balance, loss, &device);
                assert!((value / expected_value - 1.0).abs() < 1e-5);
                let mut compared = Compared {
                    found: &found,
                    expected: &expected,
                    trained: 0,
                };
                networks.visit(&mut compared);
                let trained = if lags { 6 } else { 2 * 6 + 4 };
                assert_eq!(compared.trained, trained);
            }
        }
    }
}
