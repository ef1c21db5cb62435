//! The JSON Schema of a sweep file, made from the very structs that read it. It refuses what [`super::Sweep`] refuses, as far as a schema can
//! say it: not that names are defined, that files are there, or that parts add up.

use schemars::generate::SchemaSettings;

use super::document::Document;

/// The schema as JSON text with a final newline. Draft 7: the newest that editors and `taplo` read.
pub fn schema() -> String {
    let mut schema = SchemaSettings::draft07()
        .into_generator()
        .into_root_schema_for::<Document>();
    schema.insert("title".into(), "A sweep of dtd".into());
    format!("{:#}\n", schema.to_value())
}
