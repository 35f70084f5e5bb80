use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3};

use crate::align::{Aligned, Matching, Stage, align};
use crate::evidence::{Evidence, weigh};
use crate::frame::Frame;
use crate::hypothesis::Hypothesis;
use crate::mount::Mount;
use crate::polish::polish;
use crate::problem::Problem;
use crate::{Freedom, Located, PerceptionError, Request, View};

/// Distance that the coarse search's steps move the surface by, at most about, m.
const STEP: f64 = 0.025;
/// Hypotheses that are refined roughly, and those that are refined fully.
const ROUGH: usize = 24;
const FULL: usize = 6;
/// Of those at one place of the grid, so many at most: the yaws of a round object are all alike, and must not crowd out
/// other places.
const TURNS: usize = 4;
/// Those whose score is at least this share of the best are refined to the end.
const RIVAL: f64 = 0.85;
/// Fewer pixels than this are no evidence.
const LEAST_PIXELS: f64 = 25.0;
/// Less than this share of the surface in sight is too little to look for.
const LEAST_VISIBLE: f64 = 0.06;
/// An object is there if at least this share of what should be seen agrees.
const LEAST_AGREEMENT: f64 = 0.6;
/// A rival's odds fall by e for each such share of the best score that it lacks. Pixels are not independent, and the
/// stored geometry is not exact, so that counting every pixel would be overconfident.
const ODDS: f64 = 0.02;

/// Finds one object in the images.
///
/// `table_height` is the height of the surface that things stand on, m; points on it are left out.
///
/// # Errors
/// [`PerceptionError::NotVisible`] if the place is hidden, [`PerceptionError::NotFound`] if it is seen and nothing there
/// looks like the object, [`PerceptionError::Request`] or [`PerceptionError::Image`] if the input cannot be used.
pub fn locate(views: &[View], table_height: f64, request: &Request<'_>) -> Result<Located, PerceptionError> {
    let (frames, mount) = frames(views, table_height)?;
    Ok(locate_in(&frames, &mount, request)?.0)
}

/// Checks and prepares all images.
pub(crate) fn frames(views: &[View], table_height: f64) -> Result<(Vec<Frame>, Mount), PerceptionError> {
    if views.is_empty() {
        return Err(PerceptionError::Image { time: 0.0, message: "there is none; take at least one".into() });
    }
    let mut frames = views.iter().map(Frame::new).collect::<Result<Vec<_>, _>>()?;
    let mount = Mount::by_table(&mut frames, table_height);
    frames.iter_mut().for_each(|f| f.drop_table(table_height));
    Ok((frames, mount))
}

/// The same with prepared images; also the poses of the links, and the distance within which points are explained.
pub(crate) fn locate_in(frames: &[Frame], mount: &Mount, request: &Request<'_>) -> Result<(Located, Explained), PerceptionError> {
    let problem = Problem::new(request, frames, mount)?;
    let grid = candidates(&problem);
    let shares: Vec<f64> = grid.iter().map(|h| problem.seen_through(h, STEP, &[]).1).collect();
    let best_visible_share = shares.iter().copied().fold(0.0, f64::max);
    let hidden_share = shares.iter().filter(|s| **s < LEAST_VISIBLE).count() as f64 / shares.len().max(1) as f64;
    let name = || request.name.to_owned();
    let not_visible = || PerceptionError::NotVisible { object: name(), hidden_share, best_visible_share };
    if best_visible_share < LEAST_VISIBLE {
        return Err(not_visible());
    }

    let mut found = refine(&problem, grid);
    found.sort_by(|a, b| b.1.score().total_cmp(&a.1.score()));
    let Some((best, evidence)) = found.first() else { return Err(not_visible()) };
    if evidence.agree < LEAST_PIXELS || evidence.inlier_share() < LEAST_AGREEMENT {
        // It may stand where it cannot be seen.
        return Err(if hidden_share > 0.2 {
            not_visible()
        } else {
            PerceptionError::NotFound { object: name(), inlier_share: evidence.inlier_share(), violated_share: evidence.violated_share() }
        });
    }
    let (covariance, rivals) = spread(&problem, &found);
    let mut pose = Matrix6::zeros();
    pose.copy_from(&covariance.view((0, 0), (6, 6)));
    let mut q_deviation = vec![0.0; best.hypothesis.q.len()];
    for (k, joint) in request.joints.iter().enumerate() {
        if let Some(d) = q_deviation.get_mut(joint.slot) {
            *d = covariance[(6 + k, 6 + k)].max(0.0).sqrt();
        }
    }
    let located = Located {
        X_WO: best.hypothesis.X_WO,
        q: best.hypothesis.q.clone(),
        covariance: pose,
        q_deviation,
        residual_rms: best.rms,
        inlier_share: evidence.inlier_share(),
        violated_share: evidence.violated_share(),
        visible_share: evidence.visible_share(),
        pixels: evidence.agree as usize,
        rivals,
    };
    let explained = Explained {
        X_WL: problem.placed(&best.hypothesis).X_WL,
        within: (3.5 * best.rms).max(0.008),
        surface: problem.surface,
        X_CD: best.hypothesis.X_CD,
        mount: after(&best.information),
    };
    Ok((located, explained))
}

