//! From a sweep to recorded scenario folders.

#![forbid(unsafe_code)]
