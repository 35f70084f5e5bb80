//! Analytic derivatives of the rigid bodies against central differences, for every kind of joint and of parameter.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{menagerie, panda, random, random_state, random_vector};
use nalgebra::{DMatrix, DVector, Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand_pcg::Pcg64;
use sagci_dynamics::{
    Adjoint, Base, ExternalWrench, ForwardDynamicsDerivatives, InverseDynamicsDerivatives, Multibody, Part, RigidGradient, RigidParameter,
    SpatialInertia, SpatialVector, plane_axes, wrench_at_origin,
};
use sagci_model::JointKind;

const STEP: f64 = 1e-3;

/// The slope of `f` at 0, exact for polynomials of degree four.
fn slope(mut f: impl FnMut(f64) -> f64) -> f64 {
    (8.0 * (f(STEP) - f(-STEP)) - (f(2.0 * STEP) - f(-2.0 * STEP))) / (12.0 * STEP)
}

/// Central differences of a vector.
fn slopes(n: usize, mut f: impl FnMut(f64) -> Vec<f64>) -> Vec<f64> {
    let values: Vec<Vec<f64>> = [1.0, -1.0, 2.0, -2.0].iter().map(|k| f(k * STEP)).collect();
    (0..n).map(|i| (8.0 * (values[0][i] - values[1][i]) - (values[2][i] - values[3][i])) / (12.0 * STEP)).collect()
}

fn agree(what: &str, ours: &[f64], theirs: &[f64], bound: f64) {
    let scale = theirs.iter().fold(1e-2, |m: f64, x| m.max(x.abs()));
    for (i, (a, b)) in ours.iter().zip(theirs).enumerate() {
        assert!((a - b).abs() <= bound * scale, "{what}, entry {i}: {a} against {b} by differences, of {scale:.1e}");
    }
}

struct Scene {
    multibody: Multibody,
    external: Vec<ExternalWrench>,
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    lambda: Vec<f64>,
}

/// A tree with every kind of joint welded to the world, the same tree floating, and one held by it.
fn scene(followers: bool, rng: &mut Pcg64) -> Scene {
    let (zoo, arm) = (menagerie(followers), panda());
    let X_LO = Isometry3::new(Vector3::new(0.1, -0.2, 0.05), Vector3::new(0.3, 0.2, -0.5));
    let parts = [
        Part {
            name: "zoo".into(),
            model: &zoo,
            base: Base::Welded(Isometry3::new(Vector3::new(0.3, 0.1, -0.2), Vector3::new(0.5, 0.1, 0.2))),
        },
        Part { name: "free".into(), model: &zoo, base: Base::Floating },
        Part { name: "arm".into(), model: &arm, base: Base::Held { part: 1, link: "f".into(), X_LO } },
    ];
    let mut multibody = Multibody::new(&parts).unwrap();
    multibody.set_gravity(Vector3::new(1.0, -2.0, -9.0));
    for (k, armature) in multibody.armature_mut().iter_mut().enumerate() {
        *armature = 0.01 * k as f64;
    }
    let (q, v) = random_state(&multibody, rng);
    let external = ["zoo/h", "free/e", "free/f", "arm/panda_hand"]
        .iter()
        .map(|link| {
            let [f, t, p] = [0; 3].map(|_| Vector3::from_column_slice(&random_vector(3, 3.0, rng)));
            ExternalWrench { link: multibody.link(link).unwrap(), F_W: wrench_at_origin(&f, &t, &Point3::from(p)) }
        })
        .collect();
    let n = multibody.nv();
    Scene { external, q, v, a: random_vector(n, 3.0, rng), lambda: random_vector(n, 1.0, rng), multibody }
}

impl Scene {
    fn inverse(&self, multibody: &Multibody, q: &[f64], v: &[f64], a: &[f64]) -> Vec<f64> {
        let mut ws = multibody.workspace();
        let mut tau = vec![0.0; multibody.nv()];
        multibody.set_state(&mut ws, q, v).unwrap();
        multibody.inverse_dynamics(&mut ws, a, &self.external, &mut tau).unwrap();
        tau
    }

    fn forward(&self, q: &[f64], v: &[f64], tau: &[f64]) -> Vec<f64> {
        let mut ws = self.multibody.workspace();
        let mut a = vec![0.0; self.multibody.nv()];
        self.multibody.set_state(&mut ws, q, v).unwrap();
        self.multibody.forward_dynamics(&mut ws, tau, &self.external, &mut a).unwrap();
        a
    }

    /// `lambda . ID` for a changed multibody.
    fn power(&self, multibody: &Multibody) -> f64 {
        self.inverse(multibody, &self.q, &self.v, &self.a).iter().zip(&self.lambda).map(|(t, l)| t * l).sum()
    }

    fn moved(&self, k: usize, h: f64) -> Vec<f64> {
        let mut q = self.q.clone();
        let mut e = vec![0.0; self.multibody.nv()];
        e[k] = h;
        self.multibody.integrate(&mut q, &e, 1.0).unwrap();
        q
    }

    /// The parameters' slopes of `lambda . ID` by differences.
    fn by_parameter(&self, change: impl Fn(&mut Multibody, f64)) -> f64 {
        slope(|h| {
            let mut multibody = self.multibody.clone();
            change(&mut multibody, h);
            self.power(&multibody)
        })
    }
}

fn nudge(v: &[f64], k: usize, h: f64) -> Vec<f64> {
    let mut v = v.to_vec();
    v[k] += h;
    v
}

#[test]
fn efforts_change_with_position_and_velocity_as_differences_say() {
    let mut rng = random(61);
    for trial in 0..6 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let n = scene.multibody.nv();
        let mut ws = scene.multibody.workspace();
        let mut d = InverseDynamicsDerivatives::new(&scene.multibody);
        scene.multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        scene.multibody.inverse_dynamics_derivatives(&mut ws, &scene.a, &scene.external, &mut d).unwrap();
        for k in 0..n {
            let by_q = slopes(n, |h| scene.inverse(&scene.multibody, &scene.moved(k, h), &scene.v, &scene.a));
            agree(&format!("trial {trial}, by q[{k}]"), d.d_q.column(k).as_slice(), &by_q, 1e-8);
            let by_v = slopes(n, |h| scene.inverse(&scene.multibody, &scene.q, &nudge(&scene.v, k, h), &scene.a));
            agree(&format!("trial {trial}, by v[{k}]"), d.d_v.column(k).as_slice(), &by_v, 1e-8);
        }
    }
}

