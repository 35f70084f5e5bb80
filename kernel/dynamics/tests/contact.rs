//! Physics of contact: rest, sliding, rolling, impacts, stacks, grasps, and faults.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, non_snake_case)]

mod common;

use common::model;
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3, Vector6};
use sagci_dynamics::{ContactMaterial, ContactOptions, Coriolis, Grasp, Input, Linearisation, Part, State, StepWorkspace, System};
use sagci_model::ObjectModel;

const G: f64 = 9.81;

/// A rigid body of one shape, its centre of mass in the middle.
fn solid(name: &str, mass: f64, inertia: [f64; 3], geometry: &str) -> ObjectModel {
    let [x, y, z] = inertia;
    model(
        name,
        &format!(
            "<link name='{name}'><inertial><mass value='{mass}'/><inertia ixx='{x}' ixy='0' ixz='0' iyy='{y}' iyz='0' izz='{z}'/></inertial>\
             <collision><geometry>{geometry}</geometry></collision></link>"
        ),
    )
}

fn cube(name: &str, mass: f64, size: [f64; 3]) -> ObjectModel {
    let [x, y, z] = size;
    let m = mass / 12.0;
    solid(name, mass, [m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y)], &format!("<box size='{x} {y} {z}'/>"))
}

fn ball(name: &str, mass: f64, r: f64) -> ObjectModel {
    solid(name, mass, [0.4 * mass * r * r; 3], &format!("<sphere radius='{r}'/>"))
}

fn scene(models: &[&ObjectModel], options: ContactOptions) -> System {
    let parts: Vec<Part<'_>> = models.iter().map(|m| Part::floating(m)).collect();
    System::new(&parts).unwrap().with_contacts(&parts, options).unwrap()
}

fn ground(system: &mut System, normal: Vector3<f64>, friction: f64) {
    let material = ContactMaterial { friction, ..ContactMaterial::default() };
    system.add_ground("ground", Vector3::zeros(), Unit::new_normalize(normal), material).unwrap();
}

fn options(friction: f64) -> ContactOptions {
    ContactOptions { material: ContactMaterial { friction, ..ContactMaterial::default() }, ..ContactOptions::default() }
}

/// Places the k-th floating body.
fn place(state: &mut State, k: usize, p: Vector3<f64>, R: UnitQuaternion<f64>) {
    state.q[7 * k..7 * k + 7].copy_from_slice(&[R.w, R.i, R.j, R.k, p.x, p.y, p.z]);
}

fn run(system: &System, ws: &mut StepWorkspace, state: &mut State, dt: f64, steps: usize) {
    for _ in 0..steps {
        system.step(ws, state, &Input::default(), dt).unwrap();
    }
}

/// Kinetic energy, and potential energy of gravity; springs of contact left out.
fn energy(system: &System, ws: &mut StepWorkspace, state: &State) -> f64 {
    system.multibody().set_state(ws.rigid(), &state.q, &state.v).unwrap();
    let multibody = system.multibody();
    let mut e = multibody.kinetic_energy(ws.rigid());
    for (id, _, _) in multibody.links() {
        let X = multibody.X_WL(ws.rigid(), id);
        let inertia = multibody.body_inertia(id);
        e -= inertia.mass * multibody.gravity().dot(&(X * nalgebra::Point3::from(inertia.center())).coords);
    }
    e
}

/// A box on a slope of the angle `a`: how far it slid along it after `steps` of 1 ms.
fn slope(a: f64, friction: f64, steps: usize) -> (f64, f64) {
    let cube = cube("cube", 1.0, [0.1, 0.1, 0.06]);
    let mut system = scene(&[&cube], options(friction));
    let n = Vector3::new(a.sin(), 0.0, a.cos());
    ground(&mut system, n, friction);
    let (mut ws, mut state) = (system.workspace(), system.state());
    let R = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), a);
    place(&mut state, 0, n * 0.03, R);
    run(&system, &mut ws, &mut state, 1e-3, 200);
    let p0 = Vector3::new(state.q[4], state.q[5], state.q[6]);
    run(&system, &mut ws, &mut state, 1e-3, steps);
    let p = Vector3::new(state.q[4], state.q[5], state.q[6]);
    let down = Vector3::new(a.cos(), 0.0, -a.sin());
    ((p - p0).dot(&down), R.transform_vector(&Vector3::new(state.v[3], state.v[4], state.v[5])).dot(&down))
}

