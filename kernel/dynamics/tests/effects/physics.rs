//! How each effect shows: its signature as a measurement would see it.

use std::f64::consts::TAU;

use nalgebra::Isometry3;
use sagci_dynamics::effects::{Advance, Instant, MAX_STATES, Resistance, find};
use sagci_dynamics::{Input, Part, State, System};
use sagci_model::{EffectEntry, ObjectModel};

use crate::common::{WIDE, joint, link, model, pendulum, welded};
use crate::{block, entry, run};

/// What an effect on a prescribed motion resists with: position, `dtau`, at each step.
fn sweep(name: &str, theta: &[f64], dt: f64, steps: usize, position: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    let effect = find(name).unwrap();
    let (mut z, mut v, mut out) = ([0.0; MAX_STATES], 0.0, Vec::new());
    for k in 0..steps {
        let (q, end) = (position(k as f64 * dt), position((k + 1) as f64 * dt));
        let next = (end - q) / dt;
        let before = z;
        let at = Instant { q, v, next, dt, input: 0.0, load: 0.0, time: k as f64 * dt, z: &before[..effect.states()] };
        let (mut r, mut a) = (Resistance::default(), Advance::default());
        effect.resist(theta, &at, &mut r);
        effect.advance(theta, &at, &mut a);
        z = a.z.map(|z| z.value);
        v = next;
        out.push((end, r.total(next).value));
    }
    out
}

fn force(name: &str, theta: &[f64], q: f64, v: f64) -> f64 {
    let mut r = Resistance::default();
    find(name).unwrap().resist(theta, &Instant::at(q, v, 0.0, 0.0, 0.0, &[0.0; 2]), &mut r);
    r.total(v).value
}

/// Area of a closed loop: the work that a cycle takes.
fn area(path: &[(f64, f64)]) -> f64 {
    path.windows(2).map(|w| w[1].1 * (w[1].0 - w[0].0)).sum()
}

#[test]
fn stribeck_sticks_and_slips_under_a_slow_spring_and_coulomb_does_not() {
    // A soft spring is drawn along at 5 mm/s.
    let slip = |effect: (&str, &[(&str, f64)])| {
        let system = block(1.0, &[effect, ("viscous_friction", &[("damping", 2.0)])]);
        let mut state = system.state();
        let (mut stops, mut moving, mut fastest) = (0, false, 0.0_f64);
        let drawn = |s: &State| 100.0 * (0.005 * s.time - s.q[0]);
        run(&system, &mut state, 1e-3, 40_000, drawn, |s| {
            if s.time > 20.0 {
                stops += usize::from(moving && s.v[0] == 0.0);
                fastest = fastest.max(s.v[0]);
            }
            moving = s.v[0] != 0.0;
        });
        (stops, fastest)
    };
    let stribeck = [("friction", 2.0), ("static_friction", 4.0), ("stribeck_velocity", 0.01), ("exponent", 2.0)];
    let (stops, fastest) = slip(("stribeck_friction", &stribeck));
    assert!(stops >= 2 && fastest > 0.05, "{stops} {fastest}");
    let (stops, fastest) = slip(("coulomb_friction", &[("friction", 2.0)]));
    assert!(stops == 0 && (fastest - 0.005).abs() < 1e-4, "{stops} {fastest}");
}

#[test]
fn a_block_with_unequal_friction_sticks_between_its_two_bounds() {
    let asymmetric = [("friction_positive", 3.0), ("friction_negative", 1.0), ("damping_positive", 2.0), ("damping_negative", 5.0)];
    let system = block(1.0, &[("asymmetric_friction", &asymmetric)]);
    for (push, speed) in [(2.999, 0.0), (-0.999, 0.0), (5.0, 1.0), (-3.5, -0.5)] {
        let mut state = system.state();
        run(&system, &mut state, 1e-3, 20_000, |_| push, |_| {});
        assert!((state.v[0] - speed).abs() < 1e-6, "{push}: {}", state.v[0]);
    }
}

#[test]
fn bristles_hold_like_a_spring_then_slide_and_their_loop_does_not_depend_on_the_rate() {
    let theta = [1e4, 0.0, 4.0, 4.0, 0.01];
    // Before it breaks away: a spring.
    let small = sweep("presliding_hysteresis", &theta, 1e-4, 100, |t| 1e-3 * t);
    assert!((small[99].1 - 1e4 * 1e-5).abs() < 2e-3, "{}", small[99].1);
    let cycle = |rate: f64, amplitude: f64| {
        let steps = 20_000;
        let dt = 2.0 * TAU / rate / steps as f64;
        let path = sweep("presliding_hysteresis", &theta, dt, steps, |t| amplitude * (rate * t).sin());
        area(&path[steps / 2..])
    };
    let (slow, fast) = (cycle(1.0, 2e-3), cycle(30.0, 2e-3));
    assert!((slow / fast - 1.0).abs() < 1e-6, "{slow} {fast}");
    // Sliding far, a cycle takes four amplitudes times the friction, less what bends.
    assert!((cycle(1.0, 0.1) / (4.0 * 0.1 * 4.0) - 1.0).abs() < 0.01);
    // Milliradians are nearly elastic, large amplitudes are not.
    assert!(cycle(1.0, 2e-5) < 0.1 * 4.0 * 2e-5 * 4.0);
    // Stiff bristles are stable in a coarse step, and hold a push below the friction without creep.
    let stiff = [("stiffness", 1e7), ("micro_damping", 10.0), ("friction", 4.0), ("static_friction", 5.0), ("stribeck_velocity", 0.01)];
    let system = block(0.2, &[("presliding_hysteresis", &stiff)]);
    let mut state = system.state();
    run(&system, &mut state, 5e-3, 2000, |_| 3.0, |s| assert!(s.q[0].abs() < 1e-5, "{}", s.q[0]));
    assert!((state.z[0] - 3.0 / 1e7).abs() < 1e-12 && state.v[0].abs() < 1e-12, "{state:?}");
    run(&system, &mut state, 5e-3, 2000, |_| 6.0, |_| {});
    assert!(state.v[0] > 1.0);
}

