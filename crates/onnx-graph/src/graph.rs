//! Graph builder. Values are identified by generated names.

use std::ops::Range;

use prost::Message;

use crate::proto::{
    AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, StringStringEntryProto,
    TensorProto, ValueInfoProto,
};

const IR_VERSION: i64 = 8;
/// Version of ONNX's operators; the nodes that callers add are of this one.
const OPSET_VERSION: i64 = 13;

/// Nodes and constants.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<NodeProto>,
    constants: Vec<TensorProto>,
}

/// Texts in the model header.
#[derive(Debug, Clone, Copy)]
pub struct ModelTexts<'a> {
    /// Graph name.
    pub name: &'a str,
    /// Version of the writing program.
    pub version: &'a str,
    /// Keys and values for the reader.
    pub metadata: &'a [(&'a str, &'a str)],
}

impl Graph {
    /// Adds an operation with settings; returns its value.
    pub fn node(
        &mut self,
        operator: &str,
        inputs: &[&str],
        attributes: Vec<AttributeProto>,
    ) -> String {
        let output = format!("{}_{}", operator.to_lowercase(), self.nodes.len());
        self.nodes.push(NodeProto {
            input: inputs.iter().map(|&name| name.to_owned()).collect(),
            output: vec![output.clone()],
            name: output.clone(),
            op_type: operator.into(),
            attribute: attributes,
        });
        output
    }

    /// Adds an operation without settings; returns its value.
    pub fn plain(&mut self, operator: &str, inputs: &[&str]) -> String {
        self.node(operator, inputs, vec![])
    }

    /// Values joined along an axis.
    pub fn concat(&mut self, parts: &[&str], axis: i64) -> String {
        self.node("Concat", parts, vec![AttributeProto::int("axis", axis)])
    }

    /// Slice along an axis.
    pub fn slice(&mut self, value: &str, part: Range<i64>, axis: i64) -> String {
        let ends = [part.start, part.end, axis];
        let [from, to, axis] = ends.map(|number| self.integers(&[number]));
        self.plain("Slice", &[value, &from, &to, &axis])
    }

    /// Converts the elements to an element type from [`crate::proto`].
    pub fn cast(&mut self, value: &str, element_type: i32) -> String {
        let to = AttributeProto::int("to", element_type.into());
        self.node("Cast", &[value], vec![to])
    }

    /// Single-precision constant.
    pub fn floats(&mut self, dims: &[i64], values: &[f32]) -> String {
        self.constant(|name| TensorProto::floats(name, dims, values))
    }

    /// Double-precision constant.
    pub fn doubles(&mut self, dims: &[i64], values: &[f64]) -> String {
        self.constant(|name| TensorProto::doubles(name, dims, values))
    }

    /// Single-precision scalar.
    pub fn number(&mut self, value: f64) -> String {
        self.floats(&[], &[value as f32])
    }

    /// Double-precision scalar.
    pub fn double(&mut self, value: f64) -> String {
        self.doubles(&[], &[value])
    }

    /// Integer list.
    pub fn integers(&mut self, values: &[i64]) -> String {
        self.constant(|name| TensorProto::integers(name, values))
    }

    /// Integer scalar.
    pub fn integer(&mut self, value: i64) -> String {
        self.constant(|name| TensorProto {
            dims: vec![],
            ..TensorProto::integers(name, &[value])
        })
    }

    fn constant(&mut self, make: impl FnOnce(&str) -> TensorProto) -> String {
        let name = format!("constant_{}", self.constants.len());
        self.constants.push(make(&name));
        name
    }

    /// Names the last node's value, which becomes a model output.
    pub fn name_last(&mut self, name: &str) {
        if let Some(last) = self.nodes.last_mut() {
            last.output = vec![name.into()];
        }
    }

    /// Nodes and constants.
    pub fn parts(&self) -> (&[NodeProto], &[TensorProto]) {
        (&self.nodes, &self.constants)
    }

    /// Wraps the graph in a model.
    pub fn into_model(
        self,
        inputs: Vec<ValueInfoProto>,
        outputs: Vec<ValueInfoProto>,
        texts: ModelTexts,
    ) -> ModelProto {
        let entry = |&(key, value): &(&str, &str)| StringStringEntryProto {
            key: key.into(),
            value: value.into(),
        };
        ModelProto {
            ir_version: IR_VERSION,
            producer_name: "dtd".into(),
            producer_version: texts.version.into(),
            graph: Some(GraphProto {
                node: self.nodes,
                name: texts.name.into(),
                initializer: self.constants,
                input: inputs,
                output: outputs,
            }),
            opset_import: vec![OperatorSetIdProto {
                domain: String::new(),
                version: OPSET_VERSION,
            }],
            metadata_props: texts.metadata.iter().map(entry).collect(),
        }
    }
}

impl ModelProto {
    /// Content of the ONNX file.
    pub fn bytes(&self) -> Vec<u8> {
        self.encode_to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proto::{Dimension, FLOAT};

    #[test]
    fn a_model_survives_its_bytes() {
        let mut graph = Graph::default();
        let (half, one) = (graph.number(0.5), graph.double(1.0));
        let scaled = graph.plain("Mul", &["x", &half]);
        let one = graph.cast(&one, FLOAT);
        graph.node(
            "LeakyRelu",
            &[&scaled],
            vec![AttributeProto::float("alpha", 0.01)],
        );
        graph.concat(&[&scaled, &one], 0);
        graph.name_last("y");
        let value = |name: &str| ValueInfoProto::floats(name, &[Dimension::Named("n".into())]);
        let texts = ModelTexts {
            name: "half",
            version: "1",
            metadata: &[("unit", "m")],
        };
        let model = graph.into_model(vec![value("x")], vec![value("y")], texts);
        assert_eq!(ModelProto::decode(model.bytes().as_slice()).unwrap(), model);
        let graph = model.graph.unwrap();
        assert_eq!(graph.node.last().unwrap().output, ["y"]);
        assert_eq!(graph.initializer[1].raw_data, 1.0_f64.to_le_bytes());
    }
}
