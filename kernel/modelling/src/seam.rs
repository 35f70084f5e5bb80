//! Seams across a panel: lines along which points are missing in its plane, or lie behind it.
//!
//! A gap between two leaves may be narrower than points are apart. But the rays that enter it end behind the panel, on its neighbour's side
//! or on what the leaves close, and nowhere else does one see behind a panel. Both show best among all points of a cloud. A handle's shadow
//! takes points away as well, though not along the whole of a line: so each quarter of a line is asked by itself, and none counts for much.

/// Quarters of a line.
const QUARTERS: usize = 4;
/// Bins that are looked at together, so that no seam falls between two.
const FINE: usize = 3;
/// How far on both sides of a line the ground is taken from, m, and how far beyond a panel's edges one looks.
const GROUND: f64 = 0.02;
const MARGIN: f64 = 0.05;
/// How far behind a panel what is seen through a seam may lie, m: a shelf, a box's side, what a front closes.
pub(crate) const BEHIND: f64 = 0.12;
/// How a line may lean, m a m: the arm knows its camera's pose to some tenths of a degree.
const LEANS: [f64; 3] = [0.0, -0.004, 0.004];
/// Numbers that tell of the inside of a panel along one direction, and of an edge.
pub(crate) const INSIDE: usize = 13;
pub(crate) const EDGE: usize = 5;
/// The same of a side behind a front.
pub(crate) const LINE: usize = 8;

type Row = [f32; QUARTERS];

/// What speaks for a seam at a line.
#[derive(Debug, Clone, Copy, Default)]
struct Evidence {
    /// All of it, in standard deviations.
    score: f64,
    /// Least two of the quarters'.
    least: [f64; 2],
    /// That points are missing, and how large a share; that some lie behind, and how many as a share of those that are not missing elsewhere.
    missing: [f64; 2],
    behind: [f64; 2],
    /// How much farther out what lies above is, m, and how sure that is.
    step: [f64; 2],
}

/// Running sums over bins along one direction of a panel.
struct Sums {
    from: f64,
    bin: f64,
    flat: Vec<Row>,
    back: Vec<Row>,
    depth: Vec<f64>,
    square: Vec<f64>,
}

/// A panel's points: off it, and along two directions; and how it lies in them.
pub(crate) struct Front<'a> {
    pub(crate) places: &'a [[f64; 3]],
    /// From and to along both directions.
    pub(crate) ranges: [(f64, f64); 2],
    /// How far off it points are its own, m.
    pub(crate) thin: f64,
    /// Distance of points, m.
    pub(crate) spacing: f64,
}

impl Sums {
    /// Along direction `k`, for lines that lean.
    fn of(front: &Front<'_>, k: usize, lean: f64) -> Self {
        let own = front.ranges[k];
        Self::between(front, k, lean, (own.0 - MARGIN, own.1 + MARGIN))
    }

    /// The same from one place to another, and nothing beyond.
    fn between(front: &Front<'_>, k: usize, lean: f64, (from, to): (f64, f64)) -> Self {
        let other = front.ranges[1 - k];
        let bin = (0.9 * front.spacing).max(0.003) / FINE as f64;
        let bins = (((to - from) / bin).ceil() as usize).clamp(4, 6000);
        let mut sums = Self {
            from,
            bin,
            flat: vec![[0.0; QUARTERS]; bins + 1],
            back: vec![[0.0; QUARTERS]; bins + 1],
            depth: vec![0.0; bins + 1],
            square: vec![0.0; bins + 1],
        };
        let (middle, length) = ((other.0 + other.1) / 2.0, (other.1 - other.0).max(1e-6));
        for p in front.places {
            let (d, t, w) = (p[0], p[1 + k], p[2 - k]);
            if !(-BEHIND..front.thin).contains(&d) || w < other.0 || w >= other.1 {
                continue;
            }
            let b = (t - from - lean * (w - middle)) / bin;
            if b < 0.0 || b >= bins as f64 {
                continue;
            }
            let (b, q) = (b as usize + 1, (((w - other.0) / length * QUARTERS as f64) as usize).min(QUARTERS - 1));
            if d > -front.thin {
                sums.flat[b][q] += 1.0;
                sums.depth[b] += d;
                sums.square[b] += d * d;
            } else {
                sums.back[b][q] += 1.0;
            }
        }
        for b in 0..bins {
            for q in 0..QUARTERS {
                sums.flat[b + 1][q] += sums.flat[b][q];
                sums.back[b + 1][q] += sums.back[b][q];
            }
            sums.depth[b + 1] += sums.depth[b];
            sums.square[b + 1] += sums.square[b];
        }
        sums
    }