#[test]
fn a_cable_has_a_loop_of_its_own_force_that_does_not_depend_on_the_rate() {
    let theta = [20.0, 0.1, 1.5, 0.01, 0.0];
    let cycle = |rate: f64| {
        let steps = 20_000;
        let path = sweep("cable_hysteresis", &theta, 2.0 * TAU / rate / steps as f64, steps, |t| 0.2 * (rate * t).sin());
        area(&path[steps / 2..])
    };
    assert!((cycle(1.0) / cycle(20.0) - 1.0).abs() < 1e-6);
    // Twice the loop's force over the way there and back, less where it turns over.
    let full = 2.0 * 1.5 * 0.4;
    assert!(cycle(1.0) < full && cycle(1.0) > 0.85 * full, "{}", cycle(1.0));
}

#[test]
fn friction_follows_the_load_through_the_joint() {
    let system = block(1.0, &[("load_dependent_friction", &[("load_coefficient", 0.2)])]);
    let mut state = system.state();
    state.v[0] = 1.0;
    run(&system, &mut state, 1e-3, 100, |_| 5.0, |_| {});
    // 5 N less a fifth of them.
    assert!((state.v[0] - 1.0 - 0.1 * 4.0).abs() < 1e-9, "{}", state.v[0]);
    // A pendulum held out against gravity is loaded twice: by the weight and by the drive.
    let mut hung = System::new(&[welded(&pendulum(1.0, 0.3, 0.01, ""))]).unwrap();
    hung.add_effect("pendulum", &entry("load_dependent_friction", Some("hinge"), &[("load_coefficient", 0.1)])).unwrap();
    let mut state = hung.state();
    (state.q[0], state.v[0]) = (0.5, 1e-9);
    let (mut tau, mut ws) = ([0.0], hung.workspace());
    hung.inverse_dynamics(&mut ws, &state, &[0.0], &[], &mut tau).unwrap();
    let weight = 9.81 * 0.3 * 0.5_f64.sin();
    assert!((tau[0] - weight * (1.0 + 0.1 * 2.0)).abs() < 1e-9, "{} {weight}", tau[0]);
}

#[test]
fn a_rough_place_rubs_both_ways_and_a_gasket_pulls_one_way() {
    let rough = [1.0, 2.0, 0.1, 0.02];
    let mean = |name: &str, theta: &[f64], q: f64| 0.5 * (force(name, theta, q, 1e-6) + force(name, theta, q, -1e-6));
    let half = |name: &str, theta: &[f64], q: f64| 0.5 * (force(name, theta, q, 1e-6) - force(name, theta, q, -1e-6));
    assert!((half("position_dependent_friction", &rough, 0.1) - 3.0).abs() < 1e-12);
    assert!((half("position_dependent_friction", &rough, 0.3) - 1.0).abs() < 1e-9);
    assert_eq!(mean("position_dependent_friction", &rough, 0.1), 0.0);
    for shape in [0.0, 1.0] {
        let gasket = [30.0, 0.01, shape];
        assert_eq!(half("magnetic_gasket", &gasket, 0.004), 0.0);
        assert!(mean("magnetic_gasket", &gasket, 0.0) == 30.0 && mean("magnetic_gasket", &gasket, 0.1) < 0.3, "only near shut");
        assert!(mean("magnetic_gasket", &gasket, 0.004) > mean("magnetic_gasket", &gasket, 0.008));
    }
}

#[test]
fn suction_fades_with_dwell_and_is_lost_past_the_seal() {
    let stiffness = 3000.0;
    let air = [("stiffness", stiffness), ("time_constant", 5.0), ("seal_position", 0.01)];
    let theta: Vec<f64> = air.iter().map(|(_, v)| *v).collect();
    // Drawn open by 4 mm within 0.1 s and held: the pull decays with the leak.
    let held = sweep("air_suction", &theta, 1e-3, 10_100, |t| (0.04 * t).min(0.004));
    let peak = held[100].1;
    assert!((peak / (stiffness * 0.004) - 1.0).abs() < 0.02, "{peak}");
    assert!((held[5100].1 / peak - (-1.0_f64).exp()).abs() < 0.01 && (held[10_098].1 / peak - (-2.0_f64).exp()).abs() < 0.01);
    // Shut in haste, the air within is pressed; a dwell lets it out, so opening takes more the longer it was shut.
    let opening = |dwell: f64| {
        let position = move |t: f64| if t < 0.1 { 0.01 - 0.1 * t } else { (0.04 * (t - 0.1 - dwell)).max(0.0) };
        let steps = ((0.2 + dwell) / 1e-3) as usize;
        sweep("air_suction", &theta, 1e-3, steps, position).iter().fold(0.0_f64, |m, (_, f)| m.max(*f))
    };
    let peaks = [1.0, 10.0, 60.0].map(opening);
    assert!(peaks[1] > peaks[0] + 3.0 && peaks[2] > peaks[1], "{peaks:?}");
    // Past the seal there is no pull, and none is left on the way back.
    let out = sweep("air_suction", &theta, 1e-3, 600, |t| if t < 0.3 { 0.1 * t } else { 0.06 - 0.1 * t });
    assert_eq!(out[200].1, 0.0);
    assert!((out[549].0 - 0.005).abs() < 1e-9 && out[549].1 < 0.0, "{:?}", out[549]);
}

