//! A step's derivatives by every kind of parameter, against central differences of the step and against its reverse pass.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::{menagerie, model, panda, random, random_state, random_vector, welded};
use nalgebra::{Isometry3, Vector3};
use sagci_dynamics::effects::{Acts, Prior, catalogue};
use sagci_dynamics::residual::{Activation, Residual};
use sagci_dynamics::rollout::{Inputs, Rollout, RolloutOptions};
use sagci_dynamics::{
    ContactMaterial, ContactOptions, Coriolis, ExternalWrench, Grasp, Input, Linearisation, MeasurementDerivatives, ParameterKind,
    ParameterVector, Part, SpatialVector, State, System,
};
use sagci_model::{EffectEntry, ObjectModel};

const DT: f64 = 1e-3;
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
const SCHEMES: [Coriolis; 2] = [Coriolis::AtStart, Coriolis::AtMidpoint];

/// Columns compared by kind, and those at a switch.
#[derive(Default)]
struct Count {
    compared: std::collections::BTreeMap<String, [usize; 2]>,
}

impl Count {
    fn add(&mut self, kind: &str, switched: bool) {
        self.compared.entry(kind.into()).or_default()[usize::from(switched)] += 1;
    }

    fn print(&self, name: &str) {
        for (kind, [compared, switched]) in &self.compared {
            println!("{name}, {kind}: {compared} columns compared, {switched} at a switch");
        }
    }

    fn of(&self, kind: ParameterKind) -> usize {
        self.compared.get(&format!("{kind:?}")).map_or(0, |c| c[0])
    }

    fn share(&self) -> f64 {
        let [compared, switched] = self.compared.values().fold([0, 0], |s, c| [s[0] + c[0], s[1] + c[1]]);
        switched as f64 / (compared + switched).max(1) as f64
    }
}

struct Case<'a> {
    system: System,
    state: State,
    tau: &'a [f64],
    external: &'a [ExternalWrench],
    /// How sharp a next state is: rounding, or what the contact solver leaves.
    resolution: f64,
}

