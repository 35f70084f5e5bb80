#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use sagci_model::ObjectModel;
use sagci_recording::{JointLog, Log, Series};

use crate::fit::{Derivatives, Effort, Fit};
use crate::hypothesis::{Hypothesis, Knob};
use crate::noise;
use crate::plant::Plant;
use crate::search::{STEP, Search};
use crate::tests::{door, swing, with};
use crate::trajectory::{Drive, Trajectory};
use crate::weigh::CONVINCING;

const PERIOD: f64 = 0.005;

/// Positions that are read along inputs, from a velocity at rest's place.
fn along(model: &ObjectModel, step: f64, velocity: f64, inputs: &[f64], drive: Drive) -> Vec<f64> {
    let mut trajectory = Trajectory::steady(inputs.len(), PERIOD, &[0.0], vec![drive]);
    trajectory.input.copy_from_slice(inputs);
    let plant = Plant::new(model, &[[false; 2]], step).unwrap();
    let mut motion = plant.motion();
    motion.state.v[0] = velocity;
    let mut read = Vec::new();
    for k in 0..inputs.len() - 1 {
        plant.interval(&mut motion, &trajectory, k).unwrap();
        motion.state.time = trajectory.time[k + 1];
        read.push(plant.reading(&motion, 0));
    }
    read
}

fn furthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// What acts half-way through a step is not half of it all the way: over hundreds of rows that is a drive's lag.
#[test]
fn a_late_input_acts_at_its_instant() {
    let inputs: Vec<f64> = (0..200).map(|k: i32| 2.0 * (1.3 * f64::from(k)).sin()).collect();
    for (effect, number) in [("transport_delay", "delay"), ("clock_skew", "skew")] {
        let late = with(&door(), effect, &[(number, 0.0118)]);
        let command = Drive::Command(sagci_recording::CommandKind::Effort);
        let reference = along(&late, 5e-5, 0.0, &inputs, command);
        let off = furthest(&along(&late, STEP, 0.0, &inputs, command), &reference);
        assert!(off < 2e-7, "{effect}: {off} rad");
    }
}

/// Where a joint turns round under dry friction neither of two ways over an interval foretells the other; shorter steps come near the instant.
#[test]
fn a_joint_that_turns_round_under_friction_does_so_at_its_instant() {
    let rubbing = with(&door(), "coulomb_friction", &[("friction", 0.8)]);
    // To and fro, ten times a second.
    let inputs: Vec<f64> = (0..400).map(|k: i32| 6.0 * (0.1 * std::f64::consts::PI * f64::from(k) + 0.4).cos()).collect();
    let reference = along(&rubbing, 2e-5, 0.0, &inputs, Drive::Effort);
    let off = furthest(&along(&rubbing, STEP, 0.0, &inputs, Drive::Effort), &reference);
    let friction = furthest(&along(&door(), STEP, 0.0, &inputs, Drive::Effort), &reference);
    assert!(off < 0.005 * friction, "{off} rad after 40 times, where friction made {friction}");
}

/// Stamps jitter about a period. Half of such rows were gone in twice as many steps as the others, and cost twice as much.
#[test]
fn a_row_that_is_a_little_longer_than_a_step_is_followed_as_well() {
    let model = with(&door(), "viscous_friction", &[("damping", 0.1)]);
    let off = |period: f64| {
        let at = |step: f64| {
            let plant = Plant::new(&model, &[[false; 2]], step).unwrap();
            let mut motion = plant.motion();
            motion.state.v[0] = 0.5;
            plant.interval(&mut motion, &Trajectory::steady(2, period, &[0.3], vec![Drive::Effort]), 0).unwrap();
            motion.state.q[0]
        };
        (at(STEP) - at(1e-5)).abs()
    };
    assert!(off(1.12 * PERIOD) < 1.12_f64.powi(3) * 1.1 * off(PERIOD).max(1e-12), "{} and {} rad", off(1.12 * PERIOD), off(PERIOD));
    assert!(off(1.12 * PERIOD) < 1e-6, "{}", off(1.12 * PERIOD));
}

/// A frictionless joint that turns round is as smooth as one that goes on.
#[test]
fn a_free_joint_that_turns_round_is_followed_to_second_order() {
    let inputs: Vec<f64> = (0..400).map(|k: i32| 6.0 * (0.1 * std::f64::consts::PI * f64::from(k) + 0.4).cos()).collect();
    let off = |step: f64| furthest(&along(&door(), step, 0.3, &inputs, Drive::Effort), &along(&door(), 2e-5, 0.3, &inputs, Drive::Effort));
    assert!(off(2.5e-4) < off(1.25e-3) / 15.0, "{} and {} rad", off(1.25e-3), off(2.5e-4));
}