#[test]
fn a_latch_takes_more_to_open_than_to_shut_and_drops() {
    let theta = [30.0, 8.0, 0.001, 0.01];
    let path = sweep("latch", &theta, 1e-3, 2000, |t| 0.02 * (0.5 * TAU * t).sin().max(0.0));
    let (opening, shutting) = path.split_at(500);
    let top = |path: &[(f64, f64)]| path.iter().fold(0.0_f64, |m, (_, f)| m.max(f.abs()));
    assert!((top(opening) - 30.0).abs() < 0.2 && (top(&shutting[..500]) - 8.0).abs() < 0.2);
    assert!(opening.iter().all(|(_, f)| *f >= 0.0) && shutting[..500].iter().all(|(_, f)| *f <= 0.0));
    assert!(opening.iter().filter(|(q, _)| *q > 0.011).all(|(_, f)| *f == 0.0), "free above");
    // Mean of the bump: 16 (1/3 - 1/2 + 1/5) = 8/15 of the peak. Both ways are lost.
    assert!((area(&path[..1000]) - 8.0 / 15.0 * 0.01 * (30.0 + 8.0)).abs() < 2e-3);
    // As a door: a pull below the peak leaves it shut, one above opens it.
    let parameters = [("opening_force", 30.0), ("closing_force", 8.0), ("position", 0.001), ("width", 0.01)];
    let system = block(1.0, &[("latch", &parameters), ("viscous_friction", &[("damping", 20.0)])]);
    for (pull, opens) in [(29.0, false), (31.0, true)] {
        let mut state = system.state();
        // Drawn slowly, so that no swing carries it over.
        run(&system, &mut state, 1e-3, 5000, |s| pull * s.time.min(4.0) / 4.0, |_| {});
        assert_eq!(state.q[0] > 0.02, opens, "{pull}: {}", state.q[0]);
    }
    // And shut again with far less.
    let mut state = system.state();
    state.q[0] = 0.02;
    run(&system, &mut state, 1e-3, 3000, |_| -9.0, |_| {});
    assert!(state.q[0] < 0.0, "{}", state.q[0]);
    (state.q[0], state.v[0], state.time) = (0.0, 0.0, 0.0);
    run(&system, &mut state, 1e-3, 5000, |s| 29.0 * s.time.min(4.0) / 4.0, |_| {});
    assert!(state.q[0] < 0.01, "shut is latched: {}", state.q[0]);
}

#[test]
fn a_detent_is_a_well_with_its_greatest_force_one_width_off() {
    let theta = [6.0, 0.2, 0.01];
    assert!((force("detent", &theta, 0.21, 0.0) - 6.0).abs() < 1e-12 && (force("detent", &theta, 0.19, 0.0) + 6.0).abs() < 1e-12);
    assert!(force("detent", &theta, 0.2, 0.0) == 0.0 && force("detent", &theta, 0.3, 0.0).abs() < 1e-12);
    let system =
        block(0.5, &[("detent", &[("force", 6.0), ("position", 0.2), ("width", 0.01)]), ("viscous_friction", &[("damping", 3.0)])]);
    let mut state = system.state();
    state.q[0] = 0.212;
    run(&system, &mut state, 1e-3, 4000, |_| 0.0, |_| {});
    assert!((state.q[0] - 0.2).abs() < 1e-4, "it snaps in: {}", state.q[0]);
}

#[test]
fn a_soft_close_catches_in_its_zone_and_one_way_only() {
    let theta = [50.0, 0.05, 100.0];
    assert_eq!(force("soft_close_damper", &theta, 0.06, -1.0), 0.0);
    assert!((force("soft_close_damper", &theta, 0.04, -1.0) - (100.0 * 0.04 - 50.0)).abs() < 1e-12);
    assert!((force("soft_close_damper", &theta, 0.04, 1.0) - 100.0 * 0.04).abs() < 1e-12);
    let parameters = [("damping", 50.0), ("position", 0.05), ("stiffness", 100.0)];
    let system = block(2.0, &[("soft_close_damper", &parameters)]);
    for speed in [0.1, 0.5, 1.0] {
        let mut state = system.state();
        (state.q[0], state.v[0]) = (0.1, -speed);
        let mut caught = None;
        run(
            &system,
            &mut state,
            1e-3,
            6000,
            |_| 0.0,
            |s| {
                if s.q[0] < 0.02 && caught.is_none() {
                    caught = Some(s.v[0]);
                }
            },
        );
        // It draws shut from any speed, and arrives slowly.
        assert!(state.q[0].abs() < 5e-3 && caught.unwrap().abs() < speed, "{speed}: {state:?} {caught:?}");
    }
}

#[test]
fn a_stop_bounces_with_a_restitution_in_its_range() {
    // Hunt and Crossley: e = 1 - 2/3 v d / k for small losses.
    for (dissipation, expected) in [(1e4, 0.033), (2e5, 0.45)] {
        let stop = [("stiffness", 1e5), ("dissipation", dissipation), ("position", 0.1), ("side", 1.0)];
        let system = block(1.0, &[("hard_stop", &stop)]);
        let mut state = system.state();
        (state.q[0], state.v[0]) = (0.09, 0.5);
        run(&system, &mut state, 1e-5, 20_000, |_| 0.0, |_| {});
        let lost = 1.0 + state.v[0] / 0.5;
        assert!((lost / expected - 1.0).abs() < 0.25, "{dissipation}: {lost}");
    }
}

