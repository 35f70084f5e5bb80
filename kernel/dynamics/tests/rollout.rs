//! Gradients of rollouts against central differences, checkpoints, threads and errors.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use std::collections::BTreeMap;

use common::{WIDE, brick, joint, link, menagerie, model, panda, random, random_state, random_vector, root, slide, welded};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};
use sagci_dynamics::effects::{Acts, Prior, catalogue};
use sagci_dynamics::residual::{Activation, Residual};
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutGradient, RolloutOptions, Smoothing, rollouts};
use sagci_dynamics::{
    ContactMaterial, ContactOptions, Coriolis, DynamicsError, Grasp, ParameterKind, Part, SpatialVector, State, StateCotangent, System,
};
use sagci_model::{EffectEntry, JointKind, ObjectModel};

const KINDS: [ParameterKind; 14] = [
    ParameterKind::LinkMass,
    ParameterKind::LinkCenter,
    ParameterKind::LinkInertia,
    ParameterKind::JointAxis,
    ParameterKind::JointOrigin,
    ParameterKind::Armature,
    ParameterKind::Damping,
    ParameterKind::DryFriction,
    ParameterKind::Effect,
    ParameterKind::ContactFriction,
    ParameterKind::ContactStiffness,
    ParameterKind::ContactDissipation,
    ParameterKind::ShapePose,
    ParameterKind::Residual,
];

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    let parameters: BTreeMap<_, _> = parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect();
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters, ..EffectEntry::default() }
}

fn microwave() -> ObjectModel {
    let folder = root().join("world-models/microwave");
    ObjectModel::read(folder.join(std::fs::read_to_string(folder.join("HEAD")).unwrap().trim())).unwrap()
}

/// A loss with random weights on all states: linear in velocities and one-dof positions, and on poses of floating bodies.
struct Loss {
    by_v: Vec<f64>,
    by_q: Vec<f64>,
    joints: Vec<(JointKind, usize, usize)>,
    steps: usize,
}

impl Loss {
    fn new(system: &System, steps: usize, seed: u64) -> Self {
        let multibody = system.multibody();
        let mut rng = random(seed);
        let joints = multibody.joints().iter().map(|j| (j.kind, j.q.start, j.v.start)).collect();
        Self { by_v: random_vector(multibody.nv(), 1.0, &mut rng), by_q: random_vector(2 * multibody.nv(), 1.0, &mut rng), joints, steps }
    }

    /// All states count, the last one more.
    fn at(&self, step: usize, state: &State, bar: Option<&mut StateCotangent>) -> f64 {
        let size = if step == self.steps { 1.0 } else { 0.3 * (1.0 + (step as f64).sin()) / self.steps as f64 };
        let mut zero = StateCotangent { q: vec![0.0; self.by_v.len()], v: vec![0.0; self.by_v.len()], z: vec![] };
        let bar = bar.unwrap_or(&mut zero);
        let mut value = 0.0;
        for (k, w) in self.by_v.iter().enumerate() {
            value += size * w * state.v[k];
            bar.v[k] += size * w;
        }
        for &(kind, q, v) in &self.joints {
            match kind {
                JointKind::Floating => {
                    let x = &state.q[q..];
                    let R = UnitQuaternion::new_normalize(Quaternion::new(x[0], x[1], x[2], x[3])).to_rotation_matrix();
                    let (a, b) = (Vector3::from_column_slice(&self.by_q[v..v + 3]), Vector3::from_column_slice(&self.by_q[v + 3..v + 6]));
                    let e = Vector3::new(0.3, -0.5, 0.8);
                    value += size * (a.dot(&(R * e)) + b.dot(&Vector3::new(x[4], x[5], x[6])));
                    let (turn, slide) = (e.cross(&(R.transpose() * a)), R.transpose() * b);
                    for k in 0..3 {
                        bar.q[v + k] += size * turn[k];
                        bar.q[v + 3 + k] += size * slide[k];
                    }
                }
                JointKind::Planar => {
                    let (sin, cos) = state.q[q + 2].sin_cos();
                    let w = &self.by_q[v..v + 3];
                    value += size * (0..3).map(|k| w[k] * state.q[q + k]).sum::<f64>();
                    bar.q[v] += size * (cos * w[0] + sin * w[1]);
                    bar.q[v + 1] += size * (-sin * w[0] + cos * w[1]);
                    bar.q[v + 2] += size * w[2];
                }
                _ => {
                    value += size * self.by_q[v] * state.q[q];
                    bar.q[v] += size * self.by_q[v];
                }
            }
        }
        value
    }
}

struct Case {
    system: System,
    x0: State,
    tau: Vec<f64>,
    steps: usize,
    dt: f64,
    /// Step of the differences: small where switches are near.
    reach: f64,
}

