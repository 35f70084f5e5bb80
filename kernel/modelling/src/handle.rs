//! What stands out of a part's panel, and the bar or knob among it that a hand can take hold of.

use nalgebra::{Point3, Vector3};

use crate::candidate::{Shape, quantile, shape};
use crate::grid::Grid;
use crate::posed::Posed;

/// Greatest half of a handle's width and greatest length that a hand closes on, m.
const WIDEST: f64 = 0.035;
const LONGEST: f64 = 2.0;
/// Share of how far a handle stands off from which on it is the bar; what is nearer the panel are its posts.
const OUTER: f64 = 0.6;
/// Least distance over which points of one handle are beside one another, m.
const BESIDE: f64 = 0.01;

/// What stands out of a panel, and which way that is.
pub(crate) struct Proud {
    pub(crate) points: Vec<Point3<f64>>,
    pub(crate) outward: Vector3<f64>,
    /// Where the panel is along it, m.
    pub(crate) panel: f64,
}

pub(crate) fn proud(posed: &Posed<'_>, part: &[usize], s: &Shape) -> Proud {
    // What stands out of the panel, away from the object's middle: a handle, most likely. Some of its points may be in no superpoint, or in
    // one that was not taken for the part's.
    let outward = s.outward(posed);
    let panel_at = s.panel.iter().map(|p| p.coords.dot(&outward)).sum::<f64>() / s.panel.len().max(1) as f64;
    let least = (3.0 * posed.analysis.scale.noise).max(0.008);
    let many = posed.points.len() / 60;
    let small = |i: usize| match posed.analysis.piece[i] {
        Some(k) => part.contains(&(k as usize)) || posed.analysis.superpoints[k as usize].points.len() < many,
        None => true,
    };
    let level = if outward.z.abs() > 0.9 { Vector3::y() } else { outward.cross(&Vector3::z()).normalize() };
    let rise = outward.cross(&level);
    let reach = |e: &Vector3<f64>| {
        let mut t: Vec<f64> = s.panel.iter().map(|p| p.coords.dot(e)).collect();
        (quantile(&mut t, 0.01), quantile(&mut t, 0.99))
    };
    let (wide, high) = (reach(&level), reach(&rise));
    let points: Vec<Point3<f64>> = (0..posed.points.len())
        .filter(|i| {
            let p = posed.points[*i].coords;
            let off = p.dot(&outward) - panel_at;
            let (u, v) = (p.dot(&level), p.dot(&rise));
            off > least && off < 0.1 && u > wide.0 && u < wide.1 && v > high.0 && v < high.1 && small(*i)
        })
        .map(|i| posed.points[i])
        .collect();
    Proud { points, outward, panel: panel_at }
}

/// A bar or knob that a hand can take hold of, in K.
#[derive(Debug, Clone)]
pub(crate) struct Handle {
    /// Ends of its middle line, m.
    pub(crate) from: Point3<f64>,
    pub(crate) to: Point3<f64>,
    /// Half of its width, m.
    pub(crate) radius: f64,
    /// Unit vector away from the panel.
    pub(crate) outward: Vector3<f64>,
    /// From its middle line to the panel, m.
    pub(crate) off: f64,
}

/// The handle of a part, if one is seen: what stands out of its panel, if that is of a size for a hand.
pub(crate) fn handle(posed: &Posed<'_>, part: &[usize]) -> Option<Handle> {
    let s = shape(posed, part);
    let proud = proud(posed, part, &s);
    if proud.points.len() < 8 {
        return None;
    }
    let off = |p: &Point3<f64>| p.coords.dot(&proud.outward) - proud.panel;
    let far = quantile(&mut proud.points.iter().map(off).collect::<Vec<_>>(), 0.9);
    let bar: Vec<Point3<f64>> = proud.points.iter().filter(|p| off(p) > OUTER * far).copied().collect();
    // A part that was taken for narrower than it is ends amid its handle.
    let reach = BESIDE.max(2.0 * posed.analysis.scale.spacing);
    let outer = |p: &Point3<f64>| (OUTER * far..far + reach).contains(&off(p));
    let whole = connected(&bar, posed.points.iter().filter(|p| outer(p)).copied().collect(), reach);
    measured(&whole, &proud).or_else(|| measured(&bar, &proud))
}

