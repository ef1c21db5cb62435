//! The files of the whole corpus, ours and those in the store: which of two versions stays.

mod settle;

pub use settle::Keep;
