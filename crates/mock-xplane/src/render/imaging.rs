//! What lies between an ideal image and a camera's: moving air, a swaying mast, blur, noise and exposure.

pub(crate) mod blur;
pub(crate) mod seeing;
pub(crate) mod sensor;
pub(crate) mod sway;
pub(crate) mod tone;
