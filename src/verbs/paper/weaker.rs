//! A detector that misses aircraft: the same model with other settings beside it.

use std::fs;
use std::path::{Path, PathBuf};

use dataset::files::json_file::write_atomically;
use dataset::files::outside_file::{self, FileKind};
use labeller::detector::ModelFile;
use toml::Table;

use crate::failure::Failure;

/// Name of the model.
const FILE: &str = "weaker.onnx";

/// Copies the model into a folder, with its settings, this shrink factor before the first pass, and this minimum score if it is not 0.
pub(super) fn write(
    model: &Path,
    shrink: u32,
    least_score: f64,
    folder: &Path,
) -> Result<PathBuf, Failure> {
    let beside = ModelFile::profile_path(model);
    let mut settings: Table = if beside.exists() {
        let text = outside_file::read_text(&beside, FileKind::SETTINGS);
        text.map_err(Failure::bad_input)?.parse()?
    } else {
        Table::new()
    };
    settings.insert("first_pass_shrink".into(), i64::from(shrink).into());
    if least_score > 0.0 {
        settings.insert("least_score".into(), least_score.into());
    }
    fs::create_dir_all(folder).map_err(dataset::Error::io("create", folder))?;
    let copy = folder.join(FILE);
    let content = fs::read(model).map_err(dataset::Error::io("read", model))?;
    write_atomically(&copy, &content)?;
    write_atomically(
        &ModelFile::profile_path(&copy),
        settings.to_string().as_bytes(),
    )?;
    Ok(copy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_settings_of_the_model_stay_and_others_are_added() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("net.onnx");
        fs::write(&model, "network").unwrap();
        fs::write(folder.path().join("net.onnx.toml"), "aircraft_class = 4\n").unwrap();
        let weaker = write(&model, 2, 0.75, &folder.path().join("weaker")).unwrap();
        assert_eq!(fs::read_to_string(&weaker).unwrap(), "network");
        let settings: Table = fs::read_to_string(ModelFile::profile_path(&weaker))
            .unwrap()
            .parse()
            .unwrap();
        assert_eq!(settings["aircraft_class"].as_integer(), Some(4));
        assert_eq!(settings["first_pass_shrink"].as_integer(), Some(2));
        assert_eq!(settings["least_score"].as_float(), Some(0.75));
    }
}