#[test]
fn accelerations_change_with_position_velocity_and_effort_as_differences_say() {
    let mut rng = random(62);
    for trial in 0..4 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let n = scene.multibody.nv();
        let mut ws = scene.multibody.workspace();
        let mut d = ForwardDynamicsDerivatives::new(&scene.multibody);
        let (tau, mut a) = (scene.inverse(&scene.multibody, &scene.q, &scene.v, &scene.a), vec![0.0; n]);
        scene.multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        scene.multibody.forward_dynamics_derivatives(&mut ws, &tau, &scene.external, &mut a, &mut d).unwrap();
        agree("accelerations", &a, &scene.a, 1e-8);
        for k in 0..n {
            let by_q = slopes(n, |h| scene.forward(&scene.moved(k, h), &scene.v, &tau));
            agree(&format!("trial {trial}, by q[{k}]"), d.d_q.column(k).as_slice(), &by_q, 1e-7);
            let by_v = slopes(n, |h| scene.forward(&scene.q, &nudge(&scene.v, k, h), &tau));
            agree(&format!("trial {trial}, by v[{k}]"), d.d_v.column(k).as_slice(), &by_v, 1e-7);
            let by_tau = slopes(n, |h| scene.forward(&scene.q, &scene.v, &nudge(&tau, k, h)));
            agree(&format!("trial {trial}, by tau[{k}]"), d.d_tau.column(k).as_slice(), &by_tau, 1e-7);
        }
    }
}

fn sweep(scene: &Scene) -> (Adjoint, RigidGradient) {
    let mut ws = scene.multibody.workspace();
    let (mut adjoint, mut gradient) = (Adjoint::new(&scene.multibody), RigidGradient::new(&scene.multibody));
    scene.multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
    scene.multibody.inverse_dynamics_adjoint(&mut ws, &scene.lambda, &scene.a, &scene.external, true, &mut adjoint).unwrap();
    scene.multibody.rigid_gradient(&adjoint, &mut gradient).unwrap();
    (adjoint, gradient)
}

