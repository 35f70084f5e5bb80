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

/// Solves `A X = B` by Gaussian elimination with pivots, both row-major and changed: `A` is `n x n`, `B` has rows of `width` and
/// becomes `X`. A zero pivot gives numbers that are not finite.
pub(crate) fn eliminate(A: &mut [f64], n: usize, B: &mut [f64], width: usize) {
    for k in 0..n {
        let pivot = (k..n).max_by(|i, j| A[i * n + k].abs().total_cmp(&A[j * n + k].abs())).unwrap_or(k);
        if pivot != k {
            for j in 0..n {
                A.swap(k * n + j, pivot * n + j);
            }
            for j in 0..width {
                B.swap(k * width + j, pivot * width + j);
            }
        }
        for i in k + 1..n {
            let factor = A[i * n + k] / A[k * n + k];
            for j in k..n {
                A[i * n + j] -= factor * A[k * n + j];
            }
            for j in 0..width {
                B[i * width + j] -= factor * B[k * width + j];
            }
        }
    }
    for k in (0..n).rev() {
        for j in 0..width {
            let sum: f64 = (k + 1..n).map(|i| A[k * n + i] * B[i * width + j]).sum();
            B[k * width + j] = (B[k * width + j] - sum) / A[k * n + k];
        }
    }
}

/// What each of the `chosen` rows (in order) stands on, counted among those, where the others are taken out: see [`tree_factor`].
pub(crate) fn before_among(before: &[usize], chosen: &[usize], out: &mut Vec<usize>) {
    out.clear();
    if chosen.len() == before.len() {
        out.extend_from_slice(before);
        return;
    }
    for &k in chosen {
        let mut next = before[k];
        out.push(loop {
            match next.checked_sub(1).map(|i| chosen.binary_search(&i)) {
                None => break 0,
                Some(Ok(slot)) => break slot + 1,
                Some(Err(_)) => next = before[next - 1],
            }
        });
    }
}

/// Copies the rows of a row-major `n x n` matrix into rows of whole lanes.
pub(crate) fn into_lanes(A: &[f64], n: usize, out: &mut [Lane]) {
    for (from, to) in A.chunks_exact(n.max(1)).zip(out.chunks_exact_mut(n.div_ceil(4).max(1))) {
        let (whole, rest) = from.as_chunks::<4>();
        for (to, from) in to.iter_mut().zip(whole) {
            *to = *from;
        }
        if let (Some(to), [first, others @ ..]) = (to.get_mut(whole.len()), rest) {
            let mut lane = [*first, 0.0, 0.0, 0.0];
            for (to, from) in lane[1..].iter_mut().zip(others) {
                *to = *from;
            }
            *to = lane;
        }
    }
}

/// Factors the symmetric `n x n` matrix `A`, of which the lower triangle is given, as `L^T D L` in place (Featherstone 2008,
/// section 6.5); `n.div_ceil(4)` lanes a row. `before[i]` is the row that row `i` stands on, plus one, and zero for a root: `A`
/// must be zero between rows of different branches, and `L` is then too. Where each row stands on the one before it, `A` may be any.
/// The diagonal takes `1 / D`. What stands above the diagonal comes out as anything.
///
/// # Errors
/// The index of the first pivot that is not positive (or not a number).
pub(crate) fn tree_factor(A: &mut [Lane], before: &[usize]) -> Result<(), usize> {
    // Rows of fixed length stay in registers.
    match before.len().div_ceil(4) {
        1 => factor_rows(A.as_chunks_mut::<1>().0, before),
        2 => factor_rows(A.as_chunks_mut::<2>().0, before),
        3 => factor_rows(A.as_chunks_mut::<3>().0, before),
        4 => factor_rows(A.as_chunks_mut::<4>().0, before),
        width => factor_long_rows(A, before, width),
    }
}