#[test]
fn a_box_below_the_friction_angle_stays_for_ten_minutes() {
    let (way, _) = slope(0.45_f64.atan(), 0.5, 600_000);
    assert!(way.abs() < 1e-3, "{way:e}");
}

#[test]
fn a_box_above_the_friction_angle_slides_as_coulomb_says() {
    for (a, mu) in [(0.6_f64, 0.5), (0.5, 0.3), (1.0, 0.2)] {
        let (way, speed) = slope(a, mu, 500);
        let expected = G * (a.sin() - mu * a.cos());
        let (from_speed, from_way) = (speed / 0.7, 2.0 * way / (0.7 * 0.7 - 0.2 * 0.2));
        assert!((from_speed / expected - 1.0).abs() < 0.01, "{from_speed} {expected}");
        assert!((from_way / expected - 1.0).abs() < 0.01, "{from_way} {expected}");
    }
}

#[test]
fn a_ball_that_slides_ends_up_rolling_with_five_sevenths_of_its_speed() {
    let ball = ball("ball", 0.5, 0.05);
    let mut system = scene(&[&ball], options(0.4));
    ground(&mut system, Vector3::z(), 0.4);
    let (mut ws, mut state) = (system.workspace(), system.state());
    state.q[6] = 0.05;
    state.v[3] = 1.0;
    run(&system, &mut ws, &mut state, 1e-4, 5000);
    let R = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(state.q[0], state.q[1], state.q[2], state.q[3]));
    let (w, v) = (R * Vector3::new(state.v[0], state.v[1], state.v[2]), R * Vector3::new(state.v[3], state.v[4], state.v[5]));
    assert!((v.x - 5.0 / 7.0).abs() < 0.001, "{v:?}");
    assert!((v.x - 0.05 * w.y).abs() < 1e-4, "{v:?} {w:?}");
    assert!(ws.contacts(&system).all(|c| c.sticks));
}

#[test]
fn a_stack_of_boxes_stays_at_rest() {
    let cubes: Vec<ObjectModel> = (0..4).map(|k| cube(&format!("cube{k}"), 1.0, [0.1, 0.1, 0.1])).collect();
    let mut system = scene(&cubes.iter().collect::<Vec<_>>(), options(0.5));
    ground(&mut system, Vector3::z(), 0.5);
    let (mut ws, mut state) = (system.workspace(), system.state());
    for k in 0..4 {
        place(&mut state, k, Vector3::new(0.003 * k as f64, 0.0, 0.05 + 0.1 * k as f64), UnitQuaternion::identity());
    }
    run(&system, &mut ws, &mut state, 1e-3, 3000);
    assert_eq!(ws.contacts(&system).count(), 16);
    for k in 0..4 {
        assert!((state.q[7 * k + 4] - 0.003 * k as f64).abs() < 1e-5);
        assert!((state.q[7 * k + 6] - 0.05 - 0.1 * k as f64).abs() < 1e-4);
        assert!(state.v[6 * k..6 * k + 6].iter().all(|v| v.abs() < 1e-5), "{:?}", state.v);
    }
    let force: f64 = ws.contacts(&system).filter(|c| c.b == "ground").map(|c| c.impulse_W.z / 1e-3).sum();
    assert!((force - 4.0 * G).abs() < 1e-3, "{force}");
}

#[test]
fn a_step_with_contact_depends_on_nothing_but_its_state() {
    let (low, high) = (cube("low", 1.0, [0.2, 0.2, 0.1]), ball("high", 0.3, 0.05));
    let mut system = scene(&[&low, &high], options(0.5));
    ground(&mut system, Vector3::z(), 0.5);
    let (mut used, mut state) = (system.workspace(), system.state());
    place(&mut state, 0, Vector3::new(0.0, 0.0, 0.0499), UnitQuaternion::identity());
    place(&mut state, 1, Vector3::new(0.01, 0.0, 0.16), UnitQuaternion::identity());
    // Slides, is fallen upon, and comes to rest.
    state.v[3] = 0.4;
    for k in 0..400 {
        let mut fresh = state.clone();
        system.step(&mut system.workspace(), &mut fresh, &Input::default(), 1e-3).unwrap();
        run(&system, &mut used, &mut state, 1e-3, 1);
        assert_eq!(fresh, state, "step {k}");
    }
}

