//! Common part of all ONNX models: inputs in pixels, box selection, features, and the answer in metres.
//!
//! Inputs and formulas are in double precision, as in this crate: differences between views are 0.01 px at coordinates around 1,000 px.

use std::ops::Range;

use onnx_graph::proto::{AttributeProto, DOUBLE, Dimension, FLOAT, ModelProto, ValueInfoProto};
use onnx_graph::{Graph, ModelTexts};

use crate::config::{Loss, TARGET_UNIT_M, Target};
use crate::networks::normalisation::{BOX_FEATURES, Normalisation};

/// Input: `[batch, views, 4]`, centre right, centre down, width, height, pixels; NaN for an empty view.
pub(crate) const BOXES: &str = "boxes";
/// Input: `[batch, views, 2]`, `dx_px` and `dy_px` of `registrations/*.parquet` for a view. The shift of the reference view to itself is 0;
/// NaN marks a missing registration.
pub(crate) const REGISTRATIONS: &str = "registrations";
/// Output: `[batch]`, metres; NaN for no answer.
const DISTANCE: &str = "distance_m";

/// Graph that begins at the boxes. Values per view and answers are `[batch, ..]`.
pub(crate) struct EstimatorGraph<'a> {
    pub(crate) graph: Graph,
    normalisation: &'a Normalisation,
    /// True where a view saw the aircraft, `[batch, views, 1]`.
    seen: String,
    takes_registrations: bool,
}

impl<'a> EstimatorGraph<'a> {
    /// Begins with the selection of boxes that resemble the training side, as in an evaluation.
    pub(crate) fn new(normalisation: &'a Normalisation) -> Self {
        let mut graph = Graph::default();
        let views = normalisation.views.len();
        let dims = [1, views as i64, BOX_FEATURES as i64];
        let believed: Vec<_> = (0..views)
            .flat_map(|view| normalisation.believed_px(view))
            .collect();
        let mut bound = |which: usize| {
            let bounds: Vec<f64> = believed.iter().map(|range| range[which]).collect();
            graph.doubles(&dims, &bounds)
        };
        let (least, most) = (bound(0), bound(1));
        // Comparisons with NaN are false, so a missing box is not seen.
        let above = graph.plain("GreaterOrEqual", &[BOXES, &least]);
        let below = graph.plain("LessOrEqual", &[BOXES, &most]);
        let inside = graph.plain("And", &[&above, &below]);
        let seen = reduced(&mut graph, "ReduceMin", &inside, 2, true);
        Self {
            graph,
            normalisation,
            seen,
            takes_registrations: false,
        }
    }

    pub(crate) fn views(&self) -> usize {
        self.normalisation.views.len()
    }

    /// Slice along `[batch, views, ..]`.
    pub(crate) fn of_view(&mut self, value: &str, view: usize) -> String {
        let view = self.graph.integer(view as i64);
        let axis = AttributeProto::int("axis", 1);
        self.graph.node("Gather", &[value, &view], vec![axis])
    }

    /// Slices along the second axis: views in `[batch, views, ..]`, or columns in `[batch, columns]`.
    pub(crate) fn some_of(&mut self, value: &str, which: impl Iterator<Item = usize>) -> String {
        let which: Vec<i64> = which.map(|index| index as i64).collect();
        let which = self.graph.integers(&which);
        let axis = AttributeProto::int("axis", 1);
        self.graph.node("Gather", &[value, &which], vec![axis])
    }

    /// True if a view saw the aircraft, `[batch, 1]`.
    pub(crate) fn seen_by(&mut self, view: usize) -> String {
        let seen = self.seen.clone();
        self.of_view(&seen, view)
    }

    /// True if all given views saw the aircraft, `[batch, 1]`.
    pub(crate) fn seen_by_all(&mut self, views: &[usize]) -> String {
        let seen = self.seen.clone();
        let of_views = self.some_of(&seen, views.iter().copied());
        self.all(&of_views)
    }

    /// Logical and: `[batch, n, 1]` to `[batch, 1]`.
    pub(crate) fn all(&mut self, values: &str) -> String {
        reduced(&mut self.graph, "ReduceMin", values, 1, false)
    }

    /// Logical or: `[batch, n, 1]` to `[batch, 1]`.
    pub(crate) fn any(&mut self, values: &str) -> String {
        reduced(&mut self.graph, "ReduceMax", values, 1, false)
    }

    /// Logical and: `[batch, n, m]` to `[batch, n, 1]`.
    pub(crate) fn all_in_rows(&mut self, values: &str) -> String {
        reduced(&mut self.graph, "ReduceMin", values, 2, true)
    }

