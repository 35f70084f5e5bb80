//! One object, its prior, and the pixels that may belong to it: what a hypothesis is scored and refined against.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Isometry3, Point3, UnitQuaternion, Vector3};

use crate::frame::{Frame, Pixel};
use crate::hypothesis::{Hypothesis, Placed};
use crate::mount::Mount;
use crate::surface::{SampleGrid, Surface};
use crate::{Freedom, PerceptionError, Prior, Request};

/// Number of samples of the coarse surface, and of the fine one.
const COARSE_SAMPLES: f64 = 1200.0;
const FINE_SAMPLES: f64 = 20000.0;
/// Number of points that the thinned cloud aims at.
const THINNED_POINTS: f64 = 400.0;
/// Standard deviation of the height at which a standing object is expected, m: the table and the model are true to this.
const STANDING_HEIGHT: f64 = 0.003;

/// A point of the thinned cloud.
pub(crate) struct Thinned {
    pub point: Point3<f64>,
    pub normal: Vector3<f64>,
    /// How many pixels it stands for.
    pub weight: f64,
}

/// The surface at one resolution.
pub(crate) struct Resolution {
    /// One for each link.
    pub grids: Vec<SampleGrid>,
    /// Mean distance of neighbouring samples, m.
    pub spacing: f64,
}

/// Everything about one question.
pub(crate) struct Problem<'a> {
    pub request: &'a Request<'a>,
    pub frames: &'a [Frame],
    pub surface: Surface,
    pub coarse: Resolution,
    pub fine: Resolution,
    pub thinned: Vec<Thinned>,
    /// The pixels within reach of the prior: frame and place in its `pixels`.
    pub pixels: Vec<(usize, usize)>,
    /// Centre of the prior.
    pub start: Hypothesis,
    /// Which parameters may move.
    pub free: Vec<usize>,
    /// Inverse covariance of the parameters about `start`, before anything is seen.
    pub prior_information: DMatrix<f64>,
    /// Half extents of the search in the prior's own axes x and y, m, and in yaw, rad.
    pub reach: [f64; 3],
    /// Yaw of the prior's own axes.
    pub yaw: f64,
    /// Radius of the sphere about the object's origin that holds it, m.
    pub radius: f64,
}

/// A point of the cloud on the surface.
pub(crate) struct Match {
    pub link: usize,
    /// Surface point and normal in the world.
    pub point: Point3<f64>,
    pub normal: Vector3<f64>,
    /// Signed distance of the cloud's point along the normal, m.
    pub along: f64,
    /// Vector from the surface point to the cloud's, less its part along the normal, m.
    pub across: Vector3<f64>,
}

