//! The JSON Schema of a sweep file, generated from the structs that read it. It rejects what [`super::Sweep`] rejects, as far as a
//! schema can: it cannot check that names are defined, files exist, or shares add up.

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
