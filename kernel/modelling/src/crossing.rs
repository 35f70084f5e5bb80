//! Where two flat pieces meet at a shallow angle, each point is given to the piece on whose side of the meeting line it lies.
//!
//! A flush door that stands ajar leaves its frame's plane at the hinge. Near there its points lie within the noise of both planes, and region
//! growing gives them all to the piece that came first: the leaf loses what lies next to its hinge, by as much as a third of its width. Along the
//! direction u across the line in which the planes meet, the points of both pieces are one sequence that follows one plane up to some place and
//! the other from there on. That place is the change point of greatest likelihood (Hinkley 1970): no single point tells it, all of them do.

use nalgebra::{Point3, Vector3};

use crate::superpoint::{Scale, Superpoint};

/// Angles between planes at which growing mistakes one for the other, rad. Below the least two pieces are one plane, bent by the camera.
const LEAST: f64 = 0.02;
const MOST: f64 = 0.35;
/// Residuals count up to this many times the noise, so that what lies on neither plane says nothing.
const FAR: f64 = 3.0;
/// The same of what single points tell apart, which growing does.
const TOLD: f64 = 4.0;
/// Squared residuals, in the noise's squares, that a change must save over none: as of a step by four deviations.
const SAVED: f64 = 16.0;
/// How often two pieces are parted, with planes through what they then hold.
const ROUNDS: usize = 3;
/// Share of the smaller piece's extent along the line that is left out at either end: there its outline may be rounded or slanted.
const ENDS: f64 = 0.01;

/// Least noise, m: what is finer tells nothing of a hinge.
const LEAST_NOISE: f64 = 0.001;
/// Points that are too few for a piece.
const FEW: usize = 10;

/// A point near the line: how far across it, and its squared distances from both planes, in the noise's squares.
struct Near {
    u: f64,
    to_small: f64,
    to_large: f64,
    point: u32,
}

/// Parts all pieces of a cloud that meet so.
pub(crate) fn part(cloud: &[Point3<f64>], pieces: &mut [Superpoint], scale: Scale) {
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|k| std::cmp::Reverse(pieces[*k].points.len()));
    for (i, large) in order.iter().enumerate() {
        for small in &order[i + 1..] {
            // What was the other's has bent both planes.
            for _ in 0..ROUNDS {
                let Some((of_small, of_large)) = parted(cloud, &pieces[*small], &pieces[*large], scale) else { break };
                pieces[*small] = Superpoint::of(of_small, cloud, true);
                pieces[*large] = Superpoint::of(of_large, cloud, true);
            }
        }
    }
}

/// The points of two pieces after parting; `None` where they do not meet so, or nothing says that they are two there.
fn parted(cloud: &[Point3<f64>], small: &Superpoint, large: &Superpoint, scale: Scale) -> Option<(Vec<u32>, Vec<u32>)> {
    let line = Line::of(small, large)?;
    let noise = scale.noise.max(small.residual).max(large.residual).max(LEAST_NOISE);
    let near = line.near(cloud, small, large, noise)?;
    let change = change(&near)?;
    let mut held = vec![None; cloud.len()];
    near.iter().enumerate().for_each(|(k, x)| held[x.point as usize] = Some(k >= change));
    let (mut of_small, mut of_large) = (Vec::new(), Vec::new());
    for (points, own) in [(&small.points, true), (&large.points, false)] {
        for i in points {
            if held[*i as usize].unwrap_or(own) { of_small.push(*i) } else { of_large.push(*i) }
        }
    }
    (of_small.len() > FEW && of_large.len() > FEW).then_some((of_small, of_large))
}

/// Where the planes of two pieces meet.
struct Line {
    /// The point of both planes that is nearest to the small piece's middle.
    on: Point3<f64>,
    /// Along it.
    l: Vector3<f64>,
    /// Across it, in the small piece's plane and to where that lies.
    u: Vector3<f64>,
    /// Between the planes, rad.
    angle: f64,
}

impl Line {
    fn of(small: &Superpoint, large: &Superpoint) -> Option<Self> {
        let angle = small.normal.dot(&large.normal).abs().min(1.0).acos();
        if !(LEAST..MOST).contains(&angle) {
            return None;
        }
        let l = small.normal.cross(&large.normal).normalize();
        let u = l.cross(&small.normal);
        let deep = (large.center - small.center).dot(&large.normal);
        let on = small.center + u * (deep / u.dot(&large.normal));
        let u = if (small.center - on).dot(&u) < 0.0 { -u } else { u };
        Some(Self { on, l, u, angle })
    }