impl Case {
    fn options(&self) -> RolloutOptions {
        RolloutOptions::new(self.steps, self.dt)
    }

    fn value(&self, system: &System, x0: &State, tau: &[f64], loss: &Loss) -> f64 {
        let mut rollout = Rollout::new(system, self.options()).unwrap();
        let mut value = 0.0;
        rollout.forward(system, x0, &Inputs { tau, ..Inputs::default() }, |k, s| value += loss.at(k, s, None)).unwrap();
        value
    }

    fn run(&self, system: &System, loss: &Loss) -> RolloutGradient {
        let inputs = Inputs { tau: &self.tau, ..Inputs::default() };
        let mut rollout = Rollout::new(system, self.options()).unwrap();
        rollout.forward(system, &self.x0, &inputs, |_, _| {}).unwrap();
        rollout
            .backward(system, &inputs, |k, s, bar| {
                loss.at(k, s, Some(bar));
            })
            .unwrap();
        rollout.gradient().clone()
    }

    /// Compares the gradient along random directions, one group of variables at a time, with central differences of fourth
    /// order. A group whose differences depend on their step lies at a switch; returns how many did, of how many.
    fn check(&self, name: &str, seed: u64) -> (usize, usize) {
        let (n, loss) = (self.system.multibody().nv(), Loss::new(&self.system, self.steps, seed));
        let gradient = self.run(&self.system, &loss);
        let mut rng = random(seed + 1000);
        let (mut switched, mut all) = (0, 0);
        // `terms`: the products of gradient and direction whose sum is compared; their root sum of squares is its typical size,
        // that of the whole group is `scale`.
        let mut compare = |group: &str, terms: &[f64], scale: f64, along: &dyn Fn(f64) -> f64, reach: f64| {
            let analytic: f64 = terms.iter().sum();
            let typical = terms.iter().map(|t| t * t).sum::<f64>().sqrt();
            let difference = |h: f64| (8.0 * (along(h) - along(-h)) - (along(2.0 * h) - along(-2.0 * h))) / (12.0 * h);
            all += 1;
            // Near switches differences need a small step, and far from them a large one, or rounding drowns them.
            let (mut told, mut best) = (None, 5e-7);
            // Bounds are further away than that.
            for step in [1.0, 8.0, 64.0, 512.0, 0.125].map(|s| s * reach).into_iter().filter(|s| *s < 5e-3) {
                let (coarse, fine) = (difference(step), difference(0.5 * step));
                // Rounding of the loss counts `1 / step` times.
                let noise = 2e-8 * along(0.0).abs().max(1.0) / step.max(1e-5);
                let size = fine.abs().max(0.1 * typical.max(scale)).max(noise);
                let spread = (coarse - fine).abs() / size;
                if spread <= best {
                    (told, best) = (Some((fine, size)), spread);
                }
                // Two that agree by chance are outdone by two that agree well.
                if best <= 5e-8 {
                    break;
                }
            }
            let Some((fine, size)) = told else {
                switched += 1;
                println!("{name}, {group}: at a switch (analytic {analytic})");
                return;
            };
            let error = (analytic - fine).abs() / size;
            assert!(error < 1e-6, "{name}, by {group}: {analytic} where differences say {fine} ({error:.1e})");
        };
        for trial in 0..2 {
            let d = random_vector(n, 1.0, &mut rng);
            let dot = |a: &[f64]| a.iter().zip(&d).map(|(a, b)| a * b).collect::<Vec<_>>();
            let along = |h: f64| {
                let mut x0 = self.x0.clone();
                self.system.multibody().integrate(&mut x0.q, &d, h).unwrap();
                self.value(&self.system, &x0, &self.tau, &loss)
            };
            compare(&format!("q {trial}"), &dot(&gradient.x0.q), 0.0, &along, self.reach);
            let along = |h: f64| {
                let mut x0 = self.x0.clone();
                x0.v.iter_mut().zip(&d).for_each(|(v, d)| *v += h * d);
                self.value(&self.system, &x0, &self.tau, &loss)
            };
            compare(&format!("v {trial}"), &dot(&gradient.x0.v), 0.0, &along, self.reach);
        }
        let d = random_vector(self.tau.len(), 1.0, &mut rng);
        let along = |h: f64| {
            let tau: Vec<f64> = self.tau.iter().zip(&d).map(|(t, d)| t + h * d).collect();
            self.value(&self.system, &self.x0, &tau, &loss)
        };
        compare("tau", &gradient.tau.iter().zip(&d).map(|(a, b)| a * b).collect::<Vec<_>>(), 0.0, &along, self.reach);
        for kind in KINDS {
            let which = self.system.parameters_of_kind(kind);
            if which.is_empty() {
                continue;
            }
            let (values, by) = (which.values(&self.system).unwrap(), gradient.parameters(&self.system, &which).unwrap());
            // Every entry on its own where they are few, otherwise along directions.
            let directions: Vec<Vec<f64>> = if which.len() <= 12 {
                (0..which.len()).map(|k| (0..which.len()).map(|j| if j == k { 1.0 } else { 0.0 }).collect()).collect()
            } else {
                (0..3).map(|_| random_vector(which.len(), 1.0, &mut rng)).collect()
            };
            let scale = (by.iter().zip(&values).map(|(b, x)| (b * x.abs().max(1.0)).powi(2)).sum::<f64>() / which.len() as f64).sqrt();
            for d in directions {
                // Armatures and losses that start at zero may not go below: those are compared a little above.
                let step: Vec<f64> = values.iter().zip(&d).map(|(x, d)| d * x.abs().max(1.0)).collect();
                let low = values.iter().zip(which.bounds()).any(|(x, [least, _])| *x < least + 1e-2);
                let step: Vec<f64> = if low { step.iter().map(|s| s.abs()).collect() } else { step };
                let base: Vec<f64> = values.iter().zip(&step).map(|(x, s)| if low { x + 1e-2 * s } else { *x }).collect();
                let mut at_base = self.system.clone();
                at_base.set_parameters(&which, &base).unwrap();
                let by = if low { self.run(&at_base, &loss).parameters(&at_base, &which).unwrap() } else { by.clone() };
                let along = |h: f64| {
                    let moved: Vec<f64> = base.iter().zip(&step).map(|(x, s)| x + h * s).collect();
                    let mut system = self.system.clone();
                    system.set_parameters(&which, &moved).unwrap();
                    self.value(&system, &self.x0, &self.tau, &loss)
                };
                compare(
                    &format!("{kind:?}"),
                    &by.iter().zip(&step).map(|(a, b)| a * b).collect::<Vec<_>>(),
                    scale,
                    &along,
                    if low { self.reach.min(1e-4) } else { self.reach },
                );
            }
        }
        (switched, all)
    }
}

