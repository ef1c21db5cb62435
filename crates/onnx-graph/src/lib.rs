//! ONNX models, written node by node: [`Graph`] for those who export a network, [`proto`] for those who read the file format itself.

#![forbid(unsafe_code)]

mod graph;
pub mod proto;

pub use graph::{Graph, ModelTexts};
