//! Dense Cholesky factorisation in place, row-major, for the small matrices of one tree.

/// Factors the lower triangle of the symmetric `n x n` matrix `A` as `L L^T`; the index of the pivot that is not positive
/// otherwise.
pub(crate) fn cholesky(A: &mut [f64], n: usize) -> Result<(), usize> {
    for j in 0..n {
        let mut d = A[j * n + j];
        for k in 0..j {
            d -= A[j * n + k] * A[j * n + k];
        }
        // Also catches a pivot that is not a number.
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

/// Solves `L L^T x = b` in place.
pub(crate) fn cholesky_solve(L: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let mut s = x[i];
        for k in 0..i {
            s -= L[i * n + k] * x[k];
        }
        x[i] = s / L[i * n + i];
    }
    for i in (0..n).rev() {
        let mut s = x[i];
        for k in i + 1..n {
            s -= L[k * n + i] * x[k];
        }
        x[i] = s / L[i * n + i];
    }
}
