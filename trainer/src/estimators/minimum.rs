//! Minimum of a function of one variable without a derivative.

/// Search range and resolution.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search {
    /// Ends of the range, exclusive.
    pub from: f64,
    pub to: f64,
    /// Parts that a range is divided into.
    pub parts: u32,
    /// Number of searches, each between the neighbours of the previous best position.
    pub rounds: u32,
}

impl Search {
    /// The place where the function is lowest.
    pub(crate) fn lowest(self, mut function: impl FnMut(f64) -> f64) -> f64 {
        let (mut from, mut to) = (self.from, self.to);
        let mut best = f64::midpoint(from, to);
        for _ in 0..self.rounds {
            let step = (to - from) / f64::from(self.parts);
            let places = (1..self.parts).map(|i| from + step * f64::from(i));
            best = places
                .map(|place| (function(place), place))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map_or(best, |(_, place)| place);
            (from, to) = (best - step, best + step);
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lowest_place_is_found_between_kinks() {
        let search = Search {
            from: -10.0,
            to: 30.0,
            parts: 16,
            rounds: 9,
        };
        let found = search.lowest(|x| (x - 7.3).abs() + 0.1 * (x + 2.0).abs());
        assert!((found - 7.3).abs() < 1e-5, "{found}");
    }
}