#[test]
fn backlash_loses_motion_where_the_load_turns_round() {
    let gap = [("half_gap", 0.01), ("rotor_inertia", 0.1)];
    let mut system =
        block(1.0, &[("backlash", &gap), ("coulomb_friction", &[("friction", 1.0)]), ("viscous_friction", &[("damping", 5.0)])]);
    // A strong controller on the motor: what the link does lacks the gap.
    let motor = |s: &State| s.q[0] + s.z[0];
    let drive = move |s: &State, amplitude: f64| {
        let (x, v) = (amplitude * (2.0 * s.time).sin(), 2.0 * amplitude * (2.0 * s.time).cos());
        3000.0 * (x - motor(s)) + 100.0 * (v - (s.v[0] + s.z[1]))
    };
    for amplitude in [0.1, 0.05] {
        let (mut state, mut least, mut most) = (system.state(), f64::MAX, f64::MIN);
        run(
            &system,
            &mut state,
            1e-3,
            10_000,
            |s| drive(s, amplitude),
            |s| {
                assert!(s.z[0].abs() <= 0.01 + 1e-12, "motor and link never part by more than the gap: {}", s.z[0]);
                if s.time > 4.0 {
                    (least, most) = (least.min(s.q[0]), most.max(s.q[0]));
                }
            },
        );
        assert!((most - least - 2.0 * (amplitude - 0.01)).abs() < 3e-3, "{amplitude}: {}", most - least);
    }
    // Motion within the gap does not reach the link at all.
    let mut state = system.state();
    run(&system, &mut state, 1e-3, 5000, |s| drive(s, 0.008), |s| assert_eq!(s.q[0], 0.0));
    // In contact, motor and link are one mass.
    let mut pushed = block(1.0, &[("backlash", &gap)]);
    let mut state = pushed.state();
    state.z[0] = 0.01;
    run(&pushed, &mut state, 1e-3, 100, |_| 2.2, |_| {});
    assert!((state.v[0] - 0.1 * 2.2 / 1.1).abs() < 1e-9 && state.z[1].abs() < 1e-9, "{state:?}");
    // The encoder reads the link, or the motor where the model says so.
    assert_eq!(pushed.measure(&state, 0.0, 0).position.value, state.q[0]);
    *pushed.parameters_mut().last_mut().unwrap() = 1.0;
    assert_eq!(pushed.measure(&state, 0.0, 0).position.value, state.q[0] + 0.01);
    system.set_effect_parameters(&[0.0, 0.1, 1e9, 0.0, 0.0, 1.0, 5.0]).unwrap();
    let mut state = system.state();
    run(&system, &mut state, 1e-3, 2000, |_| 3.0, |s| assert_eq!(s.z[0], 0.0));
}

/// A spring and a damper that only push: met with some speed, half a period later the teeth part, with what the damping left of it (for
/// little damping exp(-pi zeta), Goldsmith 1960), and no momentum is lost.
#[test]
fn teeth_that_give_way_part_with_what_their_damping_leaves() {
    let (rotor, link) = (0.1, 1.0);
    let reduced = rotor * link / (rotor + link);
    for (side, zeta) in [(1.0, 0.0), (-1.0, 0.1), (1.0, 0.05)] {
        let pace = 300.0;
        let gap =
            [("half_gap", 0.01), ("rotor_inertia", rotor), ("stiffness", reduced * pace * pace), ("damping", 2.0 * zeta * reduced * pace)];
        let system = block(link, &[("backlash", &gap)]);
        let mut state = system.state();
        state.z[1] = side;
        run(&system, &mut state, 2e-5, 1150, |_| 0.0, |_| {});
        let parted = -state.z[1] * side;
        let expected = (-std::f64::consts::PI * zeta).exp();
        assert!((parted - expected).abs() < 0.03, "{zeta}: parted with {parted} instead of {expected}");
        let momentum = link * state.v[0] + rotor * (state.v[0] + state.z[1]);
        assert!((momentum - rotor * side).abs() < 1e-9, "{momentum}");
    }
}

/// Pressed together, they come to rest on one another, and are one mass, in steps that are far longer than their own time.
#[test]
fn teeth_that_give_way_come_to_rest_under_a_push() {
    for pace in [100.0, 3000.0] {
        let gap = [("half_gap", 0.01), ("rotor_inertia", 0.1), ("stiffness", 0.1 * pace * pace), ("damping", 0.6 * 0.1 * pace)];
        let system = block(1.0, &[("backlash", &gap)]);
        let mut state = system.state();
        run(&system, &mut state, 1e-3, 3000, |_| 2.2, |_| {});
        let deep = 2.0 / (0.1 * pace * pace);
        assert!((state.z[0] - 0.01 - deep).abs() < 0.01 * deep && state.z[1].abs() < 1e-6, "{state:?}");
        assert!((state.v[0] - 3.0 * 2.0).abs() < 0.02, "{state:?}");
    }
}

#[test]
fn an_elastic_joint_rings_at_its_own_frequency_and_a_stiff_one_is_stable() {
    let (k, J, m) = (4000.0, 0.5, 2.0);
    let spring = [("stiffness", k), ("damping", 0.0), ("rotor_inertia", J)];
    let system = block(m, &[("joint_elasticity", &spring)]);
    let mut state = system.state();
    // Twisted and let go: motor and link against one another.
    state.z[0] = 1e-3;
    let (mut crossings, mut last, mut first, mut end) = (0, 1e-3, None, 0.0);
    let mut peak = 0.0_f64;
    run(
        &system,
        &mut state,
        1e-3,
        4000,
        |_| 0.0,
        |s| {
            if last < 0.0 && s.z[0] >= 0.0 {
                let time = s.time - 1e-3 * s.z[0] / (s.z[0] - last);
                (first, end) = (first.or(Some(time)), time);
                crossings += 1;
            }
            last = s.z[0];
            if s.time > 3.8 {
                peak = peak.max(s.z[0]);
            }
        },
    );
    let frequency = f64::from(crossings - 1) / (end - first.unwrap());
    let expected = (k * (1.0 / J + 1.0 / m)).sqrt() / TAU;
    // 16 Hz at 1 kHz: the midpoint rule is slow by (omega h)^2 / 12.
    assert!((frequency / expected - 1.0).abs() < 2e-3, "{frequency} {expected}");
    // No damping of its own, but for the joint's positions, which the step takes at its end.
    assert!(peak > 0.999e-3 * 0.97, "{peak}");
    // Anti-resonance: driven at the frequency of the link held fast on its spring, the motor stands and the link swings.
    let stiff = [("stiffness", 1e5), ("damping", 1.0), ("rotor_inertia", 0.01)];
    let system = block(0.1, &[("joint_elasticity", &stiff), ("viscous_friction", &[("damping", 1.0)])]);
    for dt in [1e-3, 5e-3, 0.02] {
        let mut state = system.state();
        run(&system, &mut state, dt, 5000, |_| 1.0, |s| assert!(s.v[0].abs() < 3.0, "{dt}: {}", s.v[0]));
        assert!((state.v[0] - 1.0).abs() < 1e-2, "{dt}: {}", state.v[0]);
    }
}