fn moving_arm(seed: u64) -> (ObjectModel, Vec<f64>, Vec<f64>) {
    let mut rng = random(seed);
    let q: Vec<f64> = [0.0, -0.785, 0.3, -2.356, 0.2, 1.571, 0.785, 0.02, 0.02]
        .iter()
        .zip(random_vector(9, 0.01, &mut rng))
        .map(|(a, b)| a + b)
        .collect();
    (panda(), q, random_vector(9, 0.02, &mut rng).iter().map(|x| x + 0.2).collect())
}

fn arm_case(coriolis: Coriolis, steps: usize, seed: u64) -> Case {
    let (arm, q, v) = moving_arm(seed);
    let mut system = System::new(&[welded(&arm)]).unwrap();
    system.set_coriolis(coriolis);
    let mut x0 = system.state();
    x0.q.copy_from_slice(&q);
    x0.v.copy_from_slice(&v);
    (x0.v[7], x0.v[8]) = (0.01, 0.012);
    // Gravity carried, so that nothing turns round.
    let mut ws = system.multibody().workspace();
    system.multibody().set_positions(&mut ws, &x0.q).unwrap();
    let mut hold = vec![0.0; 9];
    system.multibody().gravity_efforts(&mut ws, &mut hold).unwrap();
    let mut rng = random(seed + 7);
    let tau = (0..steps)
        .flat_map(|_| hold.iter().map(|h| h + 0.8).collect::<Vec<_>>())
        .zip(random_vector(steps * 9, 0.3, &mut rng))
        .map(|(a, b)| a + b)
        .collect();
    Case { system, x0, tau, steps, dt: 1e-3, reach: 1e-4 }
}

#[test]
fn gradients_of_an_arm_are_those_of_central_differences() {
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let (mut switched, mut all) = (0, 0);
        for (steps, seeds) in [(1, 4), (10, 4), (200, 1)] {
            for seed in 0..seeds {
                let (s, a) = arm_case(coriolis, steps, seed).check(&format!("arm, {coriolis:?}, {steps} steps, {seed}"), seed);
                (switched, all) = (switched + s, all + a);
            }
        }
        println!("{coriolis:?}: {switched} of {all} at a switch");
        assert!(switched * 10 <= all);
    }
}

