//! Scenario images, and their distance from those of a well-behaved simulator.

use std::path::Path;

use dataset::corpus::Corpus;
use dataset::video::VideoReader;

/// Maximum mean difference between images with the same pose, of 255: 32-bit numbers shift cameras by millimetres.
pub const ALIKE: f64 = 0.25;

/// A scenario's images from both views.
pub fn pictures(corpus: &Path, id: &str) -> Vec<Vec<u8>> {
    let scenario = Corpus::open(corpus).unwrap().scenario(id);
    let mut all = Vec::new();
    for view in ["left", "right"] {
        let mut reader = VideoReader::open(&scenario.video_path(view)).unwrap();
        let mut rgb = Vec::new();
        while reader.next_frame(&mut rgb).unwrap().is_some() {
            all.push(rgb.clone());
        }
    }
    all
}

/// The largest mean difference of two images of the same tick and view, levels of 255.
pub fn farthest(found: &[Vec<u8>], wanted: &[Vec<u8>]) -> f64 {
    assert_eq!(found.len(), wanted.len(), "numbers of images");
    let apart = |(a, b): (&Vec<u8>, &Vec<u8>)| {
        assert_eq!(a.len(), b.len());
        let sum: f64 = a
            .iter()
            .zip(b)
            .map(|(a, b)| f64::from(a.abs_diff(*b)))
            .sum();
        sum / a.len() as f64
    };
    found.iter().zip(wanted).map(apart).fold(0.0, f64::max)
}