impl<'a> Problem<'a> {
    /// Checks a request and gathers what it needs.
    pub fn new(request: &'a Request<'a>, frames: &'a [Frame], mount: &Mount) -> Result<Self, PerceptionError> {
        let refuse = |message: String| PerceptionError::Request { object: request.name.to_owned(), message };
        let moving: Vec<usize> = request.model.moving_joints().collect();
        if request.q.len() != moving.len() {
            return Err(refuse(format!("has {} moving joints, but {} positions are given", moving.len(), request.q.len())));
        }
        if !request.q.iter().all(|q| q.is_finite()) {
            return Err(refuse("a joint position is not a finite number".into()));
        }
        for search in &request.joints {
            let Some(joint) = moving.get(search.slot) else {
                return Err(refuse(format!("joint {} is to be estimated, but it has only {}", search.slot, moving.len())));
            };
            if request.model.joints[*joint].kind.positions() != 1 {
                return Err(refuse(format!("joint '{}' has more than one position to estimate", request.model.joints[*joint].name)));
            }
            if !(search.lower.is_finite() && search.upper.is_finite() && search.lower <= search.upper) {
                return Err(refuse(format!("the range {}..{} of a joint to estimate is not a range", search.lower, search.upper)));
            }
        }
        if request.freedom == Freedom::Held && request.joints.is_empty() {
            return Err(refuse("its pose is held and no joint is to be estimated: nothing is asked".into()));
        }
        let surface = Surface::of(request.model);
        if surface.area <= 0.0 {
            return Err(refuse("has no shape that a camera could see".into()));
        }
        let (X_WO, reach, yaw) = prior_box(request, &surface).map_err(refuse)?;
        let mut q = request.q.clone();
        for s in &request.joints {
            if let Some(position) = q.get_mut(s.slot) {
                *position = position.clamp(s.lower, s.upper);
            }
        }
        let start = Hypothesis { X_WO, q, X_CD: Isometry3::identity() };

        let coarse = Resolution::of(&surface, surface.area / COARSE_SAMPLES, 2.0);
        let fine = Resolution::of(&surface, surface.area / FINE_SAMPLES, 3.0);
        let radius = radius(request, &surface, &start);
        let pose_and_joints = prior_information(request, reach, yaw);
        let camera = pose_and_joints.len();
        let mut prior_information = DMatrix::zeros(camera + 6, camera + 6);
        prior_information.view_mut((0, 0), (camera, camera)).set_diagonal(&pose_and_joints);
        prior_information.view_mut((camera, camera), (6, 6)).copy_from(&mount.information);
        let free = match request.freedom {
            Freedom::Held => 6..6,
            Freedom::Standing => 2..6,
            Freedom::Free => 0..6,
        }
        .chain(6..6 + request.joints.len())
        .collect();

        let center = Point3::from(X_WO.translation.vector);
        let within = radius + reach[0].hypot(reach[1]) + 0.03;
        let mut pixels = Vec::new();
        for (f, frame) in frames.iter().enumerate() {
            pixels.extend(frame.pixels.iter().enumerate().filter(|(_, p)| (p.point - center).norm() < within).map(|(i, _)| (f, i)));
        }
        let voxel = (surface.area / 2.0 / THINNED_POINTS).sqrt().max(0.006);
        let thinned = thin(pixels.iter().map(|(f, i)| &frames[*f].pixels[*i]), voxel);
        Ok(Self { request, frames, surface, coarse, fine, thinned, pixels, start, free, prior_information, reach, yaw, radius })
    }

    /// Where the links are under a hypothesis.
    pub fn placed(&self, hypothesis: &Hypothesis) -> Placed {
        hypothesis.placed(self.request.model, &self.request.joints)
    }

    /// The surface point that a point of the cloud belongs to.
    pub fn matched(
        &self,
        at: &Resolution,
        X_WL: &[Isometry3<f64>],
        skip: &[bool],
        point: &Point3<f64>,
        normal: &Vector3<f64>,
        radius: f64,
    ) -> Option<Match> {
        let mut limit = radius;
        let mut best = None;
        for (link, (grid, X)) in at.grids.iter().zip(X_WL).enumerate() {
            if grid.samples.is_empty() || skip.get(link).copied().unwrap_or(false) {
                continue;
            }
            let (p, n) = (X.inverse_transform_point(point), X.inverse_transform_vector(normal));
            if let Some((sample, d2)) = grid.nearest(&p, &n, limit) {
                limit = d2.sqrt();
                best = Some((link, *sample));
            }
        }
        let (link, sample) = best?;
        let X = &X_WL[link];
        let (s, n) = (X * sample.point, X * sample.normal);
        let d = point - s;
        let along = n.dot(&d);
        Some(Match { link, point: s, normal: n, along, across: d - n * along })
    }

