//! Central differences of `J^T F` for random pairs of shapes, on trees with several kinds of joints.
#![allow(clippy::unwrap_used, clippy::panic)]

use nalgebra::{Isometry3, Unit, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_model::ObjectModel;

use super::*;
use crate::contact::feature::Feature;
use crate::{ContactMaterial, ContactOptions, Grasp, Part, System, Workspace};

fn model(name: &str, geometry: &str) -> ObjectModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("object.urdf");
    let inertial = "<inertial><mass value='1'/><inertia ixx='0.1' ixy='0' ixz='0' iyy='0.1' iyz='0' izz='0.1'/></inertial>";
    let joint = |name: &str, kind: &str, parent: &str, child: &str, more: &str| {
        format!(
            "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><axis xyz='0.6 0 0.8'/>\
             <origin xyz='0.1 -0.2 0.1' rpy='0.3 0.2 -0.4'/><limit lower='-9' upper='9' effort='9' velocity='9'/>{more}</joint>"
        )
    };
    let urdf = format!(
        "<robot name='{name}'><link name='root'>{inertial}</link><link name='arm'>{inertial}</link>\
         <link name='tip'>{inertial}<collision><origin xyz='0.05 0.1 -0.02' rpy='0.1 0.7 -0.2'/><geometry>{geometry}</geometry></collision></link>\
         {}{}</robot>",
        joint("j1", "revolute", "root", "arm", ""),
        joint("j2", "prismatic", "arm", "tip", "<mimic joint='j1' multiplier='0.4' offset='0.1'/>")
    );
    std::fs::write(&path, urdf).unwrap();
    ObjectModel::read_urdf(path).unwrap()
}

struct Bench {
    system: System,
    rigid: Workspace,
    ws: ContactWorkspace,
}

impl Bench {
    /// `J^T F` at fixed contact ids; `None` where the contacts are others than `ids`.
    fn force(&mut self, q: &[f64], v: &[f64], w: &[f64], ids: Option<&[u32]>) -> Option<Vec<f64>> {
        let contacts = self.system.contacts.as_deref().unwrap();
        let multibody = self.system.multibody();
        multibody.set_state(&mut self.rigid, q, v).unwrap();
        self.ws.find(contacts, multibody, &self.rigid, 1e-2);
        if let Some(ids) = ids
            && !self.ws.points.iter().map(|p| &p.found.id).eq(ids)
        {
            return None;
        }
        self.ws.rates(contacts, w);
        self.ws.differentiate();
        let mut out = vec![0.0; w.len()];
        for (active, wrench) in self.ws.active.iter().zip(&self.ws.by_active) {
            let group = &contacts.groups[active.group];
            for (J, c) in self.ws.J[group.start..].iter().zip(&group.columns) {
                out[c.v] += J.dot(&wrench.F);
            }
        }
        Some(out)
    }
}

/// Moves two bodies with the shapes until they touch at random, and gives a state. Stiffness is low, so that depths vary freely.
fn bench(first: &str, second: Option<&str>, grasp: bool, options: &ContactOptions) -> Bench {
    let (a, b) = (model("a", first), second.map(|s| model("b", s)));
    let parts: Vec<Part<'_>> = std::iter::once(Part::floating(&a)).chain(b.iter().map(Part::floating)).collect();
    let mut system = System::new(&parts).unwrap().with_contacts(&parts, *options).unwrap();
    if b.is_none() {
        let n = Unit::new_normalize(Vector3::new(0.2, -0.1, 1.0));
        system.add_ground("ground", Vector3::new(0.0, 0.0, -0.2), n, options.material).unwrap();
    }
    if grasp {
        let link = |n: &str| system.multibody().link(n).unwrap();
        let turn = |x: f64| Isometry3::new(Vector3::new(x, 0.1, -0.05), Vector3::new(0.2, x, 0.1));
        let grasp = Grasp {
            a: link("a/tip"),
            X_AG: turn(0.1),
            b: link("b/arm"),
            X_BH: turn(-0.2),
            stiffness: Vector6::new(3.0, 2.0, 1.0, 50.0, 80.0, 20.0),
            damping: Vector6::new(0.1, 0.2, 0.3, 1.0, 2.0, 3.0),
            limit: [1.0, 10.0],
        };
        system.add_grasp(grasp).unwrap();
    }
    let rigid = system.multibody().workspace();
    let ws = ContactWorkspace::new(system.contacts.as_deref().unwrap(), system.multibody().nv());
    Bench { system, rigid, ws }
}

