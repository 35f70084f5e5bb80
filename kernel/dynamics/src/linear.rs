//! Dense Cholesky factorisation in place, row-major, for the small matrices of one tree.

/// Factors the lower triangle of the symmetric, row-major `n x n` matrix `A` as `L L^T`, in place.
///
/// # Errors
/// The index of the first pivot that is not positive (or not a number).
///
/// # Panics
/// `A` has fewer than `n * n` entries.
pub fn cholesky(A: &mut [f64], n: usize) -> Result<(), usize> {
    for i in 0..n {
        let (above, row) = A.split_at_mut(i * n);
        let row = &mut row[..i + 1];
        for j in 0..i {
            let other = &above[j * n..j * n + j + 1];
            row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
        }
        let d = row[i] - dot(&row[..i], &row[..i]);
        if d.is_nan() || d <= 0.0 {
            return Err(i);
        }
        row[i] = d.sqrt();
    }
    Ok(())
}

/// Sums in two strands, which processors add side by side.
#[inline]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let (mut s, mut t) = (0.0, 0.0);
    let mut pairs = x.chunks_exact(2).zip(y.chunks_exact(2));
    for (x, y) in &mut pairs {
        s += x[0] * y[0];
        t += x[1] * y[1];
    }
    if x.len() % 2 == 1 {
        s += x[x.len() - 1] * y[x.len() - 1];
    }
    s + t
}

/// Solves `L x = b` in place, with `L` from [`cholesky`].
///
/// # Panics
/// `L` has fewer than `n * n` entries, or `x` fewer than `n`.
pub fn cholesky_solve_lower(L: &[f64], n: usize, x: &mut [f64]) {
    for i in 0..n {
        let row = &L[i * n..i * n + i + 1];
        x[i] = (x[i] - dot(&row[..i], &x[..i])) / row[i];
    }
}

/// Solves `L L^T x = b` in place, with `L` from [`cholesky`].
///
/// # Panics
/// `L` has fewer than `n * n` entries, or `x` fewer than `n`.
pub fn cholesky_solve(L: &[f64], n: usize, x: &mut [f64]) {
    cholesky_solve_lower(L, n, x);
    for i in (0..n).rev() {
        let row = &L[i * n..i * n + i + 1];
        let (before, rest) = x.split_at_mut(i);
        rest[0] /= row[i];
        for (x, l) in before.iter_mut().zip(&row[..i]) {
            *x -= l * rest[0];
        }
    }
}