fn factor_rows<const W: usize>(A: &mut [[Lane; W]], before: &[usize]) -> Result<(), usize> {
    for k in (0..before.len()).rev() {
        let (above, row) = A.split_at_mut(k);
        let original = row[0];
        let row = row[0].as_flattened_mut();
        let d = row[k];
        if d.is_nan() || d <= 0.0 {
            return Err(k);
        }
        let inverse = 1.0 / d;
        row[k] = inverse;
        let mut next = before[k];
        while next != 0 {
            let i = next - 1;
            let factor = row[i] * inverse;
            row[i] = factor;
            let mut target = above[i];
            for (to, from) in target.iter_mut().zip(&original) {
                add_scaled(to, -factor, from);
            }
            above[i] = target;
            next = before[i];
        }
    }
    Ok(())
}

fn factor_long_rows(A: &mut [Lane], before: &[usize], width: usize) -> Result<(), usize> {
    for k in (0..before.len()).rev() {
        let (above, row) = A.split_at_mut(k * width);
        let row = &mut row[..k / 4 + 1];
        let d = row[k / 4][k % 4];
        if d.is_nan() || d <= 0.0 {
            return Err(k);
        }
        let inverse = 1.0 / d;
        row[k / 4][k % 4] = inverse;
        let mut next = before[k];
        while next != 0 {
            let i = next - 1;
            let factor = row[i / 4][i % 4] * inverse;
            // What lies between the branches is zero in row `k`, and stays as it is.
            for (to, from) in above[i * width..i * width + i / 4 + 1].iter_mut().zip(&*row) {
                let mut lane = *to;
                add_scaled(&mut lane, -factor, from);
                *to = lane;
            }
            row[i / 4][i % 4] = factor;
            next = before[i];
        }
    }
    Ok(())
}

/// Solves `L^T D L x = b` in place, with the factor from [`tree_factor`].
pub(crate) fn tree_solve(L: &[Lane], x: &mut [f64]) {
    let width = 4 * x.len().div_ceil(4).max(1);
    let L = &L.as_flattened()[..x.len() * width];
    for (k, row) in L.chunks_exact(width).enumerate().rev() {
        let (before, rest) = x.split_at_mut(k);
        for (x, l) in before.iter_mut().zip(row) {
            *x -= l * rest[0];
        }
    }
    for (k, row) in L.chunks_exact(width).enumerate() {
        let (before, rest) = x.split_at_mut(k);
        rest[0] = rest[0] * row[k] - dot(&row[..k], before);
    }
}

/// Solves `L^T D L X = B` in place for many right-hand sides side by side: `across` lanes a row of `B`.
pub(crate) fn tree_solve_rows(L: &[Lane], n: usize, B: &mut [Lane], across: usize) {
    // Rows of fixed length stay in registers.
    match across {
        1 => solve_rows(L, n, B.as_chunks_mut::<1>().0),
        2 => solve_rows(L, n, B.as_chunks_mut::<2>().0),
        3 => solve_rows(L, n, B.as_chunks_mut::<3>().0),
        4 => solve_rows(L, n, B.as_chunks_mut::<4>().0),
        5 => solve_rows(L, n, B.as_chunks_mut::<5>().0),
        6 => solve_rows(L, n, B.as_chunks_mut::<6>().0),
        7 => solve_rows(L, n, B.as_chunks_mut::<7>().0),
        _ => solve_long_rows(L, n, B, across),
    }
}

fn solve_rows<const W: usize>(L: &[Lane], n: usize, B: &mut [[Lane; W]]) {
    let (stride, L) = (4 * n.div_ceil(4), L.as_flattened());
    for k in (0..n).rev() {
        let (row, below) = B[k..n].split_at_mut(1);
        let mut sum = row[0];
        let factors = L.get((k + 1) * stride + k..).unwrap_or(&[]).iter().step_by(stride.max(1));
        for (factor, other) in factors.zip(below) {
            add_scaled_row(&mut sum, -factor, other);
        }
        row[0] = sum;
    }
    for k in 0..n {
        let (above, row) = B.split_at_mut(k);
        let factors = &L[k * stride..k * stride + k + 1];
        let mut sum = [[0.0; 4]; W];
        add_scaled_row(&mut sum, factors[k], &row[0]);
        for (factor, other) in factors.iter().zip(above) {
            add_scaled_row(&mut sum, -factor, other);
        }
        row[0] = sum;
    }
}

