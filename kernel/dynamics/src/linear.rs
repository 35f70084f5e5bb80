//! Dense Cholesky factorisation in place, row-major, for the small matrices of one tree.

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