const SHAPES: [&str; 4] = [
    "<sphere radius='0.2'/>",
    "<capsule radius='0.1' length='0.4'/>",
    "<box size='0.3 0.4 0.25'/>",
    "<cylinder radius='0.15' length='0.3'/>",
];

#[test]
fn dense_blocks_and_the_reverse_form_are_the_differences_of_the_joint_forces() {
    let mut kinds = std::collections::BTreeMap::new();
    let mut rng = Pcg64::seed_from_u64(7);
    let mut switched = (0, 0);
    let mut cases: Vec<(usize, Option<usize>)> = (0..4).flat_map(|i| (i..4).map(move |j| (i, Some(j)))).collect();
    cases.extend((0..4).map(|i| (i, None)));
    for (i, j) in cases {
        // Wide stiction, so that both stuck and sliding points occur.
        for (slip, grasp) in [(10.0, false), (1e-3, j.is_some())] {
            let material = ContactMaterial { stiffness: 2e3, dissipation: 0.3, friction: 0.7 };
            let options = ContactOptions { material, margin: 0.05, slip, share: 0.8 };
            let mut bench = bench(SHAPES[i], j.map(|j| SHAPES[j]), grasp, &options);
            let (nq, n) = (bench.system.multibody().nq(), bench.system.multibody().nv());
            let mut tried = 0;
            for _ in 0..4000 {
                let mut q = vec![0.0; nq];
                bench.system.multibody().neutral_positions(&mut q);
                let turn: Vec<f64> = (0..n).map(|_| rng.random_range(-0.4..0.4)).collect();
                bench.system.multibody().integrate(&mut q, &turn, 1.0).unwrap();
                let v: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
                let w: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
                let Some(_) = bench.force(&q, &v, &w, None) else { continue };
                // Balls must not hold one another's centres, nor boxes be deep in one another: features change at each turn there.
                if bench.ws.points.is_empty() || bench.ws.points.iter().any(|p| p.found.depth > 0.08) {
                    continue;
                }
                let ids: Vec<u32> = bench.ws.points.iter().map(|p| p.found.id).collect();
                let names: Vec<String> = bench
                    .ws
                    .points
                    .iter()
                    .map(|p| match p.found.feature {
                        Feature::Face { motion, of_a, .. } => {
                            format!("face {} {of_a}", format!("{motion:?}").split(' ').next().unwrap_or(""))
                        }
                        Feature::Point { line, of_a, .. } => format!("point {} {of_a}", line.is_some()),
                        Feature::Lines { .. } => "lines".into(),
                        Feature::Rim { .. } => "rim".into(),
                    })
                    .collect();
                let (mut by_q, mut by_v, mut by_w) = (vec![0.0; n * n], vec![0.0; n * n], vec![0.0; n * n]);
                let contacts = bench.system.contacts.as_deref().unwrap();
                bench.ws.add_dense(contacts, &w, &v, |i, k, [q, v, w]| {
                    by_q[i * n + k] += q;
                    by_v[i * n + k] += v;
                    by_w[i * n + k] += w;
                });
                let lambda: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
                let gradient = gradient(&bench, &w, &lambda);
                let size = by_q.iter().chain(&by_v).fold(1e-3, |m: f64, x| m.max(x.abs()));
                let e = 1e-6;
                let mut worst = 0.0_f64;
                let mut same = true;
                for k in 0..n {
                    let mut ends = Vec::new();
                    for sign in [1.0, -1.0] {
                        let mut step = vec![0.0; n];
                        step[k] = sign * e;
                        let mut moved = q.clone();
                        bench.system.multibody().integrate(&mut moved, &step, 1.0).unwrap();
                        let by_q = bench.force(&moved, &v, &w, Some(&ids));
                        let mut faster = v.clone();
                        faster[k] += sign * e;
                        let by_v = bench.force(&q, &faster, &w, Some(&ids));
                        let (Some(by_q), Some(by_v)) = (by_q, by_v) else { continue };
                        ends.push((by_q, by_v));
                    }
                    let [plus, minus] = ends.as_slice() else {
                        same = false;
                        break;
                    };
                    let mut whole = 0.0;
                    for row in 0..n {
                        let (dq, dv) = ((plus.0[row] - minus.0[row]) / (2.0 * e), (plus.1[row] - minus.1[row]) / (2.0 * e));
                        worst = worst.max((dq + by_q[row * n + k]).abs() / size).max((dv + by_v[row * n + k]).abs() / size);
                        whole += lambda[row] * dq;
                    }
                    worst = worst.max((whole - gradient[k]).abs() / size);
                }
                if !same {
                    switched.0 += 1;
                    continue;
                }
                // A corner of the law within the difference shows as an error that does not come from the formula.
                if worst > 1e-6 {
                    switched.1 += 1;
                    assert!(worst < 1e-2 || tried > 200 || near_corner(&bench, slip), "{i} {j:?} {names:?}: {worst:e}");
                }
                for name in names {
                    let entry = kinds.entry(name).or_insert((0, 0));
                    if worst <= 1e-6 { entry.0 += 1 } else { entry.1 += 1 }
                }
                tried += 1;
                if tried == 25 {
                    break;
                }
            }
        }
    }
    println!("{kinds:#?} switched {switched:?}");
    assert!(kinds.len() >= 9, "{kinds:?}");
    for (name, (good, bad)) in kinds {
        assert!(good > 10 * bad && good > 0, "{name}: {good} {bad}");
    }
}