/// Points that can be come to from others, each step no longer than `reach`.
fn connected(from: &[Point3<f64>], among: Vec<Point3<f64>>, reach: f64) -> Vec<Point3<f64>> {
    let grid = Grid::new(&among, reach);
    let mut seen = vec![false; among.len()];
    let mut next = from.to_vec();
    while let Some(p) = next.pop() {
        grid.near(&p, reach, |i, _| {
            if !std::mem::replace(&mut seen[i], true) {
                next.push(among[i]);
            }
        });
    }
    among.into_iter().zip(seen).filter_map(|(p, seen)| seen.then_some(p)).collect()
}

/// A bar through points, if it is of a size for a hand.
fn measured(bar: &[Point3<f64>], proud: &Proud) -> Option<Handle> {
    let outward = proud.outward;
    let level = if outward.z.abs() > 0.9 { Vector3::y() } else { outward.cross(&Vector3::z()).normalize() };
    let ends = |e: &Vector3<f64>| {
        let mut t: Vec<f64> = bar.iter().map(|p| p.coords.dot(e)).collect();
        (quantile(&mut t, 0.05), quantile(&mut t, 0.95))
    };
    let rise = outward.cross(&level);
    let (u, v) = (ends(&level), ends(&rise));
    let ((along, long), (across, wide)) = if u.1 - u.0 > v.1 - v.0 { ((level, u), (rise, v)) } else { ((rise, v), (level, u)) };
    let radius = (0.5 * (wide.1 - wide.0)).max(0.003);
    if radius > WIDEST || long.1 - long.0 > LONGEST || bar.len() < 5 {
        return None;
    }
    let middle = ends(&outward);
    let at = |t: f64| Point3::from(along * t + across * ((wide.0 + wide.1) / 2.0) + outward * ((middle.0 + middle.1) / 2.0));
    let off = (middle.0 + middle.1) / 2.0 - proud.panel;
    Some(Handle { from: at(long.0), to: at(long.1), radius, outward, off })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::float_cmp)]

    use super::*;
    use crate::analysis::analyse;

    /// A front with a seam, its top and a side, and a bar before the seam: as a camera sees them.
    fn front(seam: f64, bar: f64, radius: f64) -> Vec<Point3<f64>> {
        let steps = |low: f64, high: f64| (0..).map(move |i| low + 0.004 * f64::from(i)).take_while(move |t| *t < high);
        let mut points = Vec::new();
        for y in steps(-0.3, 0.3) {
            points.extend(steps(0.0, 0.4).filter(|_| (y - seam).abs() > 0.006).map(|z| Point3::new(0.0, y, z)));
            points.extend(steps(-0.3, 0.0).map(|x| Point3::new(x, y, 0.4)));
        }
        points.extend(steps(0.0, 0.4).flat_map(|z| steps(-0.3, 0.0).map(move |x| Point3::new(x, 0.3, z))));
        for z in steps(0.08, 0.32) {
            let around = (0..=24).map(|k| std::f64::consts::PI * (f64::from(k) / 24.0 - 0.5));
            points.extend(around.map(|a| Point3::new(0.05 + radius * a.cos(), bar + radius * a.sin(), z)));
        }
        points
    }

    #[test]
    fn a_handle_that_its_part_ends_amid_is_held_by_its_whole_width() {
        let (seam, bar, radius) = (0.11, 0.115, 0.02);
        let analyses = analyse(&front(seam, bar, radius)).unwrap();
        let posed = (0..4).map(|q| Posed::new(&analyses[0], q)).find(|p| p.of_world(&Vector3::x()).x > 0.99).unwrap();
        let beside = |p: &&crate::superpoint::Superpoint| {
            let at = analyses[0].R_AW.inverse() * p.center;
            p.flat && at.x.abs() < 0.01 && at.y < seam && at.z < 0.39
        };
        let part: Vec<usize> = (0..analyses[0].superpoints.len()).filter(|k| beside(&&analyses[0].superpoints[*k])).collect();
        assert_eq!(part.len(), 1, "the front is not parted at its seam");
        let found = handle(&posed, &part).unwrap();
        let across = found.from.coords.dot(&posed.of_world(&Vector3::y()));
        assert!((found.radius - radius).abs() < 0.003, "{found:?}");
        assert!((across - bar).abs() < 0.003, "{found:?}");
    }
}
