//! Differential dynamic programming: against the Riccati recursion, another solver's optimum, limits, and guesses that do not hang
//! together.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

use std::path::{Path, PathBuf};

use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};
use sagci_dynamics::{Coriolis, Input, Part, State, System};
use sagci_model::ObjectModel;
use sagci_planning::{Cost, Ddp, DdpEnd, DdpOptions, Knot, PlanError, Quadratic, ReachCost, ReachWeights};

fn peers() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/peers/models")
}

/// Two carts on one rail, the second upon the first: a linear system.
fn carts() -> System {
    let link = |name: &str, mass: f64| {
        format!(
            "<link name='{name}'><inertial><mass value='{mass}'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>"
        )
    };
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            "<joint name='{name}' type='prismatic'><parent link='{parent}'/><child link='{child}'/><axis xyz='1 0 0'/>\
             <limit lower='-1e3' upper='1e3' velocity='1e3' effort='1e3'/></joint>"
        )
    };
    let urdf = link("rail", 1.0) + &link("a", 2.0) + &link("b", 0.5) + &joint("first", "rail", "a") + &joint("second", "a", "b");
    let folder = std::env::temp_dir().join(format!("carts-{}-{:?}", std::process::id(), std::thread::current().id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("object.urdf");
    std::fs::write(&path, format!("<robot name='carts'>{urdf}</robot>")).unwrap();
    let model = ObjectModel::read_urdf(&path).unwrap();
    std::fs::remove_dir_all(folder).unwrap();
    System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap()
}

/// `(x - goal) . X (x - goal) / 2 + x . N u + u . U u / 2`, and at the end the first term alone.
struct Regulator {
    X: DMatrix<f64>,
    U: DMatrix<f64>,
    N: DMatrix<f64>,
    goal: DVector<f64>,
}

impl Regulator {
    fn new() -> Self {
        let X = DMatrix::from_row_slice(4, 4, &[3.0, 0.4, 0.1, 0.0, 0.4, 2.0, 0.0, 0.2, 0.1, 0.0, 0.5, 0.1, 0.0, 0.2, 0.1, 0.4]);
        let N = DMatrix::from_row_slice(4, 2, &[0.01, 0.02, -0.01, 0.0, 0.03, 0.01, 0.0, 0.02]);
        Self { X, U: DMatrix::from_row_slice(2, 2, &[0.05, 0.01, 0.01, 0.08]), N, goal: DVector::from_vec(vec![0.5, -0.3, 0.0, 0.0]) }
    }
}

fn flat(state: &State) -> DVector<f64> {
    DVector::from_iterator(state.q.len() + state.v.len(), state.q.iter().chain(&state.v).copied())
}

impl Cost for Regulator {
    fn running(&mut self, knot: &mut Knot<'_>, u: &[f64], model: &mut Quadratic) -> Result<f64, PlanError> {
        let (x, u) = (flat(knot.state), DVector::from_column_slice(u));
        let away = &x - &self.goal;
        model.x = &self.X * &away + &self.N * &u;
        model.u = &self.U * &u + self.N.tr_mul(&x);
        (model.xx, model.uu, model.xu) = (self.X.clone(), self.U.clone(), self.N.clone());
        Ok(0.5 * away.dot(&(&self.X * &away)) + x.dot(&(&self.N * &u)) + 0.5 * u.dot(&(&self.U * &u)))
    }

    fn terminal(&mut self, knot: &mut Knot<'_>, model: &mut Quadratic) -> Result<f64, PlanError> {
        let away = flat(knot.state) - &self.goal;
        model.clear();
        model.x = &self.X * &away;
        model.xx = self.X.clone();
        Ok(0.5 * away.dot(&(&self.X * &away)))
    }
}

fn start(system: &System) -> State {
    let mut x0 = system.state();
    x0.q.copy_from_slice(&[-0.2, 0.7]);
    x0.v.copy_from_slice(&[0.3, -0.1]);
    x0
}

/// A and B of the carts: sums of masses move with the first, the second moves relative to it.
fn linear(dt: f64) -> (DMatrix<f64>, DMatrix<f64>) {
    let inverse = DMatrix::from_row_slice(2, 2, &[2.5, 0.5, 0.5, 0.5]).try_inverse().unwrap();
    let (mut A, mut B) = (DMatrix::identity(4, 4), DMatrix::zeros(4, 2));
    A.view_mut((0, 2), (2, 2)).copy_from(&(DMatrix::identity(2, 2) * dt));
    B.view_mut((0, 0), (2, 2)).copy_from(&(&inverse * dt * dt));
    B.view_mut((2, 0), (2, 2)).copy_from(&(&inverse * dt));
    (A, B)
}

#[test]
fn a_linear_quadratic_problem_is_solved_in_one_round_with_riccatis_gains() {
    let (system, mut cost, knots, dt) = (carts(), Regulator::new(), 40, 0.05);
    let mut ddp = Ddp::new(&system, DdpOptions { tolerance: 1e-10, ..DdpOptions::new(knots, dt) }).unwrap();
    // From a guess that does not hang together, too.
    let mut guess = vec![start(&system); knots + 1];
    for (k, state) in guess.iter_mut().enumerate() {
        state.q[0] += (k as f64 * 0.7).sin();
        state.v[1] -= (k as f64 * 1.3).cos();
    }
    let (A, B) = linear(dt);
    let mut costs = Vec::new();
    for states in [None, Some(&guess[..])] {
        let summary = ddp.solve(&system, &mut cost, &start(&system), &vec![0.7; 2 * knots], states).unwrap();
        assert_eq!((summary.end, summary.iterations, summary.gap), (DdpEnd::Converged, 1, 0.0));
        costs.push(summary.cost);
        let mut P = cost.X.clone();
        let mut K = DMatrix::zeros(2, 4);
        for k in (0..knots).rev() {
            let Quu = &cost.U + B.tr_mul(&(&P * &B));
            let Qux = cost.N.transpose() + B.tr_mul(&(&P * &A));
            let gain = -Quu.cholesky().unwrap().solve(&Qux);
            ddp.feedback(k, &mut K).unwrap();
            assert!((&K - &gain).amax() < 1e-10 * gain.amax(), "knot {k}: {K} against {gain}");
            P = &cost.X + A.tr_mul(&(&P * &A)) + Qux.tr_mul(&gain);
        }
        // The trajectory is the system's own.
        let (mut ws, mut state) = (system.workspace(), start(&system));
        for k in 0..knots {
            system.step(&mut ws, &mut state, &Input { tau: ddp.control(k), external: &[] }, dt).unwrap();
            assert!((flat(&state) - flat(&ddp.states()[k + 1])).amax() < 1e-12);
        }
    }
    assert!((costs[0] - costs[1]).abs() < 1e-9 * costs[0], "{costs:?}");
}

/// The arm of the peers' comparison: free of friction and away from limits, Coriolis forces at the start of a step.
fn arm() -> System {
    let mut model = ObjectModel::read_urdf(peers().join("panda_arm.urdf")).unwrap();
    for joint in &mut model.joints {
        joint.damping = 0.0;
        (joint.limits.lower, joint.limits.upper) = (f64::NEG_INFINITY, f64::INFINITY);
    }
    let mut system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
    system.set_coriolis(Coriolis::AtStart);
    system
}

const RUNNING: ReachWeights = ReachWeights { pose: 1.0, state: 1e-2, effort: 1e-4 };
const TERMINAL: ReachWeights = ReachWeights { pose: 1e3, state: 1e-1, effort: 0.0 };
const KNOTS: usize = 100;
const DT: f64 = 0.01;

fn goal() -> Isometry3<f64> {
    let R = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, 0.0));
    Isometry3::from_parts(Translation3::new(0.62, 0.0, 0.6), UnitQuaternion::from_rotation_matrix(&R))
}