#[test]
fn reverse_sweep_is_the_transpose_of_the_derivatives() {
    let mut rng = random(63);
    for trial in 0..6 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let (adjoint, _) = sweep(&scene);
        let mut ws = scene.multibody.workspace();
        let mut d = InverseDynamicsDerivatives::new(&scene.multibody);
        scene.multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        scene.multibody.inverse_dynamics_derivatives(&mut ws, &scene.a, &scene.external, &mut d).unwrap();
        let lambda = DVector::from_column_slice(&scene.lambda);
        agree("by q", &adjoint.q, d.d_q.tr_mul(&lambda).as_slice(), 1e-12);
        agree("by v", &adjoint.v, d.d_v.tr_mul(&lambda).as_slice(), 1e-12);
        agree("by a", &adjoint.a, (scene.multibody.mass_matrix(&mut ws).unwrap() * &lambda).as_slice(), 1e-12);
        agree("efforts", &adjoint.tau, &scene.inverse(&scene.multibody, &scene.q, &scene.v, &scene.a), 1e-12);
    }
}

#[test]
fn gradients_by_inertia_gravity_and_armature_agree_with_differences() {
    let mut rng = random(64);
    for trial in 0..3 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let (_, gradient) = sweep(&scene);
        let links: Vec<_> = scene.multibody.links().map(|(id, part, name)| (id, format!("{part}/{name}"))).collect();
        for (i, (link, name)) in links.iter().enumerate() {
            let by_differences: Vec<f64> = (0..10)
                .map(|e| {
                    scene.by_parameter(|m, h| {
                        let mut entries = m.link_inertia(*link).entries();
                        entries[e] += h;
                        m.set_link_inertia(*link, &SpatialInertia::from_entries(&entries));
                    })
                })
                .collect();
            agree(&format!("inertia of {name}"), &gradient.inertia[i], &by_differences, 1e-9);
        }
        let by_gravity: Vec<f64> = (0..3).map(|k| scene.by_parameter(|m, h| m.set_gravity(m.gravity() + Vector3::ith(k, h)))).collect();
        agree("gravity", gradient.gravity.as_slice(), &by_gravity, 1e-9);
        let by_armature: Vec<f64> = (0..scene.multibody.nv()).map(|k| scene.by_parameter(|m, h| m.armature_mut()[k] += h)).collect();
        agree("armature", &gradient.armature, &by_armature, 1e-9);
    }
}

#[test]
fn gradients_by_origin_agree_with_differences_for_every_joint_fixed_ones_too() {
    let mut rng = random(65);
    for trial in 0..4 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let (_, gradient) = sweep(&scene);
        let joints: Vec<_> = scene.multibody.model_joints().map(|(id, part, name, kind)| (id, format!("{part}/{name}"), kind)).collect();
        for (i, (joint, name, kind)) in joints.iter().enumerate() {
            if *kind == JointKind::Floating && name == "free/free" {
                assert_eq!(gradient.origin[i], SpatialVector::zeros());
                continue;
            }
            let by_differences: Vec<f64> = (0..6)
                .map(|e| {
                    scene.by_parameter(|m, h| {
                        let mut twist = [0.0; 6];
                        twist[e] = h;
                        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(twist[0], twist[1], twist[2]));
                        let shift = Translation3::new(twist[3], twist[4], twist[5]);
                        let X_PJ = m.joint_origin(*joint) * Isometry3::from_parts(shift, turn);
                        m.set_joint_origin(*joint, &X_PJ);
                    })
                })
                .collect();
            agree(&format!("origin of {name} ({kind:?})"), gradient.origin[i].as_slice(), &by_differences, 1e-8);
        }
    }
}

#[test]
fn gradients_by_axis_agree_with_differences_for_every_joint() {
    let mut rng = random(66);
    for trial in 0..4 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let (_, gradient) = sweep(&scene);
        let joints: Vec<_> = scene.multibody.model_joints().map(|(id, part, name, kind)| (id, format!("{part}/{name}"), kind)).collect();
        for (i, (joint, name, kind)) in joints.iter().enumerate() {
            let n = *scene.multibody.joint_axis(*joint);
            let across = plane_axes(&n);
            let by_differences: Vec<f64> = across
                .iter()
                .map(|e| scene.by_parameter(|m, h| m.set_joint_axis(*joint, &Unit::new_normalize(n.into_inner() + e * h))))
                .collect();
            let ours = across.map(|e| gradient.axis[i].dot(&e));
            agree(&format!("axis of {name} ({kind:?})"), &ours, &by_differences, 1e-8);
            assert!(gradient.axis[i].dot(&n).abs() < 1e-9 * (1.0 + gradient.axis[i].norm()), "along the axis nothing changes");
        }
    }
}

