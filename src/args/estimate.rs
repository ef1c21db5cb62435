//! Options of `dtd estimate`.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use labeller::RowBand;
use live::Source;

use crate::args::detector::RuntimeArgs;
use crate::args::folder;
use crate::args::shared::output::Output;

/// A run, its sources, and outputs.
#[derive(Debug, Args)]
pub(crate) struct EstimateArgs {
    /// Folder of the run, as written by `dtd train`
    #[arg(value_parser = folder())]
    pub(crate) run: PathBuf,
    /// Source of a view: rtsp://, a video or SDP file, /dev/videoN, or corpus:CORPUS/SCENARIO; once for each view
    ///
    /// RTSP uses TCP unless the address ends with ?transport=udp. A video file is played in its own time.
    #[arg(long = "view", value_name = "VIEW=SOURCE", required = true)]
    pub(crate) views: Vec<OfView<Source>>,
    /// View of the run to estimate without; may be repeated
    #[arg(long, value_name = "VIEW")]
    pub(crate) without: Vec<String>,
    /// Seconds to add to a view's image times, e.g. right=+0.120, or auto
    ///
    /// Offsets of streams whose clocks run free are measured, from the aircraft that both views see. With `auto`, offsets of
    /// video files are measured too; otherwise all files are taken to begin at the same time.
    #[arg(long = "offset", value_name = "VIEW=SECONDS")]
    pub(crate) offsets: Vec<OfView<GivenOffset>>,
    /// Keep measured offsets in this file (JSON), and begin with those that it has
    ///
    /// Valid only for this run and these source addresses, parameters included. No other process may use it meanwhile.
    #[arg(long, value_name = "FILE", value_parser = Output::File.parser())]
    pub(crate) keep_offsets: Option<PathBuf>,
    /// File whose first line is the password of the view's server
    #[arg(long = "password-file", value_name = "VIEW=FILE")]
    pub(crate) password_files: Vec<OfView<PathBuf>>,
    /// View whose rtsps:// server may have any certificate, also one that this computer does not trust; may be repeated
    ///
    /// Whoever is between the camera and this computer can then read the password and replace the images.
    #[arg(long, value_name = "VIEW")]
    pub(crate) insecure_tls: Vec<String>,
    /// Estimator that answers [default: the training's choice, `inverse_range` with its filter]
    #[arg(long, value_name = "NAME")]
    pub(crate) estimator: Option<String>,
    /// The detector, an ONNX file [default: the bundled one]
    ///
    /// It must be the one whose boxes the run was trained on. The bundled one has never seen a photograph (docs/my-rig.md).
    #[arg(long, value_name = "M.onnx")]
    pub(crate) model: Option<PathBuf>,
    /// Rows of the images to search: TOP:BOTTOM [default: all]
    #[arg(long, value_name = "TOP:BOTTOM")]
    pub(crate) rows: Option<RowBand>,
    #[command(flatten)]
    pub(crate) runtime: RuntimeArgs,
    /// Serve metrics (OpenMetrics) at http://ADDRESS:PORT/metrics; a port alone means this computer
    ///
    /// Port 0 takes any free one, which stderr names.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = metrics_address)]
    pub(crate) metrics: Option<SocketAddr>,
    /// Read recordings as fast as they can be searched, and search every image
    #[arg(long)]
    pub(crate) as_fast_as_possible: bool,
    /// Open every source, print its properties, and end
    #[arg(long)]
    pub(crate) check: bool,
}

/// Clock offset given for a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum GivenOffset {
    Seconds(f64),
    /// To be measured.
    Auto,
}

impl FromStr for GivenOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            seconds => (seconds.parse().map(Self::Seconds))
                .map_err(|_| format!("{seconds} is not a number; expected seconds, or auto")),
        }
    }
}

/// A value for a view, as VIEW=VALUE.
#[derive(Debug, Clone)]
pub(crate) struct OfView<T> {
    pub(crate) view: String,
    pub(crate) value: T,
}

impl<T: FromStr<Err: std::fmt::Display>> FromStr for OfView<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (view, value) = text
            .split_once('=')
            .filter(|(view, value)| !view.is_empty() && !value.is_empty())
            .ok_or("expected the name of a view, = and its value")?;
        Ok(Self {
            view: view.into(),
            value: value.parse().map_err(|error: T::Err| error.to_string())?,
        })
    }
}

pub(crate) fn metrics_address(text: &str) -> Result<SocketAddr, String> {
    if let Ok(port) = text.trim_start_matches(':').parse::<u16>() {
        return Ok((Ipv4Addr::LOCALHOST, port).into());
    }
    text.parse()
        .map_err(|_| "expected ADDRESS:PORT, e.g. 127.0.0.1:9464, or a port".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_of_this_computer() {
        for (text, expected) in [
            ("9464", "127.0.0.1:9464"),
            (":0", "127.0.0.1:0"),
            ("0.0.0.0:9464", "0.0.0.0:9464"),
            ("[::1]:9464", "[::1]:9464"),
        ] {
            assert_eq!(metrics_address(text).unwrap().to_string(), expected);
        }
        assert!(metrics_address("camera:9464").is_err());
    }

    #[test]
    fn a_value_of_a_view_may_contain_an_equals_sign() {
        let of_view: OfView<String> = "left=rtsp://camera/?a=b".parse().unwrap();
        assert_eq!(
            (&*of_view.view, &*of_view.value),
            ("left", "rtsp://camera/?a=b")
        );
        assert!("left".parse::<OfView<f64>>().is_err());
        assert!("left=soon".parse::<OfView<f64>>().is_err());
    }
}