    fn bins(&self) -> usize {
        self.depth.len() - 1
    }

    fn bin_of(&self, t: f64) -> usize {
        (((t - self.from) / self.bin).max(0.0) as usize).min(self.bins())
    }

    fn at(&self, b: usize) -> f64 {
        self.from + (b as f64 + 0.5 * FINE as f64) * self.bin
    }

    /// The sums' difference over bins.
    fn rows(of: &[Row], from: usize, to: usize) -> [f64; QUARTERS] {
        std::array::from_fn(|q| f64::from(of[to][q] - of[from][q]))
    }

    fn total(of: &[Row], from: usize, to: usize) -> f64 {
        Self::rows(of, from, to).iter().sum()
    }

    /// What speaks for a seam in the bins that begin at `b`.
    fn evidence(&self, b: usize) -> Evidence {
        let window = ((GROUND / self.bin) as usize).max(4 * FINE);
        let (low, high) = (
            (b.saturating_sub(1 + window), b.saturating_sub(1)),
            ((b + FINE + 1).min(self.bins()), (b + FINE + 1 + window).min(self.bins())),
        );
        let share = |s: (usize, usize)| if s.1 > s.0 { FINE as f64 / (s.1 - s.0) as f64 } else { 0.0 };
        let ground = |of: &[Row], greatest: bool| -> [f64; QUARTERS] {
            let (x, y) = (Self::rows(of, low.0, low.1), Self::rows(of, high.0, high.1));
            std::array::from_fn(|q| {
                let (x, y) = (x[q] * share(low), y[q] * share(high));
                if greatest { x.max(y) } else { x.min(y) }
            })
        };
        let to = (b + FINE).min(self.bins());
        let (flat, back) = (Self::rows(&self.flat, b.min(to), to), Self::rows(&self.back, b.min(to), to));
        let (usual, seen) = (ground(&self.flat, false), ground(&self.back, true));
        let mut quarters: [f64; QUARTERS] = std::array::from_fn(|q| {
            let missing = (usual[q] - flat[q]) / (usual[q] + 0.5).sqrt();
            // Behind what is no panel there is nothing to be told.
            let behind = if usual[q] < 0.3 { 0.0 } else { (back[q] - seen[q]) / (seen[q] + 0.5).sqrt() };
            missing.max(behind).max((missing + behind) * std::f64::consts::FRAC_1_SQRT_2).clamp(-1.0, 4.0)
        });
        let score = quarters.iter().sum::<f64>() / (QUARTERS as f64).sqrt();
        quarters.sort_by(f64::total_cmp);
        let sum = |x: &[f64; QUARTERS]| x.iter().sum::<f64>();
        let (u, f, s, k) = (sum(&usual), sum(&flat), sum(&seen), sum(&back));
        let (m, n) = (Self::total(&self.flat, low.0, low.1), Self::total(&self.flat, high.0, high.1));
        let mut step = [0.0; 2];
        if m >= 12.0 && n >= 12.0 {
            let mean = |s: (usize, usize), n: f64| (self.depth[s.1] - self.depth[s.0]) / n;
            let (x, y) = (mean(low, m), mean(high, n));
            let variance =
                (self.square[low.1] - self.square[low.0] + self.square[high.1] - self.square[high.0] - m * x * x - n * y * y) / (m + n);
            step = [y - x, (y - x).abs() / (variance.max(1e-6) * (1.0 / m + 1.0 / n)).sqrt()];
        }
        Evidence {
            score,
            least: [quarters[0], quarters[1]],
            missing: [(u - f) / (u + 0.5).sqrt(), (u - f) / u.max(1.0)],
            behind: [(k - s) / (s + 0.5).sqrt(), (k - s) / u.max(1.0)],
            step,
        }
    }
}