/// What a late input has moved after a row says nothing of how much it moves.
#[test]
fn inputs_that_come_late_do_not_make_a_joint_immovable() {
    let mobility = |model: &ObjectModel| Plant::new(model, &[[false; 2]], STEP).unwrap().mobility(&[0.3], PERIOD, &[1.0])[0];
    for (effect, number) in [("transport_delay", "delay"), ("clock_skew", "skew")] {
        for late in [0.003, 0.0118] {
            let model = with(&door(), effect, &[(number, late)]);
            let (late_one, usual) = (mobility(&model), mobility(&door()));
            assert!((late_one / usual - 1.0).abs() < 0.02, "{effect} of {late} s: {late_one} for {usual}");
        }
    }
}

/// A filter that is told that no effort moves a joint, since friction holds it under the largest, believes none of the motion that it sees.
#[test]
fn friction_that_holds_a_joint_does_not_make_it_immovable() {
    let mobility = |friction: f64| {
        let model = with(&door(), "coulomb_friction", &[("friction", friction)]);
        Plant::new(&model, &[[false; 2]], STEP).unwrap().mobility(&[0.3], PERIOD, &[1.0])[0]
    };
    let (moves, held) = (mobility(0.5), mobility(1.5));
    assert!((held / moves - 1.0).abs() < 0.02, "{held} where it is held, {moves} where it moves");
}

/// Two links that hang on one another.
pub(crate) fn double_pendulum(folder: &std::path::Path) -> ObjectModel {
    let link = |name: &str| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
               <inertia ixx="0.002" iyy="0.002" izz="0.0002" ixy="0" ixz="0" iyz="0"/></inertial></link>"#
        )
    };
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            r#"<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
               <origin xyz="0 0 -0.2"/><axis xyz="0 1 0"/></joint>"#
        )
    };
    let joints = [joint("shoulder", "base", "upper"), joint("elbow", "upper", "lower")].concat();
    let text = format!(r#"<robot name="two"><link name="base"/>{}{}{joints}</robot>"#, link("upper"), link("lower"));
    std::fs::write(folder.join("object.urdf"), text).unwrap();
    ObjectModel::read_urdf(folder.join("object.urdf")).unwrap()
}

/// Coriolis forces are taken at a step's start. Two ways over a piece take the first order off, however fast links fling one another.
#[test]
fn two_links_that_fling_one_another_are_followed_to_second_order() {
    let folder = tempfile::tempdir().unwrap();
    let model = double_pendulum(folder.path());
    let along = |step: f64| {
        let plant = Plant::new(&model, &[[false; 2]; 2], step).unwrap();
        let mut motion = plant.motion();
        motion.state.v.copy_from_slice(&[4.0, -9.0]);
        let mut positions = Vec::new();
        for _ in 0..100 {
            plant.interval(&mut motion, &Trajectory::steady(2, PERIOD, &[0.0, 0.0], vec![Drive::Effort; 2]), 0).unwrap();
            positions.extend(motion.state.q.iter().copied());
        }
        positions
    };
    let right = along(2e-5);
    let off = |step: f64| furthest(&along(step), &right);
    assert!(off(2.5e-4) < off(1.25e-3) / 15.0 && off(1.25e-3) > 1e-6, "{} and {} rad", off(1.25e-3), off(2.5e-4));
}

/// A filter sets a joint that stands moving by a little, and friction stops it within less than a careful step: where and when is known.
#[test]
fn a_joint_that_friction_stops_at_once_stands_where_it_should() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = double_pendulum(folder.path());
    model.joints[1].friction = 0.3;
    let at = |step: f64| {
        let plant = Plant::new(&model, &[[false; 2]; 2], step).unwrap();
        let mut motion = plant.motion();
        motion.state.v.copy_from_slice(&[0.5, 0.01]);
        plant.interval(&mut motion, &Trajectory::steady(2, PERIOD, &[0.0, 0.0], vec![Drive::Effort; 2]), 0).unwrap();
        (motion.state.q, motion.state.v)
    };
    let ((q, v), (right, right_v)) = (at(STEP), at(2e-5));
    assert_eq!([v[1], right_v[1]], [0.0; 2], "it stands");
    assert!((q[1] - right[1]).abs() < 0.5 * right[1].abs(), "{} rad, not {}", q[1], right[1]);
    assert!((q[0] - right[0]).abs() < 1e-6, "the other goes to {} rad, not {}", q[0], right[0]);
}