#[test]
fn gradients_of_an_arm_beside_a_microwave_are_those_of_central_differences() {
    let (arm, q, v) = moving_arm(3);
    let oven = microwave();
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let mut system = System::new(&[welded(&arm), Part::welded(&oven, Isometry3::translation(0.6, 0.1, 0.0))]).unwrap();
        system.set_coriolis(coriolis);
        let n = system.multibody().nv();
        let mut x0 = system.state();
        x0.q[..9].copy_from_slice(&q);
        x0.v[..9].copy_from_slice(&v);
        // Fingers slow enough not to reach their limits.
        (x0.v[7], x0.v[8]) = (0.01, 0.012);
        for k in 9..n {
            (x0.q[k], x0.v[k]) = (0.5, 0.8);
        }
        let mut ws = system.multibody().workspace();
        system.multibody().set_positions(&mut ws, &x0.q).unwrap();
        let mut hold = vec![0.0; n];
        system.multibody().gravity_efforts(&mut ws, &mut hold).unwrap();
        let tau = random_vector(200 * n, 0.3, &mut random(4))
            .iter()
            .enumerate()
            // Fingers weigh 15 g: this is what keeps them from turning round.
            .map(|(k, x)| hold[k % n] + (x + 0.8) * if (7..9).contains(&(k % n)) { 0.003 } else { 1.0 })
            .collect();
        let case = Case { system, x0, tau, steps: 200, dt: 1e-3, reach: 1e-5 };
        let (switched, all) = case.check(&format!("arm and microwave, {coriolis:?}"), 5);
        assert!(switched * 5 <= all, "{switched} of {all}");
    }
}

#[test]
fn gradients_of_free_bodies_and_every_kind_of_joint_are_those_of_central_differences() {
    let (zoo, body) = (menagerie(false), brick([0.02, 0.001, 0.002, 0.03, -0.001, 0.025]));
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        for (name, system) in [
            ("brick", System::new(&[Part::floating(&body)]).unwrap()),
            ("zoo", System::new(&[welded(&zoo)]).unwrap()),
            ("free zoo", System::new(&[Part::floating(&zoo)]).unwrap()),
            ("followers", System::new(&[welded(&menagerie(true))]).unwrap()),
        ] {
            let mut system = system;
            system.set_coriolis(coriolis);
            for steps in [1, 10, 50] {
                let mut x0 = system.state();
                let (q, v) = random_state(system.multibody(), &mut random(steps as u64));
                x0.q.copy_from_slice(&q);
                x0.v.copy_from_slice(&v);
                let tau = random_vector(steps * system.multibody().nv(), 1.0, &mut random(9));
                let case = Case { system: system.clone(), x0, tau, steps, dt: 2e-3, reach: 1e-3 };
                let (switched, _) = case.check(&format!("{name}, {coriolis:?}, {steps} steps"), 2);
                assert_eq!(switched, 0, "{name} has nothing that switches");
            }
        }
    }
}

/// A door with a handle on it: sticks, slides, stands at limits and stops.
fn door(limits: [f64; 2]) -> System {
    let urdf = link("frame", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("door", 6.0, [0.25, 0.0, 0.0], [0.1, 0.0, 0.0, 0.2, 0.0, 0.3])
        + &link("latch", 0.3, [0.02, 0.01, 0.0], [0.001, 0.0, 0.0, 0.001, 0.0, 0.002])
        + &joint(
            "hinge",
            "revolute",
            "frame",
            "door",
            [0.0, 0.1, 1.0],
            [0.0; 6],
            &format!(
                "<limit lower='{}' upper='{}' velocity='9' effort='9'/><dynamics damping='0.3' friction='0.5'/>",
                limits[0], limits[1]
            ),
        )
        + &joint(
            "knob",
            "revolute",
            "door",
            "latch",
            [1.0, 0.0, 0.0],
            [0.45, 0.0, 0.0, 0.0, 0.0, 0.0],
            &format!("{WIDE}<dynamics damping='0.01' friction='0.02'/>"),
        );
    let mut system = System::new(&[welded(&model("door", &urdf))]).unwrap();
    system.add_effect("door", &effect("joint_spring", "hinge", &[("stiffness", 3.0), ("rest_position", 0.2)])).unwrap();
    system
}

#[test]
fn gradients_of_a_door_that_slides_sticks_and_stops_are_those_of_central_differences() {
    // Held: the knob sticks, or the hinge does, or the hinge stands at its limit; and a hard stop is run into.
    let wide = [-3.0, 3.0];
    let mut stop = door(wide);
    stop.add_effect("door", &effect("hard_stop", "hinge", &[("stiffness", 2e3), ("dissipation", 3e3), ("position", 0.52), ("side", 1.0)]))
        .unwrap();
    for (name, system, q, v, tau) in [
        ("slides", door(wide), [0.5, 0.1], [1.0, 0.5], [0.4, 0.1]),
        ("knob sticks", door(wide), [0.5, 0.1], [1.0, 0.0], [0.4, 0.001]),
        ("hinge sticks", door(wide), [0.2, 0.1], [0.0, 0.5], [0.1, 0.1]),
        ("all sticks", door(wide), [0.2, 0.1], [0.0, 0.0], [0.1, 0.001]),
        ("at its limit", door([-0.1, 0.6]), [0.6, 0.1], [0.0, 0.5], [9.0, 0.1]),
        ("beyond its limit", door([-0.1, 0.6]), [0.63, 0.1], [0.0, 0.5], [3.0, 0.1]),
        ("in a stop", stop, [0.525, 0.1], [0.8, 0.5], [0.4, 0.1]),
    ] {
        for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
            for steps in [1, 10, 30] {
                let mut system = system.clone();
                system.set_coriolis(coriolis);
                let mut x0 = system.state();
                x0.q.copy_from_slice(&q);
                x0.v.copy_from_slice(&v);
                let case = Case { system, x0, tau: tau.repeat(steps), steps, dt: 1e-3, reach: 1e-4 };
                let (switched, all) = case.check(&format!("{name}, {coriolis:?}, {steps} steps"), 3);
                // Knob and hinge at rest at the friction's start can differ in their first step alone.
                assert!(switched * 3 <= all, "{name}: {switched} of {all}");
            }
        }
    }
}