/// Is a point within the difference of a corner of the law?
fn near_corner(bench: &Bench, slip: f64) -> bool {
    bench.ws.points.iter().any(|p| {
        let v_n = p.found.n.dot(&p.v);
        let speed = (p.v - p.found.n * v_n).norm();
        p.found.depth.abs() < 1e-4 || (p.found.depth - 0.8e-2 * v_n).abs() < 1e-4 || (speed - slip).abs() < 1e-4
    })
}

/// The gradient by `q` from the seeds: each joint moves all bodies outward of it, and turns their velocities.
fn gradient(bench: &Bench, w: &[f64], lambda: &[f64]) -> Vec<f64> {
    let multibody = bench.system.multibody();
    let mut seeds = vec![Seed::default(); multibody.bodies.len()];
    bench.ws.reverse(bench.system.contacts.as_deref().unwrap(), lambda, &mut seeds);
    let velocity = |x: &[f64]| {
        let mut V = vec![SpatialVector::zeros(); multibody.bodies.len()];
        for (i, body) in multibody.bodies.iter().enumerate().skip(1) {
            V[i] = V[body.parent];
            for k in 0..body.nv {
                V[i] += bench.rigid.S[body.tree + k] * x[body.v + k];
            }
        }
        V
    };
    let (V, Vl) = (velocity(&bench.rigid.v), velocity(lambda));
    let Vw = velocity(w);
    let mut out = vec![0.0; lambda.len()];
    for (i, seed) in seeds.iter().enumerate().skip(1) {
        let mut at = i;
        while at != 0 {
            let body = &multibody.bodies[at];
            for k in 0..body.nv {
                let S = bench.rigid.S[body.tree + k];
                let turned = |V: &[SpatialVector]| cross_motion(&S, &(V[i] - V[body.parent]));
                out[body.v + k] +=
                    seed.pose.dot(&S) + seed.next.dot(&turned(&Vw)) + seed.old.dot(&turned(&V)) + seed.multiplier.dot(&turned(&Vl));
            }
            at = body.parent;
        }
    }
    out
}

