//! Settings of `dtd estimate` from `ESTIMATE.toml` and from options, which override the file.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use dataset::files::outside_file::{self, FileKind};
use dataset::files::toml_file::{TomlError, TomlFile};
use labeller::RowBand;
use labeller::detector::Device;
use live::{Decoder, Settings, Source};

use crate::estimate_args::{EstimateArgs, GivenOffset, OfView, metrics_address};
use crate::failure::Failure;

/// What was given, by view and for all of them.
#[derive(Debug)]
pub(super) struct Given {
    pub(super) sources: BTreeMap<String, Source>,
    pub(super) without: Vec<String>,
    pub(super) offsets_s: BTreeMap<String, f64>,
    pub(super) measured: BTreeSet<String>,
    pub(super) password_files: BTreeMap<String, PathBuf>,
    pub(super) estimator: Option<String>,
    pub(super) model: Option<PathBuf>,
    pub(super) rows: Option<RowBand>,
    pub(super) device: Device,
    pub(super) decoder: Decoder,
    pub(super) metrics: Option<SocketAddr>,
    pub(super) keep_offsets: Option<PathBuf>,
}

impl Given {
    /// The settings of a command.
    ///
    /// # Errors
    /// The file cannot be read, a value in it is wrong, or a view has two values.
    pub(super) fn of(args: &EstimateArgs) -> Result<Self, Failure> {
        let of_options = Self::of_options(args)?;
        match &args.config {
            None => Ok(of_options),
            Some(path) => {
                let text = outside_file::read_text(path, FileKind::SETTINGS)
                    .map_err(Failure::bad_input)?;
                of_options.or(path, &text)
            }
        }
    }

    fn of_options(args: &EstimateArgs) -> Result<Self, Failure> {
        let (mut offsets_s, mut measured) = (BTreeMap::new(), BTreeSet::new());
        for (view, offset) in by_view("--offset", &args.offsets)? {
            match offset {
                GivenOffset::Seconds(seconds) => {
                    offsets_s.insert(view, seconds);
                }
                GivenOffset::Auto => {
                    measured.insert(view);
                }
            }
        }
        Ok(Self {
            sources: by_view("--view", &args.views)?,
            without: args.without.clone(),
            offsets_s,
            measured,
            password_files: by_view("--password-file", &args.password_files)?,
            estimator: args.estimator.clone(),
            model: args.model.clone(),
            rows: args.rows,
            device: args.runtime.device,
            decoder: args.decoder.unwrap_or_default(),
            metrics: args.metrics,
            keep_offsets: args.keep_offsets.clone(),
        })
    }

    /// With what the text of a file says and no option does.
    fn or(mut self, path: &Path, text: &str) -> Result<Self, Failure> {
        let file = TomlFile::new(path, text);
        let settings: Settings = file
            .parse()
            .map_err(|error| Failure::bad_input_message(without_sources(&error)))?;
        for (view, of_view) in settings.views {
            if !self.sources.contains_key(&view) {
                let source = of_view.source.parse().map_err(|error| {
                    // Not with the line, which may have a password.
                    let place = path.display();
                    Failure::bad_input_message(format!("{place}: views.{view}.source: {error}"))
                })?;
                self.sources.insert(view.clone(), source);
            }
            if !self.offsets_s.contains_key(&view) && !self.measured.contains(&view) {
                match (of_view.offset_s, of_view.measures_offset) {
                    (Some(_), true) => {
                        let message =
                            "an offset is given and to be measured; leave one of them out";
                        let error = file.rejected(&format!("views.{view}.offset_s"), message);
                        return Err(Failure::bad_input(error));
                    }
                    (Some(offset_s), false) => {
                        self.offsets_s.insert(view.clone(), offset_s);
                    }
                    (None, true) => {
                        self.measured.insert(view.clone());
                    }
                    (None, false) => {}
                }
            }
            if let Some(password_file) = of_view.password_file {
                self.password_files.entry(view).or_insert(password_file);
            }
        }
        self.without.extend(settings.without);
        self.estimator = self.estimator.or(settings.estimator);
        self.model = self.model.or(settings.model);
        self.keep_offsets = self.keep_offsets.or(settings.keep_offsets);
        if self.decoder == Decoder::default() {
            self.decoder = settings.decoder.unwrap_or_default();
        }
        if self.rows.is_none() {
            self.rows = parsed(file, "rows", settings.rows.as_deref(), RowBand::from_str)?;
        }
        if self.metrics.is_none() {
            let metrics = settings.metrics.as_deref();
            self.metrics = parsed(file, "metrics", metrics, metrics_address)?;
        }
        if self.device == Device::default()
            && let Some(device) =
                parsed(file, "device", settings.device.as_deref(), Device::from_str)?
        {
            self.device = device;
        }
        Ok(self)
    }
}

