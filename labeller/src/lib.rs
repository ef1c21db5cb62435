//! Geodesic labels, projected truth boxes and detections.

#![forbid(unsafe_code)]