/// The reach, its start, and the efforts that hold it there.
fn reach(system: &System) -> (ReachCost, State, Vec<f64>) {
    let mut x0 = system.state();
    x0.q.copy_from_slice(&[0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.8]);
    let (mut rigid, mut tau) = (system.multibody().workspace(), vec![0.0; 7]);
    system.multibody().set_positions(&mut rigid, &x0.q).unwrap();
    system.multibody().gravity_efforts(&mut rigid, &mut tau).unwrap();
    let cost = ReachCost::new(system, "panda_hand", &goal(), &x0, RUNNING, TERMINAL).unwrap();
    (cost, x0, tau)
}

fn pose_error(system: &System, state: &State) -> f64 {
    let mut rigid = system.multibody().workspace();
    system.multibody().set_positions(&mut rigid, &state.q).unwrap();
    let X = system.multibody().X_WL(&rigid, system.multibody().link("panda_hand").unwrap());
    (X.translation.vector - goal().translation.vector).norm() + X.rotation.angle_to(&goal().rotation)
}

#[test]
fn the_arm_reaches_at_the_cost_that_crocoddyl_finds() {
    let system = arm();
    let (mut cost, x0, tau) = reach(&system);
    let mut ddp = Ddp::new(&system, DdpOptions::new(KNOTS, DT)).unwrap();
    let summary = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    assert_eq!(summary.end, DdpEnd::Converged);
    // Crocoddyl 3.2.1, SolverFDDP, 6 iterations: tests/peers/side_by_side.py.
    assert!((summary.cost - CROCODDYL).abs() < 1e-7, "{summary:?}");
    assert!(summary.iterations <= 6, "{summary:?}");
    assert!(pose_error(&system, &ddp.states()[KNOTS]) < 0.02);
}

