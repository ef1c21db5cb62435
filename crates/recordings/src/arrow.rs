//! Least squares with some shared unknowns and many groups of own ones: the matrix of the normal equations has the shape of an arrow.
//!
//! Groups are eliminated one by one, so the effort grows with their number and not with its cube.

use dataset::numbers::least_squares::{CholeskyFactor, dot};

/// Factors of unknowns, by their numbers in rising order.
pub(crate) type Terms = Vec<(usize, f64)>;

/// Equations of some unknowns; only the upper triangle of the matrix counts.
#[derive(Debug, Clone)]
struct Square {
    unknowns: usize,
    matrix: Vec<f64>,
    right: Vec<f64>,
}

/// Normal equations.
#[derive(Debug, Clone)]
pub(crate) struct Arrow {
    /// Each group's own equations, and their products with the shared unknowns: by shared unknown, then by own one.
    groups: Vec<(Square, Vec<Vec<f64>>)>,
    shared: Square,
}

/// The unknowns, with the factors of the matrix for their deviations.
#[derive(Debug, Clone)]
pub(crate) struct Solved {
    pub(crate) shared: Vec<f64>,
    pub(crate) own: Vec<Vec<f64>>,
    shared_factor: CholeskyFactor,
    /// Each group's factor, with its whitened mixed part.
    factors: Vec<(CholeskyFactor, Vec<Vec<f64>>)>,
}

impl Square {
    fn new(unknowns: usize) -> Self {
        Self {
            unknowns,
            matrix: vec![0.0; unknowns * unknowns],
            right: vec![0.0; unknowns],
        }
    }

    fn add(&mut self, row: &[(usize, f64)], value: f64, weight: f64) {
        for (i, a) in row {
            self.right[*i] += weight * a * value;
            for (j, b) in row {
                self.matrix[i * self.unknowns + j] += weight * a * b;
            }
        }
    }

    fn factor(&self) -> Option<CholeskyFactor> {
        CholeskyFactor::of(self.matrix.clone(), self.unknowns)
    }
}

impl Arrow {
    /// For numbers of own unknowns and of shared ones.
    pub(crate) fn new(own: &[usize], shared: usize) -> Self {
        let group = |own: &usize| (Square::new(*own), vec![vec![0.0; *own]; shared]);
        Self {
            groups: own.iter().map(group).collect(),
            shared: Square::new(shared),
        }
    }

    /// Adds an equation of a group's own unknowns and of shared ones.
    pub(crate) fn add(
        &mut self,
        group: usize,
        own: &[(usize, f64)],
        shared: &[(usize, f64)],
        value: f64,
        weight: f64,
    ) {
        let (square, mixed) = &mut self.groups[group];
        square.add(own, value, weight);
        for (i, a) in own {
            for (j, b) in shared {
                mixed[*j][*i] += weight * a * b;
            }
        }
        self.shared.add(shared, value, weight);
    }

    /// Adds an equation of shared unknowns.
    pub(crate) fn add_shared(&mut self, shared: &[(usize, f64)], value: f64, weight: f64) {
        self.shared.add(shared, value, weight);
    }

    /// `None` if the equations do not determine all unknowns, or are not finite.
    pub(crate) fn solve(mut self) -> Option<Solved> {
        let mut factors = Vec::with_capacity(self.groups.len());
        for (square, mixed) in &self.groups {
            let factor = square.factor()?;
            let mut white = mixed.clone();
            white.iter_mut().for_each(|column| factor.whiten(column));
            let mut right = square.right.clone();
            factor.whiten(&mut right);
            // What the own unknowns explain is taken from the shared equations.
            for (own, right) in right.iter().enumerate() {
                let row = white.iter().map(|column| column[own]).enumerate();
                let row: Terms = row.filter(|(_, factor)| *factor != 0.0).collect();
                self.shared.add(&row, *right, -1.0);
            }
            factors.push((factor, white));
        }
        let shared_factor = self.shared.factor()?;
        let shared = shared_factor.solve(self.shared.right)?;
        let own = self
            .groups
            .into_iter()
            .zip(&factors)
            .map(|((square, mixed), (factor, _))| {
                let mut right = square.right;
                for (column, value) in mixed.iter().zip(&shared) {
                    for (right, mixed) in right.iter_mut().zip(column) {
                        *right -= mixed * value;
                    }
                }
                factor.solve(right)
            });
        Some(Solved {
            own: own.collect::<Option<_>>()?,
            shared,
            shared_factor,
            factors,
        })
    }
}

impl Solved {
    /// Standard deviation of a sum of a group's own unknowns and shared ones.
    pub(crate) fn sd_of(&self, group: usize, own: &[(usize, f64)], shared: &[(usize, f64)]) -> f64 {
        let mut left = vec![0.0; self.shared.len()];
        for (unknown, factor) in shared {
            left[*unknown] += factor;
        }
        let (factor, white) = &self.factors[group];
        let mut alone = vec![0.0; self.own[group].len()];
        for (unknown, factor) in own {
            alone[*unknown] += factor;
        }
        factor.whiten(&mut alone);
        for (left, column) in left.iter_mut().zip(white) {
            *left -= dot(column, &alone);
        }
        self.shared_factor.whiten(&mut left);
        (dot(&alone, &alone) + dot(&left, &left)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use dataset::numbers::least_squares::NormalEquations;

    use super::*;

    #[test]
    fn groups_are_eliminated_to_the_solution_and_deviations_of_the_whole_matrix() {
        let mut arrow = Arrow::new(&[2, 1], 2);
        let mut whole = NormalEquations::new(5);
        // Own unknowns of the groups are the whole's 0, 1 and 2.
        for step in 0..24 {
            let x = f64::from(step);
            let (group, first, own) = if step % 3 == 0 {
                (1, 2, vec![(0, x.cos())])
            } else {
                (0, 0, vec![(0, 1.0), (1, (0.7 * x).sin())])
            };
            let shared = [(0, (1.3 * x).cos()), (1, 0.1 * x)];
            let (value, weight) = ((2.1 * x).sin(), 1.0 + x);
            arrow.add(group, &own, &shared, value, weight);
            let mut row = [0.0; 5];
            own.iter().for_each(|(i, a)| row[first + i] = *a);
            shared.iter().for_each(|(i, a)| row[3 + i] = *a);
            whole.add(&row, value, weight);
        }
        arrow.add_shared(&[(1, 1.0)], 0.5, 2.0);
        whole.add(&[0.0, 0.0, 0.0, 0.0, 1.0], 0.5, 2.0);
        let (solved, expected) = (arrow.solve().unwrap(), whole.solve().unwrap());
        let found = [solved.own.concat(), solved.shared.clone()].concat();
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let covariance = whole.inverse().unwrap();
        let sd = solved.sd_of(0, &[(1, 2.0)], &[(0, -1.0)]);
        let variance = 4.0 * covariance[1][1] - 4.0 * covariance[1][3] + covariance[3][3];
        assert!((sd - variance.sqrt()).abs() < 1e-12, "{sd} {variance}");
        let alone = solved.sd_of(1, &[], &[(1, 1.0)]);
        assert!((alone - covariance[4][4].sqrt()).abs() < 1e-12, "{alone}");
    }
}
