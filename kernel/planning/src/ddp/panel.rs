//! Products of small dense matrices in rows of four numbers side by side, which processors multiply at once.
//!
//! A panel is a row-major matrix whose rows are padded with zeros to whole lanes.

/// Four columns side by side.
pub(super) type Lane = [f64; 4];

/// Adds `sum_k factor(k) rows_k` to blocks `from..` of the row `to`; all rows are as long as `to`.
#[inline]
pub(super) fn add_rows(to: &mut [Lane], from: usize, rows: &[Lane], count: usize, factor: impl Fn(usize) -> f64 + Copy) {
    let (width, mut at) = (to.len(), from);
    while at < width {
        at += match width - at {
            1 => add_blocks::<1>(to, at, rows, count, factor),
            2 => add_blocks::<2>(to, at, rows, count, factor),
            3 => add_blocks::<3>(to, at, rows, count, factor),
            _ => add_blocks::<4>(to, at, rows, count, factor),
        };
    }
}

/// The same for `N` blocks from `at`, which stay in registers.
#[inline(always)]
fn add_blocks<const N: usize>(to: &mut [Lane], at: usize, rows: &[Lane], count: usize, factor: impl Fn(usize) -> f64) -> usize {
    let mut sum = [[0.0; 4]; N];
    sum.copy_from_slice(&to[at..at + N]);
    for (k, row) in rows.chunks_exact(to.len()).enumerate().take(count) {
        let f = factor(k);
        for (sum, x) in sum.iter_mut().zip(&row[at..at + N]) {
            for (sum, x) in sum.iter_mut().zip(x) {
                *sum += f * x;
            }
        }
    }
    to[at..at + N].copy_from_slice(&sum);
    N
}

/// Product of a padded row with a vector.
#[inline]
pub(super) fn dot(row: &[Lane], x: &[f64]) -> f64 {
    let mut sum = [0.0; 4];
    let whole = x.chunks_exact(4);
    let rest = whole.remainder();
    for (row, x) in row.iter().zip(whole) {
        for (sum, (a, b)) in sum.iter_mut().zip(row.iter().zip(x)) {
            *sum += a * b;
        }
    }
    for (sum, (a, b)) in sum.iter_mut().zip(row[x.len() / 4..].as_flattened().iter().zip(rest)) {
        *sum += a * b;
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3])
}
