//! The assembled symmetric positive definite linear system A x = b of a step, factorised by faer's sparse Cholesky
//! decomposition.

use std::collections::BTreeMap;

use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Col, Side};
use glam::DMat3;
use palpate::{Error, Result};

/// A symmetric matrix in assembly: entries of its lower triangle in any order; repeated entries are summed.
#[derive(Debug, Clone, Default)]
pub struct Entries {
    places: Vec<(usize, usize)>,
    values: Vec<f64>,
}

impl Entries {
    /// Adds `value` at (row, column). Entries of the upper triangle are ignored, since symmetry implies them.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        if row >= column {
            self.places.push((row, column));
            self.values.push(value);
        }
    }

    /// Adds a 3x3 block whose first element is at (row, column).
    pub fn add_block(&mut self, row: usize, column: usize, block: &DMat3) {
        for r in 0..3 {
            (0..3).for_each(|c| self.add(row + r, column + c, block.col(c)[r]));
        }
    }

    /// Adds `factor` times the outer product of a sparse row with itself.
    pub fn add_outer(&mut self, row: &[(usize, f64)], factor: f64) {
        for &(i, x) in row {
            for &(j, y) in row {
                self.add(i, j, factor * x * y);
            }
        }
    }

    /// Row, column and value of the entries, as they were added; lower triangle only, with repetitions.
    pub fn lower(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        self.places.iter().zip(&self.values).map(|(&(row, column), &value)| (row, column, value))
    }

    /// The 3x3 blocks on the diagonal whose first rows are `firsts`.
    pub fn diagonal_blocks(&self, firsts: &[usize]) -> Vec<DMat3> {
        let place: BTreeMap<usize, usize> = firsts.iter().enumerate().map(|(k, first)| (*first, k)).collect();
        let mut blocks = vec![DMat3::ZERO; firsts.len()];
        for (row, column, value) in self.lower() {
            let Some((first, k)) = place.range(..=column).next_back() else { continue };
            if row < first + 3 {
                let (i, j) = (row - first, column - first);
                blocks[*k].col_mut(j)[i] += value;
                if i != j {
                    blocks[*k].col_mut(i)[j] += value;
                }
            }
        }
        blocks
    }

    /// The product y = A x, for residuals.
    pub fn multiply(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        for (&(i, j), &value) in self.places.iter().zip(&self.values) {
            y[i] += value * x[j];
            if i != j {
                y[j] += value * x[i];
            }
        }
        y
    }
}

/// Direct solver, which keeps its symbolic factorisation while the rows and columns of the matrix entries stay the
/// same.
#[derive(Default)]
pub struct Solver {
    pattern: Option<Pattern>,
    /// Number of symbolic factorisations so far.
    pub symbolic_count: usize,
}

struct Pattern {
    places: Vec<(usize, usize)>,
    matrix: SymbolicSparseColMat<usize>,
    order: Argsort<usize>,
    factor: SymbolicLlt<usize>,
}

impl Solver {
    /// Solves A x = b. Returns an error if A is not positive definite (or not finite).
    pub fn solve(&mut self, a: &Entries, b: &[f64]) -> Result<Vec<f64>> {
        if b.is_empty() {
            return Ok(Vec::new());
        }
        let failed = |what: &str| {
            Error::Simulation(format!("reference solver: {what} failed for a system of {} unknowns", b.len()))
        };
        if self.pattern.as_ref().is_none_or(|p| p.places != a.places || p.matrix.nrows() != b.len()) {
            self.pattern = Some(Pattern::new(a, b.len()).ok_or_else(|| failed("symbolic factorisation"))?);
            self.symbolic_count += 1;
        }
        let Some(pattern) = &self.pattern else { return Err(failed("symbolic factorisation")) };
        let matrix = SparseColMat::new_from_argsort(pattern.matrix.clone(), &pattern.order, &a.values)
            .map_err(|_| failed("assembly"))?;
        let factor = Llt::try_new_with_symbolic(pattern.factor.clone(), matrix.as_ref(), Side::Lower)
            .map_err(|_| failed("Cholesky factorisation"))?;
        let x = factor.solve(Col::from_fn(b.len(), |i| b[i]));
        Ok((0..b.len()).map(|i| x[i]).collect())
    }
}

impl Pattern {
    fn new(a: &Entries, size: usize) -> Option<Self> {
        let pairs: Vec<_> = a.places.iter().map(|&(row, col)| Pair { row, col }).collect();
        let (matrix, order) = SymbolicSparseColMat::try_new_from_indices(size, size, &pairs).ok()?;
        let factor = SymbolicLlt::try_new(matrix.as_ref(), Side::Lower).ok()?;
        Some(Self { places: a.places.clone(), matrix, order, factor })
    }
}
