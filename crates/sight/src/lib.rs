//! Fixed cameras: where each looks, by the ground that its images show.
//!
//! ```text
//! image                  -> Watched     its turn from the flight's first image, image by image
//! turns of a flight      -> walk        the turn at every image, in hindsight
//! first images           -> Background  their mean, below the horizon
//! Background, References -> Sight       turn, roll and zoom from what a training saw, with their covariance
//! places in two views    -> lag         how late one view's images are, and from when on
//! ```
//!
//! One fit does both comparisons ([`fit`]): tiles of a reference are found again in another image, and decide together about one
//! [`Motion`]. Nothing here knows videos, corpora or runs, and nothing needs a later image.

pub mod background;
pub mod fit;
pub mod ground;
pub mod lag;
pub mod references;
pub mod sight;
pub mod walk;
pub mod watched;