#[test]
fn seeds_on_poses_and_velocities_are_carried_to_state_and_parameters() {
    // For seeds alone (lambda = 0, a = 0), with L = sum of pose . X + velocity . V over two links.
    let mut rng = random(67);
    for trial in 0..4 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let multibody = &scene.multibody;
        let n = multibody.nv();
        let seeds: Vec<_> = ["zoo/h", "free/g", "arm/panda_hand"]
            .iter()
            .map(|l| {
                let [pose, velocity] = [0; 2].map(|_| SpatialVector::from_column_slice(&random_vector(6, 1.0, &mut rng)));
                (multibody.link(l).unwrap(), pose, velocity)
            })
            .collect();
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        let X_start: Vec<Isometry3<f64>> = seeds.iter().map(|(l, ..)| multibody.X_WL(&ws, *l)).collect();
        // Pose displacement as a world twist, to second order in it, and velocity at the world's origin.
        let value = |m: &Multibody, q: &[f64], v: &[f64]| -> f64 {
            let mut ws = m.workspace();
            m.set_state(&mut ws, q, v).unwrap();
            seeds
                .iter()
                .zip(&X_start)
                .map(|((link, pose, velocity), start)| {
                    let X = m.X_WL(&ws, *link);
                    let moved = X * start.inverse();
                    let twist =
                        SpatialVector::from_iterator(moved.rotation.scaled_axis().iter().chain(moved.translation.vector.iter()).copied());
                    let V = m.V_WL(&ws, *link);
                    let omega = V.fixed_rows::<3>(0).into_owned();
                    let v_O = V.fixed_rows::<3>(3).into_owned() - omega.cross(&X.translation.vector);
                    let V = SpatialVector::from_iterator(omega.iter().chain(v_O.iter()).copied());
                    pose.dot(&twist) + velocity.dot(&V)
                })
                .sum()
        };
        let (mut adjoint, mut gradient) = (Adjoint::new(multibody), RigidGradient::new(multibody));
        for (link, pose, velocity) in &seeds {
            adjoint.seed(multibody, *link, pose, velocity);
        }
        let zeros = vec![0.0; n];
        multibody.inverse_dynamics_adjoint(&mut ws, &zeros, &zeros, &[], true, &mut adjoint).unwrap();
        multibody.rigid_gradient(&adjoint, &mut gradient).unwrap();
        let by_q: Vec<f64> = (0..n).map(|k| slope(|h| value(multibody, &scene.moved(k, h), &scene.v))).collect();
        agree("by q", &adjoint.q, &by_q, 1e-8);
        let by_v: Vec<f64> = (0..n).map(|k| slope(|h| value(multibody, &scene.q, &nudge(&scene.v, k, h)))).collect();
        agree("by v", &adjoint.v, &by_v, 1e-8);
        for (i, (joint, _, name, kind)) in multibody.model_joints().enumerate() {
            if matches!(kind, JointKind::Fixed | JointKind::Floating) {
                continue;
            }
            let n = *multibody.joint_axis(joint);
            let changed = |change: &dyn Fn(&mut Multibody)| {
                let mut m = multibody.clone();
                change(&mut m);
                value(&m, &scene.q, &scene.v)
            };
            let across = plane_axes(&n);
            let by_axis = across.map(|e| slope(|h| changed(&|m| m.set_joint_axis(joint, &Unit::new_normalize(n.into_inner() + e * h)))));
            agree(&format!("axis of {name}"), &across.map(|e| gradient.axis[i].dot(&e)), &by_axis, 1e-8);
            let X = *multibody.joint_origin(joint);
            let by_origin: Vec<f64> = (0..6)
                .map(|e| {
                    slope(|h| {
                        let (mut turn, mut shift) = (Vector3::zeros(), Vector3::zeros());
                        if e < 3 {
                            turn[e] = h
                        } else {
                            shift[e - 3] = h
                        }
                        changed(&|m| m.set_joint_origin(joint, &(X * Isometry3::new(shift, turn))))
                    })
                })
                .collect();
            agree(&format!("origin of {name}"), gradient.origin[i].as_slice(), &by_origin, 1e-8);
        }
        // Seeds are used once.
        multibody.inverse_dynamics_adjoint(&mut ws, &zeros, &zeros, &[], false, &mut adjoint).unwrap();
        assert!(adjoint.v.iter().all(|x| *x == 0.0), "seeds must be taken once");
    }
}

