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

use crate::args::estimate::{EstimateArgs, GivenOffset, OfView, metrics_address};
use crate::args::shared::output::Output;
use crate::failure::Failure;

/// Given options, by view and for all views.
#[derive(Debug)]
pub(super) struct Given {
    pub(super) sources: BTreeMap<String, Source>,
    pub(super) without: Vec<String>,
    pub(super) offsets_s: BTreeMap<String, f64>,
    pub(super) measured: BTreeSet<String>,
    pub(super) password_files: BTreeMap<String, PathBuf>,
    pub(super) insecure_tls: BTreeSet<String>,
    pub(super) estimator: Option<String>,
    pub(super) model: Option<PathBuf>,
    pub(super) rows: Option<RowBand>,
    pub(super) device: Option<Device>,
    pub(super) decoder: Option<Decoder>,
    pub(super) metrics: Option<SocketAddr>,
    pub(super) keep_offsets: Option<PathBuf>,
}

impl Given {
    /// Reads the options and the file.
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
            insecure_tls: args.insecure_tls.iter().cloned().collect(),
            estimator: args.estimator.clone(),
            model: args.model.clone(),
            rows: args.rows,
            device: args.runtime.device,
            decoder: args.decoder,
            metrics: args.metrics,
            keep_offsets: args.keep_offsets.clone(),
        })
    }

    /// Adds settings of a file that no option overrides.
    fn or(mut self, path: &Path, text: &str) -> Result<Self, Failure> {
        let settings: Settings = TomlFile::new(path, text)
            .parse()
            .map_err(|error| Failure::bad_input_message(without_values(&error)))?;
        let wrong = |key: &str, why: String| {
            Failure::bad_input_message(format!("{}: {key}: {why}", path.display()))
        };
        // Passwords and offsets of the file are of the sources that it names.
        let is_of_options = |view: &String| self.sources.contains_key(view);
        let without = settings.without.into_iter();
        let without: Vec<String> = without.filter(|view| !is_of_options(view)).collect();
        let views = settings.views.into_iter();
        let views: Vec<_> = views
            .filter(|(view, _)| !is_of_options(view) && !self.without.contains(view))
            .collect();
        for (view, of_view) in views {
            let source: Result<Source, live::Error> = of_view.source.parse();
            let source = source
                .map_err(|error| wrong(&format!("views.{view}.source"), error.to_string()))?;
            self.sources.insert(view.clone(), source);
            if !self.offsets_s.contains_key(&view) && !self.measured.contains(&view) {
                match (of_view.offset_s, of_view.measures_offset) {
                    (Some(_), true) => {
                        let why = "an offset is given and to be measured; leave one of them out";
                        return Err(wrong(&format!("views.{view}.offset_s"), why.into()));
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
            if of_view.insecure_tls {
                self.insecure_tls.insert(view.clone());
            }
            if let Some(password_file) = of_view.password_file {
                self.password_files.entry(view).or_insert(password_file);
            }
        }
        self.without.extend(without);
        self.estimator = self.estimator.or(settings.estimator);
        self.model = self.model.or(settings.model);
        if let Some(file) = &settings.keep_offsets {
            (Output::File.check(file))
                .map_err(|why| wrong("keep_offsets", format!("{} {why}", file.display())))?;
        }
        self.keep_offsets = self.keep_offsets.or(settings.keep_offsets);
        self.decoder = self.decoder.or(settings.decoder);
        let rows = settings.rows.as_deref().map(RowBand::from_str).transpose();
        let rows = rows.map_err(|error| wrong("rows", error.to_string()))?;
        self.rows = self.rows.or(rows);
        let metrics = settings.metrics.as_deref().map(metrics_address).transpose();
        let metrics = metrics.map_err(|why| wrong("metrics", why))?;
        self.metrics = self.metrics.or(metrics);
        let device = settings.device.as_deref().map(Device::from_str).transpose();
        let device = device.map_err(|error| wrong("device", error.to_string()))?;
        self.device = self.device.or(device);
        Ok(self)
    }
}

/// A mistake without its line's text and values: addresses may have passwords.
fn without_values(error: &TomlError) -> String {
    let is_of_keys = ["unknown field", "unknown variant", "missing field"]
        .iter()
        .any(|kind| error.message.starts_with(kind));
    let message = if is_of_keys && !error.message.contains([':', '@', '?', '=']) {
        error.message.as_str()
    } else {
        "this is not TOML, or no value that belongs here; `dtd schema estimate` says what does"
    };
    let place = error.path.display();
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
        device = "cuda"
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
        assert_eq!(of_file.decoder, Some(Decoder::Vaapi));
        assert_eq!(of_file.metrics.unwrap().to_string(), "127.0.0.1:9464");
        assert_eq!(of_file.rows.unwrap().bottom_px, 900);
        assert_eq!(of_file.password_files["left"], Path::new("left.txt"));
        let options = [
            "--view=left=other.mp4",
            "--offset=right=auto",
            "--estimator=mono_inverse_range",
            "--decoder=cpu",
            "--device=cpu",
        ];
        let both = given(&options, TEXT).unwrap();
        assert_eq!(both.sources["left"].to_string(), "other.mp4");
        assert_eq!(both.sources["right"].to_string(), "right.mp4");
        assert!(both.offsets_s.is_empty() && both.measured.contains("right"));
        assert_eq!(both.estimator.unwrap(), "mono_inverse_range");
        assert_eq!(both.decoder, Some(Decoder::Cpu));
        assert_eq!(both.device, Some(Device::default()));
        assert!(
            both.password_files.is_empty(),
            "that one is of the file's source"
        );
        let alone = given(&["--without=right"], TEXT).unwrap();
        assert!(!alone.sources.contains_key("right") && alone.offsets_s.is_empty());
        let back = given(&["--view=right=other.mp4"], "without = [\"right\"]").unwrap();
        assert!(back.without.is_empty());
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
            ("views.left = \"rtsp:me:secret@camera/left\"".into(), "e.toml:1:"),
            ("decoder = \"me:secret\"".into(), "e.toml:1:"),
            ("rows = \"9:1\"".into(), "rows"),
            ("row = \"1:9\"".into(), "unknown field"),
            ("decoder = \"gpu\"".into(), "vaapi"),
            (
                "views.left = { source = \"rtsp://a/?token=secret\", offset_s = 1, measures_offset = true }".into(),
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