#[test]
fn gradients_through_a_residual_are_those_of_central_differences() {
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let zoo = menagerie(false);
        let mut system = System::new(&[welded(&zoo)]).unwrap();
        system.set_coriolis(coriolis);
        let joints = ["ja", "jb", "jc", "jd", "je"];
        let mut residual = Residual::new(system.multibody(), &joints, &["ja", "jc", "jd"], &[7, 6], Activation::Silu, 3).unwrap();
        let mut normalisation = residual.network().normalisation().clone();
        let mut rng = random(8);
        normalisation.input_mean = random_vector(normalisation.input_mean.len(), 0.3, &mut rng);
        normalisation.input_scale = random_vector(normalisation.input_scale.len(), 0.5, &mut rng).iter().map(|x| 2.0 + x).collect();
        residual.set_normalisation(normalisation).unwrap();
        let weights = random_vector(residual.network().weights().len(), 0.5, &mut rng);
        residual.set_weights(&weights).unwrap();
        system.set_residual(Some(&residual)).unwrap();
        for steps in [1, 20] {
            let mut x0 = system.state();
            let (q, v) = random_state(system.multibody(), &mut random(12));
            x0.q.copy_from_slice(&q);
            x0.v.copy_from_slice(&v);
            let tau = random_vector(steps * system.multibody().nv(), 1.0, &mut random(9));
            let case = Case { system: system.clone(), x0, tau, steps, dt: 2e-3, reach: 1e-3 };
            assert_eq!(case.check(&format!("residual, {coriolis:?}, {steps}"), 4).0, 0);
        }
    }
}

#[test]
fn the_gradient_by_external_forces_is_that_of_central_differences() {
    let system = System::new(&[welded(&panda())]).unwrap();
    let links = [system.multibody().link("panda_hand").unwrap(), system.multibody().link("panda_link4").unwrap()];
    let (_, q, v) = moving_arm(1);
    let mut x0 = system.state();
    x0.q.copy_from_slice(&q);
    x0.v.copy_from_slice(&v);
    let steps = 20;
    let mut rng = random(3);
    let draw = |rng: &mut _| (0..2 * steps).map(|_| SpatialVector::from_column_slice(&random_vector(6, 2.0, rng))).collect::<Vec<_>>();
    let (wrenches, d) = (draw(&mut rng), draw(&mut rng));
    let loss = Loss::new(&system, steps, 1);
    let mut rollout = Rollout::new(&system, RolloutOptions { links: 2, ..RolloutOptions::new(steps, 1e-3) }).unwrap();
    let mut value = |h: f64| {
        let moved: Vec<_> = wrenches.iter().zip(&d).map(|(w, d)| w + d * h).collect();
        let mut sum = 0.0;
        rollout.forward(&system, &x0, &Inputs { tau: &[], links: &links, wrenches: &moved }, |k, s| sum += loss.at(k, s, None)).unwrap();
        sum
    };
    let difference = (value(1e-3) - value(-1e-3)) / 2e-3;
    let inputs = Inputs { tau: &[], links: &links, wrenches: &wrenches };
    rollout.forward(&system, &x0, &inputs, |_, _| {}).unwrap();
    rollout
        .backward(&system, &inputs, |k, s, bar| {
            loss.at(k, s, Some(bar));
        })
        .unwrap();
    let analytic: f64 = rollout.gradient().wrenches.iter().zip(&d).map(|(a, b)| a.dot(b)).sum();
    assert!((analytic / difference - 1.0).abs() < 1e-6, "{analytic} {difference}");
}

