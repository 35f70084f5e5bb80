//! A twice continuously differentiable curve through configurations: natural cubic splines over chord length, clamped
//! to the chords' directions at the ends.

/// q(s) for s in 0..1.
#[derive(Debug, Clone)]
pub(crate) struct Spline {
    s: Vec<f64>,
    q: Vec<Vec<f64>>,
    /// Second derivatives at the knots.
    m: Vec<Vec<f64>>,
}

impl Spline {
    /// Through at least two distinct points; repeated points are dropped. `None` if fewer remain.
    pub(crate) fn through(points: &[Vec<f64>]) -> Option<Self> {
        let mut q: Vec<Vec<f64>> = Vec::with_capacity(points.len());
        for p in points {
            if q.last().is_none_or(|l| l.iter().zip(p).any(|(a, b)| (a - b).abs() > 1e-9)) {
                q.push(p.clone());
            }
        }
        if q.len() < 2 {
            return None;
        }
        let n = q.len();
        let dof = q[0].len();
        let mut s = vec![0.0; n];
        for i in 1..n {
            s[i] = s[i - 1] + q[i].iter().zip(&q[i - 1]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        }
        let total = s[n - 1];
        s.iter_mut().for_each(|x| *x /= total);
        let mut m = vec![vec![0.0; dof]; n];
        for j in 0..dof {
            // Tridiagonal system of the clamped spline (Thomas).
            let h: Vec<f64> = (1..n).map(|i| s[i] - s[i - 1]).collect();
            let slope: Vec<f64> = (1..n).map(|i| (q[i][j] - q[i - 1][j]) / h[i - 1]).collect();
            let mut c = vec![0.0; n];
            let mut d = vec![0.0; n];
            // Ends: natural, no curvature.
            for i in 1..n - 1 {
                let (a, b, r) = (h[i - 1], 2.0 * (h[i - 1] + h[i]), 6.0 * (slope[i] - slope[i - 1]));
                let w = b - a * c[i - 1];
                c[i] = h[i] / w;
                d[i] = (r - a * d[i - 1]) / w;
            }
            for i in (1..n - 1).rev() {
                m[i][j] = d[i] - c[i] * m[i + 1][j];
            }
        }
        Some(Self { s, q, m })
    }

    pub(crate) fn dof(&self) -> usize {
        self.q[0].len()
    }

    /// Position, first and second derivative by s.
    pub(crate) fn at(&self, s: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        let s = s.clamp(0.0, 1.0);
        let i = self.s.partition_point(|x| *x <= s).clamp(1, self.s.len() - 1);
        let h = self.s[i] - self.s[i - 1];
        let (b, a) = ((s - self.s[i - 1]) / h, (self.s[i] - s) / h);
        for j in 0..q.len() {
            let (q0, q1, m0, m1) = (self.q[i - 1][j], self.q[i][j], self.m[i - 1][j], self.m[i][j]);
            q[j] = a * q0 + b * q1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0;
            dq[j] = (q1 - q0) / h + ((3.0 * b * b - 1.0) * m1 - (3.0 * a * a - 1.0) * m0) * h / 6.0;
            ddq[j] = a * m0 + b * m1;
        }
    }

    /// Knots.
    pub(crate) fn knots(&self) -> &[f64] {
        &self.s
    }
}