/// The surface that explains points.
pub(crate) struct Explained {
    /// Where the camera was found to be against where it was said to be.
    pub X_CD: Isometry3<f64>,
    /// What is known of it now.
    pub mount: Option<Mount>,
    surface: crate::surface::Surface,
    X_WL: Vec<Isometry3<f64>>,
    within: f64,
}

impl Explained {
    /// Does a point lie on the surface?
    pub fn covers(&self, point: &Point3<f64>) -> bool {
        self.surface.is_near(&self.X_WL, point, self.within)
    }
}

/// What is left known of the camera when all else is eliminated.
fn after(information: &DMatrix<f64>) -> Option<Mount> {
    let covariance = information.clone().try_inverse()?;
    let at = covariance.nrows() - 6;
    let mut own = Matrix6::zeros();
    own.copy_from(&covariance.view((at, at), (6, 6)));
    Some(Mount { information: own.try_inverse()? })
}

/// The grid over the prior. Where joints are estimated as well as the pose, the pose is scanned with the links that stay
/// put, and the joints from the best poses.
fn candidates(problem: &Problem<'_>) -> Vec<Hypothesis> {
    let poses = pose_grid(problem);
    if problem.request.joints.is_empty() {
        return poses;
    }
    let poses = if poses.len() > 1 {
        let moved = moved_links(problem);
        best_of(problem, poses, &moved, ROUGH / 2)
    } else {
        poses
    };
    let mut grid = poses;
    for joint in &problem.request.joints {
        let lever = lever(problem, joint.slot);
        let count = ((joint.upper - joint.lower) * lever / STEP).ceil().clamp(1.0, 120.0) as usize;
        grid = grid
            .iter()
            .flat_map(|h| {
                (0..=count).map(|i| {
                    let mut h = h.clone();
                    if let Some(q) = h.q.get_mut(joint.slot) {
                        *q = joint.lower + (joint.upper - joint.lower) * i as f64 / count as f64;
                    }
                    h
                })
            })
            .collect();
        // Two joints at full resolution, from there on the best only.
        if grid.len() > 5000 {
            grid = best_of(problem, grid, &[], 200);
        }
    }
    grid
}

fn pose_grid(problem: &Problem<'_>) -> Vec<Hypothesis> {
    if problem.request.freedom == Freedom::Held {
        return vec![problem.start.clone()];
    }
    let steps = |half_width: f64, step: f64| -> Vec<f64> {
        let count = (half_width / step).ceil() as i64;
        (-count..=count).map(|i| if count == 0 { 0.0 } else { half_width * i as f64 / count as f64 }).collect()
    };
    let [x, y, yaw] = problem.reach;
    // Far parts of a large object move by the step when it turns.
    let turn_step = (STEP / problem.radius).clamp(0.06, 0.26);
    let mut turns = steps(yaw, turn_step);
    if yaw >= std::f64::consts::PI {
        turns.pop();
    }
    let axes = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), problem.yaw);
    let mut grid = Vec::new();
    for &dx in &steps(x, STEP) {
        for &dy in &steps(y, STEP) {
            let shift = axes * Vector3::new(dx, dy, 0.0);
            for &turn in &turns {
                let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
                let X_WO = Isometry3::from_parts(
                    Translation3::from(problem.start.X_WO.translation.vector + shift),
                    turn * problem.start.X_WO.rotation,
                );
                grid.push(Hypothesis { X_WO, q: problem.start.q.clone(), X_CD: problem.start.X_CD });
            }
        }
    }
    grid
}

/// Which links the searched joints move.
fn moved_links(problem: &Problem<'_>) -> Vec<bool> {
    let a = problem.placed(&problem.start).X_WL;
    let mut moved = vec![false; a.len()];
    for joint in &problem.request.joints {
        let mut h = problem.start.clone();
        if let Some(q) = h.q.get_mut(joint.slot) {
            *q += 0.1;
        }
        for (flag, (x, y)) in moved.iter_mut().zip(a.iter().zip(&problem.placed(&h).X_WL)) {
            *flag |= (x.to_matrix() - y.to_matrix()).norm() > 1e-9;
        }
    }
    // An object that moves as a whole has nothing that stays put.
    let seen_still = moved.iter().zip(&problem.coarse.grids).any(|(m, g)| !m && g.samples.len() > 50);
    if seen_still { moved } else { Vec::new() }
}