/// What is told of a panel along one of its directions: its inside, and its lower and its upper edge.
pub(crate) fn told(front: &Front<'_>, k: usize) -> ([f64; INSIDE], [[f64; EDGE]; 2]) {
    let (low, high) = front.ranges[k];
    let length = high - low;
    let margin = 0.03_f64.max(0.05 * length);
    let mut best: (Evidence, f64) = (Evidence::default(), low);
    let mut step: (Evidence, f64) = (Evidence::default(), low);
    let mut edges = [[0.0; EDGE]; 2];
    for lean in LEANS {
        let sums = Sums::of(front, k, lean);
        let (from, to) = (sums.bin_of(low + margin), sums.bin_of(high - margin));
        for b in from..to.saturating_sub(FINE).max(from) {
            let e = sums.evidence(b);
            if e.score > best.0.score {
                best = (e, sums.at(b));
            }
            if e.step[1] > step.0.step[1] {
                step = (e, sums.at(b));
            }
        }
        for (side, edge) in [low, high].into_iter().enumerate() {
            let (from, to) = (sums.bin_of(edge - 0.015), sums.bin_of(edge + 0.015));
            for b in from..to.saturating_sub(FINE).max(from) {
                let e = sums.evidence(b);
                if e.score / 4.0 > edges[side][2] {
                    edges[side][2] = e.score / 4.0;
                    edges[side][3] = e.missing[1].max(0.0);
                }
            }
            if lean != 0.0 {
                continue;
            }
            let out = if side == 0 { -1.0 } else { 1.0 };
            let strip = |x: f64, y: f64| {
                let (a, b) = (sums.bin_of(edge + out * x), sums.bin_of(edge + out * y));
                (a.min(b), a.max(b))
            };
            let (beyond, within) = (strip(0.01, 0.04), strip(-0.01, -0.04));
            let own = Sums::total(&sums.flat, within.0, within.1);
            let flat = Sums::total(&sums.flat, beyond.0, beyond.1);
            edges[side][0] = (flat / own.max(1.0)).min(2.0);
            edges[side][1] = (Sums::total(&sums.back, beyond.0, beyond.1) / own.max(1.0)).min(2.0);
            if flat >= 5.0 && own >= 5.0 {
                let mean = |s: (usize, usize), n: f64| (sums.depth[s.1] - sums.depth[s.0]) / n;
                edges[side][4] = 100.0 * (mean(beyond, flat) - mean(within, own));
            }
        }
    }
    let place = |t: f64| (t - low).min(high - t).max(0.0);
    let (e, t) = best;
    let inside = [
        e.score / 4.0,
        e.least[0],
        e.least[1],
        e.missing[0] / 4.0,
        2.0 * e.missing[1],
        e.behind[0] / 4.0,
        2.0 * e.behind[1],
        100.0 * e.step[0].abs(),
        4.0 * place(t) / length.max(1e-3),
        5.0 * place(t),
        100.0 * step.0.step[0].abs(),
        step.0.step[1] / 10.0,
        step.0.score / 4.0,
    ];
    (inside, edges)
}

/// What is told of a side that lies along a front: how much of it is seen, the clearest line in it, and the clearest step. Direction 0 of
/// `side` leads out of the front, which ends at zero; lines are looked for so far behind that.
pub(crate) fn behind(side: &Front<'_>, (far, near): (f64, f64)) -> [f64; LINE] {
    let sums = Sums::between(side, 0, 0.0, side.ranges[0]);
    let seen = Sums::total(&sums.flat, 0, sums.bins());
    let (mut line, mut step) = (Evidence::default(), Evidence::default());
    for b in sums.bin_of(far)..sums.bin_of(near).saturating_sub(FINE) {
        let e = sums.evidence(b);
        if e.score > line.score {
            line = e;
        }
        if e.step[1] > step.step[1] {
            step = e;
        }
    }
    [
        (1.0 + seen).log10(),
        line.score / 4.0,
        line.least[0],
        line.least[1],
        2.0 * line.missing[1],
        2.0 * line.behind[1],
        100.0 * step.step[0],
        step.step[1] / 10.0,
    ]
}