    /// Score of a hypothesis in pixels: those that it explains, less those whose rays went through it. `tolerance` is
    /// the distance at which a point no longer counts. Links that `skip` names are left out.
    pub fn score(&self, hypothesis: &Hypothesis, tolerance: f64, skip: &[bool]) -> f64 {
        let X_WL = self.placed(hypothesis).X_WL;
        let mut score = 0.0;
        for t in &self.thinned {
            if let Some(m) = self.matched(&self.coarse, &X_WL, skip, &t.point, &t.normal, tolerance + self.coarse.spacing) {
                let across = (m.across.norm() - self.coarse.spacing).max(0.0);
                let d2 = m.along * m.along + across * across;
                score += t.weight * (1.0 - d2 / (tolerance * tolerance)).max(0.0);
            }
        }
        score - self.seen_through(hypothesis, tolerance, skip).0
    }

    /// Number of pixels whose rays went through the surface, and the share of its camera-facing surface that is neither
    /// hidden nor outside the images (the best view's).
    pub fn seen_through(&self, hypothesis: &Hypothesis, tolerance: f64, skip: &[bool]) -> (f64, f64) {
        let X_WL = self.placed(hypothesis).X_WL;
        let cell = self.coarse.spacing * self.coarse.spacing;
        let (mut violated, mut best_share) = (0.0, 0.0f64);
        for frame in self.frames {
            let X_DW = hypothesis.X_DW(&frame.X_WC);
            let eye = X_DW.inverse_transform_point(&Point3::origin());
            let (mut facing, mut seen) = (0.0, 0.0);
            for (link, (grid, X)) in self.coarse.grids.iter().zip(&X_WL).enumerate() {
                if skip.get(link).copied().unwrap_or(false) {
                    continue;
                }
                for s in &grid.samples {
                    let (p, n) = (X * s.point, X * s.normal);
                    let to_eye = eye - p;
                    let distance = to_eye.norm();
                    let cos = n.dot(&to_eye) / distance;
                    if cos < 0.05 {
                        continue;
                    }
                    let Some((column, row, z)) = frame.project(&X_DW, &p) else {
                        facing += cell * cos / (distance * distance);
                        continue;
                    };
                    let size = cell * cos / (frame.footprint(z) * frame.footprint(z));
                    facing += cell * cos / (distance * distance);
                    let measured = frame.nearest[row * frame.width + column];
                    if measured <= 0.0 {
                        continue;
                    }
                    let slack = 0.005 + 3.0 * frame.noise * z * z;
                    if z < measured + slack {
                        seen += cell * cos / (distance * distance);
                        violated += size * ((measured - z - slack) / tolerance).clamp(0.0, 1.0);
                    }
                }
            }
            if facing > 0.0 {
                best_share = best_share.max(seen / facing);
            }
        }
        (violated, best_share)
    }
}

impl Resolution {
    fn of(surface: &Surface, cell: f64, cells_per_edge: f64) -> Self {
        let spacing = cell.sqrt();
        let grids = surface.links.iter().map(|l| SampleGrid::new(l.samples(cell), spacing * cells_per_edge)).collect();
        Self { grids, spacing }
    }
}

/// Centre of the prior, its half extents in x, y and yaw, and the yaw of the axes x and y.
fn prior_box(request: &Request<'_>, surface: &Surface) -> Result<(Isometry3<f64>, [f64; 3], f64), String> {
    let finite = |X: &Isometry3<f64>| X.to_matrix().iter().all(|x| x.is_finite());
    match &request.prior {
        Prior::Near { X_WO, shift, yaw } => {
            if !(finite(X_WO) && (0.0..10.0).contains(shift) && (0.0..=std::f64::consts::PI).contains(yaw)) {
                return Err(format!("the prior's pose, shift {shift} m or yaw {yaw} rad is out of range"));
            }
            Ok((*X_WO, [*shift, *shift, *yaw], 0.0))
        }
        Prior::Region { X_WG, size } => {
            if !(finite(X_WG) && size.iter().all(|s| s.is_finite() && *s >= 0.0)) {
                return Err("the prior's region is not a box".into());
            }
            let up = X_WG.rotation * Vector3::z();
            if up.z < 0.9 {
                return Err("the prior's region lies on its side: its z axis must point up".into());
            }
            let yaw = yaw_of(&X_WG.rotation);
            // The object stands upright: its lowest point is on the floor.
            let X_OL = request.model.X_OL(&request.q);
            let (mut least, mut wide) = (f64::INFINITY, 0.0f64);
            for (link, p) in surface.corners() {
                let p = X_OL[link] * p;
                least = least.min(p.z);
                wide = wide.max(p.x.abs().min(p.y.abs()));
            }
            let floor = X_WG * Point3::new(0.0, 0.0, -size[2] / 2.0);
            let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
            let X_WO = Isometry3::from_parts((floor - Vector3::z() * least).coords.into(), rotation);
            Ok((X_WO, [size[0] / 2.0, size[1] / 2.0, std::f64::consts::PI], yaw))
        }
    }
}

