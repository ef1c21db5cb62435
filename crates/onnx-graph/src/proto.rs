//! The subset of ONNX's file format that this project's models need, as Protocol Buffers messages.
//!
//! Field numbers as in `onnx.proto` (ONNX 1.13, IR version 8). Writing them by hand avoids a compiler for `.proto` files.

use prost::{Message, Oneof};

/// Element type `FLOAT`.
pub const FLOAT: i32 = 1;
/// Element type `INT64`.
pub(crate) const INT64: i32 = 7;
/// Element type `DOUBLE`.
pub const DOUBLE: i32 = 11;

/// A model.
#[derive(Clone, PartialEq, Message)]
pub struct ModelProto {
    /// Version of the file format.
    #[prost(int64, tag = "1")]
    pub ir_version: i64,
    /// Program that wrote it.
    #[prost(string, tag = "2")]
    pub producer_name: String,
    /// Version of the producer.
    #[prost(string, tag = "3")]
    pub producer_version: String,
    /// The computation.
    #[prost(message, optional, tag = "7")]
    pub graph: Option<GraphProto>,
    /// Versions of the operator sets.
    #[prost(message, repeated, tag = "8")]
    pub opset_import: Vec<OperatorSetIdProto>,
    /// Free text for the reader.
    #[prost(message, repeated, tag = "14")]
    pub metadata_props: Vec<StringStringEntryProto>,
}

/// An operator set.
#[derive(Clone, PartialEq, Message)]
pub struct OperatorSetIdProto {
    /// Empty for ONNX's own operators.
    #[prost(string, tag = "1")]
    pub domain: String,
    /// Version.
    #[prost(int64, tag = "2")]
    pub version: i64,
}

/// A key and a value.
#[derive(Clone, PartialEq, Message)]
pub struct StringStringEntryProto {
    /// Key.
    #[prost(string, tag = "1")]
    pub key: String,
    /// Value.
    #[prost(string, tag = "2")]
    pub value: String,
}

/// A computation: nodes in the order of their dependencies.
#[derive(Clone, PartialEq, Message)]
pub struct GraphProto {
    /// Operations.
    #[prost(message, repeated, tag = "1")]
    pub node: Vec<NodeProto>,
    /// Name.
    #[prost(string, tag = "2")]
    pub name: String,
    /// Constants.
    #[prost(message, repeated, tag = "5")]
    pub initializer: Vec<TensorProto>,
    /// Inputs.
    #[prost(message, repeated, tag = "11")]
    pub input: Vec<ValueInfoProto>,
    /// Outputs.
    #[prost(message, repeated, tag = "12")]
    pub output: Vec<ValueInfoProto>,
}

/// An operation.
#[derive(Clone, PartialEq, Message)]
pub struct NodeProto {
    /// Names of the inputs.
    #[prost(string, repeated, tag = "1")]
    pub input: Vec<String>,
    /// Names of the outputs.
    #[prost(string, repeated, tag = "2")]
    pub output: Vec<String>,
    /// Name.
    #[prost(string, tag = "3")]
    pub name: String,
    /// Operator.
    #[prost(string, tag = "4")]
    pub op_type: String,
    /// Settings.
    #[prost(message, repeated, tag = "5")]
    pub attribute: Vec<AttributeProto>,
}

/// Attribute.
#[derive(Clone, PartialEq, Message)]
pub struct AttributeProto {
    /// Name.
    #[prost(string, tag = "1")]
    pub name: String,
    /// Value of type `FLOAT`.
    #[prost(float, optional, tag = "2")]
    pub f: Option<f32>,
    /// Value of type `INT`.
    #[prost(int64, optional, tag = "3")]
    pub i: Option<i64>,
    /// Value of type `STRING`.
    #[prost(bytes = "vec", optional, tag = "4")]
    pub s: Option<Vec<u8>>,
    /// Value of type `INTS`.
    #[prost(int64, repeated, packed = "false", tag = "8")]
    pub ints: Vec<i64>,
    /// Type of the value that is set: 1 `FLOAT`, 2 `INT`, 3 `STRING`, 7 `INTS`.
    #[prost(int32, tag = "20")]
    pub r#type: i32,
}

impl AttributeProto {
    /// A number with a fraction.
    pub fn float(name: &str, value: f32) -> Self {
        Self {
            name: name.into(),
            f: Some(value),
            r#type: 1,
            ..Self::default()
        }
    }

    /// A whole number.
    pub fn int(name: &str, value: i64) -> Self {
        Self {
            name: name.into(),
            i: Some(value),
            r#type: 2,
            ..Self::default()
        }
    }

    /// A word.
    pub fn text(name: &str, value: &str) -> Self {
        Self {
            name: name.into(),
            s: Some(value.into()),
            r#type: 3,
            ..Self::default()
        }
    }

