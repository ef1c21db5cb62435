//! ONNX export of the formulas, in double precision.

use onnx_graph::proto::AttributeProto;

use super::{Fit, InverseRange, ViewSet};
use crate::networks::estimator_graph::{BOXES, EstimatorGraph};
use crate::samples::FARTHEST_M;

impl InverseRange {
    /// Distance from the first fit whose positions are available, metres.
    pub(crate) fn to_onnx(&self, graph: &mut EstimatorGraph) -> String {
        let mut answer = graph.graph.double(f64::NAN);
        for fit in self.fits.iter().rev() {
            let applies = fit.set.applies_to_onnx(graph);
            let places = fit.set.places_to_onnx(graph);
            let distance = fit.distance_to_onnx(graph, &places);
            answer = graph.graph.plain("Where", &[&applies, &distance, &answer]);
        }
        answer
    }
}

impl ViewSet {
    /// True if all positions are available, `[batch, 1]`.
    fn applies_to_onnx(&self, graph: &mut EstimatorGraph) -> String {
        let seen = graph.seen_by_all(&self.views);
        if !self.registered {
            return seen;
        }
        let shifts = self.shifts_to_onnx(graph);
        let missing = graph.graph.plain("IsNaN", &[&shifts]);
        let measured = graph.graph.plain("Not", &[&missing]);
        let measured = graph.all_in_rows(&measured);
        let measured = graph.all(&measured);
        // One view is the reference.
        let zero = graph.graph.double(0.0);
        let still = graph.graph.plain("Equal", &[&shifts, &zero]);
        let still = graph.all_in_rows(&still);
        let with_reference = graph.any(&still);
        let registered = graph.graph.plain("And", &[&measured, &with_reference]);
        graph.graph.plain("And", &[&seen, &registered])
    }

    fn shifts_to_onnx(&self, graph: &mut EstimatorGraph) -> String {
        graph.registrations(&self.views, 0..2)
    }

    /// Coordinates, `[batch, 2 * views]`.
    fn places_to_onnx(&self, graph: &mut EstimatorGraph) -> String {
        let boxes = graph.some_of(BOXES, self.views.iter().copied());
        let centres = graph.graph.slice(&boxes, 0..2, 2);
        let places = if self.registered {
            let shifts = self.shifts_to_onnx(graph);
            let in_reference = graph.graph.plain("Sub", &[&centres, &shifts]);
            let over_views = AttributeProto::ints("axes", &[1]);
            let mean = (graph.graph).node("ReduceMean", &[&in_reference], vec![over_views]);
            graph.graph.plain("Add", &[&mean, &shifts])
        } else {
            centres
        };
        let row = graph.graph.integers(&[-1, 2 * self.views.len() as i64]);
        graph.graph.plain("Reshape", &[&places, &row])
    }
}

impl Fit {
    /// Distance at these coordinates, `[batch, 1]`; NaN where the formula has none.
    fn distance_to_onnx(&self, graph: &mut EstimatorGraph, places: &str) -> String {
        let graph = &mut graph.graph;
        let count = self.scales.offset_px.len();
        let length = count as i64;
        let offset = graph.doubles(&[length], &self.scales.offset_px);
        let scale = graph.doubles(&[length], &self.scales.scale_px);
        let moved = graph.plain("Sub", &[places, &offset]);
        let scaled = graph.plain("Div", &[&moved, &scale]);

        let (constant, rest) = self.coefficients_per_m.split_at(1);
        let (linear, products) = rest.split_at(count);
        // Upper triangle, row by row: products of a coordinate with itself and all after it.
        let mut square = vec![0.0; count * count];
        let mut products = products.iter();
        for row in 0..count {
            for (cell, &product) in square[row * count + row..(row + 1) * count]
                .iter_mut()
                .zip(&mut products)
            {
                *cell = product;
            }
        }
        let constant = graph.double(constant[0]);
        let linear = graph.doubles(&[length, 1], linear);
        let square = graph.doubles(&[length, length], &square);
        let linear = graph.plain("MatMul", &[&scaled, &linear]);
        let rows = graph.plain("MatMul", &[&scaled, &square]);
        let products = graph.plain("Mul", &[&rows, &scaled]);
        let columns = graph.integers(&[1]);
        let quadratic = graph.plain("ReduceSum", &[&products, &columns]);
        let inverse_range = graph.plain("Sum", &[&constant, &linear, &quadratic]);

        let (zero, none) = (graph.double(0.0), graph.double(f64::NAN));
        let setback = graph.double(self.setback_m);
        let range = graph.plain("Reciprocal", &[&inverse_range]);
        let distance = graph.plain("Sub", &[&range, &setback]);
        let farthest = graph.double(FARTHEST_M);
        let before = graph.plain("Greater", &[&inverse_range, &zero]);
        let least = graph.plain("GreaterOrEqual", &[&distance, &zero]);
        let most = graph.plain("LessOrEqual", &[&distance, &farthest]);
        let on_earth = graph.plain("And", &[&least, &most]);
        let valid = graph.plain("And", &[&before, &on_earth]);
        graph.plain("Where", &[&valid, &distance, &none])
    }
}
