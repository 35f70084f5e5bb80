//! What says that a part moves, and is no mere face of a block.
//!
//! A block's face fills its rectangle as well as a shut front does. But a front is a thing of its own: a gap or a step runs around it, in its own
//! plane or, where it covers the whole face, on the sides that lie along it, as far behind as it is thick; or it stands out, is set back, has a
//! handle, or stands open. So of each part that was found all that is told of groups is asked again, and beside it what its sides show. The
//! other heads learned from furniture, of which most moves. This one learns from more blocks than furniture, seen by cameras and spread evenly as
//! points of a mesh are, and answers one thing alone: how likely it is a part that moves. A thing none of whose parts is likely to is rigid.
//!
//! One proof needs no network: a line along most edges of a part, in which points are missing or lie behind, all along it. It is looked for some
//! way within the edges, too, since a front that lies flush in a narrow frame is taken for one panel with it.

use nalgebra::Point3;

use crate::border::Panel;
use crate::mask::{self, Known, MASK};
use crate::network::Matrix;
use crate::posed::Posed;
use crate::seam::{BEHIND, Front, LINE, around, behind};

/// Features of a part.
pub const EVIDENCE: usize = MASK + 4 * LINE + 10;

/// How deep along a front's sides one looks, m, and where the back of a front may be.
const DEEP: f64 = 0.1;
const BACK: (f64, f64) = (-0.045, -0.003);

/// The network's input for each part, of which it is known what was promised.
pub(crate) fn rows(posed: &Posed<'_>, groups: &[Vec<usize>], promises: &[[f64; 2]], known: &Known<'_>) -> Matrix {
    let a = posed.analysis;
    let told = mask::rows(posed, groups, known);
    let dense: Vec<Point3<f64>> = a.dense.iter().map(|(p, _)| Point3::from(posed.of_world(&p.coords))).collect();
    let thin = a.scale.thin();
    // A block is all on the faces of its box.
    let on_box = |p: &&Point3<f64>| (0..3).any(|k| (p[k] - posed.low[k]).min(posed.high[k] - p[k]) < thin);
    let boxed = posed.points.iter().filter(on_box).count() as f64 / posed.points.len().max(1) as f64;
    let mut all: Vec<f32> = Vec::with_capacity(groups.len() * EVIDENCE);
    for (g, group) in groups.iter().enumerate() {
        let panel = Panel::of(posed, group);
        let places: Vec<[f64; 3]> = dense.iter().map(|p| panel.coordinates(p)).filter(|c| c[0] > -DEEP - 0.01 && c[0] < thin).collect();
        let mut row: Vec<f64> = Vec::with_capacity(EVIDENCE - MASK);
        let mut apart = Vec::new();
        for k in 0..2 {
            let ranges = [panel.level, panel.rise];
            let mut sides = [(ranges[k].0, -1.0), (ranges[k].1, 1.0)].map(|(edge, out)| {
                let along: Vec<[f64; 3]> =
                    places.iter().map(|c| [out * (c[1 + k] - edge), c[0], c[2 - k]]).filter(|c| c[0] > -BEHIND && c[0] < BEHIND).collect();
                // Where the side is: a front may overlap the case, or the case the front.
                let at = side_of(&along, thin);
                let moved: Vec<[f64; 3]> = along.iter().map(|c| [c[0] - at, c[1], c[2]]).collect();
                let side = Front { places: &moved, ranges: [(-DEEP, 0.0), ranges[1 - k]], thin, spacing: a.scale.spacing };
                (behind(&side, BACK), at)
            });
            // Left and right, above and below are the same here: the better seen one first.
            if sides[0].0[0] < sides[1].0[0] {
                sides.swap(0, 1);
            }
            row.extend(sides.iter().flat_map(|s| s.0));
            apart.extend(sides.map(|s| 20.0 * s.1));
        }
        row.extend(apart);
        let most = promises.iter().map(|p| p[0]).fold(0.0, f64::max);
        row.extend(promises[g].map(|p| 2.0 * p - 1.0));
        row.extend([2.0 * most - 1.0, groups.len() as f64 / 4.0 - 1.0]);
        row.extend([4.0 * boxed - 3.0, posed.pieces.len() as f64 / 20.0 - 1.0]);
        debug_assert_eq!(row.len() + MASK, EVIDENCE);
        all.extend(told.row(g).iter());
        all.extend(row.into_iter().map(|x| x.clamp(-3.0, 3.0) as f32));
    }
    Matrix::from_row_slice(groups.len(), EVIDENCE, &all)
}

/// Where a front's seam may lie about its panel's edges, m: beyond them and within.
const FRAME: (f64, f64) = (0.01, 0.06);

/// How clear the seam around a part is: that of its four edges which is least clear but for one, since what lies on the ground or is seen askew
/// may not show it.
pub(crate) fn seam(posed: &Posed<'_>, group: &[usize]) -> f64 {
    let a = posed.analysis;
    let thin = a.scale.thin();
    let panel = Panel::of(posed, group);
    let ranges = [panel.level, panel.rise];
    let near =
        |c: &[f64; 3]| c[0] > -BEHIND && c[0] < thin && (0..2).all(|k| c[1 + k] > ranges[k].0 - 0.06 && c[1 + k] < ranges[k].1 + 0.06);
    let places: Vec<[f64; 3]> =
        a.dense.iter().map(|(p, _)| panel.coordinates(&Point3::from(posed.of_world(&p.coords)))).filter(near).collect();
    let front = Front { places: &places, ranges, thin, spacing: a.scale.spacing };
    let mut edges = [around(&front, 0, FRAME), around(&front, 1, FRAME)].concat();
    edges.sort_by(f64::total_cmp);
    edges[1]
}

/// How far beyond a panel's edge most points behind the panel lie that are near it, m.
fn side_of(along: &[[f64; 3]], thin: f64) -> f64 {
    const REACH: f64 = 0.03;
    let mut bins = [0_usize; 30];
    for c in along.iter().filter(|c| c[1] < -thin && c[0].abs() < REACH) {
        bins[(((c[0] + REACH) / (2.0 * REACH) * 30.0) as usize).min(29)] += 1;
    }
    let best = (0..30).max_by_key(|b| (bins[*b], std::cmp::Reverse(b.abs_diff(15)))).unwrap_or(15);
    let (low, high) = ((best as f64 - 1.5) * REACH / 15.0 - REACH, (best as f64 + 2.5) * REACH / 15.0 - REACH);
    let (mut sum, mut n) = (0.0, 0.0);
    for c in along.iter().filter(|c| c[1] < -thin && c[0] > low && c[0] < high) {
        sum += c[0];
        n += 1.0;
    }
    if n > 0.0 { sum / n } else { 0.0 }
}
