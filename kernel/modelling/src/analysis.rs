//! The geometry of a cloud, before anything is decided: the object's points in the frame of its box, and their superpoints.

use std::borrow::Cow;
use std::sync::Arc;

use nalgebra::{Point3, Rotation3, Vector3};

use crate::background::Walls;
use crate::grid::Grid;
use crate::prepare::Thinned;
use crate::superpoint::{Regions, Scale, Superpoint};
use crate::{ModellingError, around, background, frame, ground, normal, prepare};

/// What is known of a cloud by geometry alone.
#[derive(Clone)]
pub struct Analysis {
    /// The object's thinned points in A, m.
    pub(crate) points: Vec<Point3<f64>>,
    /// Of each point the unit normal of the surface about it, in A; its sign means nothing. Zero where that is not known.
    pub(crate) normals: Vec<Vector3<f64>>,
    /// From W's axes to A's; both have the same origin.
    pub(crate) R_AW: Rotation3<f64>,
    /// Pieces, largest first.
    pub(crate) superpoints: Vec<Superpoint>,
    /// Of each point its piece.
    pub(crate) piece: Vec<Option<u32>>,
    /// The object's points as they came, in W, m, and of each the thinned point that stands for it: more of them show finer seams.
    pub(crate) dense: Arc<Vec<(Point3<f64>, u32)>>,
    /// Of each input point, the point of the object that stands for it; none for the surroundings.
    pub(crate) of_input: Vec<Option<u32>>,
    /// How fine the cloud is.
    pub(crate) scale: Scale,
    /// Least and greatest corner of the object in A, without its outermost points, m.
    pub(crate) low: Point3<f64>,
    /// The greatest.
    pub(crate) high: Point3<f64>,
    /// What is worth telling a person.
    pub(crate) notes: Vec<String>,
    /// What the input's lengths were multiplied by to get metres.
    pub(crate) factor: f64,
}

/// Looks at a cloud in the world's frame: once for each yaw that the object's walls may have, the likeliest first.
///
/// Errors: as [`crate::perceive()`].
pub fn analyse(input: &[Point3<f64>]) -> Result<Vec<Analysis>, ModellingError> {
    let unit = prepare::Unit::of(input)?;
    let mut notes = Vec::new();
    if unit.factor != 1.0 {
        let name = if unit.factor < 5e-3 { "millimetres" } else { "centimetres" };
        notes.push(format!("the cloud seems to be in {name}: it was multiplied by {}", unit.factor));
    }
    if unit.finite < input.len() {
        notes.push(format!("{} of {} points are not numbers", input.len() - unit.finite, input.len()));
    }
    let mut cloud = Cow::Borrowed(input);
    if unit.factor != 1.0 {
        cloud = Cow::Owned(input.iter().map(|p| p * unit.factor).collect());
    }
    let mut walls: Option<Walls> = None;
    for crop in 0.. {
        let cells = prepare::in_cells(&cloud)?;
        let local = Surface::of(&cells).local;
        walls = background::walls(&cells, &local, walls.as_ref());
        let before = walls.as_ref().map(|w| w.before.as_slice());
        if crop < CROPS
            && let Some(near) = around::near(&cells, &local, before)
        {
            cut(&mut cloud, &cells.of_input, &near);
            continue;
        }
        if let Some(before) = before {
            notes.push("a wall behind the object was left out".to_owned());
            cut(&mut cloud, &cells.of_input, before);
        }
        break;
    }
    let mut thinned = prepare::thin(&cloud)?;
    let mut surface = Surface::of(&thinned);
    // A floor, and the table that stands on it.
    for _ in 0..2 {
        let cleared = ground::clear(&thinned.points, &surface.local, thinned.cell);
        let Some(z) = cleared.support else { break };
        notes.push(format!("a level surface at a height of {z:.3} m was left out: the object stands on it"));
        cut(&mut cloud, &thinned.of_input, &cleared.object);
        thinned = prepare::thin(&cloud)?;
        surface = Surface::of(&thinned);
    }
    if unit.finite > MANY {
        notes.push(format!("{} points were thinned to {}, one in {:.1} mm", unit.finite, thinned.points.len(), 1e3 * thinned.cell));
    }
    let mut all = look_at(&cloud, thinned, surface, notes)?;
    all.iter_mut().for_each(|a| a.factor = unit.factor);
    Ok(all)
}

/// How often surroundings are cropped: each time what is left is looked at more finely.
const CROPS: usize = 3;
/// Of more points it is told how they were thinned.
const MANY: usize = 500_000;

/// Cuts the points off a cloud whose thinned point is not kept: in their places are no numbers. What is left may be much smaller, so it is to be
/// thinned anew.
fn cut(cloud: &mut Cow<'_, [Point3<f64>]>, of_input: &[Option<u32>], kept: &[bool]) {
    let nowhere = Point3::from(Vector3::repeat(f64::NAN));
    for (p, of) in cloud.to_mut().iter_mut().zip(of_input) {
        if !of.is_some_and(|k| kept[k as usize]) {
            *p = nowhere;
        }
    }
}

/// The normals of a thinned cloud, and how far and how fine it is.
struct Surface {
    diagonal: f64,
    spacing: f64,
    local: Vec<normal::Local>,
}

impl Surface {
    fn of(thinned: &Thinned) -> Self {
        let (low, high) = bounds(&thinned.points);
        let diagonal = (high - low).norm();
        let spacing = spacing(&thinned.points, diagonal).max(thinned.cell);
        let radius = (2.6 * spacing).max(0.008).max(0.012 * diagonal);
        let grid = Grid::new(&thinned.points, radius);
        Self { diagonal, spacing, local: normal::normals(&thinned.points, &grid, radius) }
    }
}

