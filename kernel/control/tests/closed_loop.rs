//! The laws in a closed loop with our own dynamics of the arm that ships, at 1 kHz.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

use std::path::PathBuf;

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use sagci_control::{
    ArmModel, CartesianImpedance, CartesianReference, ControlError, Damping, JointImpedance, JointReference, Payload, Posture, WrenchFilter,
};
use sagci_dynamics::{ExternalWrench, Input, LinkId, Multibody, Part, State, StepWorkspace, System, wrench_at_origin};
use sagci_model::ObjectModel;
use sagci_signal::{Command, Observation, Wrench};

const PERIOD: f64 = 1e-3;
const READY: [f64; 7] = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785];

fn panda() -> ObjectModel {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../world-models/panda");
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    ObjectModel::read(folder.join(head.trim())).unwrap()
}

/// The arm without dry friction and damping of its joints, where a test is about exact figures.
fn smooth(mut arm: ObjectModel) -> ObjectModel {
    for joint in &mut arm.joints {
        (joint.damping, joint.friction) = (0.0, 0.0);
    }
    arm
}

/// The arm as the plant: efforts in, encoders out. The fingers are held at their width.
struct Plant {
    system: System,
    ws: StepWorkspace,
    state: State,
    hand: LinkId,
    push: Vector3<f64>,
    tau: Vec<f64>,
    peak: Vec<f64>,
}

impl Plant {
    fn new(parts: &[Part<'_>], q: &[f64; 7]) -> Self {
        let system = System::new(parts).unwrap();
        let mut state = system.state();
        state.q[..7].copy_from_slice(q);
        state.q[7..9].fill(0.02);
        let (ws, hand) = (system.workspace(), system.multibody().link("panda_hand").unwrap());
        Self { ws, state, hand, push: Vector3::zeros(), tau: vec![0.0; 9], peak: vec![0.0; 7], system }
    }

    fn observe(&self) -> Observation {
        Observation {
            time: self.state.time,
            q: self.state.q[..7].to_vec(),
            v: self.state.v[..7].to_vec(),
            tau: self.tau[..7].to_vec(),
            gripper_width: self.state.q[7] + self.state.q[8],
            ..Observation::default()
        }
    }

    /// Holds the command for one period. `push` acts on the tool's origin.
    fn advance(&mut self, command: &Command, X_WT: &Isometry3<f64>) {
        for (i, tau) in command.tau.iter().enumerate() {
            self.tau[i] = *tau;
            self.peak[i] = self.peak[i].max(tau.abs());
        }
        for i in 7..9 {
            self.tau[i] = 500.0 * (0.02 - self.state.q[i]) - 10.0 * self.state.v[i];
        }
        let F_W = wrench_at_origin(&self.push, &Vector3::zeros(), &Point3::from(X_WT.translation.vector));
        let external = [ExternalWrench { link: self.hand, F_W }];
        self.system.step(&mut self.ws, &mut self.state, &Input { tau: &self.tau, external: &external }, PERIOD).unwrap();
    }
}

fn welded(model: &ObjectModel) -> [Part<'_>; 1] {
    [Part::welded(model, Isometry3::identity())]
}

#[test]
fn model_of_the_arm_agrees_with_the_whole_tree() {
    let model = panda();
    let X_WR = Isometry3::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.0, 0.0, 0.4));
    let mut arm = ArmModel::new(&model, X_WR).unwrap();
    let multibody = Multibody::welded(&model, X_WR).unwrap();
    let mut ws = multibody.workspace();
    let mut rng = rand_pcg::Pcg64::seed_from_u64(1);
    let mut draw = |n: usize| (0..n).map(|_| rng.random_range(-1.0..1.0)).collect::<Vec<f64>>();
    let (q, v, a) = (draw(7), draw(7), draw(7));
    arm.update(&q, &v, 0.05).unwrap();
    let all = |x: &[f64], finger: f64| x.iter().copied().chain([finger, finger]).collect::<Vec<_>>();
    multibody.set_state(&mut ws, &all(&q, 0.025), &all(&v, 0.0)).unwrap();
    let (mut whole, mut ours) = (vec![0.0; 9], vec![0.0; 7]);
    multibody.inverse_dynamics(&mut ws, &all(&a, 0.0), &[], &mut whole).unwrap();
    arm.inverse_dynamics(&a, &mut ours).unwrap();
    assert!(ours.iter().zip(&whole).all(|(o, w)| (o - w).abs() < 1e-11), "{ours:?} {whole:?}");
    // The tool lies midway between the pads, and moves as its Jacobian says.
    let pads = |name: &str| multibody.X_WL(&ws, multibody.link(name).unwrap()).translation.vector;
    let middle = 0.5 * (pads("panda_leftfinger") + pads("panda_rightfinger"));
    let axis = arm.X_WT() * Vector3::z();
    assert!((arm.X_WT().translation.vector - middle).cross(&axis).norm() < 1e-9, "the tool's z axis passes between the fingers");
    let V = arm.J_WT() * nalgebra::DVector::from_column_slice(&v);
    assert!((V - arm.V_WT()).norm() < 1e-12);
    let h = 1e-6;
    let before = *arm.X_WT();
    let next: Vec<f64> = q.iter().zip(&v).map(|(q, v)| q + h * v).collect();
    let velocity = *arm.V_WT();
    arm.update(&next, &v, 0.05).unwrap();
    let shift = (arm.X_WT().translation.vector - before.translation.vector) / h;
    assert!((shift - velocity.fixed_rows::<3>(3)).norm() < 1e-5);
}