#[test]
fn checkpoints_change_no_bit() {
    let case = arm_case(Coriolis::AtMidpoint, 157, 2);
    let loss = Loss::new(&case.system, case.steps, 2);
    let inputs = Inputs { tau: &case.tau, ..Inputs::default() };
    let run = |memory: usize| {
        let mut rollout = Rollout::new(&case.system, RolloutOptions { memory, ..case.options() }).unwrap();
        rollout.forward(&case.system, &case.x0, &inputs, |_, _| {}).unwrap();
        rollout
            .backward(&case.system, &inputs, |k, s, bar| {
                loss.at(k, s, Some(bar));
            })
            .unwrap();
        (rollout.checkpoint_spacing(), rollout.gradient().clone())
    };
    let (all, whole) = run(64 << 20);
    let (few, parts) = run(60_000);
    assert_eq!(all, 157);
    assert!(few < 40, "{few}");
    assert_eq!(whole, parts);
    // Backward twice is the same too, and the least memory is named.
    assert!(matches!(
        Rollout::new(&case.system, RolloutOptions { memory: 1000, ..case.options() }),
        Err(DynamicsError::OutOfBounds { .. })
    ));
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let case = arm_case(Coriolis::AtStart, 30, 2);
    let loss = Loss::new(&case.system, case.steps, 2);
    let run = |threads: usize| {
        rollouts(&case.system, case.options(), 12, threads, |k, rollout| {
            let tau: Vec<f64> = case.tau.iter().map(|t| t + 0.01 * k as f64).collect();
            let inputs = Inputs { tau: &tau, ..Inputs::default() };
            rollout.forward(&case.system, &case.x0, &inputs, |_, _| {})?;
            rollout.backward(&case.system, &inputs, |k, s, bar| {
                loss.at(k, s, Some(bar));
            })?;
            Ok((rollout.last().clone(), rollout.gradient().clone()))
        })
        .unwrap()
    };
    let one = run(1);
    assert_eq!(one.len(), 12);
    assert!(one[0] != one[1]);
    for threads in [2, 3, 7] {
        assert_eq!(run(threads), one);
    }
}

#[test]
fn smoothing_sees_past_a_stuck_joint() {
    // A block on a rough slide, pushed just too little to move: its own gradient is zero, the smoothed one points on.
    let system = System::new(&[welded(&slide(2.0, &format!("{WIDE}<dynamics damping='0' friction='3'/>")))]).unwrap();
    let (x0, tau) = (system.state(), [2.9]);
    let inputs = Inputs { tau: &tau, ..Inputs::default() };
    let mut rollout = Rollout::new(&system, RolloutOptions::new(100, 1e-3)).unwrap();
    rollout.forward(&system, &x0, &inputs, |_, _| {}).unwrap();
    rollout.backward(&system, &inputs, |k, _, bar| bar.q[0] += f64::from(u8::from(k == 100))).unwrap();
    assert!(rollout.gradient().tau.iter().all(|t| *t == 0.0));
    let smoothing = Smoothing { pairs: 20, seed: 1, q: 0.0, v: 0.0, tau: 0.5 };
    let mut run = || {
        smoothing
            .gradient(&system, &mut rollout, &x0, &inputs, |k, s, bar| {
                if k == 100 {
                    bar.q[0] += 1.0;
                    s.q[0]
                } else {
                    0.0
                }
            })
            .unwrap()
    };
    let (value, gradient) = run();
    assert!(value > 0.0 && gradient.tau.iter().sum::<f64>() > 1e-6, "{value} {:?}", gradient.tau);
    assert_eq!(run(), (value, gradient), "the same seed gives the same bits");
}

#[test]
fn errors_say_at_which_step_and_joint() {
    let body = brick([0.02, 0.001, 0.002, 0.03, -0.001, 0.025]);
    let flying = System::new(&[Part::floating(&body)]).unwrap();
    let mut tau = vec![0.0; 50 * 6];
    tau[17 * 6 + 3] = 1e305;
    tau[17 * 6 + 1] = 1e305;
    let mut rollout = Rollout::new(&flying, RolloutOptions::new(50, 1e-3)).unwrap();
    let error = rollout.forward(&flying, &flying.state(), &Inputs { tau: &tau, ..Inputs::default() }, |_, _| {}).unwrap_err();
    let DynamicsError::AtStep { step, .. } = &error else { panic!("{error}") };
    assert!((17..=19).contains(step), "{error}");
    assert!(error.to_string().starts_with("step 1"), "{error}");
    assert!(rollout.backward(&flying, &Inputs::default(), |_, _, _| {}).is_err(), "a failed forward pass has no way back");
    let system = System::new(&[welded(&panda())]).unwrap();
    let mut rollout = Rollout::new(&system, RolloutOptions::new(50, 1e-3)).unwrap();
    let mut tau = vec![0.0; 50 * 9];
    tau[17 * 9 + 3] = f64::NAN;
    let error = rollout.forward(&system, &system.state(), &Inputs { tau: &tau, ..Inputs::default() }, |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("step 17") && error.to_string().contains("panda_joint4"), "{error}");
    assert!(rollout.forward(&system, &system.state(), &Inputs { tau: &tau[..7], ..Inputs::default() }, |_, _| {}).is_err());
    let other = System::new(&[welded(&microwave())]).unwrap();
    assert!(matches!(rollout.forward(&other, &other.state(), &Inputs::default(), |_, _| {}), Err(DynamicsError::ForeignWorkspace)));
    assert!(Rollout::new(&system, RolloutOptions::new(0, 1e-3)).is_err());
    assert!(Rollout::new(&system, RolloutOptions::new(5, f64::NAN)).is_err());
}