#[test]
fn bodies_that_collide_keep_their_momentum() {
    let (a, b) = (cube("a", 1.0, [0.1, 0.2, 0.15]), cube("b", 0.4, [0.2, 0.1, 0.1]));
    let mut system = scene(&[&a, &b], options(0.5));
    system.multibody_mut().set_gravity(Vector3::zeros());
    system.set_coriolis(Coriolis::AtMidpoint);
    let (mut ws, mut state) = (system.workspace(), system.state());
    place(&mut state, 0, Vector3::new(0.0, 0.0, 0.0), UnitQuaternion::from_euler_angles(0.3, 0.2, 0.5));
    place(&mut state, 1, Vector3::new(0.25, 0.05, 0.03), UnitQuaternion::from_euler_angles(0.9, 0.1, -0.5));
    state.v[3..6].copy_from_slice(&[1.0, 0.5, 0.2]);
    state.v[9..12].copy_from_slice(&[-1.0, 0.3, 0.1]);
    let momentum = |ws: &mut StepWorkspace, state: &State| {
        system.multibody().set_state(ws.rigid(), &state.q, &state.v).unwrap();
        system.multibody().momentum(ws.rigid())
    };
    let before = momentum(&mut ws, &state);
    let mut touched = false;
    for _ in 0..400 {
        // Impulses are exactly opposite; what is left is the turning of axes over a step.
        system.step(&mut ws, &mut state, &Input::default(), 1e-3).unwrap();
        touched |= ws.contacts(&system).any(|c| c.impulse_W.norm() > 1e-3);
    }
    let after = momentum(&mut ws, &state);
    assert!(touched);
    assert!((after.linear - before.linear).norm() < 5e-3 * before.linear.norm(), "{before:?} {after:?}");
}

#[test]
fn energy_never_grows() {
    let shapes = [
        cube("box", 1.0, [0.1, 0.15, 0.2]),
        ball("ball", 0.5, 0.08),
        solid("capsule", 0.7, [2e-3, 2e-3, 5e-4], "<capsule radius='0.04' length='0.2'/>"),
        solid("cylinder", 0.7, [2e-3, 2e-3, 1e-3], "<cylinder radius='0.05' length='0.2'/>"),
    ];
    for seed in 0..12 {
        let mut rng = common::random(seed);
        let shape = &shapes[seed as usize % 4];
        let mut system = scene(&[shape], options(0.3));
        ground(&mut system, Vector3::z(), 0.3);
        let (mut ws, mut state) = (system.workspace(), system.state());
        let turn = common::random_vector(6, 2.0, &mut rng);
        place(&mut state, 0, Vector3::new(0.0, 0.0, 0.4), UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]));
        state.v.copy_from_slice(&turn);
        let mut last = energy(&system, &mut ws, &state);
        let first = last;
        for step in 0..3000 {
            if let Err(e) = system.step(&mut ws, &mut state, &Input::default(), 1e-3) {
                panic!("seed {seed} step {step}: {e} {state:?} {:?}", ws.contacts(&system).collect::<Vec<_>>());
            }
            let now = energy(&system, &mut ws, &state);
            // What springs of contact give back, and the integrator's error in free flight.
            let spring: f64 = ws.contacts(&system).map(|c| 0.5 * 1e6 * c.depth.max(0.0).powi(2)).sum();
            assert!(now < last + spring + 2e-5 * first.abs(), "seed {seed}: {last} {now} {spring}");
            last = now;
        }
        assert!(state.q[6] > 0.0 && state.v.iter().all(|v| v.abs() < 50.0), "{state:?}");
    }
}