#[inline(always)]
fn add_scaled_row<const W: usize>(to: &mut [Lane; W], a: f64, x: &[Lane; W]) {
    for (to, x) in to.iter_mut().zip(x) {
        add_scaled(to, a, x);
    }
}

fn solve_long_rows(L: &[Lane], n: usize, B: &mut [Lane], across: usize) {
    let mut at = 0;
    while at < across {
        match across - at {
            1 => solve_strip::<1>(L, n, B, across, at),
            2 => solve_strip::<2>(L, n, B, across, at),
            3 => solve_strip::<3>(L, n, B, across, at),
            _ => solve_strip::<4>(L, n, B, across, at),
        }
        at += 4;
    }
}

/// [`tree_solve_rows`] for `W` lanes of each row, from the lane `at` on.
fn solve_strip<const W: usize>(L: &[Lane], n: usize, B: &mut [Lane], across: usize, at: usize) {
    let (stride, L) = (4 * n.div_ceil(4), L.as_flattened());
    let strip = |B: &[Lane], k: usize| -> [Lane; W] { std::array::from_fn(|i| B[k * across + at + i]) };
    let put = |B: &mut [Lane], k: usize, sum: &[Lane; W]| B[k * across + at..k * across + at + W].copy_from_slice(sum);
    for k in (0..n).rev() {
        let mut sum = strip(B, k);
        for i in k + 1..n {
            add_scaled_row(&mut sum, -L[i * stride + k], &strip(B, i));
        }
        put(B, k, &sum);
    }
    for k in 0..n {
        let mut sum = [[0.0; 4]; W];
        add_scaled_row(&mut sum, L[k * stride + k], &strip(B, k));
        for i in 0..k {
            add_scaled_row(&mut sum, -L[k * stride + i], &strip(B, i));
        }
        put(B, k, &sum);
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_branched_matrix_is_factored_and_solved_for_one_side_and_many() {
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
        let lanes = || vec![[0.0; 4]; 2 * n];
        let (mut L, mut units, mut long) = (lanes(), lanes(), lanes());
        into_lanes(&full, n, &mut L);
        tree_factor(&mut L, &before).unwrap();
        for k in 0..n {
            units[2 * k + k / 4][k % 4] = 1.0;
        }
        long.copy_from_slice(&units);
        tree_solve_rows(&L, n, &mut units, 2);
        solve_long_rows(&L, n, &mut long, 2);
        for k in 0..n {
            let mut x = vec![0.0; n];
            x[k] = 1.0;
            tree_solve(&L, &mut x);
            for i in 0..n {
                let unit: f64 = (0..n).map(|j| full[i * n + j] * x[j]).sum();
                assert!((unit - if i == k { 1.0 } else { 0.0 }).abs() < 1e-13);
                assert!((units[2 * i + k / 4][k % 4] - x[i]).abs() < 1e-14);
                assert!((long[2 * i + k / 4][k % 4] - x[i]).abs() < 1e-14);
            }
        }
        let mut long = lanes();
        into_lanes(&full, n, &mut long);
        factor_long_rows(&mut long, &before, 2).unwrap();
        for i in 0..n {
            for k in 0..i + 1 {
                assert_eq!(long[2 * i + k / 4][k % 4], L[2 * i + k / 4][k % 4]);
            }
        }
        full[3 * n + 3] = -1.0;
        into_lanes(&full, n, &mut L);
        assert_eq!(tree_factor(&mut L, &before), Err(3));
    }
}