const CROCODDYL: f64 = 0.406_968_759;

#[test]
fn a_guess_whose_states_do_not_follow_from_its_controls_ends_in_the_same_reach() {
    let system = arm();
    let (mut cost, x0, tau) = reach(&system);
    let mut ddp = Ddp::new(&system, DdpOptions { tolerance: 1e-9, ..DdpOptions::new(KNOTS, DT) }).unwrap();
    let near = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    // Straight in the joints to somewhere else, held up as if at the start.
    let guess: Vec<State> = (0..=KNOTS)
        .map(|k| {
            let mut state = x0.clone();
            state.q.iter_mut().enumerate().for_each(|(i, q)| *q += 0.4 * k as f64 / KNOTS as f64 * (i as f64 - 3.0) / 3.0);
            state
        })
        .collect();
    let far = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), Some(&guess)).unwrap();
    assert_eq!((far.end, far.gap), (DdpEnd::Converged, 0.0));
    assert!((near.cost - far.cost).abs() < 1e-7, "{near:?}, {far:?}");
}

#[test]
fn controls_stay_within_their_limits_and_what_is_held_there_has_no_gain() {
    // The first cart could do with more, and the second has no drive.
    let (system, mut cost, knots) = (carts(), Regulator::new(), 40);
    let limits = [vec![-1.5, 0.0], vec![2.5, 0.0]];
    let options = DdpOptions { limits: Some(limits.clone()), tolerance: 1e-12, ..DdpOptions::new(knots, 0.05) };
    let mut ddp = Ddp::new(&system, options).unwrap();
    let x0 = start(&system);
    let summary = ddp.solve(&system, &mut cost, &x0, &vec![5.0; 2 * knots], None).unwrap();
    assert_eq!(summary.end, DdpEnd::Converged);
    let total = |controls: &[f64]| {
        let (mut ws, mut state, mut cost, mut model) = (system.workspace(), x0.clone(), Regulator::new(), None);
        let mut rigid = system.multibody().workspace();
        let mut sum = 0.0;
        for k in 0..=knots {
            let model = model.get_or_insert_with(|| Quadratic {
                x: DVector::zeros(4),
                u: DVector::zeros(2),
                xx: DMatrix::zeros(4, 4),
                uu: DMatrix::zeros(2, 2),
                xu: DMatrix::zeros(4, 2),
            });
            let mut knot = Knot { index: k, dt: 0.05, system: &system, state: &state.clone(), rigid: &mut rigid };
            if k == knots {
                return sum + cost.terminal(&mut knot, model).unwrap();
            }
            let u = &controls[2 * k..2 * k + 2];
            sum += cost.running(&mut knot, u, model).unwrap();
            system.step(&mut ws, &mut state, &Input { tau: u, external: &[] }, 0.05).unwrap();
        }
        sum
    };
    let best: Vec<f64> = (0..knots).flat_map(|k| ddp.control(k).to_vec()).collect();
    assert!((total(&best) - summary.cost).abs() < 1e-12);
    let (mut held, mut K) = (0, DMatrix::zeros(2, 4));
    for k in 0..knots {
        let u = best[2 * k];
        assert!((-1.5..=2.5).contains(&u) && best[2 * k + 1] == 0.0, "knot {k}: {:?}", ddp.control(k));
        ddp.feedback(k, &mut K).unwrap();
        assert!(K.row(1).amax() == 0.0);
        // The problem is convex: no control may lower the cost alone.
        let mut other = best.clone();
        let mut slope = 0.0;
        for side in [1.0, -1.0] {
            other[2 * k] = u + side * 1e-4;
            slope += side * total(&other) / 2e-4;
        }
        if u == 2.5 || u == -1.5 {
            held += 1;
            assert!(slope * u < 0.0, "knot {k}: slope {slope} at {u}");
            assert!(K.row(0).amax() == 0.0, "knot {k}");
        } else {
            assert!(slope.abs() < 1e-5, "knot {k}: slope {slope} at {u}");
        }
    }
    assert!(held > 2 && held < knots - 2, "{held} controls at their limits");
}