#[test]
fn ripple_is_periodic_in_position_at_every_speed() {
    for speed in [0.3, 2.0] {
        let path = sweep("torque_ripple", &[0.5, 12.0, 0.4], 1e-4, 5000, |t| speed * t);
        for (q, f) in &path {
            assert!((f - 0.5 * (12.0 * q + 0.4).sin()).abs() < 1e-12);
        }
    }
}

#[test]
fn a_delay_shifts_the_response_exactly() {
    let direct = block(1.0, &[("viscous_friction", &[("damping", 3.0)])]);
    // On the grid of steps the same numbers come later.
    let delayed = block(1.0, &[("viscous_friction", &[("damping", 3.0)]), ("transport_delay", &[("delay", 0.017)])]);
    let input = |t: f64| if t < -1e-9 { 0.0 } else { (7.0 * t).cos() };
    let path = |system: &System, dt: f64, steps: usize| {
        let (mut state, mut path) = (system.state(), vec![0.0]);
        run(system, &mut state, dt, steps, |s| input(s.time), |s| path.push(s.q[0]));
        path
    };
    let (a, b) = (path(&direct, 1e-3, 500), path(&delayed, 1e-3, 517));
    for (k, a) in a.iter().enumerate() {
        assert!((a - b[k + 17]).abs() < 1e-12, "{k}: {a} {}", b[k + 17]);
    }
    assert!(b[..=17].iter().all(|q| q.abs() < 1e-18));
    // Off the grid, the impulse that has arrived is exactly that of the held input, shifted.
    let off = block(1.0, &[("transport_delay", &[("delay", 0.0123)])]);
    let (mut state, mut given) = (off.state(), Vec::new());
    run(&off, &mut state, 1e-3, 400, |s| input(s.time), |s| given.push((s.time, s.v[0])));
    let held = |t: f64| -> f64 {
        let whole = (t / 1e-3 + 1e-9).floor();
        let done: f64 = (0..whole.max(0.0) as usize).map(|k| 1e-3 * input(k as f64 * 1e-3)).sum();
        if t <= 0.0 { 0.0 } else { done + (t - whole * 1e-3) * input(whole * 1e-3) }
    };
    for (t, v) in given {
        assert!((v - held(t - 0.0123)).abs() < 1e-12, "{t}: {v} {}", held(t - 0.0123));
    }
    // Steps far shorter than the ring can hold one by one still arrive at the right time.
    let mut state = off.state();
    run(&off, &mut state, 1e-5, 30_000, |s| input(s.time), |_| {});
    let expected = (7.0_f64 * (0.3 - 0.0123)).sin() / 7.0;
    assert!((state.v[0] - expected).abs() < 1e-4, "{} {expected}", state.v[0]);
}

#[test]
fn a_lag_answers_a_step_exponentially_whatever_the_step_in_time() {
    for dt in [1e-4, 5e-3, 0.05] {
        let system = block(1.0, &[("actuator_lag", &[("time_constant", 0.02)])]);
        let mut state = system.state();
        run(
            &system,
            &mut state,
            dt,
            (0.2 / dt) as usize,
            |_| 3.0,
            |s| {
                let T = 0.02;
                // The integral of 3 (1 - exp(-t / T)).
                let expected = 3.0 * (s.time - T * (1.0 - (-s.time / T).exp()));
                assert!((s.v[0] - expected).abs() < 1e-12 && (s.z[0] - 3.0 * (1.0 - (-s.time / T).exp())).abs() < 1e-12);
            },
        );
    }
}

#[test]
fn a_command_passes_delay_limit_lag_and_gain_in_that_order() {
    // Added the wrong way round on purpose.
    let chain: [(&str, &[(&str, f64)]); 4] = [
        ("torque_gain", &[("gain_error", 0.5)]),
        ("actuator_lag", &[("time_constant", 0.01)]),
        ("actuator_saturation", &[("limit", 4.0)]),
        ("transport_delay", &[("delay", 0.005)]),
    ];
    let system = block(1.0, &chain);
    let (mut state, mut ws) = (system.state(), system.workspace());
    for k in 0..200 {
        system.step(&mut ws, &mut state, &Input { tau: &[10.0], ..Input::default() }, 1e-3).unwrap();
        if k < 5 {
            assert_eq!(state.v[0], 0.0, "nothing has arrived");
        }
    }
    // Clipped to 4, then half of it.
    assert!((ws.reached()[0] - 2.0).abs() < 1e-6, "{}", ws.reached()[0]);
    let t = 0.195;
    let expected = 2.0 * (t - 0.01 * (1.0 - (-t / 0.01_f64).exp()));
    assert!((state.v[0] - expected).abs() < 1e-9, "{} {expected}", state.v[0]);
    let saturated = block(2.0, &[("actuator_saturation", &[("limit", 4.0)])]);
    for (u, reaches) in [(3.0, 3.0), (9.0, 4.0), (-9.0, -4.0)] {
        let mut state = saturated.state();
        run(&saturated, &mut state, 1e-3, 10, |_| u, |_| {});
        assert!((state.v[0] - 0.01 * reaches / 2.0).abs() < 1e-14);
    }
}