#[test]
fn compensating_gravity_holds_the_arm_and_its_payload() {
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    // A held object that is part of the plant, and told to the controller as payload.
    let mut brick = ObjectModel {
        name: "brick".into(),
        folder: PathBuf::new(),
        links: vec![sagci_model::Link {
            name: "brick".into(),
            inertial: sagci_model::Inertial {
                mass: 0.8,
                p_LoLcm: Point3::new(0.01, 0.02, 0.03),
                I_LLcm_L: Matrix3::from_diagonal(&Vector3::new(1e-3, 2e-3, 1.5e-3)),
            },
            visuals: vec![],
            collisions: vec![],
        }],
        joints: vec![],
        document: sagci_model::Document::default(),
    };
    let X_LT = model.document.robot.as_ref().unwrap().gripper.X_LT.isometry();
    let held =
        Part { name: "brick".into(), model: &brick, base: sagci_dynamics::Base::Held { part: 0, link: "panda_hand".into(), X_LO: X_LT } };
    let mut plant = Plant::new(&[Part::welded(&model, Isometry3::identity()), held], &READY);
    let inertial = brick.links[0].inertial;
    let load = Payload { mass: inertial.mass, p_TCm: inertial.p_LoLcm, I_Cm_T: inertial.I_LLcm_L };
    brick.links.clear();
    arm.set_payload(Some(&load)).unwrap();
    let mut command = Command::default();
    for _ in 0..1000 {
        arm.observe(&plant.observe()).unwrap();
        command.tau = arm.bias().to_vec();
        plant.advance(&command, &Isometry3::identity());
    }
    let drift = READY.iter().zip(&plant.state.q).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(drift < 1e-6, "{drift}");
    // Without the payload the arm would sink.
    arm.set_payload(None).unwrap();
    for _ in 0..1000 {
        arm.observe(&plant.observe()).unwrap();
        command.tau = arm.bias().to_vec();
        plant.advance(&command, &Isometry3::identity());
    }
    assert!((plant.state.q[1] - READY[1]).abs() > 0.02, "the payload must weigh something");
}

#[test]
fn joint_impedance_tracks_a_sine() {
    // With the joints' own dry friction of 0.2 N m, which the law does not know.
    let model = panda();
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let stiffness = [600.0, 600.0, 600.0, 600.0, 50.0, 50.0, 50.0];
    let damping = [50.0, 50.0, 50.0, 50.0, 3.0, 3.0, 3.0];
    let mut law = JointImpedance::new(&arm, &stiffness, &damping).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    let (mut command, mut worst) = (Command::default(), 0.0_f64);
    for _ in 0..4000 {
        let t = plant.state.time;
        // Starts at rest: amplitude (1 - cos w t) / 2.
        let (w, s) = (2.0, 0.4);
        let q: Vec<f64> = READY.iter().map(|q| q + s * 0.5 * (1.0 - (w * t).cos())).collect();
        let (v, a) = ([s * 0.5 * w * (w * t).sin(); 7], [s * 0.5 * w * w * (w * t).cos(); 7]);
        law.step(&mut arm, &plant.observe(), &JointReference { q: &q, v: &v, a: &a }, PERIOD, &mut command).unwrap();
        for i in 0..7 {
            worst = worst.max(stiffness[i] * (q[i] - plant.state.q[i]).abs());
        }
        plant.advance(&command, &Isometry3::identity());
    }
    // Each joint lags by what its spring needs against that friction, and hardly more: 4 mrad at the wrist.
    println!("joint sine: the springs give {worst:.2} N m");
    assert!(worst < 0.3, "{worst}");
}