/// Largest difference between a step's derivatives and central differences, over the size of the largest entry. `None` where a contact
/// opens, closes, starts or stops to slide, or changes its corner within the differences.
fn gradient_error(system: &System, ws: &mut StepWorkspace, state: &State, tau: &[f64], dt: f64, e: f64) -> Option<f64> {
    let signature = |ws: &StepWorkspace| -> Vec<(u32, bool, bool, bool)> {
        ws.contacts(system).map(|c| (c.id, c.sticks, c.depth > 0.0, c.impulse_W.norm() > 0.0)).collect()
    };
    let multibody = system.multibody();
    let n = multibody.nv();
    let mut x = Linearisation::new(system);
    let mut next = state.clone();
    system.linearise(ws, state, &Input { tau, external: &[] }, dt, &mut next, &mut x).unwrap();
    let here = signature(ws);
    let mut worst = 0.0_f64;
    let size = x.A.amax().max(x.B.amax());
    for c in 0..3 * n {
        let mut ends: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        for sign in [2.0, 1.0, -1.0, -2.0] {
            let (mut start, mut tau) = (state.clone(), tau.to_vec());
            let mut step = vec![0.0; n];
            step[c % n] = sign * e;
            match c / n {
                0 => multibody.integrate(&mut start.q, &step, 1.0).unwrap(),
                1 => start.v[c % n] += sign * e,
                _ => tau[c % n] += sign * e / dt,
            }
            system.step(ws, &mut start, &Input { tau: &tau, external: &[] }, dt).unwrap();
            if signature(ws) != here {
                return None;
            }
            let mut q = vec![0.0; n];
            multibody.difference(&next.q, &start.q, &mut q).unwrap();
            ends.push((q, start.v));
        }
        for k in 0..n {
            let scale = if c < 2 * n { 1.0 } else { dt };
            // Differences of fourth order.
            let slope = |of: &dyn Fn(usize) -> f64| (8.0 * (of(1) - of(2)) - (of(0) - of(3))) / (12.0 * e) * scale;
            let (dq, dv) = (slope(&|i| ends[i].0[k]), slope(&|i| ends[i].1[k]));
            let column = |r: usize| if c < 2 * n { x.A[(r, c)] } else { x.B[(r, c - 2 * n)] };
            worst = worst.max((dq - column(k)).abs() / size).max((dv - column(n + k)).abs() / size);
        }
    }
    Some(worst)
}

#[test]
fn the_step_has_the_derivatives_that_it_says_with_contact_and_without() {
    let shapes = [
        cube("box", 1.0, [0.1, 0.15, 0.2]),
        ball("ball", 0.5, 0.08),
        solid("capsule", 0.7, [2e-3, 2e-3, 5e-4], "<capsule radius='0.04' length='0.2'/>"),
        solid("cylinder", 0.7, [2e-3, 2e-3, 1e-3], "<cylinder radius='0.05' length='0.2'/>"),
    ];
    let (mut good, mut all, mut touching, mut switching) = (0, 0, 0, 0);
    for seed in 0..8 {
        let mut rng = common::random(seed + 50);
        let base = cube("base", 2.0, [0.5, 0.5, 0.1]);
        let material = ContactMaterial { stiffness: 2e4, dissipation: 1.0, friction: 0.4 };
        let mut system = scene(&[&base, &shapes[seed as usize % 4]], ContactOptions { material, slip: 1e-3, ..ContactOptions::default() });
        ground(&mut system, Vector3::z(), 0.3);
        system.set_coriolis(Coriolis::AtStart);
        let (mut ws, mut state) = (system.workspace(), system.state());
        let turn = common::random_vector(6, 1.5, &mut rng);
        place(&mut state, 0, Vector3::new(0.0, 0.0, 0.0501), UnitQuaternion::identity());
        place(&mut state, 1, Vector3::new(0.05, 0.02, 0.3), UnitQuaternion::from_euler_angles(turn[0], turn[1], turn[2]));
        state.v[6..].copy_from_slice(&turn);
        let tau = common::random_vector(12, 0.01, &mut rng);
        for step in 0..600 {
            if step % 12 == 0 {
                all += 1;
                // Differences are too coarse where slopes change fast, and too fine for the solver's tolerance: the best of four.
                let errors = [1e-4, 3e-5, 1e-5, 3e-6].map(|e| gradient_error(&system, &mut ws, &state, &tau, 2e-3, e));
                let best = errors.iter().flatten().copied().fold(f64::INFINITY, f64::min);
                if best < 1e-6 {
                    good += 1;
                    touching += usize::from(ws.contacts(&system).any(|c| c.impulse_W.norm() > 0.0));
                } else {
                    // Only where something switches within the differences.
                    assert!(errors.iter().any(Option::is_none), "seed {seed}, step {step}: {errors:?}");
                    switching += 1;
                }
            }
            system.step(&mut ws, &mut state, &Input { tau: &tau, external: &[] }, 2e-3).unwrap();
        }
    }
    println!("derivatives agree in {good} of {all} states, {touching} of them with contact; {switching} switch within the differences");
    assert!(touching > 300 && switching < all / 50, "{good} {touching} {switching} of {all}");
}