    /// The points of both pieces about it, as far as the small one reaches along it, by their places across it; none where either has none there.
    fn near(&self, cloud: &[Point3<f64>], small: &Superpoint, large: &Superpoint, noise: f64) -> Option<Vec<Near>> {
        let along = |p: &Point3<f64>| (p - self.on).dot(&self.l);
        let mut ends: Vec<f64> = small.points.iter().map(|i| along(&cloud[*i as usize])).collect();
        ends.sort_by(f64::total_cmp);
        let cut = (ends.len() as f64 * ENDS) as usize;
        let (low, high) = (*ends.get(cut)?, *ends.get(ends.len() - 1 - cut)?);
        // Beyond this the planes are told apart by single points.
        let reach = TOLD * noise / self.angle;
        let near = |point: &u32| {
            let p = &cloud[*point as usize];
            let u = (p - self.on).dot(&self.u);
            let [to_small, to_large] = [small, large].map(|s| ((p - s.center).dot(&s.normal) / noise).powi(2));
            let is_near = u.abs() < reach && (low..high).contains(&along(p)) && to_small.min(to_large) < FAR * FAR;
            is_near.then_some(Near { u, to_small: to_small.min(FAR * FAR), to_large: to_large.min(FAR * FAR), point: *point })
        };
        let of = |piece: &Superpoint| piece.points.iter().filter_map(near).collect::<Vec<_>>();
        let (mut all, of_large) = (of(small), of(large));
        if all.is_empty() || of_large.is_empty() || all.len() + of_large.len() < 2 * FEW {
            return None;
        }
        all.extend(of_large);
        all.sort_by(|a, b| a.u.total_cmp(&b.u));
        Some(all)
    }
}

/// How many of some points, by their places across the line, follow the large piece's plane before the rest follow the small one's; none where
/// one plane does for all.
fn change(all: &[Near]) -> Option<usize> {
    // What is paid if all below k follow the large plane and all from k on the small one; it starts with all on the small one.
    let on_small: f64 = all.iter().map(|x| x.to_small).sum();
    let line = all.partition_point(|x| x.u < 0.0);
    let mut paid = on_small;
    let (mut least, mut change, mut at_line) = (paid, 0, paid);
    for (k, x) in all.iter().enumerate() {
        paid += x.to_large - x.to_small;
        if paid < least {
            (least, change) = (paid, k + 1);
        }
        if k + 1 == line {
            at_line = paid;
        }
    }
    let on_large = paid;
    if on_small.min(on_large) - least < SAVED {
        return None;
    }
    // About the line itself both planes are the same: there the points say nothing, and pieces that meet at it are parted by it.
    Some(if at_line - least < SAVED { line } else { change })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use sagci_furniture::Random;

    use super::*;

    /// A wall in x = 0 and a leaf that turns out of it about z at y = 0 by an angle, each of so many points a metre, with a camera's noise; and to
    /// which of both each point belongs.
    fn ajar(angle: f64, noise: f64) -> (Vec<Point3<f64>>, Vec<bool>) {
        let random = &mut Random::new(1, "ajar");
        let mut points = Vec::new();
        let mut of_leaf = Vec::new();
        for k in 0..6000 {
            let leaf = k % 2 == 0;
            let (along, z) = (random.between(0.0, 0.8), random.between(0.0, 2.0));
            let (sin, cos) = angle.sin_cos();
            let [x, y] = if leaf { [along * sin, along * cos] } else { [0.0, -along] };
            points.push(Point3::new(x + random.normal() * noise, y, z));
            of_leaf.push(leaf);
        }
        (points, of_leaf)
    }

    /// Growing gives to the wall what is within its noise: of a leaf that is ajar by 4 degrees the third that is next to the hinge.
    #[test]
    fn a_leaf_keeps_what_lies_next_to_its_hinge() {
        let noise = 0.005;
        for angle in [0.07, 0.15, 0.3] {
            let (points, of_leaf) = ajar(angle, noise);
            let grown = |leaf: bool| {
                let own = (0..points.len() as u32).filter(|i| (points[*i as usize].x.abs() > 3.0 * noise) == leaf);
                Superpoint::of(own.collect(), &points, true)
            };
            let mut pieces = [grown(false), grown(true)];
            let wrong = |pieces: &[Superpoint; 2]| {
                let wrong = |k: usize| pieces[k].points.iter().filter(|i| of_leaf[**i as usize] != (k == 1)).count();
                wrong(0) + wrong(1)
            };
            let before = wrong(&pieces);
            part(&points, &mut pieces, Scale { spacing: 0.02, noise });
            let after = wrong(&pieces);
            assert!(after * 4 < before, "at {angle} rad {after} points lie in the wrong piece, before {before}");
        }
    }

    /// Where planes meet far from both pieces nothing changes hands.
    #[test]
    fn pieces_that_do_not_meet_stay_as_they_are() {
        let (points, of_leaf) = ajar(0.1, 0.002);
        let apart: Vec<u32> = (0..points.len() as u32).filter(|i| points[*i as usize].y.abs() > 0.3).collect();
        let [wall, leaf] = [false, true].map(|l| apart.iter().copied().filter(|i| of_leaf[*i as usize] == l).collect::<Vec<u32>>());
        let mut pieces = [wall.clone(), leaf.clone()].map(|p| Superpoint::of(p, &points, true));
        part(&points, &mut pieces, Scale { spacing: 0.02, noise: 0.002 });
        assert_eq!(pieces.map(|p| p.points), [wall, leaf]);
    }
}
