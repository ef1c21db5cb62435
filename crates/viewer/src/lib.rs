//! Viewer of a corpus in the browser: its scenarios, their images with boxes, and the errors of runs, on a page that the local computer
//! serves.
//!
//! Input: a corpus, finished or in the making, and the folders of runs. Output: a page (`page/`, embedded), tables as JSON, videos and
//! single images. The server is read-only, listens on the loopback device alone, and serves no file outside the corpus.

#![forbid(unsafe_code)]

mod error;
mod library;
mod opened;
mod overview;
mod path;
mod pictures;
mod problems;
mod rounded;
mod run;
mod scenario_tables;
mod server;

pub use error::ViewError;
pub use server::{ViewOptions, serve};
