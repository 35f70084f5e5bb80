//! Products of small dense matrices in rows of four numbers side by side, which processors multiply at once.
//!
//! A panel is a row-major matrix whose rows are padded with zeros to whole lanes.

/// Four columns side by side.
pub(super) type Lane = [f64; 4];

/// Adds `sum_k factors_k rows_k` to blocks `from..` of the row `to`; all rows are as long as `to`.
#[inline]
pub(super) fn add_rows(to: &mut [Lane], from: usize, rows: &[Lane], factors: &[f64]) {
    let (width, mut at) = (to.len(), from);
    while at < width {
        at += match width - at {
            1 => add_blocks::<1>(to, at, rows, factors),
            2 => add_blocks::<2>(to, at, rows, factors),
            3 => add_blocks::<3>(to, at, rows, factors),
            _ => add_blocks::<4>(to, at, rows, factors),
        };
    }
}

/// The same for `N` blocks from `at`, which stay in registers.
#[inline(always)]
fn add_blocks<const N: usize>(to: &mut [Lane], at: usize, rows: &[Lane], factors: &[f64]) -> usize {
    let width = to.len();
    let Some(to) = to[at..].first_chunk_mut::<N>() else { return N };
    let mut sum = *to;
    // Blocks of one row, and what lies between them and the next row's. (To ask for whole rows costs a division.)
    let mut rest = rows.get(at..).unwrap_or_default();
    for f in factors {
        let Some(x) = rest.first_chunk::<N>() else { break };
        rest = rest.get(width..).unwrap_or_default();
        for (sum, x) in sum.iter_mut().zip(x) {
            for (sum, x) in sum.iter_mut().zip(x) {
                *sum += f * x;
            }
        }
    }
    *to = sum;
    N
}

/// Writes `scale` times the first entries of column `k` of a panel, `width` lanes a row.
#[inline]
pub(super) fn put_column(to: &mut [f64], panel: &[Lane], width: usize, k: usize, scale: f64) {
    let (mut rest, lane) = (panel.get(k / 4..).unwrap_or_default(), k % 4);
    for to in to {
        let Some(first) = rest.first() else { break };
        *to = scale * first[lane];
        rest = rest.get(width..).unwrap_or_default();
    }
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
