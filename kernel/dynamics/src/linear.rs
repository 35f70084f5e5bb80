//! Cholesky factorisations in place, row-major, for the small matrices of one tree: dense, and the one that keeps the zeros
//! between branches.

use crate::workspace::{Lane, add_scaled};

/// Factors the lower triangle of the symmetric, row-major `n x n` matrix `A` as `L L^T`, in place.
///
/// # Errors
/// The index of the first pivot that is not positive (or not a number).
///
/// # Panics
/// `A` has fewer than `n * n` entries.
pub fn cholesky(A: &mut [f64], n: usize) -> Result<(), usize> {
    for j in 0..n {
        let mut d = A[j * n + j];
        for k in 0..j {
            d -= A[j * n + k] * A[j * n + k];
        }
        if d.is_nan() || d <= 0.0 {
            return Err(j);
        }
        let d = d.sqrt();
        A[j * n + j] = d;
        for i in j + 1..n {
            let mut s = A[i * n + j];
            for k in 0..j {
                s -= A[i * n + k] * A[j * n + k];
            }
            A[i * n + j] = s / d;
        }
    }
    Ok(())
}

/// Solves `L x = b` in place, with `L` from [`cholesky`].
///
/// # Panics
/// `L` has fewer than `n * n` entries, or `x` fewer than `n`.
pub fn cholesky_solve_lower(L: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let mut s = x[i];
        for k in 0..i {
            s -= L[i * n + k] * x[k];
        }
        x[i] = s / L[i * n + i];
    }
}

/// Solves `L L^T x = b` in place, with `L` from [`cholesky`].
///
/// # Panics
/// `L` has fewer than `n * n` entries, or `x` fewer than `n`.
pub fn cholesky_solve(L: &[f64], n: usize, x: &mut [f64]) {
    cholesky_solve_lower(L, n, x);
    for i in (0..n).rev() {
        let mut s = x[i];
        for k in i + 1..n {
            s -= L[k * n + i] * x[k];
        }
        x[i] = s / L[i * n + i];
    }
}

/// Factors the symmetric, row-major `n x n` matrix `A`, of which the lower triangle is given, as `L^T D L` in place (Featherstone
/// 2008, section 6.5). `before[i]` is the row that row `i` stands on, plus one, and zero for a root: `A` must be zero between
/// rows of different branches, and `L` is then too. The diagonal takes `1 / D`.
///
/// # Errors
/// The index of the first pivot that is not positive (or not a number).
pub(crate) fn tree_factor(A: &mut [f64], before: &[usize]) -> Result<(), usize> {
    let n = before.len();
    for k in (0..n).rev() {
        let (above, row_k) = A.split_at_mut(k * n);
        let row_k = &mut row_k[..k + 1];
        let d = row_k[k];
        if d.is_nan() || d <= 0.0 {
            return Err(k);
        }
        let inverse = 1.0 / d;
        row_k[k] = inverse;
        let mut i = before[k];
        while i != 0 {
            let factor = row_k[i - 1] * inverse;
            // What lies between the branches is zero in row `k`, and stays as it is.
            for (x, y) in above[(i - 1) * n..(i - 1) * n + i].iter_mut().zip(&row_k[..i]) {
                *x -= factor * y;
            }
            row_k[i - 1] = factor;
            i = before[i - 1];
        }
    }
    Ok(())
}

/// Solves `L^T D L x = b` in place, with the factor from [`tree_factor`].
pub(crate) fn tree_solve(L: &[f64], before: &[usize], x: &mut [f64]) {
    let n = before.len();
    for k in (0..n).rev() {
        let (above, below) = x.split_at_mut(k);
        for (x, l) in above.iter_mut().zip(&L[k * n..k * n + k]) {
            *x -= l * below[0];
        }
    }
    for k in 0..n {
        let row = &L[k * n..k * n + k + 1];
        let sum: f64 = row[..k].iter().zip(&x[..k]).map(|(l, x)| l * x).sum();
        x[k] = x[k] * row[k] - sum;
    }
}

/// Writes the inverse of `L^T D L`, with the factor from [`tree_factor`]; `n.div_ceil(4)` lanes a row. `Y` is scratch of the same
/// size.
pub(crate) fn tree_inverse(L: &[f64], n: usize, Y: &mut [Lane], inverse: &mut [Lane]) {
    let width = n.div_ceil(4);
    // Y = L^-T: its row `k` is e_k less the factors of column `k` of L times the rows below it.
    for k in (0..n).rev() {
        let (row, below) = Y[k * width..].split_at_mut(width);
        for (block, to) in row.iter_mut().enumerate() {
            let mut sum = [0.0; 4];
            for (i, Y_i) in below.chunks_exact(width).enumerate().take(n - k - 1) {
                add_scaled(&mut sum, -L[(k + 1 + i) * n + k], &Y_i[block]);
            }
            *to = sum;
        }
        row[k / 4][k % 4] += 1.0;
    }
    // The inverse is Y^T D^-1 Y; row `k` of Y is zero before `k`.
    for (i, row) in inverse.chunks_exact_mut(width).enumerate() {
        for (block, to) in row.iter_mut().enumerate() {
            let mut sum = [0.0; 4];
            for (k, Y_k) in Y.chunks_exact(width).enumerate().take(i + 1) {
                add_scaled(&mut sum, Y_k[i / 4][i % 4] * L[k * n + k], &Y_k[block]);
            }
            *to = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_branched_matrix_is_factored_solved_and_inverted() {
        // Two branches of two rows each, on a trunk of two; and a root of its own.
        let before = [0, 1, 2, 3, 2, 5, 0];
        let n = before.len();
        let mut full = vec![0.0; n * n];
        for i in 0..n {
            full[i * n + i] = 3.0 + i as f64;
            let mut j = before[i];
            while j != 0 {
                full[i * n + j - 1] = 0.3 * (i as f64) - 0.2 * (j as f64) + 0.1;
                full[(j - 1) * n + i] = full[i * n + j - 1];
                j = before[j - 1];
            }
        }
        let (mut L, mut Y, mut inverse) = (full.clone(), vec![[0.0; 4]; 2 * n], vec![[0.0; 4]; 2 * n]);
        tree_factor(&mut L, &before).unwrap();
        tree_inverse(&L, n, &mut Y, &mut inverse);
        for k in 0..n {
            let mut x = vec![0.0; n];
            x[k] = 1.0;
            tree_solve(&L, &before, &mut x);
            for i in 0..n {
                let unit: f64 = (0..n).map(|j| full[i * n + j] * x[j]).sum();
                assert!((unit - if i == k { 1.0 } else { 0.0 }).abs() < 1e-13);
                assert!((inverse[2 * i + k / 4][k % 4] - x[i]).abs() < 1e-14);
            }
        }
        full[3 * n + 3] = -1.0;
        assert_eq!(tree_factor(&mut full, &before), Err(3));
    }
}