/// How clear the clearest line along each end of a panel is, from some way beyond the end to some way within, in standard deviations: a frame is
/// that wide where a front and what it lies flush in were taken for one panel.
pub(crate) fn around(front: &Front<'_>, k: usize, (beyond, within): (f64, f64)) -> [f64; 2] {
    let (low, high) = front.ranges[k];
    let mut best = [0.0; 2];
    for lean in LEANS {
        let sums = Sums::of(front, k, lean);
        for (end, (from, to)) in [(low - beyond, low + within), (high - within, high + beyond)].into_iter().enumerate() {
            let (from, to) = (sums.bin_of(from), sums.bin_of(to));
            for b in from..to.saturating_sub(FINE).max(from) {
                let e = sums.evidence(b);
                // All along, or it is a handle's shadow or a hole.
                best[end] = f64::max(best[end], e.score.min(2.0 * (e.least[0] + e.least[1])));
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points half a metre wide and high, 5 mm apart; `seen` says how far off the panel the ray at a place ends, if it is seen.
    fn panel(seen: impl Fn(f64, f64) -> Option<f64>) -> Vec<[f64; 3]> {
        let at = |k: usize| 0.005 * k as f64;
        let place = |i: usize| {
            // Rows shifted against one another, so that no line of a grid is a gap.
            let (u, v) = (at(i % 100) + 0.0013 * (i / 100 % 4) as f64, at(i / 100));
            seen(u, v).map(|d| [d, u, v])
        };
        (0..10_000).filter_map(place).collect()
    }

    fn inside(places: &[[f64; 3]]) -> [f64; INSIDE] {
        told(&Front { places, ranges: [(0.0, 0.5), (0.0, 0.5)], thin: 0.006, spacing: 0.007 }, 0).0
    }

    #[test]
    fn a_gap_narrower_than_points_are_apart_is_told_by_what_lies_behind_it() {
        let plain = inside(&panel(|_, _| Some(0.0)));
        // One ray in four that meets the gap enters it.
        let gap =
            inside(&panel(|u, v| Some(if (0.24..0.244).contains(&u) && ((v * 200.0) as usize).is_multiple_of(2) { -0.03 } else { 0.0 })));
        assert!(gap[0] > 0.5 && gap[5] > 0.3, "{gap:?}");
        assert!(plain[0] < 0.5 * gap[0] && plain[5] < 0.1, "{plain:?}");
    }

    #[test]
    fn the_shadow_of_a_handle_is_no_seam() {
        let seam = inside(&panel(|u, _| if (0.24..0.25).contains(&u) { None } else { Some(0.0) }));
        let shadow = inside(&panel(|u, v| if (0.24..0.25).contains(&u) && (0.2..0.3).contains(&v) { None } else { Some(0.0) }));
        assert!(seam[1] > 1.0, "least of the quarters {seam:?}");
        assert!(shadow[1] < 0.5 && shadow[0] < 0.7 * seam[0], "{shadow:?}");
    }

    #[test]
    fn the_back_of_a_front_shows_on_its_side_as_a_gap_or_as_a_step() {
        // A side 10 cm deep that ends at a front; what is 2 cm behind that is a gap, or where the side steps out by 4 mm.
        let side = |seen: &dyn Fn(f64) -> f64| {
            let places: Vec<[f64; 3]> = panel(|_, _| Some(0.0)).iter().map(|p| [seen(p[1] / 5.0 - 0.1), p[1] / 5.0 - 0.1, p[2]]).collect();
            behind(&Front { places: &places, ranges: [(-0.1, 0.0), (0.0, 0.5)], thin: 0.006, spacing: 0.004 }, (-0.045, -0.003))
        };
        let plain = side(&|_| 0.0);
        let gap = side(&|t| if (-0.022..-0.018).contains(&t) { -0.03 } else { 0.0 });
        let step = side(&|t| if t > -0.02 { 0.004 } else { 0.0 });
        assert!(gap[1] > 2.0 * plain[1] && gap[1] > 0.7 && gap[4] > 0.3 && gap[5] > 0.3, "{gap:?} {plain:?}");
        assert!((step[6] - 0.4).abs() < 0.05 && step[7] > 1.0 && plain[6].abs() < 0.01, "{step:?} {plain:?}");
    }

    #[test]
    fn a_seam_some_way_within_all_edges_is_told_and_a_hole_is_none() {
        let ends = |places: &[[f64; 3]]| {
            let front = Front { places, ranges: [(0.0, 0.5), (0.0, 0.5)], thin: 0.006, spacing: 0.007 };
            [0, 1].map(|k| around(&front, k, (0.01, 0.06))).concat().into_iter().fold(f64::INFINITY, f64::min)
        };
        let edge = |t: f64| (0.02..0.025).contains(&t) || (0.475..0.48).contains(&t);
        let within = |t: f64| (0.02..0.48).contains(&t);
        let seam = ends(&panel(|u, v| (!(edge(u) && within(v) || edge(v) && within(u))).then_some(0.0)));
        let hole = ends(&panel(|u, v| (!(edge(u) && (0.2..0.3).contains(&v))).then_some(0.0)));
        assert!(seam > 1.0 && hole < 0.25, "{seam} {hole}");
    }
}
