//! What is learned from: an object drawn, looked at, analysed, and its truth in the network's terms.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::Vector3;
use sagci_furniture::{Category, Class, Family, Kind, Labelled, Look, Noise, Object, Random, STILL, families, look};
use sagci_modelling::network::Matrix;
use sagci_modelling::{FARTHEST, Side, analyse, touching};

/// The network's inputs for one side.
pub struct Inputs {
    /// Of superpoints.
    pub pieces: Matrix,
    /// Of their points.
    pub points: Matrix,
    /// Of pairs; a thing and its mirror image share them.
    pub pairs: Arc<Matrix>,
}

/// A true joint in the network's terms.
pub struct JointTruth {
    /// Which candidate.
    pub candidate: usize,
    /// What is left of the place; none for slides.
    pub residual: Option<[f32; 2]>,
}

/// One object, seen from its front and from a wrong side.
pub struct Lesson {
    /// What kind of object it is.
    pub category: Category,
    /// From the front.
    pub front: Inputs,
    /// From another side.
    pub other: Inputs,
    /// Class of each superpoint.
    pub class: Vec<usize>,
    /// Part of each superpoint.
    pub part: Vec<i32>,
    /// How much each superpoint counts: its share of points, and how pure it is.
    pub weight: Vec<f32>,
    /// Superpoints of each part whose joint is known.
    pub parts: Vec<Vec<usize>>,
    /// Their candidates.
    pub candidates: Matrix,
    /// Their joints.
    pub joints: Vec<JointTruth>,
}

/// Number of a class in the network.
pub fn class_number(class: Class) -> usize {
    match class {
        Class::Body => 0,
        Class::Door => 1,
        Class::Drawer => 2,
        Class::Lid => 3,
        Class::Flap => 4,
    }
}

/// Share of objects that are seen in the dense cloud of many views.
const AROUND: f64 = 0.25;
/// Shares of clouds that are as sparse as any may be, that come of a perfect camera, and of one twice as bad as usual.
const SPARSE: f64 = 0.2;
const PERFECT: f64 = 0.1;
const BAD: f64 = 0.1;

/// The lessons of an index: an object and its mirror image. None where it cannot be analysed (too little of it was seen).
pub fn lesson(seed: u64, index: u64, held_out: bool) -> Vec<Lesson> {
    draw(seed, index, held_out).unwrap_or_default()
}

/// The object of an index, and what is seen of it; with what is left to be drawn.
pub(crate) fn drawn(seed: u64, index: u64, held_out: bool) -> (Object, Labelled, Random) {
    let mut random = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "lesson");
    // Storage furniture varies most, so it is drawn more often.
    let category = match random.index(9) {
        k @ 0..=5 => Category::ALL[k],
        6 => Category::Refrigerator,
        7 => Category::Door,
        _ => Category::Storage,
    };
    // One thing in ten has no moving part.
    let of: Vec<&Family> = match random.chance(0.1) {
        true => STILL.iter().filter(|f| f.held_out == held_out).collect(),
        false => families(category, held_out),
    };
    let often: Vec<&Family> = of.iter().flat_map(|f| std::iter::repeat_n(*f, f.weight)).collect();
    let mut object = often[random.index(often.len())].draw(&mut random);
    // Toys and small household things are made like furniture.
    if random.chance(0.12) {
        object = object.scaled(random.scale(0.25, 0.9));
    }
    let mut how = Look::draw(&mut random);
    // A wrist camera does not see a whole fridge.
    if random.chance(0.12) {
        how.near = random.between(0.35, 0.8);
    }
    // A robot that looks for itself goes around a thing first. From a stream of its own: what the other lessons see does not change.
    let mut around = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "around");
    if around.chance(AROUND) {
        how = Look::around(&mut around);
    }
    // Others' cameras are better, worse, or drawn: from a stream of its own.
    let mut camera = Random::new(seed.wrapping_mul(1_000_003).wrapping_add(index), "camera");
    if camera.chance(SPARSE) {
        how.points = camera.scale(1_500.0, 6_000.0) as usize;
    }
    match camera.unit() {
        x if x < PERFECT => how.noise = Noise::NONE,
        x if x < PERFECT + BAD => how.noise = how.noise.times(2.0),
        _ => {}
    }
    let cloud = look(&object, &how, &mut random);
    (object, cloud, random)
}