    /// Numbers.
    pub fn ints(name: &str, values: &[i64]) -> Self {
        Self {
            name: name.into(),
            ints: values.to_vec(),
            r#type: 7,
            ..Self::default()
        }
    }
}

/// A constant.
#[derive(Clone, PartialEq, Message)]
pub struct TensorProto {
    /// Shape.
    #[prost(int64, repeated, packed = "false", tag = "1")]
    pub dims: Vec<i64>,
    /// Element type.
    #[prost(int32, tag = "2")]
    pub data_type: i32,
    /// Name.
    #[prost(string, tag = "8")]
    pub name: String,
    /// Elements, little-endian.
    #[prost(bytes = "vec", tag = "9")]
    pub raw_data: Vec<u8>,
}

impl TensorProto {
    /// Single-precision tensor.
    pub fn floats(name: &str, dims: &[i64], values: &[f32]) -> Self {
        Self::of(name, FLOAT, dims, values.iter().map(|x| x.to_le_bytes()))
    }

    /// Double-precision tensor.
    pub fn doubles(name: &str, dims: &[i64], values: &[f64]) -> Self {
        Self::of(name, DOUBLE, dims, values.iter().map(|x| x.to_le_bytes()))
    }

    /// Integer list.
    pub fn integers(name: &str, values: &[i64]) -> Self {
        let dims = [values.len() as i64];
        Self::of(name, INT64, &dims, values.iter().map(|x| x.to_le_bytes()))
    }

    fn of<const N: usize>(
        name: &str,
        data_type: i32,
        dims: &[i64],
        elements: impl ExactSizeIterator<Item = [u8; N]>,
    ) -> Self {
        debug_assert_eq!(
            dims.iter().product::<i64>() as usize,
            elements.len(),
            "{name}"
        );
        Self {
            dims: dims.to_vec(),
            data_type,
            name: name.into(),
            raw_data: elements.flatten().collect(),
        }
    }

    /// Elements; `None` unless they are single-precision.
    pub fn float_values(&self) -> Option<Vec<f32>> {
        let (elements, rest) = self.raw_data.as_chunks::<4>();
        (self.data_type == FLOAT && rest.is_empty()).then(|| {
            elements
                .iter()
                .map(|&bytes| f32::from_le_bytes(bytes))
                .collect()
        })
    }
}

/// An input or output.
#[derive(Clone, PartialEq, Message)]
pub struct ValueInfoProto {
    /// Name.
    #[prost(string, tag = "1")]
    pub name: String,
    /// Type.
    #[prost(message, optional, tag = "2")]
    pub r#type: Option<TypeProto>,
}

impl ValueInfoProto {
    /// Single-precision tensor.
    pub fn floats(name: &str, dims: &[Dimension]) -> Self {
        Self::of(name, FLOAT, dims)
    }

    /// Double-precision tensor.
    pub fn doubles(name: &str, dims: &[Dimension]) -> Self {
        Self::of(name, DOUBLE, dims)
    }

    fn of(name: &str, elem_type: i32, dims: &[Dimension]) -> Self {
        let shape = TensorShapeProto {
            dim: dims
                .iter()
                .map(|dim| DimensionProto {
                    value: Some(dim.clone()),
                })
                .collect(),
        };
        let tensor_type = TensorTypeProto {
            elem_type,
            shape: Some(shape),
        };
        Self {
            name: name.into(),
            r#type: Some(TypeProto {
                tensor_type: Some(tensor_type),
            }),
        }
    }
}

/// Value type.
#[derive(Clone, PartialEq, Message)]
pub struct TypeProto {
    /// A tensor.
    #[prost(message, optional, tag = "1")]
    pub tensor_type: Option<TensorTypeProto>,
}

/// Tensor type.
#[derive(Clone, PartialEq, Message)]
pub struct TensorTypeProto {
    /// Element type.
    #[prost(int32, tag = "1")]
    pub elem_type: i32,
    /// Shape.
    #[prost(message, optional, tag = "2")]
    pub shape: Option<TensorShapeProto>,
}

/// Tensor shape.
#[derive(Clone, PartialEq, Message)]
pub struct TensorShapeProto {
    /// Dimensions.
    #[prost(message, repeated, tag = "1")]
    pub dim: Vec<DimensionProto>,
}

/// A dimension.
#[derive(Clone, PartialEq, Message)]
pub struct DimensionProto {
    /// Fixed or named.
    #[prost(oneof = "Dimension", tags = "1, 2")]
    pub value: Option<Dimension>,
}

/// Dimension length.
#[derive(Clone, PartialEq, Oneof)]
pub enum Dimension {
    /// Always this long.
    #[prost(int64, tag = "1")]
    Fixed(i64),
    /// Chosen by the caller; the same name means the same length.
    #[prost(string, tag = "2")]
    Named(String),
}