fn cube(name: &str, mass: f64, [x, y, z]: [f64; 3]) -> ObjectModel {
    let m = mass / 12.0;
    let [a, b, c] = [m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y)];
    model(
        name,
        &format!(
            "<link name='{name}'><inertial><mass value='{mass}'/><inertia ixx='{a}' ixy='0' ixz='0' iyy='{b}' iyz='0' izz='{c}'/></inertial>\
             <collision><geometry><box size='{x} {y} {z}'/></geometry></collision></link>"
        ),
    )
}

#[test]
fn gradients_through_contact_are_those_of_central_differences() {
    let (one, two) = (cube("one", 1.0, [0.1, 0.1, 0.06]), cube("two", 0.5, [0.05, 0.06, 0.04]));
    let mut compared = 0;
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        for (name, models, spin, push) in [
            ("a box at rest", vec![&one], [0.0, 0.0, 0.0, 0.0], 0.5),
            ("a box that slides", vec![&one], [0.3, 0.5, 0.2, 0.0], 0.5),
            ("a box on a box", vec![&one, &two], [0.2, 0.5, 0.2, 0.0], 0.5),
        ] {
            let parts: Vec<Part<'_>> = models.iter().map(|m| Part::floating(m)).collect();
            let material = ContactMaterial { friction: 0.4, stiffness: 2e4, dissipation: 1.0 };
            let options = ContactOptions { material, ..ContactOptions::default() };
            let mut system = System::new(&parts).unwrap().with_contacts(&parts, options).unwrap();
            system.add_ground("ground", Vector3::zeros(), Vector3::z_axis(), material).unwrap();
            system.set_coriolis(coriolis);
            for steps in [1, 10] {
                let mut x0 = system.state();
                x0.q[6] = 0.0299;
                x0.v[..6].copy_from_slice(&[0.0, 0.0, spin[0], spin[1], spin[2], spin[3]]);
                if models.len() > 1 {
                    x0.q[11..14].copy_from_slice(&[0.01, 0.005, 0.0797]);
                }
                let n = system.multibody().nv();
                let tau = random_vector(steps * n, 0.01, &mut random(3))
                    .iter()
                    .enumerate()
                    .map(|(k, x)| x + if k % n == 3 { push } else { 0.0 })
                    .collect();
                let case = Case { system: system.clone(), x0, tau, steps, dt: 1e-3, reach: 2e-6 };
                let (switched, all) = case.check(&format!("{name}, {coriolis:?}, {steps} steps"), 7);
                println!("{name}, {coriolis:?}, {steps} steps: {switched} of {all} at a switch");
                assert!(switched * 10 <= all, "{name}, {coriolis:?}, {steps} steps: {switched} of {all}");
                compared += all - switched;
            }
        }
    }
    assert!(compared > 480, "{compared}");
}

#[test]
fn gradients_through_a_grasp_are_those_of_central_differences() {
    let (arm, q, v) = moving_arm(2);
    let body = brick([0.02, 0.001, 0.002, 0.03, -0.001, 0.025]);
    let parts = [welded(&arm), Part::floating(&body)];
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        let mut system = System::new(&parts).unwrap();
        system.set_coriolis(coriolis);
        let multibody = system.multibody();
        let (hand, held) = (multibody.link("panda_hand").unwrap(), multibody.link("brick/brick").unwrap());
        let mut x0 = system.state();
        x0.q[..9].copy_from_slice(&q);
        x0.v[..9].copy_from_slice(&v);
        (x0.v[7], x0.v[8]) = (0.01, 0.012);
        let mut rigid = multibody.workspace();
        multibody.set_state(&mut rigid, &x0.q, &x0.v).unwrap();
        let X = multibody.X_WL(&rigid, hand) * Isometry3::translation(0.01, -0.005, 0.1);
        let R = X.rotation;
        x0.q[9..16].copy_from_slice(&[R.w, R.i, R.j, R.k, X.translation.x, X.translation.y, X.translation.z]);
        system
            .add_grasp(Grasp {
                a: hand,
                X_AG: Isometry3::translation(0.0, 0.0, 0.1),
                b: held,
                X_BH: Isometry3::identity(),
                stiffness: nalgebra::Vector6::new(20.0, 30.0, 10.0, 3e3, 2e3, 4e3),
                damping: nalgebra::Vector6::new(0.1, 0.1, 0.1, 10.0, 10.0, 10.0),
                limit: [5.0, 60.0],
            })
            .unwrap();
        for steps in [1, 20] {
            let tau = random_vector(steps * 15, 0.001, &mut random(5))
                .iter()
                .enumerate()
                .map(|(k, x)| x + if k % 15 < 7 { 1.0 } else { 0.0 })
                .collect();
            let case = Case { system: system.clone(), x0: x0.clone(), tau, steps, dt: 1e-3, reach: 1e-4 };
            let (switched, all) = case.check(&format!("grasp, {coriolis:?}, {steps} steps"), 7);
            assert!(switched * 5 <= all, "{switched} of {all}");
        }
    }
}

