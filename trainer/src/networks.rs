//! Common parts of all networks: layers and their gradients, encoded samples, the training loop with its stages and its checkpoint, and
//! their ONNX graph.

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