#[test]
fn columns_by_parameter_are_what_the_reverse_sweep_transposes() {
    let mut rng = random(68);
    for trial in 0..4 {
        let scene = scene(trial % 2 == 0, &mut rng);
        let multibody = &scene.multibody;
        let (_, gradient) = sweep(&scene);
        let (mut which, mut expected) = (Vec::new(), Vec::new());
        for (i, (link, ..)) in multibody.links().enumerate() {
            for e in 0..10 {
                which.push(RigidParameter::Inertia(link, e));
                expected.push(gradient.inertia[i][e]);
            }
        }
        for (i, (joint, ..)) in multibody.model_joints().enumerate() {
            for e in 0..6 {
                which.push(RigidParameter::Origin(joint, e));
                expected.push(gradient.origin[i][e]);
            }
            let across = plane_axes(multibody.joint_axis(joint));
            for (e, toward) in across.iter().enumerate() {
                which.push(RigidParameter::Axis(joint, e));
                expected.push(gradient.axis[i].dot(toward));
            }
        }
        for v in 0..multibody.nv() {
            which.push(RigidParameter::Armature(v));
            expected.push(gradient.armature[v]);
        }
        for k in 0..3 {
            which.push(RigidParameter::Gravity(k));
            expected.push(gradient.gravity[k]);
        }
        let mut columns = DMatrix::zeros(multibody.nv(), which.len());
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        multibody.inverse_dynamics_by_parameters(&mut ws, &scene.a, &scene.external, &which, &mut columns).unwrap();
        let ours = columns.tr_mul(&DVector::from_column_slice(&scene.lambda));
        for ((which, ours), expected) in which.iter().zip(ours.iter()).zip(&expected) {
            assert!((ours - expected).abs() < 1e-10 * (1.0 + expected.abs()), "{which:?}: {ours} {expected}");
        }
        assert!(
            multibody
                .inverse_dynamics_by_parameters(
                    &mut ws,
                    &scene.a,
                    &[],
                    &[RigidParameter::Armature(999)],
                    &mut DMatrix::zeros(multibody.nv(), 1)
                )
                .is_err()
        );
    }
}

#[test]
fn efforts_are_the_torque_regressor_times_the_inertias() {
    let mut rng = random(69);
    for followers in [false, true] {
        let scene = scene(followers, &mut rng);
        let mut multibody = scene.multibody.clone();
        multibody.armature_mut().fill(0.0);
        let mut ws = multibody.workspace();
        multibody.set_state(&mut ws, &scene.q, &scene.v).unwrap();
        let mut tau = vec![0.0; multibody.nv()];
        multibody.inverse_dynamics(&mut ws, &scene.a, &[], &mut tau).unwrap();
        let blocks = multibody.links().filter_map(|(l, ..)| multibody.regressor_columns(l)).map(|r| r.end).max().unwrap();
        let mut Y = DMatrix::zeros(multibody.nv(), blocks);
        multibody.torque_regressor(&mut ws, &scene.a, &mut Y).unwrap();
        // A link that a joint moves stands for its body; bodies stand in the order of those links.
        let moved: Vec<_> = multibody
            .model_joints()
            .zip(multibody.links())
            .filter(|((_, _, _, kind), _)| *kind != JointKind::Fixed)
            .map(|(_, (link, ..))| link)
            .collect();
        let mut pi = DVector::zeros(blocks);
        for link in moved {
            let columns = multibody.regressor_columns(link).unwrap();
            pi.rows_mut(columns.start, 10).copy_from_slice(&multibody.body_inertia(link).entries());
        }
        agree("efforts", (Y * pi).as_slice(), &tau, 1e-12);
    }
}

#[test]
fn gravity_changes_with_position_as_inverse_dynamics_at_rest() {
    let rng = &mut random(21);
    for followers in [false, true] {
        let scene = scene(followers, rng);
        let (mb, n) = (&scene.multibody, scene.multibody.nv());
        let mut ws = mb.workspace();
        mb.set_positions(&mut ws, &scene.q).unwrap();
        let (mut tau, mut held, mut d_q) = (vec![0.0; n], vec![0.0; n], DMatrix::zeros(n, n));
        mb.gravity_efforts_derivatives(&mut ws, &mut tau, &mut d_q).unwrap();
        mb.gravity_efforts(&mut ws, &mut held).unwrap();
        agree("efforts", &tau, &held, 1e-13);
        let mut whole = InverseDynamicsDerivatives::new(mb);
        mb.inverse_dynamics_derivatives(&mut ws, &vec![0.0; n], &[], &mut whole).unwrap();
        agree("derivative", d_q.as_slice(), whole.d_q.as_slice(), 1e-13);
        assert!(mb.gravity_efforts_derivatives(&mut ws, &mut tau[1..], &mut d_q).is_err());
    }
}