#[test]
fn gradients_by_material_and_by_the_pose_of_shapes_are_the_differences() {
    let mut rng = Pcg64::seed_from_u64(11);
    let mut compared = 0;
    for (i, j) in [(0, Some(2)), (1, Some(1)), (2, Some(2)), (3, None), (2, None), (0, Some(1))] {
        let material = ContactMaterial { stiffness: 2e3, dissipation: 0.3, friction: 0.7 };
        let options = ContactOptions { material, margin: 0.05, slip: 1e-3, share: 0.8 };
        let mut bench = bench(SHAPES[i], j.map(|j| SHAPES[j]), false, &options);
        // Surfaces that differ.
        for (k, g) in bench.system.contacts.as_mut().unwrap().geometries.iter_mut().enumerate() {
            g.material =
                ContactMaterial { stiffness: 2e3 + 1e3 * k as f64, dissipation: 0.3 + 0.2 * k as f64, friction: 0.7 - 0.2 * k as f64 };
        }
        let (nq, n) = (bench.system.multibody().nq(), bench.system.multibody().nv());
        let mut tried = 0;
        for _ in 0..4000 {
            let mut q = vec![0.0; nq];
            bench.system.multibody().neutral_positions(&mut q);
            let turn: Vec<f64> = (0..n).map(|_| rng.random_range(-0.4..0.4)).collect();
            bench.system.multibody().integrate(&mut q, &turn, 1.0).unwrap();
            let [v, w, lambda] = [(); 3].map(|()| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f64>>());
            bench.force(&q, &v, &w, None).unwrap();
            let pushing = bench.ws.by_pair.iter().any(|p| p.F.norm() > 0.0);
            if !pushing || bench.ws.points.iter().any(|p| p.found.depth > 0.08) || near_corner(&bench, 1e-3) {
                continue;
            }
            let ids: Vec<u32> = bench.ws.points.iter().map(|p| p.found.id).collect();
            let mut gradients = vec![([0.0; 3], SpatialVector::zeros()); bench.system.contacts.as_ref().unwrap().geometries.len()];
            {
                let contacts = bench.system.contacts.as_deref().unwrap();
                bench.ws.reverse_parameters(contacts, &lambda, |pair, by, of_a, of_b| {
                    let pair = contacts.pairs[pair];
                    for (own, other, pose) in [(pair.a, pair.b, of_a), (pair.b, pair.a, of_b)] {
                        let chain = contacts.geometries[own].material.between_by_self(&contacts.geometries[other].material);
                        // Rows and columns: stiffness, dissipation, friction.
                        for c in 0..3 {
                            gradients[own].0[c] += by[1] * chain[(0, c)] + by[2] * chain[(1, c)] + by[0] * chain[(2, c)];
                        }
                        gradients[own].1 += pose;
                    }
                });
            }
            let value = |bench: &mut Bench| {
                let force = bench.force(&q, &v, &w, Some(&ids))?;
                Some(force.iter().zip(&lambda).map(|(f, l)| f * l).sum::<f64>())
            };
            let difference = |bench: &mut Bench, change: &dyn Fn(&mut crate::contact::geometry::Geometry, f64), at: usize, e: f64| {
                let mut ends = [0.0; 2];
                for (end, sign) in ends.iter_mut().zip([1.0, -1.0]) {
                    let kept = bench.system.contacts.as_ref().unwrap().geometries[at].clone();
                    change(&mut bench.system.contacts.as_mut().unwrap().geometries[at], sign * e);
                    let found = value(bench);
                    bench.system.contacts.as_mut().unwrap().geometries[at] = kept;
                    *end = found?;
                }
                Some((ends[0] - ends[1]) / (2.0 * e))
            };
            for (at, gradient) in gradients.into_iter().enumerate() {
                let by = [
                    difference(&mut bench, &|g, e| g.material.stiffness += e, at, 1e-2),
                    difference(&mut bench, &|g, e| g.material.dissipation += e, at, 1e-6),
                    difference(&mut bench, &|g, e| g.material.friction += e, at, 1e-6),
                ];
                for (got, expected) in gradient.0.iter().zip(by) {
                    assert!((got - expected.unwrap()).abs() < 1e-6 * (1.0 + got.abs()), "{i} {j:?}: {got} {expected:?}");
                }
                let body = bench.system.contacts.as_ref().unwrap().geometries[at].body;
                let (R, p) = (bench.rigid.R_WB[body], bench.rigid.p_WB[body]);
                for k in 0..6 {
                    let turned = |g: &mut crate::contact::geometry::Geometry, e: f64| {
                        let X = SpatialVector::ith(k, e);
                        let T = *nalgebra::Rotation3::from_scaled_axis(angular(&X)).matrix();
                        let shift = Vector3::new(X[3], X[4], X[5]);
                        g.p_BG = R.transpose() * (T * (R * g.p_BG + p) + shift - p);
                        g.R_BG = R.transpose() * T * R * g.R_BG;
                    };
                    let Some(expected) = difference(&mut bench, &turned, at, 1e-6) else { continue };
                    assert!(
                        (gradient.1[k] - expected).abs() < 1e-5 * (1.0 + gradient.1.norm()),
                        "{i} {j:?} {k}: {:?} {expected}",
                        gradient.1
                    );
                    compared += 1;
                }
            }
            tried += 1;
            if tried == 10 {
                break;
            }
        }
        assert!(tried > 3, "{i} {j:?}");
    }
    assert!(compared > 500, "{compared}");
}