fn yaw_of(rotation: &UnitQuaternion<f64>) -> f64 {
    let x = rotation * Vector3::x();
    x.y.atan2(x.x)
}

fn radius(request: &Request<'_>, surface: &Surface, start: &Hypothesis) -> f64 {
    let mut configurations = vec![start.q.clone()];
    for s in &request.joints {
        for k in 0..=4 {
            let mut q = start.q.clone();
            if let Some(position) = q.get_mut(s.slot) {
                *position = s.lower + (s.upper - s.lower) * f64::from(k) / 4.0;
            }
            configurations.push(q);
        }
    }
    configurations
        .iter()
        .map(|q| {
            let X_OL = request.model.X_OL(q);
            surface.corners().map(|(link, p)| (X_OL[link] * p).coords.norm()).fold(0.0, f64::max)
        })
        .fold(0.0, f64::max)
}

/// A uniform prior of half width `h` has variance `h^2 / 3`.
fn prior_information(request: &Request<'_>, reach: [f64; 3], yaw: f64) -> DVector<f64> {
    let of = |half_width: f64| 3.0 / (half_width * half_width).max(1e-8);
    let mut information = DVector::zeros(6 + request.joints.len());
    let tilt = of(if request.freedom == Freedom::Free { reach[2].max(0.2) } else { 0.01 });
    let (sin, cos) = yaw.sin_cos();
    let wide = [(reach[0] * cos).hypot(reach[1] * sin), (reach[0] * sin).hypot(reach[1] * cos)];
    information[0] = tilt;
    information[1] = tilt;
    information[2] = of(reach[2].max(0.01));
    information[3] = of(wide[0].max(0.01));
    information[4] = of(wide[1].max(0.01));
    information[5] = match request.freedom {
        Freedom::Free => of(reach[0].max(reach[1]).max(0.03)),
        _ => 1.0 / (STANDING_HEIGHT * STANDING_HEIGHT),
    };
    for (k, joint) in request.joints.iter().enumerate() {
        information[6 + k] = of(((joint.upper - joint.lower) / 2.0).max(1e-3));
    }
    information
}

fn thin<'p>(pixels: impl Iterator<Item = &'p Pixel>, voxel: f64) -> Vec<Thinned> {
    let mut cells: BTreeMap<[i64; 4], (Vector3<f64>, Vector3<f64>, f64)> = BTreeMap::new();
    for p in pixels {
        let n = p.normal;
        let side = n.iamax() as i64 * 2 + i64::from(n[n.iamax()] > 0.0);
        let key = [(p.point.x / voxel).floor() as i64, (p.point.y / voxel).floor() as i64, (p.point.z / voxel).floor() as i64, side];
        let cell = cells.entry(key).or_insert((Vector3::zeros(), Vector3::zeros(), 0.0));
        cell.0 += p.point.coords;
        cell.1 += n;
        cell.2 += 1.0;
    }
    cells
        .into_values()
        .filter_map(|(point, normal, weight)| {
            let normal = normal.try_normalize(1e-6)?;
            Some(Thinned { point: Point3::from(point / weight), normal, weight })
        })
        .collect()
}