impl Case<'_> {
    fn input(&self) -> Input<'_> {
        Input { tau: self.tau, external: self.external }
    }

    /// Armatures and losses that start at zero may not go below: they are compared a little above.
    fn lift(&mut self, which: &ParameterVector) {
        let values = which.values(&self.system).unwrap();
        let lifted: Vec<f64> = values.iter().zip(which.bounds()).map(|(x, [least, _])| x.max(least + 1e-2)).collect();
        self.system.set_parameters(which, &lifted).unwrap();
    }

    fn check(&mut self, name: &str, count: &mut Count) {
        self.lift(&self.system.parameters_of_kind(ParameterKind::Armature));
        self.lift(&self.system.parameters_of_kind(ParameterKind::Damping));
        self.lift(&self.system.parameters_of_kind(ParameterKind::DryFriction));
        let which = self.system.all_parameters();
        let mut x = Linearisation::with_parameters(&self.system, &which).unwrap();
        let (mut ws, mut next) = (self.system.workspace(), self.system.state());
        self.system.linearise(&mut ws, &self.state, &self.input(), DT, &mut next, &mut x).unwrap();
        assert_eq!(x.P.ncols(), which.len());
        self.against_the_reverse_pass(name, &which, &x, &next);
        // A few columns of each kind.
        let mut rng = random(3);
        let values = which.values(&self.system).unwrap();
        let bounds: Vec<_> = which.bounds().collect();
        let names: Vec<_> = which.names().collect();
        for kind in KINDS {
            let all: Vec<usize> = (0..which.len()).filter(|k| which.kind(*k) == Some(kind)).collect();
            let many = all.len() > 40;
            let of_kind = all.iter().map(|k| x.P.column(*k).amax()).fold(0.0, f64::max);
            for &k in &all {
                if many && random_vector(1, 1.0, &mut rng)[0].abs() * all.len() as f64 > 40.0 {
                    continue;
                }
                let one = self.system.select_parameters(&[names[k]]).unwrap();
                let size = values[k].abs().max(if kind == ParameterKind::Effect { 1e-3 } else { 1.0 });
                let room = (values[k] - bounds[k][0]).min(bounds[k][1] - values[k]);
                let after = |h: f64| {
                    let mut system = self.system.clone();
                    system.set_parameters(&one, &[values[k] + h]).unwrap();
                    self.change(&system, &self.state, self.tau, &next)
                };
                let ours: Vec<f64> = x.P.column(k).iter().copied().collect();
                let agree = self.compare(&format!("{name}, {}", names[k]), &ours, of_kind, (size, room), &after);
                count.add(&format!("{kind:?}"), !agree);
            }
        }
        self.check_by_state(name, count, &x, &next);
    }

    /// The columns of A by q and v, and those of B.
    fn check_by_state(&self, name: &str, count: &mut Count, x: &Linearisation, next: &State) {
        let multibody = self.system.multibody();
        let (n, nz) = (multibody.nv(), next.z.len());
        for column in 0..3 * n {
            let after = |h: f64| {
                let (mut moved, mut tau) = (self.state.clone(), self.tau.to_vec());
                if column < n {
                    let mut dq = vec![0.0; n];
                    dq[column] = h;
                    multibody.integrate(&mut moved.q, &dq, 1.0).unwrap();
                } else if column < 2 * n {
                    moved.v[column - n] += h;
                } else {
                    tau[column - 2 * n] += h;
                }
                self.change(&self.system, &moved, &tau, next)
            };
            let (ours, what) =
                if column < 2 * n { (x.A.column(column), if column < n { "q" } else { "v" }) } else { (x.B.column(column - 2 * n), "tau") };
            let ours: Vec<f64> = ours.iter().copied().collect();
            assert_eq!(ours.len(), 2 * n + nz);
            let agree = self.compare(&format!("{name}, {what} {}", column % n), &ours, 1e-3, (0.1, f64::INFINITY), &after);
            count.add(what, !agree);
        }
    }

    /// Holds a column against differences of fourth order, at the step at which two of them agree; false where none do.
    fn compare(&self, name: &str, ours: &[f64], of_kind: f64, (size, room): (f64, f64), after: &dyn Fn(f64) -> Vec<f64>) -> bool {
        let largest = self.state.q.iter().chain(&self.state.v).chain(&self.state.z).fold(1.0, |m: f64, x| m.max(x.abs()));
        let difference = |h: f64| -> Option<Vec<f64>> {
            let [a, b, c, d] = if 2.01 * h <= room { [1.0, -1.0, 2.0, -2.0].map(|s| after(s * h)) } else { return None };
            Some((0..a.len()).map(|i| (8.0 * (a[i] - b[i]) - (c[i] - d[i])) / (12.0 * h)).collect())
        };
        // The step at which two agree best: near switches it must be small, and far from them large, or rounding drowns it.
        let mut best: Option<(f64, f64, f64, Vec<f64>)> = None;
        let mut coarse = difference(3e-4 * size);
        for h in [1e-4, 1e-5, 1e-6, 1e-7, 1e-8].map(|h| h * size) {
            let fine = difference(h);
            if let (Some(a), Some(b)) = (&coarse, &fine) {
                let spread = a.iter().zip(b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
                let size = b.iter().fold((0.01 * of_kind).max(1e-9), |m: f64, b| m.max(b.abs()));
                if best.as_ref().is_none_or(|(least, ..)| spread < *least) {
                    best = Some((spread, size, self.resolution * largest / h, b.clone()));
                }
                if spread <= 2e-8 * size {
                    break;
                }
            }
            coarse = fine;
        }
        let agreed = best.filter(|(spread, size, noise, _)| *spread <= 2e-7 * size + noise);
        if let Some((spread, size, noise, expected)) = agreed {
            for (i, (ours, expected)) in ours.iter().zip(&expected).enumerate() {
                let good = (ours - expected).abs() < 1e-6 * size + noise;
                assert!(good, "{name}, row {i}: {ours} against {expected} (of {size}, noise {noise:.1e}, spread {spread:.1e})");
            }
            return true;
        }
        println!("{name}: at a switch");
        false
    }

    /// From `next` to where a step leads, as a tangent.
    fn change(&self, system: &System, state: &State, tau: &[f64], next: &State) -> Vec<f64> {
        let (mut ws, mut moved) = (system.workspace(), state.clone());
        system.step(&mut ws, &mut moved, &Input { tau, external: self.external }, DT).unwrap();
        let mut change = vec![0.0; system.multibody().nv()];
        system.multibody().difference(&next.q, &moved.q, &mut change).unwrap();
        change.extend(moved.v.iter().chain(&moved.z).zip(next.v.iter().chain(&next.z)).map(|(a, b)| a - b));
        change
    }

    /// `P^T` times a cotangent is the reverse pass' gradient.
    fn against_the_reverse_pass(&self, name: &str, which: &ParameterVector, x: &Linearisation, next: &State) {
        let n = self.system.multibody().nv();
        let bar = random_vector(2 * n + next.z.len(), 1.0, &mut random(9));
        let links: Vec<_> = self.external.iter().map(|e| e.link).collect();
        let wrenches: Vec<_> = self.external.iter().map(|e| e.F_W).collect();
        let inputs = Inputs { tau: self.tau, links: &links, wrenches: &wrenches };
        let mut rollout = Rollout::new(&self.system, RolloutOptions { links: links.len(), ..RolloutOptions::new(1, DT) }).unwrap();
        rollout.forward(&self.system, &self.state, &inputs, |_, _| {}).unwrap();
        rollout
            .backward(&self.system, &inputs, |k, _, to| {
                if k == 1 {
                    to.q.copy_from_slice(&bar[..n]);
                    to.v.copy_from_slice(&bar[n..2 * n]);
                    to.z.copy_from_slice(&bar[2 * n..]);
                }
            })
            .unwrap();
        let reverse = rollout.gradient().parameters(&self.system, which).unwrap();
        for ((k, reverse), name_of) in reverse.iter().enumerate().zip(which.names()) {
            let forward: f64 = x.P.column(k).iter().zip(&bar).map(|(p, b)| p * b).sum();
            let size = x.P.column(k).iter().zip(&bar).map(|(p, b)| (p * b).abs()).sum::<f64>();
            assert!((forward - reverse).abs() < 1e-9 * size + 1e-13, "{name}, {name_of}: forward {forward}, reverse {reverse}");
        }
    }
}

