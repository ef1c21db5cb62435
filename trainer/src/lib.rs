//! Calibration networks, distance estimators, baselines, evaluation and report.

#![forbid(unsafe_code)]