#[test]
fn armature_and_payload_change_the_mass_matrix_and_come_on_top_of_what_is_set() {
    let mut system = System::new(&[welded(&pendulum(1.0, 0.3, 0.01, ""))]).unwrap();
    let inertia = |system: &System| {
        let mut ws = system.multibody().workspace();
        system.multibody().mass_matrix(&mut ws).unwrap()[(0, 0)]
    };
    let bare = inertia(&system);
    system.add_effect("pendulum", &entry("armature_inertia", Some("hinge"), &[("inertia", 0.05)])).unwrap();
    assert!((inertia(&system) - bare - 0.05).abs() < 1e-15);
    let mass = [("mass", 0.4), ("x", 0.1), ("y", 0.2), ("z", -0.5)];
    system.add_effect("pendulum", &entry("payload", Some("hinge"), &mass)).unwrap();
    // About the hinge's y axis: m (x^2 + z^2).
    let expected = bare + 0.05 + 0.4 * (0.01 + 0.25);
    assert!((inertia(&system) - expected).abs() < 1e-14);
    // Gravity on it: m g (x cos q - z sin q) about y, seen from the hinge.
    let (mut ws, mut g, mut g_bare) = (system.multibody().workspace(), [0.0], [0.0]);
    ws_gravity(&system, &mut ws, &mut g);
    let alone = System::new(&[welded(&pendulum(1.0, 0.3, 0.01, ""))]).unwrap();
    let mut ws_alone = alone.multibody().workspace();
    ws_gravity(&alone, &mut ws_alone, &mut g_bare);
    assert!((g[0] - g_bare[0]).abs() - 0.4 * 9.81 * 0.1 < 1e-12 && (g[0] - g_bare[0]).abs() > 0.39);
    // Parameters and bodies that are changed later take effect, and give the same bits as at the start.
    system.parameters_mut()[0] = 0.5;
    assert!((inertia(&system) - expected - 0.45).abs() < 1e-14);
    system.multibody_mut().armature_mut()[0] = 1.0;
    assert!((inertia(&system) - expected - 1.45).abs() < 1e-14);
    assert_eq!(system.multibody_mut().armature_mut()[0], 1.0, "what is set is without effects");
    system.multibody_mut().armature_mut()[0] = 0.0;
    system.set_effect_parameters(&[0.05, 0.4, 0.1, 0.2, -0.5]).unwrap();
    assert_eq!(inertia(&system), {
        let mut again = System::new(&[welded(&pendulum(1.0, 0.3, 0.01, ""))]).unwrap();
        again.add_effect("pendulum", &entry("armature_inertia", Some("hinge"), &[("inertia", 0.05)])).unwrap();
        again.add_effect("pendulum", &entry("payload", Some("hinge"), &mass)).unwrap();
        inertia(&again)
    });
    // In a step: the same input moves it less.
    let mut state = system.state();
    state.q[0] = 0.0;
    let reshapes: Vec<_> = system.reshapes().map(|(p, _)| p.effect.description().name).collect();
    assert_eq!(reshapes, ["armature_inertia", "payload"]);
}

fn ws_gravity(system: &System, ws: &mut sagci_dynamics::Workspace, g: &mut [f64]) {
    system.multibody().set_positions(ws, &[0.0]).unwrap();
    system.multibody().gravity_efforts(ws, g).unwrap();
}