fn down() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0)
}

fn cartesian(arm: &mut ArmModel, plant: &Plant, stiffness: Matrix6<f64>, damping: Damping) -> CartesianImpedance {
    arm.observe(&plant.observe()).unwrap();
    CartesianImpedance::new(arm, stiffness, damping).unwrap()
}

#[test]
fn cartesian_impedance_tracks_a_circle() {
    let model = panda();
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    let gains = CartesianImpedance::diagonal(40.0, [800.0; 3]);
    let damping = Damping::Matrix(CartesianImpedance::diagonal(5.0, [70.0; 3]));
    let mut law = cartesian(&mut arm, &plant, gains, damping);
    let start = *arm.X_WT();
    let (mut command, mut shift, mut turn) = (Command::default(), 0.0_f64, 0.0_f64);
    for _ in 0..5000 {
        let t = plant.state.time;
        // A circle of 10 cm in the plane y-z, with a smooth angle 0..2 pi over 5 s, turning the hand by 0.5 rad on the way.
        let (s, ds, dds) = quintic(t / 5.0);
        let (th, w, dw) = (s * std::f64::consts::TAU, ds * std::f64::consts::TAU / 5.0, dds * std::f64::consts::TAU / 25.0);
        let (sin, cos, r) = (th.sin(), th.cos(), 0.1);
        let p = Vector3::new(0.0, r * sin, r * (cos - 1.0));
        let v = Vector3::new(0.0, r * cos, -r * sin) * w;
        let a = Vector3::new(0.0, r * cos, -r * sin) * dw + Vector3::new(0.0, -r * sin, -r * cos) * w * w;
        let roll = 0.5 / std::f64::consts::TAU;
        let mut reference = CartesianReference::at(Isometry3::from_parts(
            Translation3::from(start.translation.vector + p),
            UnitQuaternion::from_scaled_axis(Vector3::x() * roll * th) * start.rotation,
        ));
        reference.V_WD = Vector6::new(roll * w, 0.0, 0.0, v.x, v.y, v.z);
        reference.A_WD = Vector6::new(roll * dw, 0.0, 0.0, a.x, a.y, a.z);
        law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
        shift = shift.max(law.error().fixed_rows::<3>(3).norm());
        turn = turn.max(law.error().fixed_rows::<3>(0).norm());
        plant.advance(&command, &Isometry3::identity());
    }
    println!("circle: {:.2} mm, {:.2e} rad", shift * 1e3, turn);
    // What is left is the dry friction of 0.2 N m a joint.
    assert!(shift < 3e-3 && turn < 0.03, "{shift} {turn}");
}

fn quintic(s: f64) -> (f64, f64, f64) {
    let s = s.clamp(0.0, 1.0);
    (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * s * s * (1.0 - s) * (1.0 - s), 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s))
}

#[test]
fn tool_yields_to_a_push_by_the_stiffness_of_the_task_frame() {
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    // The task frame is turned against world and tool: 300 N/m along its x axis, 1000 N/m across.
    let R_WK = UnitQuaternion::from_euler_angles(0.2, -0.4, 0.9);
    let gains = CartesianImpedance::diagonal(50.0, [300.0, 1000.0, 1000.0]);
    let mut law = cartesian(&mut arm, &plant, gains, Damping::Ratio(0.9));
    // The posture stays out of the tool's way entirely.
    law.set_posture(&Posture { q: READY.to_vec(), stiffness: 20.0, damping: 4.0 }).unwrap();
    let start = *arm.X_WT();
    let mut reference = CartesianReference::at(start);
    reference.R_WK = R_WK;
    let mut command = Command::default();
    for (push, stiffness) in [(R_WK * Vector3::x() * 10.0, 300.0), (R_WK * Vector3::y() * 10.0, 1000.0)] {
        plant.push = push;
        for _ in 0..6000 {
            law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
            let X_WT = *arm.X_WT();
            plant.advance(&command, &X_WT);
        }
        let moved = arm.X_WT().translation.vector - start.translation.vector;
        println!("10 N at {stiffness} N/m: {:.2} mm", moved.norm() * 1e3);
        assert!((moved - push / stiffness).norm() < 2e-4, "{moved} instead of {}", push / stiffness);
        assert!(plant.state.v.iter().all(|v| v.abs() < 1e-3), "the arm must come to rest");
    }
}

