//! Names of a scenario's objects: a file's content is part of its object's name, so no upload, however late it arrives, replaces
//! another content. `frames.parquet` is the object `frames.<hash>.parquet`.
//!
//! Folders that other tools copied there have objects under the plain names of the files; readers take those if there is no other.

use dataset::corpus::seal::SealedFile;

/// Digits of the hash in a name: 128 bits. Whoever reads the object compares all of them.
const DIGITS: usize = 32;

/// Name of the object that has this file's content, within the scenario.
pub(crate) fn content_name(file: &SealedFile) -> String {
    let digits = file.blake3.get(..DIGITS).unwrap_or(&file.blake3);
    let (folder, name) = split_folder(&file.name);
    match name.rsplit_once('.') {
        Some((stem, ending)) => format!("{folder}{stem}.{digits}.{ending}"),
        None => format!("{folder}{name}.{digits}"),
    }
}

/// The file's name of an object, whether its content is part of the name or not.
pub(crate) fn file_name(object: &str) -> String {
    let (folder, name) = split_folder(object);
    let is_hash =
        |part: &str| part.len() == DIGITS && part.bytes().all(|digit| digit.is_ascii_hexdigit());
    let parts: Vec<&str> = name.split('.').collect();
    let kept: Vec<&str> = match parts.as_slice() {
        [stem @ .., hash, ending] if !stem.is_empty() && is_hash(hash) => {
            stem.iter().copied().chain([*ending]).collect()
        }
        [stem @ .., hash] if !stem.is_empty() && is_hash(hash) => stem.to_vec(),
        _ => parts,
    };
    format!("{folder}{}", kept.join("."))
}

/// The folder with its slash, and the name within.
fn split_folder(name: &str) -> (&str, &str) {
    name.split_at(name.rfind('/').map_or(0, |slash| slash + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_content_is_part_of_the_name_and_the_ending_stays() {
        let blake3 = "0123456789abcdef".repeat(4);
        let digits = &blake3[..DIGITS];
        for (file, object) in [
            ("frames.parquet", format!("frames.{digits}.parquet")),
            ("views/left.mp4", format!("views/left.{digits}.mp4")),
            ("a.b/notes", format!("a.b/notes.{digits}")),
            ("MANIFEST.b3", format!("MANIFEST.{digits}.b3")),
        ] {
            let sealed = SealedFile {
                name: file.into(),
                blake3: blake3.clone(),
            };
            assert_eq!(content_name(&sealed), object);
            assert_eq!(file_name(&object), file);
            assert_eq!(file_name(file), file);
        }
    }
}
