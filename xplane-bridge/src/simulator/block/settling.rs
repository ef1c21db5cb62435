//! The beginning of a block: exposure, shadows and loading come to rest while its first tick is shown.

/// Grabs in a row without a change before a scene counts as settled.
pub(super) const EQUAL_GRABS: u32 = 3;

#[derive(Debug)]
pub(super) struct Settling<P> {
    last: Option<P>,
    equal: u32,
    /// True if the scene was watched for long enough to know how it moves. One that moves never comes to rest.
    pub(super) has_watched: bool,
    /// True if equal grabs ended the settling.
    pub(super) came_to_rest: bool,
}

impl<P> Settling<P> {
    pub(super) fn new() -> Self {
        Self {
            last: None,
            equal: 0,
            has_watched: false,
            came_to_rest: false,
        }
    }

    /// Compares a grab with the one before. Returns true if the scene has settled: not before `is_time`, when the frames to settle have
    /// passed, and only after it was watched if it `moves` by itself.
    pub(super) fn see(
        &mut self,
        picture: P,
        is_settled_after: fn(&P, &P) -> bool,
        is_time: bool,
        moves: bool,
    ) -> bool {
        let before = self.last.as_ref();
        let is_equal = before.is_some_and(|before| is_settled_after(&picture, before));
        self.equal = if is_equal { self.equal + 1 } else { 0 };
        self.last = Some(picture);
        let is_at_rest = self.equal >= EQUAL_GRABS && !moves;
        let has_settled = is_time && (is_at_rest || self.has_watched);
        if has_settled {
            self.came_to_rest = is_at_rest;
            self.last = None;
        }
        has_settled
    }
}