fn effect(name: &str, joint: &str, parameters: &[(&str, f64)]) -> EffectEntry {
    let parameters = parameters.iter().map(|(n, v)| ((*n).into(), *v)).collect();
    EffectEntry { effect: name.into(), joint: Some(joint.into()), parameters, ..EffectEntry::default() }
}

#[test]
fn columns_of_every_kind_of_joint_agree_with_differences_and_the_reverse_pass() {
    let (mut rng, mut count) = (random(21), Count::default());
    for followers in [false, true] {
        for coriolis in SCHEMES {
            let zoo = menagerie(followers);
            let mut system = System::new(&[welded(&zoo), Part { name: "free".into(), ..Part::floating(&zoo) }]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            (state.q, state.v) = random_state(system.multibody(), &mut rng);
            let tau = random_vector(system.multibody().nv(), 3.0, &mut rng);
            let F_W = SpatialVector::from_column_slice(&random_vector(6, 3.0, &mut rng));
            let external = [ExternalWrench { link: system.multibody().link("free/e").unwrap(), F_W }];
            Case { system, state, tau: &tau, external: &external, resolution: 2e-15 }
                .check(&format!("{coriolis:?}, followers {followers}"), &mut count);
        }
    }
    count.print("joints");
    assert!(count.share() < 0.05, "{}", count.share());
}

fn middling(prior: &Prior) -> f64 {
    match *prior {
        Prior::LogNormal { median, .. } => median,
        Prior::Normal { mean, deviation } => mean + 0.3 * deviation,
        Prior::OneOf(choices) => choices[0],
    }
}

#[test]
fn columns_of_every_effect_agree_with_differences_and_the_reverse_pass() {
    let mut count = Count::default();
    for described in catalogue() {
        let d = described.description();
        let numbers = d.parameters.iter().filter(|p| p.words.is_empty());
        let parameters: Vec<(&str, f64)> = numbers.map(|p| (p.name, middling(&p.prior[0]).clamp(p.bounds[0], p.bounds[1]))).collect();
        for coriolis in SCHEMES {
            let mut arm = panda();
            let mut entry = effect(d.name, "panda_joint4", &parameters);
            entry.joint = entry.joint.filter(|_| d.acts != Acts::Base);
            arm.document.effects.push(entry);
            let mut system = System::new(&[welded(&arm)]).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            state.q.copy_from_slice(&[0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7, 0.02, 0.015]);
            state.v.copy_from_slice(&[0.2, 0.5, -0.3, 0.4, 0.6, -0.7, 0.5, 0.3, 0.2]);
            let tau = [2.0, -20.0, 1.0, 15.0, 1.0, 2.0, 0.5, 1.0, 1.0];
            // A few steps fill the inner states.
            let mut ws = system.workspace();
            for _ in 0..3 {
                system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, DT).unwrap();
            }
            Case { system, state, tau: &tau, external: &[], resolution: 2e-15 }.check(&format!("{}, {coriolis:?}", d.name), &mut count);
        }
    }
    count.print("effects");
    assert!(count.share() < 0.05, "{}", count.share());
}