#[test]
fn the_arm_reaches_with_less_effort_than_it_would_like() {
    let system = arm();
    let (_, x0, tau) = reach(&system);
    let running = ReachWeights { effort: 1e-2, ..RUNNING };
    let mut cost = ReachCost::new(&system, "panda_hand", &goal(), &x0, running, TERMINAL).unwrap();
    let mut ddp = Ddp::new(&system, DdpOptions::new(KNOTS, DT)).unwrap();
    let free = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    assert_eq!(free.end, DdpEnd::Converged);
    let most = (0..KNOTS).fold(0.0_f64, |m, k| m.max(ddp.control(k)[0].abs()));
    let mut limits = [vec![-87.0; 7], vec![87.0; 7]];
    (limits[0][0], limits[1][0]) = (-0.7 * most, 0.7 * most);
    let mut ddp = Ddp::new(&system, DdpOptions { limits: Some(limits), ..DdpOptions::new(KNOTS, DT) }).unwrap();
    let held = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    assert_eq!(held.end, DdpEnd::Converged);
    assert!((0..KNOTS).all(|k| ddp.control(k)[0].abs() <= 0.7 * most));
    assert!((0..KNOTS).any(|k| ddp.control(k)[0].abs() == 0.7 * most));
    assert!(held.cost > free.cost && pose_error(&system, &ddp.states()[KNOTS]) < 0.05);
}

#[test]
fn the_same_problem_gives_the_same_bits() {
    let system = arm();
    let (mut cost, x0, tau) = reach(&system);
    let mut ddp = Ddp::new(&system, DdpOptions::new(KNOTS, DT)).unwrap();
    let first = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    let controls = ddp.control(KNOTS / 2).to_vec();
    let again = ddp.solve(&system, &mut cost, &x0, &tau.repeat(KNOTS), None).unwrap();
    assert_eq!(first, again);
    assert_eq!(controls, ddp.control(KNOTS / 2));
}

/// A cost that has no value.
struct Nothing;

impl Cost for Nothing {
    fn running(&mut self, _: &mut Knot<'_>, _: &[f64], model: &mut Quadratic) -> Result<f64, PlanError> {
        model.clear();
        Ok(f64::NAN)
    }
    fn terminal(&mut self, _: &mut Knot<'_>, model: &mut Quadratic) -> Result<f64, PlanError> {
        model.clear();
        Ok(0.0)
    }
}

#[test]
fn wrong_lengths_and_numbers_that_are_none_are_told() {
    let (system, mut cost) = (carts(), Regulator::new());
    let x0 = start(&system);
    let bad = |result: Result<_, PlanError>, word: &str| match result {
        Err(PlanError::BadInput { message }) => assert!(message.contains(word), "{message}"),
        other => panic!("{word}: {:?}", other.map(|_: ()| ())),
    };
    for (options, word) in [
        (DdpOptions::new(0, 0.1), "knot"),
        (DdpOptions::new(5, f64::NAN), "time step"),
        (DdpOptions { tolerance: -1.0, ..DdpOptions::new(5, 0.1) }, "tolerance"),
        (DdpOptions { limits: Some([vec![0.0], vec![1.0]]), ..DdpOptions::new(5, 0.1) }, "limits"),
        (DdpOptions { limits: Some([vec![0.0, 2.0], vec![1.0, 1.0]]), ..DdpOptions::new(5, 0.1) }, "control 1"),
    ] {
        bad(Ddp::new(&system, options).map(|_| ()), word);
    }
    let mut ddp = Ddp::new(&system, DdpOptions::new(5, 0.1)).unwrap();
    bad(ddp.solve(&system, &mut cost, &x0, &[0.0; 9], None).map(|_| ()), "9 controls");
    bad(ddp.solve(&system, &mut cost, &x0, &[0.0; 10], Some(std::slice::from_ref(&x0))).map(|_| ()), "1 states");
    bad(ddp.solve(&system, &mut cost, &x0, &[f64::NAN; 10], None).map(|_| ()), "finite");
    let mut lost = x0.clone();
    lost.v[0] = f64::INFINITY;
    bad(ddp.solve(&system, &mut cost, &lost, &[0.0; 10], None).map(|_| ()), "finite");
    lost.v.push(0.0);
    bad(ddp.solve(&system, &mut cost, &lost, &[0.0; 10], None).map(|_| ()), "another system");
    bad(ddp.solve(&arm(), &mut cost, &x0, &[0.0; 10], None).map(|_| ()), "another system");
    bad(ddp.feedback(5, &mut DMatrix::zeros(2, 4)), "knot 5");
    bad(ddp.feedback(0, &mut DMatrix::zeros(4, 2)), "4 x 2");
    assert!(ddp.control(5).is_empty());
    let nothing = ddp.solve(&system, &mut Nothing, &x0, &[0.0; 10], None);
    assert!(matches!(nothing, Err(PlanError::NoConvergence { .. })), "{nothing:?}");
    let x0 = arm().state();
    let nowhere = ReachCost::new(&arm(), "panda_foot", &goal(), &x0, RUNNING, TERMINAL);
    bad(nowhere.map(|_| ()), "panda_foot");
    let backwards = ReachWeights { pose: -1.0, ..RUNNING };
    bad(ReachCost::new(&arm(), "panda_hand", &goal(), &x0, backwards, TERMINAL).map(|_| ()), "weight");
}