/// Two equal balls on a line without gravity: gradients of the struck ball's last position by the first positions and velocities.
fn two_balls(dt: f64, share: f64) -> ([f64; 4], [f64; 4], f64) {
    let (a, b) = (ball("a", 1.0, 0.1), ball("b", 1.0, 0.1));
    let material = ContactMaterial { stiffness: 1e3, dissipation: 0.0, friction: 0.5 };
    let mut system = scene(&[&a, &b], ContactOptions { material, share, ..ContactOptions::default() });
    system.multibody_mut().set_gravity(Vector3::zeros());
    system.set_coriolis(Coriolis::AtStart);
    let (mut ws, mut state) = (system.workspace(), system.state());
    place(&mut state, 1, Vector3::new(0.5, 0.0, 0.0), UnitQuaternion::identity());
    state.v[3] = 1.0;
    let n = 12;
    let mut x = Linearisation::new(&system);
    let mut whole = nalgebra::DMatrix::<f64>::identity(2 * n, 2 * n);
    for _ in 0..(1.0 / dt).round() as usize {
        let before = state.clone();
        system.linearise(&mut ws, &before, &Input::default(), dt, &mut state, &mut x).unwrap();
        whole = &x.A * whole;
    }
    let row = |r: usize| [3, 9, n + 3, n + 9].map(|c| whole[(r, c)]);
    (row(9), row(n + 9), state.v[9])
}

#[test]
fn an_elastic_blow_hands_position_and_velocity_on_with_their_gradients() {
    // Of two equal balls the struck one ends where the other would have been: after a second its position has the gradient
    // (1, 0, 1, 0) by (x_a, x_b, v_a, v_b), its velocity (0, 0, 1, 0). A compliant blow takes the time T = pi sqrt(m / 2 k), whatever the
    // speed, in which both move at half of it; that leaves (1, 0, 1 - T / 2, T / 2), and (1, 0, 1, 0) as T goes to nothing.
    let (position, velocity, speed) = two_balls(1e-5, 0.0);
    let lasts = std::f64::consts::PI * (1.0 / (2.0 * 500.0_f64)).sqrt();
    assert!((speed - 1.0).abs() < 1e-4, "{speed}");
    for (got, expected) in position.iter().zip([1.0, 0.0, 1.0 - 0.5 * lasts, 0.5 * lasts]).chain(velocity.iter().zip([0.0, 0.0, 1.0, 0.0]))
    {
        assert!((got - expected).abs() < 5e-3, "{position:?} {velocity:?}");
    }
    // Taken ahead, the blow loses energy to the step, less with a smaller one.
    let (_, _, slow) = two_balls(1e-4, 1.0);
    let (_, _, fine) = two_balls(2e-5, 1.0);
    assert!(slow < fine && fine < 1.0 && fine > 0.98, "{slow} {fine}");
}