/// The value of a key, which a message shows in its line.
fn parsed<T, E: ToString>(
    file: TomlFile<'_>,
    key: &str,
    text: Option<&str>,
    parse: impl FnOnce(&str) -> Result<T, E>,
) -> Result<Option<T>, Failure> {
    let parsed = text.map(parse).transpose();
    parsed.map_err(|error| Failure::bad_input(file.rejected(key, &error.to_string())))
}

/// A mistake without the text of its line: addresses may have passwords.
fn without_sources(error: &TomlError) -> String {
    let place = error.path.display();
    let message = if error.message.contains("://") {
        "a value stands in the wrong place; `dtd schema estimate` says what belongs there"
    } else {
        &error.message
    };
    match error.place {
        Some((line, column)) => format!("{place}:{line}:{column}: {message}"),
        None => format!("{place}: {message}"),
    }
}

/// The values by view.
fn by_view<T: Clone>(option: &str, given: &[OfView<T>]) -> Result<BTreeMap<String, T>, Failure> {
    let mut all = BTreeMap::new();
    for OfView { view, value } in given {
        if all.insert(view.clone(), value.clone()).is_some() {
            return Err(Failure::bad_input_message(format!(
                "{option} {view} is given twice; a view has one"
            )));
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: EstimateArgs,
    }

    fn given(options: &[&str], text: &str) -> Result<Given, Failure> {
        let run = env!("CARGO_MANIFEST_DIR");
        let options = ["estimate", run, "--config", "e.toml"]
            .into_iter()
            .chain(options.iter().copied());
        let command = Command::try_parse_from(options).unwrap();
        Given::of_options(&command.args)?.or(Path::new("e.toml"), text)
    }

    const TEXT: &str = r#"
        decoder = "vaapi"
        rows = "100:900"
        metrics = "9464"
        estimator = "inverse_range"

        [views.left]
        source = "left.mp4"
        password_file = "left.txt"

        [views.right]
        source = "right.mp4"
        offset_s = 0.12
    "#;

    #[test]
    fn options_override_the_file() {
        let of_file = given(&[], TEXT).unwrap();
        assert_eq!(of_file.sources["left"].to_string(), "left.mp4");
        assert_eq!(of_file.offsets_s["right"], 0.12);
        assert_eq!(of_file.decoder, Decoder::Vaapi);
        assert_eq!(of_file.metrics.unwrap().to_string(), "127.0.0.1:9464");
        assert_eq!(of_file.rows.unwrap().bottom_px, 900);
        assert_eq!(of_file.password_files["left"], Path::new("left.txt"));
        let options = [
            "--view=left=other.mp4",
            "--offset=right=auto",
            "--estimator=mono_inverse_range",
        ];
        let both = given(&options, TEXT).unwrap();
        assert_eq!(both.sources["left"].to_string(), "other.mp4");
        assert_eq!(both.sources["right"].to_string(), "right.mp4");
        assert!(both.offsets_s.is_empty() && both.measured.contains("right"));
        assert_eq!(both.estimator.unwrap(), "mono_inverse_range");
    }

    #[test]
    fn mistakes_in_the_file_are_named_without_passwords() {
        let secret = "rtsp://me:secret@camera/left";
        for (text, expected) in [
            (
                format!("views.left.source = \"{secret}\""),
                "views.left.source",
            ),
            (format!("views.left = \"{secret}\""), "e.toml:1:"),
            (format!("views.left.source = \"{secret}"), "e.toml:1:"),
            (format!("\"{secret}\" = 1"), "e.toml:1:"),
            ("rows = \"9:1\"".into(), "e.toml:1:8"),
            ("row = \"1:9\"".into(), "unknown field"),
            ("decoder = \"gpu\"".into(), "vaapi"),
            (
                "views.left = { source = \"a.mp4\", offset_s = 1, measures_offset = true }".into(),
                "leave one of them out",
            ),
        ] {
            let said = format!("{:?}", given(&[], &text).unwrap_err());
            assert!(said.contains(expected), "{text}: {said}");
            assert!(!said.contains("secret"), "{said}");
        }
    }

    #[test]
    fn a_view_is_given_once() {
        let of = |value: &str| OfView {
            view: "left".into(),
            value: value.to_owned(),
        };
        assert!(by_view("--view", &[of("a"), of("b")]).is_err());
        assert_eq!(by_view("--view", &[of("a")]).unwrap()["left"], "a");
    }
}