/// The same of a cloud without surroundings.
fn look_at(input: &[Point3<f64>], thinned: Thinned, surface: Surface, mut notes: Vec<String>) -> Result<Vec<Analysis>, ModellingError> {
    let Surface { diagonal, spacing, local } = surface;
    let mut object = vec![true; thinned.points.len()];
    notes.extend(ground::one_object(&thinned.points, &mut object, diagonal)?);
    let kept: Vec<usize> = (0..thinned.points.len()).filter(|i| object[*i]).collect();
    if kept.len() < prepare::LEAST {
        return Err(ModellingError::TooFew { finite: kept.len(), total: input.len(), least: prepare::LEAST });
    }
    let local: Vec<normal::Local> = kept.iter().map(|i| local[*i]).collect();
    let noise = noise(&local);
    let scale = Scale { spacing, noise };
    let world: Vec<Point3<f64>> = kept.iter().map(|i| thinned.points[*i]).collect();
    if prepare::is_sheet(&world, &local) {
        return Err(ModellingError::Flat { shape: "in a plane, but for the camera's noise" });
    }
    let regions = Regions::grown(&world, &local, scale);
    let mut new_index = vec![None; thinned.points.len()];
    kept.iter().enumerate().for_each(|(new, old)| new_index[*old] = Some(new as u32));
    let of_input: Vec<Option<u32>> = thinned.of_input.iter().map(|i| i.and_then(|i| new_index[i as usize])).collect();
    let dense = Arc::new(dense(input, &of_input));
    let in_frame = |yaw: f64| {
        let R_AW = frame::upright(yaw);
        let points: Vec<Point3<f64>> = world.iter().map(|p| R_AW * p).collect();
        let normals = local.iter().map(|l| R_AW * l.normal).collect();
        let turned: Vec<(Point3<f64>, u32)> = dense.iter().map(|(p, of)| (R_AW * p, *of)).collect();
        let (superpoints, piece) = regions.superpoints(&points, &turned, scale);
        let (low, high) = bounds(&points);
        let (of_input, notes, dense) = (of_input.clone(), notes.clone(), Arc::clone(&dense));
        Analysis { points, normals, R_AW, superpoints, piece, dense, of_input, scale, low, high, notes, factor: 1.0 }
    };
    Ok(frame::yaws(&world, &local, noise.max(0.002)).into_iter().map(in_frame).collect())
}

/// Most points that seams are looked for among.
const DENSE: usize = 60_000;

/// The object's input points; of very many every so-manieth.
fn dense(input: &[Point3<f64>], of_input: &[Option<u32>]) -> Vec<(Point3<f64>, u32)> {
    let all = of_input.iter().flatten().count();
    let own = input.iter().zip(of_input).filter_map(|(p, of)| of.map(|of| (*p, of)));
    own.step_by(all / DENSE + 1).collect()
}

/// Bounds without the outermost two in a thousand along each axis.
fn bounds(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let mut low = Point3::origin();
    let mut high = Point3::origin();
    for k in 0..3 {
        let mut c: Vec<f64> = points.iter().map(|p| p[k]).collect();
        c.sort_by(f64::total_cmp);
        let cut = c.len() / 500;
        low[k] = c.get(cut).copied().unwrap_or_default();
        high[k] = c.get(c.len().saturating_sub(1 + cut)).copied().unwrap_or_default();
    }
    (low, high)
}

/// Median distance to the sixth neighbour, m, over some points.
fn spacing(points: &[Point3<f64>], diagonal: f64) -> f64 {
    // A first guess: the points as if spread over the sides of a box.
    let mut radius = 2.0 * diagonal / (points.len() as f64).sqrt();
    let step = (points.len() / 400).max(1);
    for _ in 0..6 {
        let grid = Grid::new(points, radius);
        let mut distances = Vec::new();
        let mut tried = 0;
        for p in points.iter().step_by(step) {
            let mut near = Vec::new();
            grid.near(p, radius, |_, d| near.push(d));
            tried += 1;
            if near.len() > 6 {
                near.sort_by(f64::total_cmp);
                distances.push(near[6].sqrt());
            }
        }
        if distances.len() * 4 > tried * 3 {
            distances.sort_by(f64::total_cmp);
            return distances[distances.len() / 2];
        }
        radius *= 1.6;
    }
    radius
}

/// RMS residual of what is flat: the lower third of all residuals.
fn noise(local: &[normal::Local]) -> f64 {
    let mut residuals: Vec<f64> = local.iter().map(|l| l.residual).filter(|r| r.is_finite()).collect();
    if residuals.is_empty() {
        return 0.0;
    }
    residuals.sort_by(f64::total_cmp);
    residuals[residuals.len() / 3]
}

impl Analysis {
    /// Number of superpoints.
    pub fn pieces(&self) -> usize {
        self.superpoints.len()
    }

    /// Of each input point, is it the object's? What is not is a wall's, a floor's or a crumb's.
    pub fn object_points(&self) -> Vec<bool> {
        self.of_input.iter().map(Option::is_some).collect()
    }

    /// Share of the object's points that lie on walls, whichever way these stand.
    pub fn walled(&self) -> f64 {
        crate::wall::walled(&self.superpoints, &self.points)
    }

    /// What is worth telling a person.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Of each input point the superpoint that holds it.
    pub fn piece_of_input(&self) -> Vec<Option<u32>> {
        self.of_input.iter().map(|i| i.and_then(|i| self.piece[i as usize])).collect()
    }
}
