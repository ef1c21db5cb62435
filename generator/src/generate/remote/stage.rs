//! Stage mark: it names the object store that the corpus's scenarios are uploaded to. A folder without it may hold their only copy, so no
//! file is ever removed from it.

use std::fs;
use std::path::Path;

use dataset::corpus::Corpus;
use dataset::files::json_file::{read_json, write_json};
use dataset::files::own_path::own_path;
use serde::{Deserialize, Serialize};

use crate::generate::error::GenerateError;

const MARK: &str = "stage.json";

#[derive(Serialize, Deserialize)]
struct Mark {
    /// URL of the corpus that the scenarios are uploaded to.
    corpus: String,
}

/// Rejects a folder that is a different corpus's stage, or contains scenarios and is not a stage. Does not write.
pub(crate) fn check(root: &Path, url: &str) -> Result<(), GenerateError> {
    let refused = |message: String| {
        Err(GenerateError::BadInput(format!(
            "{}: {message}, or name another folder with --staging",
            root.display()
        )))
    };
    match read_json::<Mark>(&own_path(root, MARK)?, "mark of a stage") {
        Ok(Mark { corpus }) if corpus == url => Ok(()),
        Ok(Mark { corpus }) => refused(format!(
            "is the staging folder of {corpus}, expected {url}; send to {corpus}"
        )),
        Err(error) if !error.is_not_found() => Err(error.into()),
        Err(_) => {
            let scenarios = own_path(root, "scenarios")?;
            let holds_some =
                fs::read_dir(scenarios).is_ok_and(|mut entries| entries.next().is_some());
            if !holds_some {
                Ok(())
            } else {
                refused(format!(
                    "holds scenarios and no {MARK}, so it is no stage from which they may be taken once they are sent; send them with \
                 `dtd push {} {url}`",
                    root.display()
                ))
            }
        }
    }
}

/// Marks a checked folder.
pub(crate) fn mark(stage: &Corpus, url: &str) -> Result<(), GenerateError> {
    let path = own_path(stage.root(), MARK)?;
    if !path.exists() {
        let corpus = url.to_owned();
        write_json(&path, &Mark { corpus })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_scenarios_is_a_stage_only_of_the_url_that_it_was_marked_with() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("stage");
        check(&root, "s3://bucket/a").unwrap();
        let stage = Corpus::create(&root).unwrap();
        check(&root, "s3://bucket/a").unwrap();
        fs::create_dir(stage.scenario("0001").root()).unwrap();
        let message = check(&root, "s3://bucket/a").unwrap_err().to_string();
        assert!(
            message.contains("no stage.json") && message.contains("dtd push"),
            "{message}"
        );
        mark(&stage, "s3://bucket/a").unwrap();
        check(&root, "s3://bucket/a").unwrap();
        let message = check(&root, "s3://bucket/b").unwrap_err().to_string();
        assert!(
            message.contains("the staging folder of s3://bucket/a"),
            "{message}"
        );
    }
}