#[test]
fn designed_damping_does_not_overshoot() {
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    let mut law = cartesian(&mut arm, &plant, CartesianImpedance::diagonal(30.0, [400.0; 3]), Damping::Ratio(1.0));
    let start = *arm.X_WT();
    let step = Vector3::new(0.0, 0.03, 0.0);
    let mut goal = start;
    goal.translation.vector += step;
    let reference = CartesianReference::at(goal);
    let (mut command, mut over) = (Command::default(), 0.0_f64);
    for _ in 0..3000 {
        law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
        over = over.max((arm.X_WT().translation.vector - goal.translation.vector).y);
        plant.advance(&command, &Isometry3::identity());
    }
    assert!(over < 0.02 * step.y, "overshoot {over}");
    assert!((arm.X_WT().translation.vector - goal.translation.vector).norm() < 1e-4, "it must arrive");
}

#[test]
fn efforts_keep_their_limits_and_rates() {
    let model = panda();
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    let mut law = cartesian(&mut arm, &plant, CartesianImpedance::diagonal(500.0, [20_000.0; 3]), Damping::Ratio(0.7));
    let limits: Vec<f64> = arm.limits().iter().map(|l| l.effort).collect();
    assert_eq!(limits, [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]);
    // A reference far away, and turned.
    let goal = Isometry3::from_parts(Translation3::new(-0.4, 0.5, 0.2), down());
    let reference = CartesianReference::at(goal);
    let (mut command, mut last): (Command, Option<Vec<f64>>) = (Command::default(), None);
    for _ in 0..300 {
        law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
        for i in 0..7 {
            assert!(command.tau[i].abs() <= limits[i]);
            if let Some(last) = &last {
                assert!((command.tau[i] - last[i]).abs() <= limits[i] / 0.087 * PERIOD + 1e-9);
            }
        }
        last = Some(command.tau.clone());
        plant.advance(&command, &Isometry3::identity());
    }
    assert!(plant.peak.iter().zip(&limits).any(|(p, l)| p == l), "the test must reach a limit");
}

#[test]
fn joint_limits_push_back() {
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    // Joint 4 close to its upper limit of -0.07.
    let mut q = READY;
    q[3] = -0.12;
    let plant = Plant::new(&welded(&model), &q);
    let mut law = cartesian(&mut arm, &plant, Matrix6::zeros(), Damping::Matrix(Matrix6::zeros()));
    law.set_posture(&Posture { q: q.to_vec(), stiffness: 0.0, damping: 0.0 }).unwrap();
    law.limit_margin = 0.1;
    let mut command = Command::default();
    let reference = CartesianReference::at(*arm.X_WT());
    law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
    let push = command.tau[3] - arm.bias()[3];
    // Half way into the margin: half of half the full effort.
    assert!((push + 0.5 * (1.0 - 0.0502 / 0.1) * 87.0).abs() < 0.5, "{push}");
    for i in [0, 1, 2, 4, 5, 6] {
        assert!((command.tau[i] - arm.bias()[i]).abs() < 1e-9, "joint {i} is far from its limits");
    }
}