/// The same where the stop takes half a row: what the analytic stop leaves over is a small part of what data tell, on the other joint, too.
#[test]
fn a_joint_that_stops_before_data_tell_is_where_short_steps_bring_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = double_pendulum(folder.path());
    model.joints[1].friction = 0.3;
    let told = 2e-4;
    let mut stopped = 0;
    for speed in [0.02, 0.05, 0.1, 0.15, -0.1] {
        let at = |step: f64, told: f64| {
            let mut plant = Plant::new(&model, &[[false; 2]; 2], step).unwrap();
            plant.told = vec![told; 2];
            let mut motion = plant.motion();
            motion.state.v.copy_from_slice(&[0.5, speed]);
            plant.interval(&mut motion, &Trajectory::steady(2, PERIOD, &[0.0, 0.0], vec![Drive::Effort; 2]), 0).unwrap();
            (motion.state.q, motion.state.v)
        };
        let ((q, v), (right, right_v)) = (at(STEP, told), at(2e-5, 0.0));
        stopped += usize::from(right_v[1] == 0.0 && right[1].abs() > 0.1 * told);
        for j in 0..2 {
            assert!((q[j] - right[j]).abs() < 0.1 * told, "{speed} rad/s: {} rad, not {}", q[j], right[j]);
            assert!((v[j] - right_v[j]).abs() < 0.1 * told / PERIOD, "{speed} rad/s: {} rad/s, not {}", v[j], right_v[j]);
        }
    }
    assert!(stopped >= 2, "the others go on");
}

/// The model's own motion from a fling, with noise of positions.
pub(crate) fn flung(model: &ObjectModel, velocities: [f64; 2]) -> Log {
    use rand::SeedableRng;
    let plant = Plant::new(model, &[[false; 2]; 2], 5e-5).unwrap();
    let mut motion = plant.motion();
    motion.state.v.copy_from_slice(&velocities);
    let mut random = rand_pcg::Pcg64::seed_from_u64(4);
    let mut joints =
        ["shoulder", "elbow"].map(|name| JointLog { name: name.into(), effort: Some(Series::default()), ..JointLog::default() });
    for k in 0..1000 {
        let t = PERIOD * f64::from(k);
        for (j, joint) in joints.iter_mut().enumerate() {
            joint.position.time.push(t);
            joint.position.value.push(motion.state.q[j] + 2e-5 * noise::normal(&mut random));
            let effort = joint.effort.as_mut().unwrap();
            effort.time.push(t);
            effort.value.push(0.0);
        }
        plant.interval(&mut motion, &Trajectory::steady(2, PERIOD, &[0.0, 0.0], vec![Drive::Effort; 2]), 0).unwrap();
    }
    Log { source: "flung".into(), joints: joints.to_vec(), ..Log::default() }
}

/// What steps leave over goes on from row to row as an effect does: a fast arm's is named for a motor that is too weak by half a percent.
#[test]
fn steps_leave_less_over_than_an_effect_has_to_say() {
    let folder = tempfile::tempdir().unwrap();
    let model = double_pendulum(folder.path());
    let mut shortened = Vec::new();
    for velocities in [[0.5, -0.5], [25.0, -70.0]] {
        let trajectories = [Trajectory::new(&flung(&model, velocities), &model).unwrap()];
        let mut search = Search::new(&model, &trajectories).unwrap();
        let fit = Fit::start(&search.problem, Hypothesis::known(&model, &search.joints)).unwrap();
        shortened.push(search.shorten_steps(&fit, 1.0).unwrap());
        let at = |step: f64| {
            let mut problem = search.problem.clone();
            problem.step = step;
            problem.errors(&fit.hypothesis, &fit.hypothesis.x).unwrap()
        };
        let left = 0.5 * (at(search.problem.step) - at(5e-5)).norm_squared();
        assert!(left < CONVINCING, "steps of {} s leave over e^{left} at {velocities:?} rad/s", search.problem.step);
    }
    assert_eq!(shortened, [false, true]);
}

