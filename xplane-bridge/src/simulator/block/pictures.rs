//! Images of the ticks, from their grabs until the next probe has proven them.

use std::collections::BTreeMap;

/// A tick's image.
#[derive(Debug)]
pub(super) struct Taken<P> {
    /// The frame in which the tick was written.
    pub(super) frame: u64,
    pub(super) picture: P,
    /// The grab that showed it, if a probe has to confirm it.
    pub(super) grab: Option<u64>,
}

impl<P> Taken<P> {
    /// The newest frame whose drawing the image may show.
    pub(super) fn newest_frame(&self) -> u64 {
        self.grab.unwrap_or(self.frame)
    }

    /// True if its tick is certain, with the lag confirmed up to a grab.
    fn is_proven(&self, confirmed_up_to: u64) -> bool {
        self.grab.is_none_or(|grab| grab <= confirmed_up_to)
    }
}

#[derive(Debug)]
pub(super) struct Pictures<P> {
    pub(super) kept: BTreeMap<u32, Taken<P>>,
    /// Number of delivered images, which is the first tick whose image was not.
    pub(super) delivered: u32,
    /// Newest grab with a delivered image.
    pub(super) delivered_grab: u64,
    /// The grab up to which the lag is confirmed.
    pub(super) confirmed_up_to: u64,
}

impl<P> Pictures<P> {
    pub(super) const fn new() -> Self {
        Self {
            kept: BTreeMap::new(),
            delivered: 0,
            delivered_grab: 0,
            confirmed_up_to: 0,
        }
    }

    /// True if a tick has an image, which may be delivered.
    pub(super) fn has(&self, tick: u32) -> bool {
        tick < self.delivered || self.kept.contains_key(&tick)
    }

    /// True if the tick of every image is certain.
    pub(super) fn are_proven(&self) -> bool {
        let mut kept = self.kept.values();
        kept.all(|picture| picture.is_proven(self.confirmed_up_to))
    }

    /// Discards images, and returns their ticks.
    pub(super) fn discard(&mut self, is_doubtful: impl Fn(&Taken<P>) -> bool) -> Vec<u32> {
        let doubtful = self.kept.extract_if(.., |_, picture| is_doubtful(picture));
        doubtful.map(|(tick, _)| tick).collect()
    }

    /// Discards the images taken since the last probe.
    pub(super) fn discard_unproven(&mut self) -> Vec<u32> {
        let confirmed = self.confirmed_up_to;
        self.discard(|picture| !picture.is_proven(confirmed))
    }

    /// The next image, in the order of the ticks, once it is proven.
    pub(super) fn deliver(&mut self) -> Option<Taken<P>> {
        let next = self.kept.get(&self.delivered)?;
        if !next.is_proven(self.confirmed_up_to) {
            return None;
        }
        self.delivered_grab = self.delivered_grab.max(next.newest_frame());
        self.delivered += 1;
        self.kept.remove(&(self.delivered - 1))
    }
}
