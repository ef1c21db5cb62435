//! Common parts of all networks: layers, encoded samples, the training loop with stages and checkpoint, and the ONNX graph.

pub(crate) mod checkpoint;
pub(crate) mod dense;
pub(crate) mod encoded;
pub(crate) mod estimator_graph;
pub(crate) mod lstm;
pub(crate) mod normalisation;
pub(crate) mod row_parts;
pub(crate) mod running_mean;
pub(crate) mod stage;
pub(crate) mod training_loop;
pub(crate) mod view_dropout;
