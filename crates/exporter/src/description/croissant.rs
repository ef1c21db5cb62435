//! `croissant.json`: what a folder contains, as machines read it (Croissant 1.1, MLCommons): files, hashes, fields with units, splits,
//! licence, how it was made.
//!
//! Files that come in numbers (images, labels, videos) are sets. Every other file is listed with its SHA-256 hash; the seal's manifest
//! beside it (`MANIFEST.b3`) has the BLAKE3 hashes of all of them.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use dataset::files::json_file::write_json_unsynced;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use crate::description::about::About;
use crate::description::columns_text::{Column, Kind, TableText, unit_of};
use crate::error::Result;

/// Name of the file.
pub(crate) const CROISSANT: &str = "croissant.json";

/// Contents of a folder.
#[derive(Default)]
pub(crate) struct Contents {
    pub(crate) files: Vec<ListedFile>,
    pub(crate) sets: Vec<FileSet>,
    pub(crate) records: Vec<RecordSet>,
    pub(crate) lists: Vec<NameList>,
}

/// A file that is listed with its hash.
pub(crate) struct ListedFile {
    /// Identifier used by fields.
    pub(crate) id: String,
    /// Relative to the folder, with forward slashes.
    pub(crate) name: String,
    pub(crate) form: &'static str,
}

/// Many files of a kind.
pub(crate) struct FileSet {
    pub(crate) id: String,
    /// Globs, relative to the folder.
    pub(crate) includes: Vec<String>,
    pub(crate) form: &'static str,
    pub(crate) what: &'static str,
    /// The archives that hold them; otherwise they are in the folder.
    pub(crate) archives: Vec<String>,
}

/// Records that are in the files.
pub(crate) struct RecordSet {
    pub(crate) name: &'static str,
    pub(crate) what: String,
    pub(crate) fields: Vec<Field>,
}

/// A set of names that stands in the description itself.
pub(crate) struct NameList {
    pub(crate) id: &'static str,
    pub(crate) what: &'static str,
    pub(crate) names: Vec<String>,
}

/// A field of them.
pub(crate) struct Field {
    pub(crate) column: Column,
    pub(crate) source: Value,
}

/// Parquet.
pub(crate) const PARQUET: &str = "application/x-parquet";
/// JSON.
pub(crate) const JSON: &str = "application/json";

impl ListedFile {
    pub(crate) fn new(name: impl Into<String>, form: &'static str) -> Self {
        let name = name.into();
        Self {
            id: name.clone(),
            name,
            form,
        }
    }
}

impl FileSet {
    pub(crate) fn new(
        id: impl Into<String>,
        includes: impl Into<String>,
        form: &'static str,
        what: &'static str,
    ) -> Self {
        Self {
            id: id.into(),
            includes: vec![includes.into()],
            form,
            what,
            archives: Vec::new(),
        }
    }
}

impl Field {
    pub(crate) fn new(
        name: &'static str,
        kind: Kind,
        meaning: &'static str,
        source: Value,
    ) -> Self {
        Self {
            column: Column {
                name,
                kind,
                meaning,
            },
            source,
        }
    }
}

/// Source of a field in a listed JSON file.
pub(crate) fn json_path(file: &str, path: &str) -> Value {
    json!({"fileObject": {"@id": file}, "extract": {"jsonPath": path}})
}

/// Source of a field in a set of JSON files.
pub(crate) fn json_path_in(set: &str, path: &str) -> Value {
    json!({"fileSet": {"@id": set}, "extract": {"jsonPath": path}})
}

/// A field that is a part of the path of a set's files: the group of the expression, which begins where the path begins.
pub(crate) fn part_of_path(set: &str, expression: &str) -> Value {
    json!({
        "fileSet": {"@id": set},
        "extract": {"fileProperty": "fullpath"},
        "transform": {"regex": expression},
    })
}

/// A field that is all of each of a set's files, as text.
pub(crate) fn content_of(set: &str) -> Value {
    json!({"fileSet": {"@id": set}, "extract": {"fileProperty": "content"}})
}

/// The records of a table in a set of Parquet files.
pub(crate) fn table_records(table: &TableText, set: &str) -> RecordSet {
    let field = |column: &Column| Field {
        column: *column,
        source: json!({"fileSet": {"@id": set}, "extract": {"column": column.name}}),
    };
    RecordSet {
        name: table.name,
        what: format!("A row per {}.", table.row),
        fields: table.columns.iter().map(field).collect(),
    }
}

/// Writes the file for a folder.
pub(crate) fn write(folder: &Path, about: &About, contents: &Contents) -> Result<()> {
    let described = describe(folder, about, contents)?;
    Ok(write_json_unsynced(&folder.join(CROISSANT), &described)?)
}

/// The description of a folder.
pub(crate) fn describe(folder: &Path, about: &About, contents: &Contents) -> Result<Value> {
    let mut distribution = Vec::new();
    for file in &contents.files {
        distribution.push(file_object(folder, file)?);
    }
    distribution.extend(contents.sets.iter().map(file_set));
    let mut records: Vec<Value> = contents.records.iter().map(record_set).collect();
    records.extend(contents.lists.iter().map(name_list));
    records.push(splits(about));
    let mut described = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": about.name,
        "description": about.description(),
        "version": concat!(env!("CARGO_PKG_VERSION"), "+dtd"),
        "keywords": ["aviation", "distance to touchdown", "multi-camera", "simulation"],
        "rai:dataCollection": about.collection(),
        "rai:dataAnnotationProtocol": about.annotation(),
        "distribution": distribution,
        "recordSet": records,
    });
    if let (Some(license), Value::Object(described)) = (&about.license, &mut described) {
        described.insert("license".into(), license_url(license).into());
    }
    Ok(described)
}