/// One link swings the other: without what stiffness and Coriolis forces do between rows, derivatives were off by 3 to 5 %, and on an arm by half.
#[test]
fn derivatives_by_known_numbers_hold_where_one_joint_moves_another() {
    let folder = tempfile::tempdir().unwrap();
    let model = double_pendulum(folder.path());
    let trajectories = [Trajectory::new(&flung(&model, [4.0, -9.0]), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let fit = Fit::start(&search.problem, Hypothesis::known(&model, &search.joints)).unwrap();
    let all: Vec<usize> = (0..fit.hypothesis.x.len()).collect();
    let exact = search.problem.jacobian(&fit.hypothesis, &fit.hypothesis.x, &fit.errors, &all).unwrap();
    for (fitted, (by_response, exact)) in
        fit.hypothesis.fitted.iter().zip(search.derivatives_by_response(&fit, true).unwrap().iter().zip(&exact))
    {
        let off = (exact - by_response).norm() / exact.norm().max(1.0);
        // Where errors go far within a difference they do not go straight, and that is what differs.
        let straight = exact.norm() * fitted.difference < 10.0;
        assert!(off < if straight { 0.02 } else { 0.06 }, "{:?}: {off} of {}", fitted.knob, exact.norm());
    }
}

/// An angle and a direction say nothing of each other where there is no turn: a fit that began there never turned the axis.
#[test]
fn a_turn_of_an_axis_is_left_in_any_direction_from_none() {
    let model = door();
    let trajectories = [Trajectory::new(&swing(&model, 2e-5, 1), &model).unwrap()];
    let search = Search::new(&model, &trajectories).unwrap();
    let known = Hypothesis::known(&model, &search.joints);
    let none = known.with("joint_axis_error", Some("hinge"), &[0.0; 7]).unwrap();
    let turns: Vec<usize> = (0..none.x.len()).filter(|i| matches!(none.fitted[*i].knob, Knob::Turn(..))).collect();
    let fit = Fit::start(&search.problem, none.clone())
        .unwrap()
        .finish(&search.problem, 1.0, Derivatives::FRESH, Effort::to_the_end(f64::INFINITY))
        .unwrap();
    // A hinge that stands upright feels gravity where it leans to either side.
    let told = turns.iter().filter(|i| fit.is_told(**i, 1.0)).count();
    assert_eq!((turns.len(), told), (3, 2));

    let mut turned = none.x.clone();
    for (i, x) in turns.iter().zip([0.03, -0.04, 0.0]) {
        turned[*i] = x;
    }
    let parameters = &none.model_at(&turned).document.effects[0].parameters;
    let found: Vec<f64> = ["angle", "rx", "ry", "rz"].iter().map(|n| parameters[*n]).collect();
    assert!(found.iter().zip([0.05, 0.6, -0.8, 0.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    let values = [0.05, 0.6, -0.8, 0.0, 0.0, 0.0, 0.0];
    let again = known.with("joint_axis_error", Some("hinge"), &values).unwrap();
    assert!(again.x.iter().zip(&turned).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}, {turned:?}", again.x);
}

/// A body that was led to the end of its tolerance stands where a fit with what is missing does not find back from.
#[test]
fn bodies_that_were_led_to_the_end_of_their_tolerance_are_begun_as_given_too() {
    let mut known = Hypothesis::known(&door(), &[0]);
    assert!(known.bodies_as_given().is_none());
    let mass = known.fitted.iter().position(|f| matches!(f.knob, Knob::Mass(_))).unwrap();
    let damping = known.fitted.iter().position(|f| matches!(f.knob, Knob::Damping(_))).unwrap();
    known.x[mass] = known.fitted[mass].bounds[1];
    known.x[damping] += 0.1;
    let given = known.bodies_as_given().unwrap();
    assert_eq!(given.x[mass], 0.0);
    assert_eq!(given.x[damping], known.x[damping]);
}

/// Half of each joint's effort by its drive and half from outside move an arm as all of it by its drives does: what pushes one joint pushes no
/// other. A drive that gives twice what it is told doubles its own half alone.
#[test]
fn a_force_from_outside_pushes_its_joint_behind_the_drive() {
    let folder = tempfile::tempdir().unwrap();
    let model = double_pendulum(folder.path());
    let whole = [0.4, -0.2];
    let end = |model: &ObjectModel, shares: [f64; 2]| {
        let plant = Plant::new(model, &[crate::stops::OPEN; 2], 2.5e-4).unwrap();
        let mut motion = plant.motion();
        let drive = vec![Drive::Command(sagci_recording::CommandKind::Effort); 2];
        let mut trajectory = Trajectory::steady(101, PERIOD, &whole.map(|u| shares[0] * u), drive);
        if shares[1] != 0.0 {
            trajectory.external = whole.map(|u| shares[1] * u).repeat(101);
        }
        (0..100).for_each(|k| plant.interval(&mut motion, &trajectory, k).unwrap());
        motion.state.q.clone()
    };
    let near = |a: Vec<f64>, b: Vec<f64>| assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9), "{a:?} {b:?}");
    near(end(&model, [0.5, 0.5]), end(&model, [1.0, 0.0]));
    let mut strong = model.clone();
    for joint in ["shoulder", "elbow"] {
        let parameters = [("gain_error".to_owned(), -1.0)].into();
        strong.document.effects.push(sagci_model::EffectEntry {
            effect: "torque_gain".into(),
            joint: Some(joint.into()),
            parameters,
            ..Default::default()
        });
    }
    near(end(&strong, [0.25, 0.5]), end(&model, [1.0, 0.0]));
}