#[test]
fn a_turned_axis_and_a_moved_origin_change_where_the_link_goes() {
    let place = |parameters: &[(&str, f64)]| {
        let mut system = System::new(&[welded(&pendulum(1.0, 0.3, 0.01, ""))]).unwrap();
        system.add_effect("pendulum", &entry("joint_axis_error", Some("hinge"), parameters)).unwrap();
        let mut ws = system.multibody().workspace();
        system.multibody().set_positions(&mut ws, &[std::f64::consts::FRAC_PI_2]).unwrap();
        let rod = system.multibody().link("rod").unwrap();
        let X_WL: Isometry3<f64> = system.multibody().X_WL(&ws, rod);
        X_WL * nalgebra::Point3::new(0.0, 0.0, -0.3)
    };
    let names = ["angle", "rx", "ry", "rz", "x", "y", "z"];
    let with = |values: [f64; 7]| place(&names.iter().copied().zip(values).collect::<Vec<_>>());
    let straight = with([0.0; 7]);
    assert!((straight.coords - nalgebra::Vector3::new(-0.3, 0.0, 0.0)).norm() < 1e-12);
    let moved = with([0.0, 0.0, 0.0, 0.0, 0.01, 0.02, 0.03]);
    assert!((moved - straight - nalgebra::Vector3::new(0.01, 0.02, 0.03)).norm() < 1e-12);
    // The axis y turned about x by 0.1: (0, cos, sin). The direction's length does not count.
    let turned = with([0.1, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(0.0, 0.1_f64.cos(), 0.1_f64.sin()));
    let expected = nalgebra::UnitQuaternion::from_axis_angle(&axis, std::f64::consts::FRAC_PI_2) * nalgebra::Point3::new(0.0, 0.0, -0.3);
    assert!((turned - expected).norm() < 1e-12);
    // A turn about the axis itself turns nothing.
    assert!((with([0.7, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]) - straight).norm() < 1e-12);
}

#[test]
fn sensors_read_through_scale_drift_and_clock_and_have_their_derivatives() {
    let mut system = block(1.0, &[("clock_skew", &[("skew", 0.02)]), ("sensor_drift", &[("bias", 0.1), ("rate", 0.01)])]);
    system.add_effect("slide", &entry("encoder_offset", Some("slide"), &[("offset", 0.03), ("scale_error", 0.05)])).unwrap();
    let mut effort = entry("sensor_drift", Some("slide"), &[("bias", 0.7), ("rate", 0.0)]);
    effort.choices.insert("of".into(), "effort".into());
    system.add_effect("slide", &effort).unwrap();
    let mut state = system.state();
    (state.q[0], state.v[0], state.time) = (0.4, 2.0, 3.0);
    let read = |system: &System, state: &State| {
        let r = system.measure(state, 5.0, 0);
        [r.position.value, r.velocity.value, r.effort.value, r.stamp.value]
    };
    let expected = [1.05 * 0.4 + 0.03 + 0.1 + 0.01 * 3.0, 1.05 * 2.0 + 0.01, 5.7, 3.02];
    for (have, want) in read(&system, &state).iter().zip(expected) {
        assert!((have - want).abs() < 1e-14, "{have} {want}");
    }
    let weights = [0.3, -0.7, 1.1, 0.9];
    let loss = |system: &System, state: &State| read(system, state).iter().zip(weights).map(|(r, w)| r * w).sum::<f64>();
    let (mut bar, mut theta) = (weights, vec![0.0; system.parameters().len()]);
    system.measure_back(&state, 5.0, 0, &mut bar, &mut [], &mut theta);
    assert!((bar[0] - 0.3 * 1.05).abs() < 1e-14 && (bar[1] + 0.7 * 1.05).abs() < 1e-14 && bar[2] == 1.1);
    for (i, ours) in theta.iter().enumerate() {
        if system.parameters()[i] == 1.0 || (i == 3 && system.parameters()[i] == 0.0) {
            continue;
        }
        let at = |by: f64| {
            let mut system = system.clone();
            system.parameters_mut()[i] += by;
            loss(&system, &state)
        };
        let theirs = (at(1e-4) - at(-1e-4)) / 2e-4;
        assert!((ours - theirs).abs() < 1e-9, "{i}: {ours} {theirs}");
    }
}

/// Read by one clock, an arm's second joint was on time, since a clock had to stand on the first.
#[test]
fn a_clock_without_a_joint_stamps_all_joints_of_its_part_alike() {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("a", 1.0, [0.0, 0.0, -0.2], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
        + &link("b", 1.0, [0.0, 0.0, -0.2], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
        + &joint("one", "revolute", "base", "a", [0.0, 1.0, 0.0], [0.0; 6], WIDE)
        + &joint("two", "revolute", "a", "b", [0.0, 1.0, 0.0], [0.0, 0.0, -0.4, 0.0, 0.0, 0.0], WIDE);
    let model = model("arm", &urdf);
    let mut system = System::new(&[welded(&model)]).unwrap();
    system.add_effect("arm", &entry("clock_skew", None, &[("skew", 0.02)])).unwrap();
    system.add_effect("arm", &entry("clock_skew", Some("two"), &[("skew", 0.003)])).unwrap();
    let state = State { time: 3.0, ..system.state() };
    assert_eq!(system.measure(&state, 0.0, 0).stamp.value, 3.02);
    assert!((system.measure(&state, 0.0, 1).stamp.value - 3.023).abs() < 1e-14);
    // Both joints' stamps go with the one number.
    for (v, expected) in [(0, [1.0, 0.0]), (1, [1.0, 1.0])] {
        let mut theta = [0.0; 2];
        system.measure_back(&state, 0.0, v, &mut [0.0, 0.0, 0.0, 1.0], &mut [], &mut theta);
        assert_eq!(theta, expected);
    }
    // What is no clock needs its joint.
    assert!(system.add_effect("arm", &entry("encoder_offset", None, &[("offset", 0.03), ("scale_error", 0.0)])).is_err());
}

#[test]
fn wear_decays_and_scales_losses_alone() {
    let wear = [("amplitude", 0.5), ("time_constant", 2.0)];
    let spring = [("stiffness", 4.0), ("rest_position", 0.0)];
    let system = block(1.0, &[("viscous_friction", &[("damping", 3.0)]), ("joint_spring", &spring), ("thermal_wear", &wear)]);
    let mut ws = system.workspace();
    for time in [0.0, 2.0, 50.0] {
        let mut state = system.state();
        (state.q[0], state.v[0], state.time) = (0.2, 1.0, time);
        let mut tau = [0.0];
        system.inverse_dynamics(&mut ws, &state, &[0.0], &[], &mut tau).unwrap();
        let expected = 3.0 * (1.0 + 0.5 * (-time / 2.0_f64).exp()) + 4.0 * 0.2;
        assert!((tau[0] - expected).abs() < 1e-12, "{time}: {}", tau[0]);
    }
    // A push that the cold joint holds moves the warm one.
    let system = block(1.0, &[("coulomb_friction", &[("friction", 2.0)]), ("thermal_wear", &wear)]);
    let mut state = system.state();
    run(&system, &mut state, 1e-3, 100, |_| 2.5, |s| assert_eq!(s.v[0], 0.0));
    run(&system, &mut state, 1e-3, 10_000, |_| 2.5, |_| {});
    assert!(state.v[0] > 0.5);
}

/// Springs that hardly give way let joints stand: what goes on without a step is where many steps bring it, of a base and of air behind a seal.
#[test]
fn what_goes_on_while_joints_stand_is_where_steps_bring_it() {
    for ratio in [0.0, 0.07, 1.0] {
        let mut model = base_with_blocks(Some(&[("frequency", 5.0), ("damping_ratio", ratio), ("mass", 10.0)]));
        model.document.effects.push(entry("joint_spring", Some("ja"), &[("stiffness", 1e9), ("rest_position", 0.0)]));
        let air = [("stiffness", 1.0), ("time_constant", 0.5), ("seal_position", 0.0)];
        model.document.effects.push(entry("air_suction", Some("ja"), &air));
        let system = System::new(&[Part::welded(&model, Isometry3::identity())]).unwrap();
        let (mut state, mut ws) = (system.state(), system.workspace());
        state.z.copy_from_slice(&[0.01, -0.2, 0.3]);
        // The workspace knows what the base carries after a step.
        system.step(&mut ws, &mut state.clone(), &Input::default(), 1e-5).unwrap();
        let mut stood = state.clone();
        system.stand(&ws, &mut stood, 0.4);
        for _ in 0..40_000 {
            system.step(&mut ws, &mut state, &Input::default(), 1e-5).unwrap();
        }
        let near = stood.z.iter().zip(&state.z).zip([2e-5, 1e-3, 1e-5]).all(|((a, b), bound)| (a - b).abs() < bound);
        assert!(near && stood.z[2] < 0.14, "{ratio}: {:?} {:?}", stood.z, state.z);
    }
}

/// Two blocks on one base along x, and the base that gives way.
fn on_a_base(mode: Option<&[(&str, f64)]>) -> System {
    System::new(&[Part::welded(&base_with_blocks(mode), Isometry3::identity())]).unwrap()
}

fn base_with_blocks(mode: Option<&[(&str, f64)]>) -> ObjectModel {
    let body = |n: &str| link(n, 2.0, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1]);
    let urdf = link("base", 5.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &body("a")
        + &body("b")
        + &joint("ja", "prismatic", "base", "a", [1.0, 0.0, 0.0], [0.0; 6], WIDE)
        + &joint("jb", "prismatic", "base", "b", [0.0, 1.0, 0.0], [0.0; 6], WIDE);
    let mut model = model("table", &urdf);
    if let Some(parameters) = mode {
        model.document.effects.push(EffectEntry { joint: None, ..entry("unmodelled_mode", None, parameters) });
    }
    model
}

#[test]
fn a_base_that_gives_way_is_felt_along_its_direction_and_keeps_momentum() {
    let parameters = [("frequency", 5.0), ("damping_ratio", 0.0), ("mass", 10.0)];
    let system = on_a_base(Some(&parameters));
    let (mut state, mut ws) = (system.state(), system.workspace());
    system.step(&mut ws, &mut state, &Input { tau: &[1.0, 1.0], ..Input::default() }, 1e-4).unwrap();
    // Across its direction nothing changes.
    let (a, b) = (state.v[0] / 1e-4, state.v[1] / 1e-4);
    assert!((b - 0.5).abs() < 1e-9, "{b}");
    // The whole part, the block across it too, sways with the base: 10 + 2 kg beside the block of 2 kg along it.
    let expected = 1.0 / (2.0 - 4.0 / 14.0);
    assert!((a - expected).abs() < 1e-4, "{a} {expected}");
    // Let go with the base displaced, everything swings: energy is kept.
    let mut state = system.state();
    let z = system.placements().iter().find(|p| p.effect.description().name == "unmodelled_mode").unwrap().z.start;
    state.z[z] = 0.01;
    let energy = |s: &State| {
        let stiffness = (TAU * 5.0).powi(2) * 10.0;
        let (x, rate) = (s.z[z], s.z[z + 1]);
        0.5 * stiffness * x * x + 0.5 * 12.0 * rate * rate + 0.5 * 2.0 * (s.v[0] + rate).powi(2) + 0.5 * 2.0 * s.v[1].powi(2)
    };
    let start = energy(&state);
    for _ in 0..5000 {
        system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
        assert!((energy(&state) / start - 1.0).abs() < 1e-9, "{} {start}", energy(&state));
    }
    assert!(state.v[0].abs() > 0.0);
    // A very stiff and heavy base is none.
    let firm = on_a_base(Some(&[("frequency", 1e4), ("damping_ratio", 1.0), ("mass", 1e9)]));
    let none = on_a_base(None);
    let end = |system: &System| {
        let (mut state, mut ws) = (system.state(), system.workspace());
        for _ in 0..100 {
            system.step(&mut ws, &mut state, &Input { tau: &[1.0, 0.5], ..Input::default() }, 1e-3).unwrap();
        }
        state.q
    };
    for (a, b) in end(&firm).iter().zip(end(&none)) {
        assert!((a - b).abs() < 1e-8, "{a} {b}");
    }
}

#[test]
fn all_effects_together_step_without_a_number_that_is_none() {
    let mut rng = crate::common::random(61);
    let mut system = block(1.3, &[]);
    for effect in sagci_dynamics::effects::catalogue() {
        let d = effect.description();
        let parameters: Vec<_> =
            d.parameters.iter().filter(|p| p.words.is_empty()).map(|p| (p.name, crate::draw(p, 1, &mut rng))).collect();
        let joint = (d.acts != sagci_dynamics::effects::Acts::Base).then_some("slide");
        system.add_effect("slide", &entry(d.name, joint, &parameters)).unwrap();
    }
    for dt in [1e-3, 5e-3] {
        let mut state = system.state();
        run(&system, &mut state, dt, 2000, |s| 60.0 * (3.0 * s.time).sin(), |_| {});
        let again = |mut state: State| {
            run(&system, &mut state, dt, 10, |_| 1.0, |_| {});
            state
        };
        assert_eq!(again(state.clone()), again(state));
    }
}