/// A licence as a URL.
fn license_url(license: &str) -> String {
    if license.contains("://") {
        license.to_owned()
    } else {
        format!("https://spdx.org/licenses/{license}.html")
    }
}

fn file_object(folder: &Path, file: &ListedFile) -> Result<Value> {
    let path = folder.join(&file.name);
    let (sha256, bytes) = sha256(&path).map_err(dataset::Error::io("read", &path))?;
    Ok(json!({
        "@type": "cr:FileObject",
        "@id": file.id,
        "name": file.id,
        "contentUrl": file.name,
        "contentSize": format!("{bytes} B"),
        "encodingFormat": file.form,
        "sha256": sha256,
    }))
}

fn file_set(set: &FileSet) -> Value {
    let mut described = json!({
        "@type": "cr:FileSet",
        "@id": set.id,
        "name": set.id,
        "description": set.what,
        "encodingFormat": set.form,
        "includes": set.includes,
    });
    if let (false, Value::Object(described)) = (set.archives.is_empty(), &mut described) {
        let archives = set.archives.iter().map(|name| json!({"@id": name}));
        described.insert("containedIn".into(), archives.collect());
    }
    described
}

fn record_set(set: &RecordSet) -> Value {
    let fields = set.fields.iter().map(|field| {
        let Column {
            name,
            kind,
            meaning,
        } = field.column;
        let id = format!("{}/{name}", set.name);
        let mut described = json!({
            "@type": "cr:Field",
            "@id": id,
            "name": name,
            "description": meaning,
            "dataType": data_type(kind),
            "source": field.source,
        });
        if let (Kind::F64s(count), Value::Object(described)) = (kind, &mut described) {
            described.insert("isArray".into(), true.into());
            described.insert("arrayShape".into(), count.to_string().into());
        }
        if let (Some(unit), Value::Object(described)) = (unit_of(name), &mut described) {
            let annotation = json!({
                "@type": "cr:Field",
                "@id": format!("{id}/unit"),
                "name": "unit",
                "dataType": "sc:Text",
                "equivalentProperty": "sc:unitText",
                "value": unit,
            });
            described.insert("annotation".into(), annotation);
        }
        described
    });
    json!({
        "@type": "cr:RecordSet",
        "@id": set.name,
        "name": set.name,
        "description": set.what,
        "field": fields.collect::<Vec<_>>(),
    })
}

/// The names of the splits.
fn splits(about: &About) -> Value {
    let list = NameList {
        id: "splits",
        what: "The sides of the split, by trajectory.",
        names: about.splits.iter().map(|name| (*name).to_owned()).collect(),
    };
    let mut described = name_list(&list);
    described["dataType"] = "cr:Split".into();
    described
}

fn name_list(list: &NameList) -> Value {
    let field = format!("{}/name", list.id);
    let records = list.names.iter().map(|name| json!({&field: name}));
    json!({
        "@type": "cr:RecordSet",
        "@id": list.id,
        "name": list.id,
        "description": list.what,
        "key": {"@id": field},
        "field": [{
            "@type": "cr:Field",
            "@id": field,
            "name": "name",
            "description": "its name",
            "dataType": "sc:Text",
        }],
        "data": records.collect::<Vec<_>>(),
    })
}

fn data_type(kind: Kind) -> &'static str {
    match kind {
        Kind::Text => "sc:Text",
        Kind::Bool => "sc:Boolean",
        Kind::U32 => "cr:UInt32",
        Kind::U64 => "cr:UInt64",
        Kind::I64 => "cr:Int64",
        Kind::F64 | Kind::F64s(_) => "cr:Float64",
    }
}

/// The context that the specification prescribes, and its term for annotations of fields.
fn context() -> Value {
    let mut context = Map::new();
    for (term, meaning) in [
        ("@language", "en"),
        ("@vocab", "https://schema.org/"),
        ("cr", "http://mlcommons.org/croissant/"),
        ("dct", "http://purl.org/dc/terms/"),
        ("rai", "http://mlcommons.org/croissant/RAI/"),
        ("sc", "https://schema.org/"),
        ("conformsTo", "dct:conformsTo"),
    ] {
        context.insert(term.into(), meaning.into());
    }
    for term in [
        "annotation",
        "arrayShape",
        "citeAs",
        "column",
        "containedIn",
        "equivalentProperty",
        "extract",
        "field",
        "fileObject",
        "fileProperty",
        "fileSet",
        "format",
        "includes",
        "isArray",
        "isLiveDataset",
        "jsonPath",
        "key",
        "md5",
        "parentField",
        "path",
        "recordSet",
        "references",
        "regex",
        "repeated",
        "replace",
        "samplingRate",
        "separator",
        "source",
        "subField",
        "transform",
    ] {
        context.insert(term.into(), format!("cr:{term}").into());
    }
    for (term, meaning) in [
        ("data", json!({"@id": "cr:data", "@type": "@json"})),
        ("dataType", json!({"@id": "cr:dataType", "@type": "@vocab"})),
        ("description", json!({"@container": "@language"})),
        ("examples", json!({"@id": "cr:examples", "@type": "@json"})),
        ("name", json!({"@container": "@language"})),
    ] {
        context.insert(term.into(), meaning);
    }
    context.into()
}

/// Hash and size of a file.
fn sha256(path: &Path) -> io::Result<(String, u64)> {
    let mut file = File::open(path)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    let mut bytes = 0;
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok((hex(&hasher.finalize()), bytes)),
            read => {
                hasher.update(&buffer[..read]);
                bytes += read as u64;
            }
        }
    }
}

fn hex(hash: &[u8]) -> String {
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}