/// Greatest motion of the surface for a unit of a joint.
fn lever(problem: &Problem<'_>, slot: usize) -> f64 {
    let mut h = problem.start.clone();
    if let Some(q) = h.q.get_mut(slot) {
        *q += 1e-3;
    }
    let (a, b) = (problem.placed(&problem.start).X_WL, problem.placed(&h).X_WL);
    let motion = problem.surface.corners().map(|(l, p)| (a[l] * p - b[l] * p).norm()).fold(0.0, f64::max);
    (motion / 1e-3).max(0.05)
}

/// The best by score, best first.
fn best_of(problem: &Problem<'_>, hypotheses: Vec<Hypothesis>, skip: &[bool], count: usize) -> Vec<Hypothesis> {
    let mut scored: Vec<(f64, Hypothesis)> = hypotheses.into_iter().map(|h| (problem.score(&h, STEP * 1.4, skip), h)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(count);
    scored.into_iter().map(|(_, h)| h).collect()
}

/// From the grid to fully refined hypotheses with what the images say about each.
fn refine(problem: &Problem<'_>, grid: Vec<Hypothesis>) -> Vec<(Aligned, Evidence)> {
    let rough_stages =
        [Stage { radius: 0.05, rounds: 6, matching: Matching::Thinned }, Stage { radius: 0.02, rounds: 6, matching: Matching::Thinned }];
    let near_stages = [Stage { radius: 0.02, rounds: 6, matching: Matching::Nearest }];
    let ray_stages = [Stage { radius: 0.015, rounds: 8, matching: Matching::Rays }];
    let mut rough: Vec<(f64, Hypothesis)> = spread_out(best_of(problem, grid, &[], usize::MAX))
        .iter()
        .map(|h| {
            let h = align(problem, h, &rough_stages).hypothesis;
            (problem.score(&h, 0.012, &[]), h)
        })
        .collect();
    rough.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<Hypothesis> = Vec::new();
    for (_, h) in rough {
        if kept.len() < FULL && kept.iter().all(|k| distinct(problem, k, &h)) {
            kept.push(h);
        }
    }
    let near: Vec<(Hypothesis, Evidence)> = kept
        .iter()
        .map(|h| {
            let h = align(problem, h, &near_stages).hypothesis;
            let evidence = weigh(problem, &h);
            (h, evidence)
        })
        .collect();
    let best = near.iter().map(|(_, e)| e.score()).fold(0.0, f64::max);
    near.into_iter()
        .filter(|(_, e)| e.score() >= RIVAL * best)
        .map(|(h, _)| {
            let mut aligned = align(problem, &h, &ray_stages);
            polish(problem, &mut aligned);
            let evidence = weigh(problem, &aligned.hypothesis);
            (aligned, evidence)
        })
        .collect()
}

/// The first hypotheses, with no more than a few from one place.
fn spread_out(sorted: Vec<Hypothesis>) -> Vec<Hypothesis> {
    let mut kept: Vec<Hypothesis> = Vec::with_capacity(ROUGH);
    for h in sorted {
        let here = |k: &&Hypothesis| (k.X_WO.translation.vector - h.X_WO.translation.vector).norm() < 0.5 * STEP && k.q == h.q;
        if kept.len() < ROUGH && kept.iter().filter(here).count() < TURNS {
            kept.push(h);
        }
    }
    kept
}

fn distinct(problem: &Problem<'_>, a: &Hypothesis, b: &Hypothesis) -> bool {
    let d = a.difference(b, &problem.request.joints);
    let turned = d.rows(0, 3).norm() * problem.radius.max(0.05);
    let joints = problem.request.joints.iter().enumerate().map(|(k, j)| d[6 + k].abs() * lever(problem, j.slot)).fold(0.0, f64::max);
    turned.max(d.rows(3, 3).norm()).max(joints) > 0.006
}

/// Covariance of the mixture of all rivals about the best, and their number.
fn spread(problem: &Problem<'_>, found: &[(Aligned, Evidence)]) -> (DMatrix<f64>, usize) {
    let size = 12 + problem.request.joints.len();
    let mut covariance = DMatrix::zeros(size, size);
    let (mut total, mut rivals) = (0.0, 0);
    let Some((best, top)) = found.first() else { return (covariance, 0) };
    for (aligned, evidence) in found {
        let odds = (-(top.score() - evidence.score()) / (ODDS * top.score()).max(3.0)).exp();
        let own = aligned.information.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(size, size));
        let d = aligned.hypothesis.difference(&best.hypothesis, &problem.request.joints);
        if odds > 0.1 && (rivals == 0 || distinct(problem, &aligned.hypothesis, &best.hypothesis)) {
            rivals += 1;
        }
        covariance += (own + &d * d.transpose()) * odds;
        total += odds;
    }
    (covariance / total, rivals)
}