#[test]
fn columns_of_a_learned_residual_agree_with_differences_and_the_reverse_pass() {
    let (mut rng, mut count) = (random(84), Count::default());
    for coriolis in SCHEMES {
        let zoo = menagerie(true);
        let mut system = System::new(&[welded(&zoo)]).unwrap();
        system.set_coriolis(coriolis);
        let mut residual = Residual::new(system.multibody(), &["ja", "jc", "jd", "je"], &["jb", "jd"], &[6], Activation::Tanh, 2).unwrap();
        residual.set_weights(&random_vector(residual.network().weights().len(), 0.5, &mut rng)).unwrap();
        system.set_residual(Some(&residual)).unwrap();
        let mut state = system.state();
        (state.q, state.v) = random_state(system.multibody(), &mut rng);
        let tau = random_vector(system.multibody().nv(), 3.0, &mut rng);
        Case { system, state, tau: &tau, external: &[], resolution: 2e-15 }.check(&format!("residual, {coriolis:?}"), &mut count);
    }
    count.print("residual");
    assert!(count.share() < 0.05 && count.of(ParameterKind::Residual) > 20);
}

/// A body with a shape that sits on a link of its own, fixed to the body.
fn shaped(name: &str, shape: &str) -> ObjectModel {
    model(
        name,
        &format!(
            "<link name='{name}'><inertial><mass value='0.6'/><inertia ixx='4e-3' ixy='1e-4' ixz='0' iyy='5e-3' iyz='2e-4' izz='6e-3'/></inertial></link>\
             <link name='pad'><inertial><origin xyz='0.01 0 0.02'/><mass value='0.2'/><inertia ixx='1e-4' ixy='0' ixz='0' iyy='2e-4' iyz='0' izz='3e-4'/>\
             </inertial><collision><origin xyz='0.002 0.001 -0.003' rpy='0.02 0.01 0.3'/><geometry>{shape}</geometry></collision></link>\
             <joint name='glue' type='fixed'><parent link='{name}'/><child link='pad'/><origin xyz='0.003 -0.002 0.001' rpy='0.1 -0.05 0.2'/></joint>"
        ),
    )
}

