//! Square matrices of a few rows.

use std::ops::{Index, IndexMut};

/// A square matrix, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Matrix {
    pub(crate) size: usize,
    pub(crate) values: Vec<f64>,
}

impl Matrix {
    pub(crate) fn zero(size: usize) -> Self {
        Self {
            size,
            values: vec![0.0; size * size],
        }
    }

    /// Puts a smaller matrix on the diagonal, its first element at `(at, at)`.
    pub(crate) fn set_block<const N: usize>(&mut self, at: usize, block: &[[f64; N]; N]) {
        for (i, row) in block.iter().enumerate() {
            let start = (at + i) * self.size + at;
            self.values[start..start + N].copy_from_slice(row);
        }
    }

    pub(crate) fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.size)
    }

    pub(crate) fn row(&self, number: usize) -> &[f64] {
        &self.values[number * self.size..(number + 1) * self.size]
    }

    pub(crate) fn times_vector(&self, vector: &[f64]) -> Vec<f64> {
        self.rows().map(|row| dot(row, vector)).collect()
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        let mut product = Self::zero(self.size);
        for (row, sums) in self.rows().zip(product.values.chunks_exact_mut(other.size)) {
            for (&factor, other_row) in row.iter().zip(other.rows()) {
                for (sum, value) in sums.iter_mut().zip(other_row) {
                    *sum += factor * value;
                }
            }
        }
        product
    }

    pub(crate) fn transposed(&self) -> Self {
        let mut transposed = Self::zero(self.size);
        for i in 0..self.size {
            for j in 0..self.size {
                transposed[(j, i)] = self[(i, j)];
            }
        }
        transposed
    }

    /// `self + sign * other`, element by element.
    pub(crate) fn plus(mut self, sign: f64, other: &Self) -> Self {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value += sign * other;
        }
        self
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.values[row * self.size + column]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.values[row * self.size + column]
    }
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