fn draw(seed: u64, index: u64, held_out: bool) -> Option<Vec<Lesson>> {
    let (object, cloud, mut random) = drawn(seed, index, held_out);
    let analyses = analyse(&cloud.points).ok()?;
    let out = cloud.X_WF.rotation * Vector3::x();
    let sides: Vec<Vec<Side<'_>>> = analyses.iter().map(|a| (0..4).map(|q| Side::new(a, q)).collect()).collect();
    // The analysis and the side whose front is nearest the true one.
    let along = |a: usize, q: usize| sides[a][q].front().dot(&out);
    let all = || (0..analyses.len()).flat_map(|a| (0..4).map(move |q| (a, q)));
    let (right, best) = all().max_by(|x, y| along(x.0, x.1).total_cmp(&along(y.0, y.1)))?;
    let analysis = &analyses[right];
    let n = analysis.pieces();
    if analyses.iter().any(|a| a.pieces() == 0) {
        return None;
    }
    let mut votes: Vec<BTreeMap<i32, f64>> = vec![BTreeMap::new(); n];
    for (part, piece) in cloud.part.iter().zip(analysis.piece_of_input()) {
        if let Some(piece) = piece {
            *votes[piece as usize].entry(*part).or_default() += 1.0;
        }
    }
    let mut part = Vec::with_capacity(n);
    let mut weight = Vec::with_capacity(n);
    let total: f64 = votes.iter().flat_map(BTreeMap::values).sum();
    for v in &votes {
        let sum: f64 = v.values().sum();
        let best = v.iter().max_by(|a, b| a.1.total_cmp(b.1)).map_or((0, 0.0), |(p, c)| (*p, *c));
        part.push(best.0.max(0));
        let pure = best.1 / sum.max(1.0);
        weight.push((pure * pure * (sum / total * 20.0).sqrt().clamp(0.15, 2.0)) as f32);
    }
    let class: Vec<usize> = part.iter().map(|p| class_number(object.parts[*p as usize].class)).collect();
    // A wrong side: of another yaw, where there is one, as often as of this one.
    let wrong = match analyses.len() > 1 && random.chance(0.5) {
        true => ((right + 1 + random.index(analyses.len() - 1)) % analyses.len(), random.index(4)),
        false => (right, (best + 1 + random.index(3)) % 4),
    };
    let near = touching(analysis);
    let near_wrong = if wrong.0 == right { near.clone() } else { touching(&analyses[wrong.0]) };
    let mut parts = Vec::new();
    let mut truth = Vec::new();
    for joint in &object.joints {
        let own: Vec<usize> = (0..n).filter(|i| part[*i] == joint.part as i32).collect();
        let seen: f64 = own.iter().map(|i| votes[*i].values().sum::<f64>()).sum();
        if seen < 30.0 {
            continue;
        }
        parts.push(own);
        truth.push(joint);
    }
    let inputs = |s: &Side<'_>, touching: &[f64]| {
        let f = s.features(touching);
        Inputs { pieces: f.pieces, points: f.points, pairs: Arc::new(f.pairs) }
    };
    let side = |at: (usize, usize), mirror: bool| {
        let side = Side::new(&analyses[at.0], at.1);
        if mirror { side.mirrored() } else { side }
    };
    let taught = |mirror: bool| {
        let front = side((right, best), mirror);
        let options = front.options(&parts);
        let mut kept = Vec::new();
        let mut joints = Vec::new();
        for (k, joint) in truth.iter().enumerate() {
            let (axis, origin) = cloud.joint(joint);
            let slides = joint.kind == Kind::Prismatic;
            if let Some((candidate, residual)) = front.target(&options, k, slides, &axis, &origin) {
                kept.push(parts[k].clone());
                let residual = (!slides).then(|| residual.map(|x| x.clamp(-FARTHEST, FARTHEST) as f32));
                joints.push(JointTruth { candidate, residual });
            }
        }
        let candidates = front.options(&kept).rows();
        let other = inputs(&side(wrong, mirror), &near_wrong);
        let (class, part, weight) = (class.clone(), part.clone(), weight.clone());
        Lesson { category: object.category, front: inputs(&front, &near), other, class, part, weight, parts: kept, candidates, joints }
    };
    let (one, mut image) = (taught(false), taught(true));
    // Nothing that is told of a pair tells left from right.
    debug_assert!(one.front.pairs.relative_eq(&image.front.pairs, 1e-4, 1e-4));
    image.front.pairs = one.front.pairs.clone();
    image.other.pairs = one.other.pairs.clone();
    Some(vec![one, image])
}