#[test]
fn posture_moves_the_elbow_and_not_the_tool() {
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut plant = Plant::new(&welded(&model), &READY);
    let mut law = cartesian(&mut arm, &plant, CartesianImpedance::diagonal(50.0, [800.0; 3]), Damping::Ratio(0.8));
    let mut q = READY.to_vec();
    q[0] = 0.5;
    law.set_posture(&Posture { q, stiffness: 20.0, damping: 5.0 }).unwrap();
    let start = *arm.X_WT();
    let reference = CartesianReference::at(start);
    let (mut command, mut worst) = (Command::default(), 0.0_f64);
    for _ in 0..3000 {
        law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
        worst = worst.max(law.error().fixed_rows::<3>(3).norm());
        plant.advance(&command, &Isometry3::identity());
    }
    println!("posture: elbow moved by {:.3} rad, tool by {:.2} mm", plant.state.q[0], worst * 1e3);
    assert!(plant.state.q[0] > 0.1, "{}", plant.state.q[0]);
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn numbers_that_are_none_leave_the_command_as_it_was() {
    let model = panda();
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let plant = Plant::new(&welded(&model), &READY);
    let mut law = cartesian(&mut arm, &plant, CartesianImpedance::diagonal(50.0, [800.0; 3]), Damping::Ratio(0.8));
    let mut joint = JointImpedance::new(&arm, &[100.0; 7], &[10.0; 7]).unwrap();
    let before = Command { tau: vec![1.0; 7], ..Command::default() };
    let mut command = before.clone();
    let reference = CartesianReference::at(*arm.X_WT());
    for bad in [f64::NAN, f64::INFINITY] {
        let mut observation = plant.observe();
        observation.v[2] = bad;
        assert!(law.step(&mut arm, &observation, &reference, PERIOD, &mut command).is_err());
        let mut wrong = reference;
        wrong.V_WD[4] = bad;
        assert!(law.step(&mut arm, &plant.observe(), &wrong, PERIOD, &mut command).is_err());
        let q = [bad; 7];
        let goal = JointReference { q: &q, v: &[0.0; 7], a: &[0.0; 7] };
        assert!(joint.step(&mut arm, &plant.observe(), &goal, PERIOD, &mut command).is_err());
        assert_eq!(command, before);
    }
    let mut short = plant.observe();
    short.q.pop();
    assert!(law.step(&mut arm, &short, &reference, PERIOD, &mut command).is_err());
    assert_eq!(command, before);
    // Gains that would pump energy in are refused.
    assert!(matches!(law.set_gains(-Matrix6::identity(), Damping::Ratio(1.0)), Err(ControlError::Input { .. })));
    let mut skew = Matrix6::identity();
    skew[(0, 1)] = 0.5;
    assert!(law.set_gains(skew, Damping::Ratio(1.0)).is_err());
    assert!(JointImpedance::new(&arm, &[1.0; 6], &[1.0; 7]).is_err());
    assert!(arm.set_payload(Some(&Payload { mass: -1.0, p_TCm: Point3::origin(), I_Cm_T: Matrix3::zeros() })).is_err());
}

#[test]
fn an_object_that_is_no_robot_is_refused() {
    let mut model = panda();
    model.document.robot = None;
    assert!(matches!(ArmModel::new(&model, Isometry3::identity()), Err(ControlError::NotARobot { .. })));
}

#[test]
fn laws_stay_bounded_at_a_singular_pose() {
    // Stretched out upwards: the Jacobian loses rank.
    let model = smooth(panda());
    let mut arm = ArmModel::new(&model, Isometry3::identity()).unwrap();
    let mut q = [0.0; 7];
    q[3] = -0.2;
    q[5] = 0.2;
    let mut plant = Plant::new(&welded(&model), &q);
    let mut law = cartesian(&mut arm, &plant, CartesianImpedance::diagonal(40.0, [800.0; 3]), Damping::Ratio(0.7));
    let reference = CartesianReference::at(*arm.X_WT());
    let mut command = Command::default();
    for _ in 0..1000 {
        law.step(&mut arm, &plant.observe(), &reference, PERIOD, &mut command).unwrap();
        plant.advance(&command, &Isometry3::identity());
        assert!(plant.state.v.iter().all(|v| v.abs() < 2.0), "{:?}", plant.state.v);
    }
}

#[test]
fn wrench_filter_follows_a_step_as_a_first_order_lag() {
    let mut filter = WrenchFilter::new(10.0, PERIOD).unwrap();
    filter.step(&Wrench::default());
    let one = Wrench { force: Vector3::new(1.0, 0.0, 0.0), torque: Vector3::zeros() };
    let mut last = Wrench::default();
    for _ in 0..16 {
        last = filter.step(&one);
    }
    let expected = 1.0 - (-2.0 * std::f64::consts::PI * 10.0 * 0.016_f64).exp();
    assert!((last.force.x - expected).abs() < 1e-12);
    let bad = Wrench { force: Vector3::repeat(f64::NAN), torque: Vector3::zeros() };
    assert_eq!(filter.step(&bad), last);
    assert!(WrenchFilter::new(-1.0, PERIOD).is_err());
}