fn mesh(path: &str) -> String {
    let models = common::root().join("world-models").canonicalize().unwrap();
    format!("<mesh filename='{}'/>", models.join(path).display())
}

/// Lets a body fall onto the plate of [`slab`], and holds the step's derivatives there; `sways`: the plate's base gives way.
fn check_on_plate(name: &str, plate: &str, shape: &str, height: f64, sways: bool, count: &mut Count) {
    for coriolis in SCHEMES {
        for (how, speed) in [("rests", 0.0), ("slides", 0.4)] {
            let (mut table, body) = (slab(plate), shaped("thing", shape));
            if sways {
                let mut entry = effect("unmodelled_mode", "", &[("frequency", 6.0), ("damping_ratio", 0.1), ("mass", 12.0)]);
                entry.joint = None;
                entry.choices = [("direction".into(), "z".into())].into();
                table.document.effects.push(entry);
            }
            let parts = [welded(&table), Part::floating(&body)];
            let material = ContactMaterial { friction: 0.4, stiffness: 2e4, dissipation: 1.0 };
            let options = ContactOptions { material, ..ContactOptions::default() };
            let mut system = System::new(&parts).unwrap().with_contacts(&parts, options).unwrap();
            system.add_ground("ground", Vector3::new(0.0, 0.0, -0.3), Vector3::z_axis(), material).unwrap();
            system.set_coriolis(coriolis);
            let mut state = system.state();
            // It falls onto the plate, which a joint carries.
            let turn = nalgebra::Vector4::new(0.99, 0.05, -0.02, 0.1).normalize();
            state.q[1..5].copy_from_slice(turn.as_slice());
            state.q[5..8].copy_from_slice(&[0.05, 0.02, height]);
            let mut ws = system.workspace();
            for k in 0..900 {
                system.step(&mut ws, &mut state, &Input::default(), DT).unwrap();
                if k > 60 && ws.contacts(&system).filter(|c| c.depth > 1e-6).count() > 0 && k % 50 == 0 {
                    break;
                }
            }
            assert!(ws.contacts(&system).any(|c| c.depth > 0.0), "{name} must touch");
            state.v[4] += speed;
            state.v[5] += 0.7 * speed;
            state.v[0] += 0.1 * speed;
            let tau = vec![0.3; system.multibody().nv()];
            Case { system, state, tau: &tau, external: &[], resolution: 2e-12 }.check(&format!("{name} {how}, {coriolis:?}"), count);
        }
    }
}

const PLATE: &str = "<box size='0.5 0.5 0.04'/>";

#[test]
fn columns_through_contact_agree_with_differences_and_the_reverse_pass() {
    let mut count = Count::default();
    check_on_plate("box", PLATE, "<box size='.1 .12 .08'/>", 0.09, false, &mut count);
    check_on_plate("ball", PLATE, "<sphere radius='.05'/>", 0.09, false, &mut count);
    check_on_plate("capsule", PLATE, "<capsule radius='.03' length='.06'/>", 0.09, false, &mut count);
    check_on_plate("cylinder", PLATE, "<cylinder radius='.04' length='.08'/>", 0.09, false, &mut count);
    count.print("contact");
    for kind in KINDS {
        assert!(count.of(kind) > 10 || matches!(kind, ParameterKind::Effect | ParameterKind::Residual), "{kind:?}");
    }
    println!("{:.3} at a switch", count.share());
    assert!(count.share() < 0.1, "{}", count.share());
}

#[test]
fn columns_through_contact_of_real_meshes_agree_with_differences_and_the_reverse_pass() {
    let mut count = Count::default();
    let (mug, handle) = (mesh("mug/2246cc78b49d/meshes/body.stl"), mesh("drawer/c2a2d25b1f01/meshes/drawerhandle.stl"));
    check_on_plate("hull on box", PLATE, &mug, 0.16, false, &mut count);
    check_on_plate("hull on hull", &mug, &handle, 0.2, false, &mut count);
    check_on_plate("hull on plane", "<box size='0.01 0.01 0.01'/>", &handle, 0.1, false, &mut count);
    count.print("meshes");
    assert!(count.share() < 0.1, "{}", count.share());
}

