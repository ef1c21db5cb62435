//! Files: reading what others wrote, within limits, and writing atomically.

pub mod corpus_names;
pub mod file_name;
pub mod folder_size;
pub mod json_file;
pub mod new_file;
pub(crate) mod others_decoder;
pub mod outside_file;
pub mod own_path;
pub mod toml_file;
