//! Effects that separate a camera's image from an ideal one: moving air, a swaying mast, blur, noise and exposure.

pub(crate) mod blur;
pub(crate) mod seeing;
pub(crate) mod sensor;
pub(crate) mod sway;
pub(crate) mod tone;