#[test]
fn a_grasp_holds_up_to_its_limit_and_not_beyond() {
    let base = cube("base", 1.0, [0.1, 0.1, 0.1]);
    let held = cube("held", 2.0, [0.1, 0.1, 0.1]);
    let parts = [Part::welded(&base, Isometry3::identity()), Part::floating(&held)];
    for (limit, falls) in [(40.0, false), (15.0, true)] {
        let mut system = System::new(&parts).unwrap();
        let link = |name: &str| system.multibody().link(name).unwrap();
        let (a, b) = (link("base/base"), link("held/held"));
        let (stiffness, damping) = (Vector6::new(50.0, 50.0, 50.0, 5e3, 5e3, 5e3), Vector6::new(1.0, 1.0, 1.0, 100.0, 100.0, 100.0));
        let X_AG = Isometry3::translation(0.3, 0.0, 0.0);
        system.add_grasp(Grasp { a, X_AG, b, X_BH: Isometry3::identity(), stiffness, damping, limit: [10.0, limit] }).unwrap();
        let (mut ws, mut state) = (system.workspace(), system.state());
        place(&mut state, 0, Vector3::new(0.3, 0.0, 0.0), UnitQuaternion::identity());
        run(&system, &mut ws, &mut state, 1e-3, 2000);
        if falls {
            assert!(state.q[6] < -1.0, "{state:?}");
        } else {
            // y / sqrt(1 + (y / F)^2) = m g
            let load = 2.0 * G;
            let sag = load / (1.0 - (load / limit).powi(2)).sqrt() / 5e3;
            assert!((state.q[6] + sag).abs() < 1e-4 && state.v.iter().all(|v| v.abs() < 1e-4), "{state:?}");
        }
    }
}

#[test]
fn faults_are_named_and_nothing_is_left_not_a_number() {
    let cube = cube("cube", 1.0, [0.1, 0.1, 0.1]);
    let parts = [Part::floating(&cube)];
    for bad in [
        ContactOptions { slip: 0.0, ..ContactOptions::default() },
        ContactOptions { margin: f64::NAN, ..ContactOptions::default() },
        ContactOptions { share: 2.0, ..ContactOptions::default() },
        ContactOptions { material: ContactMaterial { stiffness: -1.0, ..ContactMaterial::default() }, ..ContactOptions::default() },
    ] {
        assert!(System::new(&parts).unwrap().with_contacts(&parts, bad).is_err());
    }
    let mut system = scene(&[&cube], options(0.5));
    ground(&mut system, Vector3::z(), 0.5);
    let other = System::new(&parts).unwrap();
    let mut state = system.state();
    assert!(system.step(&mut other.workspace(), &mut state, &Input::default(), 1e-3).is_err());
    let mut ws = system.workspace();
    for dt in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(system.step(&mut ws, &mut state, &Input::default(), dt).is_err());
    }
    state.q[6] = f64::NAN;
    assert!(system.step(&mut ws, &mut state, &Input::default(), 1e-3).is_err());

    // Far under the ground, in one another's centre, and very fast: finite, or an error.
    let balls = [ball("a", 1.0, 0.1), ball("b", 1e-3, 0.1)];
    let mut system = scene(&[&balls[0], &balls[1], &cube], options(0.5));
    ground(&mut system, Vector3::z(), 0.5);
    for (height, speed) in [(-5.0, 0.0), (0.05, 1e3), (0.0, -1e5), (1e6, 1e8)] {
        let (mut ws, mut state) = (system.workspace(), system.state());
        for k in 0..3 {
            state.q[7 * k + 6] = height;
        }
        state.v[3] = speed;
        state.v[14] = speed;
        for _ in 0..50 {
            if system.step(&mut ws, &mut state, &Input::default(), 1e-3).is_err() {
                break;
            }
            assert!(state.q.iter().chain(&state.v).all(|x| x.is_finite()));
        }
        assert!(state.q.iter().chain(&state.v).all(|x| x.is_finite()));
    }
}

#[test]
fn a_mesh_without_volume_is_an_error_that_names_its_link() {
    let mut sheet = cube("sheet", 1.0, [0.1, 0.1, 0.1]);
    let corner = |x: f64, y: f64| nalgebra::Point3::new(x, y, 0.0);
    let vertices = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0), corner(1.0, 1.0)];
    let mesh = sagci_model::TriangleMesh { vertices, triangles: vec![[0, 1, 2], [1, 3, 2]] };
    sheet.links[0].collisions[0].geometry =
        sagci_model::Geometry::Mesh { file: "flat.obj".into(), scale: Vector3::repeat(1.0), mesh: std::sync::Arc::new(mesh) };
    let parts = [Part::floating(&sheet)];
    let error = System::new(&parts).unwrap().with_contacts(&parts, ContactOptions::default()).unwrap_err().to_string();
    assert!(error.contains("sheet/sheet") && error.contains("volume"), "{error}");
}
