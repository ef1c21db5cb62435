//! Columns of numbers that other programs wrote, in whichever type it keeps them.

use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type,
    TimestampMicrosecondType, TimestampMillisecondType, TimestampNanosecondType,
    TimestampSecondType, UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef, PrimitiveArray};

use super::Table;
use crate::error::Result;

impl Table {
    /// A column of numbers that may be missing: floats of 32 or 64 bits, whole numbers of any size, or times, as seconds since 1970. Whole
    /// numbers beyond 2^53 are rounded.
    ///
    /// # Errors
    /// The column is missing or contains something other than numbers.
    pub fn any_numbers(&self, column: &str) -> Result<Vec<Option<f64>>> {
        let mut values = Vec::with_capacity(self.rows());
        for array in self.arrays(column)? {
            let numbers = floats::<Float64Type>(array, |number| number)
                .or_else(|| floats::<Float32Type>(array, f64::from))
                .or_else(|| floats::<Int64Type>(array, |number| number as f64))
                .or_else(|| floats::<Int32Type>(array, f64::from))
                .or_else(|| floats::<Int16Type>(array, f64::from))
                .or_else(|| floats::<Int8Type>(array, f64::from))
                .or_else(|| floats::<UInt64Type>(array, |number| number as f64))
                .or_else(|| floats::<UInt32Type>(array, f64::from))
                .or_else(|| floats::<UInt16Type>(array, f64::from))
                .or_else(|| floats::<UInt8Type>(array, f64::from))
                .or_else(|| floats::<TimestampNanosecondType>(array, |time| time as f64 / 1e9))
                .or_else(|| floats::<TimestampMicrosecondType>(array, |time| time as f64 / 1e6))
                .or_else(|| floats::<TimestampMillisecondType>(array, |time| time as f64 / 1e3))
                .or_else(|| floats::<TimestampSecondType>(array, |time| time as f64));
            values.extend(numbers.ok_or_else(|| self.wrong_type(column, "numbers", array))?);
        }
        Ok(values)
    }
}

/// The array's numbers if it has this type.
fn floats<T: ArrowPrimitiveType>(
    array: &ArrayRef,
    float: impl Fn(T::Native) -> f64,
) -> Option<Vec<Option<f64>>> {
    let typed = array.as_any().downcast_ref::<PrimitiveArray<T>>()?;
    let numbers = typed.iter();
    Some(numbers.map(|number| number.map(&float)).collect())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use arrow_array::Float32Array;

    use super::*;
    use crate::tables::columns::TableWriter;

    #[test]
    fn numbers_of_every_type_are_floats_and_other_types_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("numbers.parquet");
        TableWriter::new()
            .i64("signed", [-1, 2])
            .u32("unsigned", [1, u32::MAX])
            .u64("long", [0, 1 << 52])
            .push("single", false, Float32Array::from(vec![0.5, 1.5]))
            .optional_f64("missing", [None, Some(0.1)])
            .text("words", ["one", "two"])
            .write(&path)
            .unwrap();
        let table = Table::read(Path::new(&path), 2).unwrap();
        let numbers = |column: &str| table.any_numbers(column).unwrap();
        assert_eq!(numbers("signed"), [Some(-1.0), Some(2.0)]);
        assert_eq!(numbers("unsigned"), [Some(1.0), Some(4_294_967_295.0)]);
        assert_eq!(numbers("long"), [Some(0.0), Some(4_503_599_627_370_496.0)]);
        assert_eq!(numbers("single"), [Some(0.5), Some(1.5)]);
        assert_eq!(numbers("missing"), [None, Some(0.1)]);
        let message = table.any_numbers("words").unwrap_err().to_string();
        let expected = "column words should hold numbers, but holds";
        assert!(message.contains(expected), "{message}");
        let message = table.any_numbers("none").unwrap_err().to_string();
        assert!(message.contains("has no column none"), "{message}");
    }
}
