//! JSON Schema for sweep files, generated from the structs that read them. It rejects what [`super::Sweep`] rejects, as far as a schema
//! can: it cannot check that names are defined, files exist, or shares add up.

use schemars::Schema;
use schemars::generate::SchemaSettings;
use schemars::transform::transform_subschemas;

use super::check::limits::LIMITS;
use super::document::Document;

/// The schema as JSON text with a final newline. Draft 7: the newest that editors and `taplo` read.
pub fn schema() -> String {
    let mut schema = schema_with_limits();
    without_limits(&mut schema);
    schema.insert("title".into(), "A sweep of dtd".into());
    format!("{:#}\n", schema.to_value())
}

/// The schema with the limits of each number under [`LIMITS`].
pub(super) fn schema_with_limits() -> Schema {
    let generator = SchemaSettings::draft07().into_generator();
    generator.into_root_schema_for::<Document>()
}

fn without_limits(schema: &mut Schema) {
    schema.remove(LIMITS);
    transform_subschemas(&mut without_limits, schema);
}