#[test]
fn columns_through_contact_on_a_base_that_gives_way_agree_with_differences_and_the_reverse_pass() {
    let mut count = Count::default();
    check_on_plate("box, base", PLATE, "<box size='.1 .12 .08'/>", 0.09, true, &mut count);
    count.print("contact and base");
    assert!(count.share() < 0.1, "{}", count.share());
}

/// A plate on a hinge with a spring and losses, fixed together from two links.
fn slab(plate: &str) -> ObjectModel {
    let inertial = "<inertial><origin xyz='0.02 0.01 0'/><mass value='3'/><inertia ixx='.02' ixy='0' ixz='0.001' iyy='.02' iyz='0' izz='.03'/></inertial>";
    let mut slab = model(
        "slab",
        &format!(
            "<link name='wall'/><link name='arm'>{inertial}</link><link name='plate'>{inertial}\
             <collision><geometry>{plate}</geometry></collision></link>\
             <joint name='hinge' type='revolute'><parent link='wall'/><child link='arm'/><axis xyz='0.1 1 0.05'/><origin xyz='-0.2 0 0' rpy='0.01 0 0'/>\
             <limit lower='-2' upper='2' velocity='9' effort='99'/><dynamics damping='0.2' friction='0.01'/></joint>\
             <joint name='weld' type='fixed'><parent link='arm'/><child link='plate'/><origin xyz='0.2 0 0' rpy='0.005 0.01 0.1'/></joint>"
        ),
    );
    slab.document.effects.push(effect("joint_spring", "hinge", &[("stiffness", 300.0), ("rest_position", -0.03)]));
    slab
}

#[test]
fn columns_through_a_grasp_and_on_a_base_that_gives_way_agree_with_the_reverse_pass() {
    let mut count = Count::default();
    for coriolis in SCHEMES {
        let (mut arm, body) = (panda(), shaped("thing", "<sphere radius='.02'/>"));
        let mut entry = effect("unmodelled_mode", "", &[("frequency", 6.0), ("damping_ratio", 0.1), ("mass", 12.0)]);
        entry.joint = None;
        entry.choices = [("direction".into(), "y".into())].into();
        arm.document.effects.push(entry);
        let parts = [Part::welded(&arm, Isometry3::identity()), Part::floating(&body)];
        let mut system = System::new(&parts).unwrap();
        system.set_coriolis(coriolis);
        let multibody = system.multibody();
        let (hand, held) = (multibody.link("panda_hand").unwrap(), multibody.link("thing/pad").unwrap());
        let mut state = system.state();
        state.q[..9].copy_from_slice(&[0.1, -0.7, 0.2, -2.2, 0.1, 1.5, 0.7, 0.02, 0.015]);
        state.v[..9].copy_from_slice(&[0.2, 0.5, -0.3, 0.4, 0.6, -0.7, 0.5, 0.01, 0.02]);
        state.z.copy_from_slice(&[3e-3, -0.08]);
        let mut rigid = multibody.workspace();
        multibody.set_state(&mut rigid, &state.q, &state.v).unwrap();
        let X = multibody.X_WL(&rigid, hand) * Isometry3::translation(0.01, -0.005, 0.1);
        let R = X.rotation;
        state.q[9..16].copy_from_slice(&[R.w, R.i, R.j, R.k, X.translation.x, X.translation.y, X.translation.z]);
        let grasp = Grasp {
            a: hand,
            X_AG: Isometry3::translation(0.0, 0.0, 0.1),
            b: held,
            X_BH: Isometry3::identity(),
            stiffness: nalgebra::Vector6::new(20.0, 30.0, 10.0, 3e3, 2e3, 4e3),
            damping: nalgebra::Vector6::new(0.1, 0.1, 0.1, 10.0, 10.0, 10.0),
            limit: [5.0, 60.0],
        };
        system.add_grasp(grasp).unwrap();
        let tau = vec![0.5; system.multibody().nv()];
        Case { system, state, tau: &tau, external: &[], resolution: 2e-15 }.check(&format!("grasp, {coriolis:?}"), &mut count);
    }
    count.print("grasp");
    assert!(count.share() < 0.05, "{}", count.share());
}

