//! One answer against its truth.

use nalgebra::{Point3, Vector3};
use sagci_furniture::{Category, Kind};

use super::{Case, angle};

/// A joint of an answer, in the frame of the cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct AnsweredJoint {
    /// Number of the part that it moves.
    pub part: i32,
    /// Does it slide?
    pub slides: bool,
    /// Its axis.
    pub axis: Vector3<f64>,
    /// A point on the axis, m.
    pub origin: Point3<f64>,
}

/// What is answered about a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct CloudAnswer {
    /// Part of each point, 0 the body; -1 where it is none.
    pub part: Vec<i32>,
    /// Confidence of each part, the body first.
    pub confidence: Vec<f64>,
    /// Joints of parts.
    pub joints: Vec<AnsweredJoint>,
}

/// How far open a part was.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Opening {
    Shut,
    Ajar,
    Open,
}

/// One true moving part.
#[derive(Debug, Clone)]
pub(crate) struct PartScore {
    pub(crate) opening: Opening,
    /// Overlap with the part that fits best.
    pub(crate) overlap: f64,
    /// Of a found part: is the type right, and the errors: rad, then m line to line and origin to line.
    pub(crate) type_right: Option<bool>,
    pub(crate) axis: Option<f64>,
    pub(crate) place: Option<[f64; 2]>,
    pub(crate) whole: bool,
}

/// One predicted mask, by each threshold of overlap: does it fit a true one?
#[derive(Debug, Clone)]
pub(crate) struct Mask {
    pub(crate) confidence: f64,
    pub(crate) moves: bool,
    /// Does the true part that it takes move?
    pub(crate) takes_moving: bool,
    /// Overlap with the true part that it takes.
    pub(crate) overlap: f64,
}

/// One cloud's scores.
#[derive(Debug, Clone)]
pub(crate) struct Scored {
    pub(crate) category: Category,
    pub(crate) line: String,
    pub(crate) diagonal: f64,
    pub(crate) body_overlap: Option<f64>,
    pub(crate) parts: Vec<PartScore>,
    pub(crate) masks: Vec<Mask>,
    pub(crate) false_joints: usize,
    pub(crate) failed: bool,
    pub(crate) seconds: f64,
}

/// Parts below this many points, and this share of the cloud, are not asked for.
const LEAST: usize = 20;
const LEAST_SHARE: f64 = 0.003;