#[test]
fn gradients_through_every_effect_are_those_of_central_differences() {
    let mut compared = 0;
    for described in catalogue() {
        let description = described.description();
        if matches!(description.acts, Acts::Measurement(_)) {
            continue;
        }
        let parameters: Vec<(&str, f64)> = description
            .parameters
            .iter()
            .filter_map(|p| match p.prior[0] {
                Prior::LogNormal { median, .. } => Some((p.name, median.clamp(p.bounds[0], p.bounds[1]))),
                Prior::Normal { mean, deviation } => Some((p.name, (mean + 0.3 * deviation).clamp(p.bounds[0], p.bounds[1]))),
                // Words have their own default; a side has none.
                Prior::OneOf(choices) => p.words.is_empty().then_some((p.name, choices[0])),
            })
            .collect();
        for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
            let mut system = door([-3.0, 3.0]);
            let mut entry = effect(description.name, "hinge", &parameters);
            entry.joint = entry.joint.filter(|_| description.acts != Acts::Base);
            system.add_effect("door", &entry).unwrap();
            system.set_coriolis(coriolis);
            for steps in [1, 30] {
                let mut x0 = system.state();
                x0.q.copy_from_slice(&[0.4, 0.1]);
                x0.v.copy_from_slice(&[1.0, 0.5]);
                x0.z.iter_mut().take(1).for_each(|z| *z = 0.0);
                let tau = (0..steps).flat_map(|k| [2.0 + 0.3 * f64::from(k as u32).sin(), 0.1]).collect();
                let case = Case { system: system.clone(), x0, tau, steps, dt: 1e-3, reach: 1e-5 };
                let (switched, all) = case.check(&format!("{}, {coriolis:?}, {steps} steps", description.name), 3);
                compared += all - switched;
            }
        }
    }
    assert!(compared > 500, "{compared}");
}

#[test]
fn gradients_of_an_arm_on_a_base_that_gives_way_are_those_of_central_differences() {
    for coriolis in [Coriolis::AtStart, Coriolis::AtMidpoint] {
        for (direction, steps) in [("x", 1), ("y", 20), ("z", 20)] {
            let mut case = arm_case(coriolis, steps, 5);
            let name = case.system.multibody().joints()[0].part.clone();
            let mut entry = effect("unmodelled_mode", "", &[("frequency", 6.0), ("damping_ratio", 0.1), ("mass", 12.0)]);
            entry.joint = None;
            entry.choices = [("direction".into(), direction.into())].into();
            case.system.add_effect(&name, &entry).unwrap();
            case.x0.z = vec![3e-3, -0.08];
            case.check(&format!("base along {direction}, {coriolis:?}, {steps} steps"), 11);
            // By the base's own start.
            let loss = Loss::new(&case.system, steps, 12);
            let inputs = Inputs { tau: &case.tau, ..Inputs::default() };
            let mut rollout = Rollout::new(&case.system, case.options()).unwrap();
            rollout.forward(&case.system, &case.x0, &inputs, |_, _| {}).unwrap();
            rollout
                .backward(&case.system, &inputs, |k, s, bar| {
                    loss.at(k, s, Some(bar));
                })
                .unwrap();
            for k in 0..2 {
                let along = |h: f64| {
                    let mut x0 = case.x0.clone();
                    x0.z[k] += h;
                    case.value(&case.system, &x0, &case.tau, &loss)
                };
                let h = 1e-4;
                let difference = (8.0 * (along(h) - along(-h)) - (along(2.0 * h) - along(-2.0 * h))) / (12.0 * h);
                let ours = rollout.gradient().x0.z[k];
                assert!((ours - difference).abs() < 1e-6 * (1e-3 + difference.abs()), "{direction}, {k}: {ours} {difference}");
            }
        }
    }
}
