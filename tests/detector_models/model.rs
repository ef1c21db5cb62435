//! ONNX models that answer every image alike.

use std::fs;
use std::path::Path;

use onnx_graph::proto::{
    AttributeProto, Dimension, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, ValueInfoProto,
};
use prost::Message;

pub(crate) fn node(op_type: &str, inputs: &[&str], outputs: &[&str]) -> NodeProto {
    NodeProto {
        op_type: op_type.into(),
        input: inputs.iter().map(ToString::to_string).collect(),
        output: outputs.iter().map(ToString::to_string).collect(),
        ..NodeProto::default()
    }
}

pub(crate) fn open(name: &str) -> Dimension {
    Dimension::Named(name.into())
}

/// Any number of windows of that size.
pub(crate) fn windows_of(size_px: i64) -> [Dimension; 4] {
    [
        open("batch"),
        Dimension::Fixed(3),
        Dimension::Fixed(size_px),
        Dimension::Fixed(size_px),
    ]
}

/// A model that answers every image alike.
pub(crate) struct Model<'a> {
    input: [Dimension; 4],
    outputs: Vec<Answer>,
    metadata: &'a [(&'a str, &'a str)],
    /// Name of the further input.
    second_input: Option<&'a str>,
    /// The settings beside it.
    settings: Option<&'a str>,
}

/// One of its outputs.
pub(crate) struct Answer {
    name: &'static str,
    shape: Vec<i64>,
    numbers: Numbers,
}

pub(crate) enum Numbers {
    Floats(Vec<f32>),
    Integers(Vec<i32>),
}

/// ONNX's element type `INT32`.
pub(crate) const INT32: i32 = 6;

impl Answer {
    pub(crate) fn floats(name: &'static str, shape: &[i64], numbers: Vec<f32>) -> Self {
        Self {
            name,
            shape: shape.to_vec(),
            numbers: Numbers::Floats(numbers),
        }
    }

    pub(crate) fn integers(name: &'static str, shape: &[i64], numbers: Vec<i32>) -> Self {
        Self {
            name,
            shape: shape.to_vec(),
            numbers: Numbers::Integers(numbers),
        }
    }

    /// A constant.
    pub(crate) fn constant(shape: &[i64], number: f32) -> Self {
        let count = shape.iter().product::<i64>() as usize;
        Self::floats("boxes", shape, vec![number; count])
    }

    fn value(&self) -> String {
        format!("{}_value", self.name)
    }

    fn initializer(&self) -> TensorProto {
        match &self.numbers {
            Numbers::Floats(numbers) => TensorProto::floats(&self.value(), &self.shape, numbers),
            Numbers::Integers(numbers) => TensorProto {
                dims: self.shape.clone(),
                data_type: INT32,
                name: self.value(),
                raw_data: numbers
                    .iter()
                    .flat_map(|number| number.to_le_bytes())
                    .collect(),
            },
        }
    }

    /// Floats depend on the image, if only by 0 times its largest value: an input must be used.
    fn node(&self) -> NodeProto {
        match self.numbers {
            Numbers::Floats(_) => node("Add", &[&self.value(), "nothing"], &[self.name]),
            Numbers::Integers(_) => node("Identity", &[&self.value()], &[self.name]),
        }
    }

    /// Declared with open lengths, so that only running the model reveals them.
    fn declared(&self) -> ValueInfoProto {
        let rank: Vec<Dimension> = (0..self.shape.len())
            .map(|at| open(&format!("{}_length{at}", self.name)))
            .collect();
        let mut declared = ValueInfoProto::floats(self.name, &rank);
        if let Numbers::Integers(_) = self.numbers {
            let tensor = declared
                .r#type
                .as_mut()
                .and_then(|made| made.tensor_type.as_mut());
            tensor.unwrap().elem_type = INT32;
        }
        declared
    }
}

impl<'a> Model<'a> {
    /// Takes windows of 64 px.
    pub(crate) fn of(outputs: Vec<Answer>) -> Self {
        Self {
            input: windows_of(64),
            outputs,
            metadata: &[],
            second_input: None,
            settings: None,
        }
    }

    pub(crate) fn with_metadata(self, metadata: &'a [(&'a str, &'a str)]) -> Self {
        Self { metadata, ..self }
    }

    pub(crate) fn with_settings(self, settings: &'a str) -> Self {
        Self {
            settings: Some(settings),
            ..self
        }
    }

    pub(crate) fn with_second_input(self, name: &'a str) -> Self {
        Self {
            second_input: Some(name),
            ..self
        }
    }

    pub(crate) fn with_input(self, input: [Dimension; 4]) -> Self {
        Self { input, ..self }
    }

    pub(crate) fn onnx(&self) -> Vec<u8> {
        let mut nodes = vec![
            node("ReduceMax", &["pictures"], &["largest"]),
            node("Mul", &["largest", "zero"], &["nothing"]),
        ];
        nodes[0].attribute = vec![AttributeProto::int("keepdims", 0)];
        nodes.extend(self.outputs.iter().map(Answer::node));
        let mut initializer = vec![TensorProto::floats("zero", &[1], &[0.0])];
        initializer.extend(self.outputs.iter().map(Answer::initializer));
        let mut input = vec![ValueInfoProto::floats("pictures", &self.input)];
        let second = self.second_input.iter();
        input.extend(
            second.map(|name| ValueInfoProto::floats(name, &[open("batch"), open("sides")])),
        );
        let graph = GraphProto {
            name: "constant".into(),
            node: nodes,
            initializer,
            input,
            output: self.outputs.iter().map(Answer::declared).collect(),
        };
        encoded(graph, self.metadata)
    }

    /// Writes it, with its settings.
    pub(crate) fn write(&self, path: &Path) {
        fs::write(path, self.onnx()).unwrap();
        if let Some(settings) = self.settings {
            fs::write(path.with_extension("onnx.toml"), settings).unwrap();
        }
    }
}

pub(crate) fn encoded(graph: GraphProto, metadata: &[(&str, &str)]) -> Vec<u8> {
    let property = |&(key, value): &(&str, &str)| StringStringEntryProto {
        key: key.into(),
        value: value.into(),
    };
    let model = ModelProto {
        ir_version: 8,
        graph: Some(graph),
        opset_import: vec![OperatorSetIdProto {
            domain: String::new(),
            version: 17,
        }],
        metadata_props: metadata.iter().map(property).collect(),
        ..ModelProto::default()
    };
    model.encode_to_vec()
}
