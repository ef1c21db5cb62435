//! A corpus in a browser: its scenarios, their pictures with boxes over them, and the errors of runs, on a page that this computer
//! serves to itself.
//!
//! Input: a corpus, finished or in the making, and the folders of runs. Output: a page (`page/`, embedded), tables as JSON, videos and
//! single pictures. Nothing is written, nothing leaves the loopback device, and no request reaches a file outside of the corpus.

#![forbid(unsafe_code)]

mod assets;
mod bitmap;
mod byte_range;
mod connections;
mod doorkeeper;
mod error;
mod library;
mod opened;
mod overview;
mod path;
mod pictures;
mod planes;
mod refusal;
mod refusal_page;
mod rounded;
mod run;
mod scenario_tables;
mod server;
mod thumbnail;
mod video_file;

pub use error::ViewError;
pub use server::{ViewOptions, serve};