#[test]
fn readings_have_the_derivatives_of_their_differences() {
    let mut compared = 0;
    let mut arm = panda();
    // All at once: what one effect gives is what the next one takes.
    for described in catalogue() {
        let d = described.description();
        if !matches!(d.acts, Acts::Measurement(_)) && d.parameter("encoder").is_none() {
            continue;
        }
        let numbers = d.parameters.iter().filter(|p| p.words.is_empty());
        let parameters: Vec<(&str, f64)> = numbers.map(|p| (p.name, middling(&p.prior[0]).clamp(p.bounds[0], p.bounds[1]))).collect();
        let mut entry = effect(d.name, "panda_joint4", &parameters);
        if d.parameter("encoder").is_some() {
            entry.choices = [("encoder".into(), "motor".into())].into();
        }
        arm.document.effects.push(entry);
    }
    let system = System::new(&[welded(&arm)]).unwrap();
    let mut state = system.state();
    state.v = random_vector(9, 0.5, &mut random(1));
    state.z = random_vector(state.z.len(), 1e-2, &mut random(2));
    state.time = 3.0;
    let which = system.select_parameters(&["*/panda_joint4.*"]).unwrap();
    let mut out = MeasurementDerivatives::new(&system, &which).unwrap();
    for v in [3, 5] {
        let effort = 1.7;
        let read = |system: &System, state: &State, effort: f64| {
            let r = system.measure(state, effort, v);
            [r.position.value, r.velocity.value, r.effort.value, r.stamp.value]
        };
        let reading = system.measure_derivatives(&state, effort, v, &mut out).unwrap();
        assert_eq!(reading, system.measure(&state, effort, v));
        let mut compare = |what: &str, ours: [f64; 4], after: &dyn Fn(f64) -> [f64; 4], h: f64| {
            let (up, down) = (after(h), after(-h));
            for k in 0..4 {
                let difference = (up[k] - down[k]) / (2.0 * h);
                assert!((ours[k] - difference).abs() < 1e-6 * (1e-2 + difference.abs()), "{what}, {k}: {} {difference}", ours[k]);
            }
            compared += usize::from(ours != [0.0; 4]);
        };
        let moved = |change: &dyn Fn(&mut State)| {
            let mut moved = state.clone();
            change(&mut moved);
            moved
        };
        compare("q", out.d_q, &|h| read(&system, &moved(&|s| s.q[v] += h), effort), 1e-5);
        compare("v", out.d_v, &|h| read(&system, &moved(&|s| s.v[v] += h), effort), 1e-5);
        compare("effort", out.d_effort, &|h| read(&system, &state, effort + h), 1e-5);
        for k in 0..state.z.len() {
            compare(
                "z",
                out.d_z.column(k).fixed_rows::<4>(0).into_owned().into(),
                &|h| read(&system, &moved(&|s| s.z[k] += h), effort),
                1e-6,
            );
        }
        let values = which.values(&system).unwrap();
        for (k, name) in which.names().enumerate() {
            let after = |h: f64| {
                let (mut system, mut values) = (system.clone(), values.clone());
                values[k] += h;
                system.set_parameters(&which, &values).unwrap();
                read(&system, &state, effort)
            };
            // Armatures and losses are at their least values, and no sensor answers to them.
            if values[k] != 0.0 || name.contains("offset") {
                compare(name, out.d_theta.column(k).fixed_rows::<4>(0).into_owned().into(), &after, 1e-4 * values[k].abs().min(1e-2));
            }
        }
    }
    assert!(compared > 12, "{compared}");
    assert!(system.measure_derivatives(&state, 0.0, 99, &mut out).is_err());
}
