//! One degree of freedom more: the part's base is a mass on a spring and a damper that gives way along one direction of the
//! world, driven by the forces with which the part's own motion reacts on it. `frequency` and `damping_ratio` are those of the base
//! alone. Joints feel it together, through their share `p(q)` of the part's momentum along the direction:
//! `M dv/dt + p ds'/dt + c + g = tau`, `(mass + m) ds'/dt + p^T dv/dt + p'^T v + damping s' + stiffness s = 0`.
//!
//! Inner states: the base's displacement and its rate. A step takes the base by the implicit midpoint rule and condenses it onto
//! the joints' next velocities (the part's share of the mass matrix less `p p^T / D`), so it is as stable as the joints.

use nalgebra::Vector3;

use super::{ABOVE_ZERO, Acts, Description, Law, Number, Parameter, Prior, Sway, around, parameters, unit};

/// With more of it nothing swings: it is a loss, and has another name.
const SWINGS: [f64; 2] = [0.0, 1.0];

#[derive(Debug)]
pub(super) struct UnmodelledMode;

static DESCRIPTION: Description = Description {
    name: "unmodelled_mode",
    summary: "the base gives way: a mass on a spring and a damper along one direction (no joint)",
    acts: Acts::Base,
    parameters: &[
        Parameter::new("frequency", ["Hz", "Hz"], [1e-3, 1e4], [around(8.0, 0.8), around(8.0, 0.8)]),
        Parameter::new("damping_ratio", unit::ONE, SWINGS, [around(0.03, 0.8), around(0.03, 0.8)]),
        Parameter::new("mass", ["kg", "kg"], ABOVE_ZERO, [around(30.0, 1.0), around(30.0, 1.0)]),
        Parameter {
            words: &["x", "y", "z"],
            prior: [Prior::OneOf(&[0.0, 1.0, 2.0]); 2],
            ..Parameter::new("direction", unit::ONE, [0.0, 2.0], [Prior::OneOf(&[0.0, 1.0, 2.0]); 2])
        },
    ],
    signature: "coherent over the joints",
    confused_with: &["joint_elasticity"],
    experiment: "clamp the base",
    source: "Noel, Kerschen 2017",
    linear: true,
    ..Description::BLANK
};

impl Law for UnmodelledMode {
    fn description(&self) -> &'static Description {
        &DESCRIPTION
    }

    fn states(&self) -> usize {
        2
    }

    fn sway<N: Number>(&self, theta: &[f64]) -> Option<Sway<N>> {
        let [frequency, ratio, mass, ..] = parameters::<N>(theta);
        let pace = frequency * std::f64::consts::TAU;
        let direction = match theta[3] {
            d if d > 1.5 => Vector3::z(),
            d if d > 0.5 => Vector3::y(),
            _ => Vector3::x(),
        };
        Some(Sway { direction, mass, damping: ratio * pace * mass * 2.0, stiffness: pace * pace * mass })
    }
}