    /// Network inputs per view, `[batch, 4]`: 0 for an empty view.
    pub(crate) fn features(&mut self, view: usize) -> String {
        let dims = [1, BOX_FEATURES as i64];
        let offset = (self.graph).doubles(&dims, &self.normalisation.offset_px[view]);
        let scale = (self.graph).doubles(&dims, &self.normalisation.scale_px[view]);
        let boxes = self.of_view(BOXES, view);
        let moved = self.graph.plain("Sub", &[&boxes, &offset]);
        let scaled = self.graph.plain("Div", &[&moved, &scale]);
        let seen = self.seen_by(view);
        let nothing = self.graph.double(0.0);
        let features = self.graph.plain("Where", &[&seen, &scaled, &nothing]);
        self.graph.cast(&features, FLOAT)
    }

    /// 1 where a view saw the aircraft, else 0, `[batch, 1]`.
    pub(crate) fn presence(&mut self, view: usize) -> String {
        let seen = self.seen_by(view);
        self.graph.cast(&seen, FLOAT)
    }

    /// Distance in units of 10 NM from a network's output.
    pub(crate) fn distance(&mut self, predicted: String, loss: Target) -> String {
        match loss.loss {
            Loss::Squared | Loss::Relative if loss.per_10_nm == 1.0 => predicted,
            Loss::Squared | Loss::Relative => {
                let per_10_nm = self.graph.floats(&[1], &[loss.per_10_nm]);
                self.graph.plain("Div", &[&predicted, &per_10_nm])
            }
            Loss::Logarithmic => self.graph.plain("Exp", &[&predicted]),
        }
    }

    /// Distance in metres from units of 10 NM.
    pub(crate) fn metres(&mut self, distance: &str) -> String {
        let distance = self.graph.cast(distance, DOUBLE);
        let unit = self.graph.double(TARGET_UNIT_M);
        self.graph.plain("Mul", &[&distance, &unit])
    }

    /// Mean of values that are 0 where they do not count; also their number.
    pub(crate) fn mean_and_count(&mut self, values: &[String], counts: &[String]) -> [String; 2] {
        let [sum, count] = [values, counts].map(|terms| {
            let terms: Vec<&str> = terms.iter().map(String::as_str).collect();
            self.graph.plain("Sum", &terms)
        });
        [self.graph.plain("Div", &[&sum, &count]), count]
    }

    /// Columns of some views' registrations, `[batch, views, columns]`. Adds the input [`REGISTRATIONS`] to the model.
    pub(crate) fn registrations(&mut self, views: &[usize], columns: Range<i64>) -> String {
        self.takes_registrations = true;
        let of_views = self.some_of(REGISTRATIONS, views.iter().copied());
        self.graph.slice(&of_views, columns, 2)
    }

    /// Model that answers `metres`, `[batch, 1]`, where any view saw the aircraft.
    pub(crate) fn model(&mut self, metres: &str, name: &str) -> ModelProto {
        let seen = self.seen.clone();
        let any = self.any(&seen);
        let none = self.graph.double(f64::NAN);
        let answers = self.graph.plain("Where", &[&any, metres, &none]);
        let list = self.graph.integers(&[-1]);
        self.graph.plain("Reshape", &[&answers, &list]);
        self.graph.name_last(DISTANCE);
        let batch = || Dimension::Named("batch".into());
        let views = self.views() as i64;
        let input = |name, length| {
            let dims = [batch(), Dimension::Fixed(views), Dimension::Fixed(length)];
            ValueInfoProto::doubles(name, &dims)
        };
        let mut inputs = vec![input(BOXES, BOX_FEATURES as i64)];
        if self.takes_registrations {
            inputs.push(input(REGISTRATIONS, 2));
        }
        let names = self.normalisation.views.join(",");
        let texts = ModelTexts {
            name,
            version: env!("CARGO_PKG_VERSION"),
            metadata: &[
                ("views", &names),
                (
                    BOXES,
                    "centre right, centre down, width, height, px; NaN: not seen",
                ),
                (DISTANCE, "distance to touchdown, m; NaN: no answer"),
            ],
        };
        let outputs = vec![ValueInfoProto::doubles(DISTANCE, &[batch()])];
        std::mem::take(&mut self.graph).into_model(inputs, outputs, texts)
    }
}

/// Logical and or or along an axis.
fn reduced(graph: &mut Graph, operator: &str, values: &str, axis: i64, keeps: bool) -> String {
    let numbers = graph.cast(values, FLOAT);
    let attributes = vec![
        AttributeProto::ints("axes", &[axis]),
        AttributeProto::int("keepdims", keeps.into()),
    ];
    let joined = graph.node(operator, &[&numbers], attributes);
    let half = graph.number(0.5);
    graph.plain("Greater", &[&joined, &half])
}