pub(crate) fn score(case: &Case, answer: Result<CloudAnswer, String>, seconds: f64) -> Scored {
    let n = case.object.parts.len();
    let (answer, failure) = match answer {
        Ok(answer) => (answer, None),
        Err(e) => (CloudAnswer { part: vec![-1; case.cloud.points.len()], confidence: Vec::new(), joints: Vec::new() }, Some(e)),
    };
    let m = answer.confidence.len();
    let mut both = vec![0_usize; n * m];
    let (mut of_true, mut of_answer) = (vec![0_usize; n], vec![0_usize; m]);
    for (t, a) in case.cloud.part.iter().zip(&answer.part) {
        let t = usize::try_from(*t).ok().filter(|t| *t < n);
        let a = usize::try_from(*a).ok().filter(|a| *a < m);
        t.into_iter().for_each(|t| of_true[t] += 1);
        a.into_iter().for_each(|a| of_answer[a] += 1);
        if let (Some(t), Some(a)) = (t, a) {
            both[t * m + a] += 1;
        }
    }
    let least = LEAST.max((LEAST_SHARE * case.cloud.points.len() as f64) as usize);
    let asked: Vec<usize> = (0..n).filter(|t| of_true[*t] >= least).collect();
    let overlap = |t: usize, a: usize| {
        let i = both[t * m + a] as f64;
        i / (of_true[t] as f64 + of_answer[a] as f64 - i).max(1.0)
    };
    // Masks take true parts in the order of their confidence.
    let mut order: Vec<usize> = (0..m).filter(|a| of_answer[*a] > 0).collect();
    order.sort_by(|a, b| answer.confidence[*b].total_cmp(&answer.confidence[*a]));
    let mut taken = vec![None; n];
    let mut masks = Vec::new();
    for a in order {
        let best = asked
            .iter()
            .copied()
            .filter(|t| taken[*t].is_none())
            .map(|t| (t, overlap(t, a)))
            .max_by(|x, y| x.1.total_cmp(&y.1))
            .filter(|x| x.1 >= 0.5);
        if let Some((t, _)) = best {
            taken[t] = Some(a);
        }
        // A mask over what is too little to be asked for is neither right nor wrong.
        let ignored = best.is_none() && (0..n).any(|t| !asked.contains(&t) && overlap(t, a) > 0.3);
        if !ignored {
            masks.push(Mask {
                confidence: answer.confidence[a],
                moves: a != 0,
                takes_moving: best.is_some_and(|b| b.0 != 0),
                overlap: best.map_or(0.0, |b| b.1),
            });
        }
    }
    let best_overlap = |t: usize| (0..m).map(|a| overlap(t, a)).fold(0.0, f64::max);
    let mut parts = Vec::new();
    for t in asked.iter().copied().filter(|t| *t > 0) {
        let joint = &case.object.joints[t - 1];
        let share = joint.state / joint.upper.max(1e-9);
        let opening = if share < 0.005 {
            Opening::Shut
        } else if share < 0.2 {
            Opening::Ajar
        } else {
            Opening::Open
        };
        let mut s = PartScore { opening, overlap: best_overlap(t), type_right: None, axis: None, place: None, whole: false };
        let found = taken[t].and_then(|a| answer.joints.iter().find(|j| j.part == a as i32));
        if let Some(found) = found {
            let (axis, origin) = case.cloud.joint(joint);
            let slides = joint.kind == Kind::Prismatic;
            s.type_right = Some(found.slides == slides);
            let off = angle(&axis, &found.axis);
            s.axis = Some(off);
            let mut near = true;
            if !slides && !found.slides {
                let along = found.axis.normalize();
                let d = origin - found.origin;
                let to_line = (d - along * d.dot(&along)).norm();
                let cross = axis.cross(&found.axis);
                // Lines that are all but parallel have no point where they are nearest.
                let between = if cross.norm() < 0.02 { to_line } else { d.dot(&cross.normalize()).abs() };
                s.place = Some([between, to_line]);
                near = to_line < 0.05;
            }
            s.whole = found.slides == slides && off < 5.0_f64.to_radians() && near;
        } else if taken[t].is_some() {
            s.type_right = Some(false);
        }
        parts.push(s);
    }
    let used: Vec<i32> = taken[1..].iter().flatten().map(|a| *a as i32).collect();
    let small = |j: &AnsweredJoint| (1..n).any(|t| !asked.contains(&t) && (j.part as usize) < m && overlap(t, j.part as usize) > 0.3);
    let false_joints = answer.joints.iter().filter(|j| !used.contains(&j.part) && !small(j)).count();
    let mut line = format!("{:44}", case.name);
    match &failure {
        Some(e) => line += &format!(" FAILED: {e}"),
        None => {
            for p in &parts {
                let opening = ["shut", "ajar", "open"][p.opening as usize];
                let verdict = if p.whole { "+" } else { "-" };
                let angle = p.axis.map_or(String::new(), |a| format!(" {:.1}d", a.to_degrees()));
                let place = p.place.map_or(String::new(), |x| format!(" {:.1}cm", 100.0 * x[1]));
                line += &format!("  {verdict}{opening} {:.2}{angle}{place}", p.overlap);
            }
            line += &format!("  false {false_joints}");
        }
    }
    Scored {
        category: case.object.category,
        line,
        diagonal: case.object.diagonal(),
        body_overlap: asked.contains(&0).then(|| best_overlap(0)),
        parts,
        masks,
        false_joints,
        failed: failure.is_some(),
        seconds,
    }
}
