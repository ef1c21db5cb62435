//! Descriptions of an export and of a corpus, for machines and for people.

pub(crate) mod about;
pub(crate) mod columns_text;
mod corpus_croissant;
pub(crate) mod croissant;

pub use corpus_croissant::{describe_corpus, is_described_as_it_is};
