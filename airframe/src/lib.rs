//! The shape of a Boeing 737-800: the mesh that is drawn and the mesh whose box is the truth.

#![forbid(unsafe_code)]
