//! A model with the numbers in it that data may move: what is fitted.

use std::f64::consts::{PI, TAU};

use nalgebra::{Cholesky, DMatrix, DVector, Vector3};
use sagci_dynamics::effects::{self, Description, Multiple, Prior};
use sagci_model::{ActuatorLaw, EffectEntry, JointKind, ObjectModel};

use crate::GapError;
use crate::plant::Plant;
use crate::stops::Stops;

/// Share of a joint's way that what is bound to a place may be wide: wider, it is a spring or a friction everywhere.
const LOCAL: f64 = 0.3;
/// Periods over that way from which on a force repeats: with fewer it is a tilt or a spring.
const REPEATS: f64 = 1.0;

/// One number of an object model.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Knob {
    /// Factor on a link's mass and rotational inertia.
    Mass(usize),
    /// One coordinate of a link's centre of mass, m.
    CenterOfMass(usize, usize),
    /// Factor on a link's rotational inertia alone.
    Inertia(usize),
    /// URDF damping of a joint.
    Damping(usize),
    /// URDF dry friction of a joint.
    Friction(usize),
    /// A number of a drive's law.
    Actuator(usize, String),
    /// A parameter of an effect, by its entry in `model.yaml`.
    Effect(usize, &'static str),
    /// How many times the second of an effect's parameters, which comes before it, the first is.
    Times(usize, &'static str, &'static str),
    /// One component of the vector by which an effect turns an axis, rad. Its angle and direction say nothing of each other where there is no
    /// turn yet, and a fit of these never leaves there.
    Turn(usize, usize),
}

impl Knob {
    /// The effect that it belongs to, by its entry in `model.yaml`.
    pub fn entry(&self) -> Option<usize> {
        match self {
            Self::Effect(entry, _) | Self::Times(entry, ..) | Self::Turn(entry, _) => Some(*entry),
            _ => None,
        }
    }

    /// The parameter of an effect that it moves, if it is one, and that of which it says the multiple.
    pub fn parameter(&self) -> Option<(&'static str, Option<&'static str>)> {
        match self {
            Self::Effect(_, name) => Some((name, None)),
            Self::Times(_, name, of) => Some((name, Some(of))),
            _ => None,
        }
    }
}

/// One number to be fitted. `x` is the number itself, or its logarithm.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub knob: Knob,
    pub unit: &'static str,
    /// `x` is the logarithm.
    pub logarithmic: bool,
    /// Bounds of `x`.
    pub bounds: [f64; 2],
    /// Prior mean and standard deviation of `x`.
    pub prior: [f64; 2],
    /// Change of `x` by which derivatives are taken.
    pub difference: f64,
}

impl Fitted {
    pub fn value(&self, x: f64) -> f64 {
        if self.logarithmic { x.exp() } else { x }
    }

    /// Where a difference to both sides of `x` is taken, as far as there is room.
    pub fn sides(&self, x: f64) -> [f64; 2] {
        let reach = WIDE * self.difference;
        [(x - reach).max(self.bounds[0]), (x + reach).min(self.bounds[1])]
    }

    pub fn coordinate(&self, value: f64) -> f64 {
        if self.logarithmic { value.max(1e-300).ln() } else { value }
    }
}

/// A model, what may be moved in it, and where it stands.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    pub model: ObjectModel,
    pub fitted: Vec<Fitted>,
    pub x: Vec<f64>,
    /// How many of the first are the model's own known numbers.
    pub known: usize,
}

/// How much farther than other differences those to both sides reach: whether a joint sticks a row sooner or later is chance, and what that
/// does to a derivative falls with its reach, while curvature cancels.
const WIDE: f64 = 4.0;

/// How far a logarithm may move from its prior, in standard deviations; keeps numbers finite.
const REACH: f64 = 12.0;

/// Standard deviation of what lies anywhere within a tolerance, as a share of that: 1 / sqrt(3).
const EVENLY: f64 = 0.577_350_269_189_625_8;

/// Least share of a body's mass and inertia with which it is still a body.
pub(crate) const LIGHTEST: f64 = 0.1;

/// A number whose whole prior moves the errors by less than this share of their noise is not seen.
const SEEN: f64 = 0.3;

impl Hypothesis {
    /// The model as given, with what counts as known and may be refitted.
    pub fn known(model: &ObjectModel, joints: &[usize]) -> Self {
        let mut this = Self { model: model.clone(), fitted: Vec::new(), x: Vec::new(), known: 0 };
        let tolerance = model.document.refit_tolerance;
        let mut push = |knob, unit, logarithmic, bounds, prior: [f64; 2], difference, x: f64| {
            this.fitted.push(Fitted { knob, unit, logarithmic, bounds, prior, difference });
            this.x.push(x);
        };
        for &i in joints {
            let joint = &model.joints[i];
            let prismatic = usize::from(joint.kind == JointKind::Prismatic);
            let units = [["N m s/rad", "N s/m"][prismatic], ["N m", "N"][prismatic]];
            for (value, knob, unit) in [(joint.damping, Knob::Damping(i), units[0]), (joint.friction, Knob::Friction(i), units[1])] {
                if value > 0.0 {
                    let x = value.ln();
                    push(knob, unit, true, [x - REACH, x + REACH], [x, 1.0], 1e-3, x);
                }
            }
        }
        // Only links that some joint moves have a say.
        let mut moves = vec![false; model.links.len()];
        for joint in &model.joints {
            moves[joint.child] = moves[joint.parent] || joint.kind != JointKind::Fixed;
        }
        for (l, link) in model.links.iter().enumerate() {
            if !moves[l] || link.inertial.mass <= 0.0 {
                continue;
            }
            if tolerance.mass > 0.0 {
                let bounds = [(-tolerance.mass).max(LIGHTEST - 1.0), tolerance.mass];
                let prior = [0.0, EVENLY * tolerance.mass];
                push(Knob::Mass(l), "1", false, bounds, prior, 0.05 * tolerance.mass, 0.0);
                push(Knob::Inertia(l), "1", false, bounds, prior, 0.05 * tolerance.mass, 0.0);
            }
            if tolerance.center_of_mass > 0.0 {
                for axis in 0..3 {
                    let t = tolerance.center_of_mass;
                    push(Knob::CenterOfMass(l, axis), "m", false, [-t, t], [0.0, EVENLY * t], 0.05 * t, 0.0);
                }
            }
        }
        for (a, actuator) in model.document.actuators.iter().enumerate() {
            for (name, fraction) in &actuator.refit {
                let Some(value) = number(&actuator.law, name) else { continue };
                let x = value.ln();
                push(Knob::Actuator(a, name.clone()), "", true, [x - 3.0 * fraction, x + 3.0 * fraction], [x, *fraction], 1e-3, x);
            }
        }
        // Effects that the model already has are known, too.
        for (e, entry) in model.document.effects.iter().enumerate() {
            let prismatic = entry.joint.as_ref().and_then(|j| model.joint(j)).is_some_and(|i| model.joints[i].kind == JointKind::Prismatic);
            if let Ok((effect, values)) = effects::parameters_of(entry) {
                for (fitted, x) in of_effect(effect.description(), e, prismatic, &values) {
                    let wide = [x, fitted.prior[1]];
                    this.fitted.push(Fitted { prior: wide, ..fitted });
                    this.x.push(x);
                }
            }
        }
        this.known = this.x.len();
        this
    }

    /// The same with fewer inertial numbers: those of which the data see nothing but what others show as well give their room to
    /// these. `jacobian` are derivatives of the errors by all numbers.
    ///
    /// On one joint, mass, centre of mass and inertia act through one or a few sums; each costs a run of the simulator.
    pub fn condensed(&self, jacobian: &[DVector<f64>], scale: f64) -> Self {
        let inertial = |k: &Knob| matches!(k, Knob::Mass(_) | Knob::Inertia(_) | Knob::CenterOfMass(..));
        let size = |i: usize| jacobian[i].norm() * self.fitted[i].prior[1] / scale;
        let mut candidates: Vec<usize> = (0..self.known).filter(|i| inertial(&self.fitted[*i].knob)).collect();
        candidates.sort_by(|a, b| size(*b).total_cmp(&size(*a)));
        let mut this = self.clone();
        let mut kept: Vec<usize> = Vec::new();
        for i in candidates {
            let deviation = self.fitted[i].prior[1];
            // What it is in terms of those kept already.
            let matrix = DMatrix::from_fn(kept.len(), kept.len(), |a, b| {
                jacobian[kept[a]].dot(&jacobian[kept[b]]) + if a == b { 1e-9 * jacobian[kept[a]].norm_squared() } else { 0.0 }
            });
            let right = DVector::from_fn(kept.len(), |a, _| jacobian[kept[a]].dot(&jacobian[i]));
            let share = Cholesky::new(matrix).map_or_else(|| DVector::zeros(kept.len()), |c| c.solve(&right));
            let mut rest = jacobian[i].clone();
            for (a, k) in kept.iter().enumerate() {
                rest.axpy(-share[a], &jacobian[*k], 1.0);
            }
            if rest.norm() * deviation / scale > SEEN {
                kept.push(i);
                continue;
            }
            for (a, k) in kept.iter().enumerate() {
                let room = &mut this.fitted[*k];
                room.prior[1] = room.prior[1].hypot(share[a] * deviation);
                let more = share[a].abs() * self.fitted[i].bounds[1];
                let least = if matches!(room.knob, Knob::CenterOfMass(..)) { f64::NEG_INFINITY } else { LIGHTEST - 1.0 };
                room.bounds = [(room.bounds[0] - more).max(least), room.bounds[1] + more];
            }
        }
        let stays = |i: &usize| !inertial(&self.fitted[*i].knob) || kept.contains(i);
        let left: Vec<usize> = (0..self.x.len()).filter(stays).collect();
        this.known = left.iter().filter(|i| **i < self.known).count();
        this.fitted = left.iter().map(|i| this.fitted[*i].clone()).collect();
        this.x = left.iter().map(|i| self.x[*i]).collect();
        this
    }

    /// Writes every sine by an amplitude that is no less than nothing and a phase within half a turn: one sine has many such pairs. Gives the
    /// numbers of which the sign turned.
    pub fn wrap_sines(&mut self) -> Vec<usize> {
        let of = |name: &str| -> Vec<(usize, usize)> {
            let entry = |k: &Knob| if let Knob::Effect(e, n) = k { (*n == name).then_some(*e) } else { None };
            self.fitted.iter().enumerate().filter_map(|(i, f)| Some((entry(&f.knob)?, i))).collect()
        };
        let phases = of("phase");
        let mut turned = Vec::new();
        for (entry, amplitude) in of("amplitude") {
            let Some((_, phase)) = phases.iter().find(|(e, _)| *e == entry) else { continue };
            if self.x[amplitude] < 0.0 {
                self.x[amplitude] = -self.x[amplitude];
                self.x[*phase] += PI;
                turned.push(amplitude);
            }
            self.x[*phase] = PI - (PI - self.x[*phase]).rem_euclid(TAU);
        }
        turned
    }

    /// The same with one more effect, its parameters at the values given.
    pub fn with(&self, effect: &str, joint: Option<&str>, values: &[f64]) -> Result<Self, GapError> {
        let description = effects::find(effect)?.description();
        let mut entry = EffectEntry { effect: effect.into(), joint: joint.map(Into::into), ..EffectEntry::default() };
        for (parameter, value) in description.parameters.iter().zip(values).filter(|(p, value)| !p.is_absent(**value)) {
            match parameter.words.get(*value as usize) {
                Some(word) => drop(entry.choices.insert(parameter.name.into(), (*word).into())),
                None => drop(entry.parameters.insert(parameter.name.into(), *value)),
            }
        }
        let prismatic = joint.and_then(|j| self.model.joint(j)).is_some_and(|i| self.model.joints[i].kind == JointKind::Prismatic);
        let mut this = self.clone();
        let index = this.model.document.effects.len();
        this.model.document.effects.push(entry);
        for (fitted, x) in of_effect(description, index, prismatic, values) {
            this.fitted.push(fitted);
            this.x.push(x);
        }
        Ok(this)
    }

    /// The same, what is bound to a place no wider than a share of a joint's way, and what repeats doing so so many times on it. A cable is bent
    /// somewhere near its way: one that rests far off is a constant force. A joint goes through a detent: one side of it alone is a force like
    /// others. `first` is the first number that this is asked of, `range` where the joint was, and `way` how far places on it lie apart, rad or m.
    pub fn confined(mut self, first: usize, range: [f64; 2], way: f64) -> Self {
        let entries = &self.model.document.effects;
        for (fitted, x) in self.fitted.iter_mut().zip(&mut self.x).skip(first) {
            let [low, high] = fitted.bounds;
            let (least, most) = match fitted.knob {
                Knob::Effect(_, "width") => (low, fitted.coordinate(LOCAL * way)),
                Knob::Effect(_, "cycles_per_turn") => (fitted.coordinate(REPEATS * TAU / way), high),
                Knob::Effect(e, "rest_position") if entries[e].effect == "cable_hysteresis" => (range[0] - way, range[1] + way),
                Knob::Effect(e, "position") if entries[e].effect == "detent" => (range[0], range[1]),
                _ => continue,
            };
            // A joint that was nowhere, or in one place, confines nothing.
            let [least, most] = [least.max(low).min(high), most.min(high).max(low)];
            if least <= most {
                fitted.bounds = [least, most];
                *x = x.max(least).min(most);
            }
        }
        self
    }

    /// The same, its losses as the model states them, those of one of its joints or of all, if one of them is off by more than so many standard
    /// deviations of its prior: without what is missing it may have been fitted to where a fit with it does not find back from.
    pub fn as_given(&self, deviations: f64, of: Option<usize>) -> Option<Self> {
        let loss = |f: &Fitted| matches!(f.knob, Knob::Damping(j) | Knob::Friction(j) if of.is_none_or(|only| only == j));
        let off = |f: &Fitted, x: f64| loss(f) && (x - f.prior[0]).abs() > deviations * f.prior[1];
        self.fitted.iter().zip(&self.x).any(|(f, x)| off(f, *x)).then(|| {
            let x = self.fitted.iter().zip(&self.x).map(|(f, x)| if loss(f) { f.prior[0] } else { *x }).collect();
            Self { x, ..self.clone() }
        })
    }

    /// The same, its bodies as the model states them, if one of them has been fitted to the end of its tolerance: what is missing took it there.
    pub fn bodies_as_given(&self) -> Option<Self> {
        let body = |f: &Fitted| matches!(f.knob, Knob::Mass(_) | Knob::Inertia(_) | Knob::CenterOfMass(..));
        let at_an_end = |f: &Fitted, x: f64| body(f) && (x <= f.bounds[0] || x >= f.bounds[1]);
        self.fitted.iter().zip(&self.x).any(|(f, x)| at_an_end(f, *x)).then(|| {
            let x = self.fitted.iter().zip(&self.x).map(|(f, x)| if body(f) { f.prior[0] } else { *x }).collect();
            Self { x, ..self.clone() }
        })
    }

    /// The same without one of its effects.
    pub fn without(&self, entry: usize) -> Self {
        let mut this = self.clone();
        this.model.document.effects.remove(entry);
        let kept: Vec<usize> = (0..self.x.len()).filter(|i| self.fitted[*i].knob.entry() != Some(entry)).collect();
        this.x = kept.iter().map(|i| self.x[*i]).collect();
        this.fitted = kept.iter().map(|i| self.fitted[*i].clone()).collect();
        for fitted in &mut this.fitted {
            if let Knob::Effect(e, _) | Knob::Times(e, ..) | Knob::Turn(e, _) = &mut fitted.knob {
                *e -= usize::from(*e > entry);
            }
        }
        this
    }

    /// The object model at `x`.
    pub fn model_at(&self, x: &[f64]) -> ObjectModel {
        let mut model = self.model.clone();
        for (fitted, x) in self.fitted.iter().zip(x) {
            let value = fitted.value(*x);
            match &fitted.knob {
                Knob::Mass(l) => {
                    let inertial = &mut model.links[*l].inertial;
                    inertial.mass *= 1.0 + value;
                    inertial.I_LLcm_L *= 1.0 + value;
                }
                Knob::Inertia(l) => model.links[*l].inertial.I_LLcm_L *= 1.0 + value,
                Knob::CenterOfMass(l, axis) => model.links[*l].inertial.p_LoLcm[*axis] += value,
                Knob::Damping(j) => model.joints[*j].damping = value,
                Knob::Friction(j) => model.joints[*j].friction = value,
                Knob::Actuator(a, name) => set_number(&mut model.document.actuators[*a].law, name, value),
                Knob::Effect(e, name) => drop(model.document.effects[*e].parameters.insert((*name).into(), value)),
                Knob::Times(e, name, of) => {
                    let parameters = &mut model.document.effects[*e].parameters;
                    let once = parameters.get(*of).copied().unwrap_or(0.0);
                    parameters.insert((*name).into(), value * once);
                }
                Knob::Turn(e, axis) => {
                    let parameters = &mut model.document.effects[*e].parameters;
                    let mut turn = turn_of(&TURN.map(|name| parameters.get(name).copied().unwrap_or(0.0)));
                    turn[*axis] = value;
                    let angle = turn.norm();
                    let direction = turn / if angle > 0.0 { angle } else { 1.0 };
                    parameters.extend(TURN.iter().map(|name| (*name).to_owned()).zip([angle, direction.x, direction.y, direction.z]));
                }
            }
        }
        model
    }

    /// The simulator at `x`.
    pub fn plant(&self, x: &[f64], limits: &[Stops], step: f64) -> Result<Plant, GapError> {
        Plant::new(&self.model_at(x), limits, step)
    }

    /// Minus the logarithm of the prior, up to a constant.
    pub fn prior(&self, x: &[f64]) -> f64 {
        self.fitted.iter().zip(x).map(|(f, x)| 0.5 * ((x - f.prior[0]) / f.prior[1]).powi(2)).sum()
    }
}

/// Parameters that turn an axis: by an angle, about a direction of any length.
pub(crate) const TURN: [&str; 4] = ["angle", "rx", "ry", "rz"];

/// The vector of such a turn, rad.
pub(crate) fn turn_of(&[angle, x, y, z]: &[f64; 4]) -> Vector3<f64> {
    Vector3::new(x, y, z).try_normalize(1e-12).map_or_else(Vector3::zeros, |direction| angle * direction)
}

/// The parameters of an effect that can be fitted, with where they stand. A place of either sign that has a size is zero where the effect acts
/// everywhere: a fit by its logarithm never comes back to that, so it stays.
fn of_effect(description: &'static Description, entry: usize, prismatic: bool, values: &[f64]) -> Vec<(Fitted, f64)> {
    let side = usize::from(prismatic);
    let second = description.second_word(values);
    let numbers = description.parameters.iter().zip(values).filter(|(p, value)| p.words.is_empty() && !p.is_absent(**value));
    let turn = match (description.parameters, values) {
        ([first, ..], [angle, x, y, z, ..]) if first.name == TURN[0] => match first.prior[side] {
            Prior::Normal { deviation, .. } => Some((first, deviation, turn_of(&[*angle, *x, *y, *z]))),
            _ => None,
        },
        _ => None,
    };
    let turning = turn.into_iter().flat_map(|(angle, deviation, turn)| {
        (0..3).map(move |axis| {
            let knob = Knob::Turn(entry, axis);
            let (bounds, prior, difference) = (angle.bounds, [0.0, deviation], 2e-3 * deviation);
            (Fitted { knob, unit: angle.unit[side], logarithmic: false, bounds, prior, difference }, turn[axis])
        })
    });
    let rest = numbers.filter(|(parameter, _)| turn.is_none() || !TURN.contains(&parameter.name)).filter_map(|(parameter, value)| {
        let second = parameter.of_second.filter(|_| second);
        let (unit, prior) = second.map_or((parameter.unit, parameter.prior), |s| (s.unit, s.prior));
        if let Some(multiple) = parameter.multiple {
            let once = description.parameter(multiple.of).and_then(|of| values.get(of)).copied().unwrap_or(1.0);
            return Some(times(entry, parameter.name, multiple, value / once, unit[side]));
        }
        let (logarithmic, mean, deviation) = match prior[side] {
            Prior::LogNormal { .. } if *value == 0.0 && parameter.bounds[0] < 0.0 => return None,
            Prior::LogNormal { median, spread } => (true, median.ln(), spread),
            Prior::Normal { mean, deviation } => (false, mean, deviation),
            Prior::OneOf(_) => return None,
        };
        let [least, most] = parameter.bounds;
        let bounds = match logarithmic {
            true => [(mean - REACH * deviation).max(least.max(1e-12).ln()), (mean + REACH * deviation).min(most.ln())],
            false => [least.max(mean - 100.0 * deviation), most.min(mean + 100.0 * deviation)],
        };
        let difference = if logarithmic { 2e-3 } else { 2e-3 * deviation };
        let knob = Knob::Effect(entry, parameter.name);
        let fitted = Fitted { knob, unit: unit[side], logarithmic, bounds, prior: [mean, deviation], difference };
        let x = fitted.coordinate(*value).clamp(bounds[0], bounds[1]);
        Some((fitted, x))
    });
    turning.chain(rest).collect()
}

/// A parameter that is fitted as a multiple of another, at a value of that multiple. Its unit is the parameter's own.
fn times(entry: usize, name: &'static str, Multiple { of, median, spread }: Multiple, value: f64, unit: &'static str) -> (Fitted, f64) {
    let prior = [median.ln(), spread];
    let bounds = [prior[0] - REACH * spread, prior[0] + REACH * spread];
    let fitted = Fitted { knob: Knob::Times(entry, name, of), unit, logarithmic: true, bounds, prior, difference: 2e-3 };
    let x = fitted.coordinate(value).clamp(bounds[0], bounds[1]);
    (fitted, x)
}

pub(crate) fn number(law: &ActuatorLaw, name: &str) -> Option<f64> {
    match (law, name) {
        (ActuatorLaw::Torque { max_effort } | ActuatorLaw::PositionServo { max_effort, .. }, "max_effort") => Some(*max_effort),
        (ActuatorLaw::PositionServo { stiffness, .. }, "stiffness") => Some(*stiffness),
        (ActuatorLaw::PositionServo { damping, .. }, "damping") => Some(*damping),
        (ActuatorLaw::DcMotor { torque_constant, .. }, "torque_constant") => Some(*torque_constant),
        (ActuatorLaw::DcMotor { resistance, .. }, "resistance") => Some(*resistance),
        (ActuatorLaw::DcMotor { gain, .. }, "gain") => *gain,
        (ActuatorLaw::DcMotor { max_voltage, .. }, "max_voltage") => Some(*max_voltage),
        _ => None,
    }
    .filter(|x| x.is_finite() && *x > 0.0)
}

fn set_number(law: &mut ActuatorLaw, name: &str, value: f64) {
    match (law, name) {
        (ActuatorLaw::Torque { max_effort } | ActuatorLaw::PositionServo { max_effort, .. }, "max_effort") => *max_effort = value,
        (ActuatorLaw::PositionServo { stiffness, .. }, "stiffness") => *stiffness = value,
        (ActuatorLaw::PositionServo { damping, .. }, "damping") => *damping = value,
        (ActuatorLaw::DcMotor { torque_constant, .. }, "torque_constant") => *torque_constant = value,
        (ActuatorLaw::DcMotor { resistance, .. }, "resistance") => *resistance = value,
        (ActuatorLaw::DcMotor { gain, .. }, "gain") => *gain = Some(value),
        (ActuatorLaw::DcMotor { max_voltage, .. }, "max_voltage") => *max_voltage = value,
        _ => {}
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::{Hypothesis, Knob};
    use crate::search::Search;
    use crate::tests::{door, swing};
    use crate::trajectory::Trajectory;

    /// A door that nobody weighed takes the room of all its inertial numbers into its mass: wider than what is left of a mass at none.
    #[test]
    fn a_body_of_which_little_is_known_keeps_a_mass() {
        let mut model = door();
        (model.document.refit_tolerance.mass, model.document.refit_tolerance.center_of_mass) = (0.8, 0.4);
        let data = [Trajectory::new(&swing(&model, 1e-4, 1), &model).unwrap()];
        let search = Search::new(&model, &data).unwrap();
        let known = search.anew(&crate::fit::Fit::start(&search.problem, Hypothesis::known(&model, &search.joints)).unwrap());
        let condensed = known.hypothesis.condensed(&known.jacobian, 1.0);
        let lowest = |h: &Hypothesis| {
            let bodies = h.fitted.iter().filter(|f| matches!(f.knob, Knob::Mass(_) | Knob::Inertia(_)));
            bodies.map(|f| 1.0 + f.bounds[0]).fold(f64::INFINITY, f64::min)
        };
        assert!(condensed.known < known.hypothesis.known && lowest(&condensed) > 0.0, "{} kg of each", lowest(&condensed));
    }

    /// Rigid teeth have two numbers, and no document says how stiff they are.
    #[test]
    fn what_an_effect_may_do_without_is_fitted_where_it_is_given_and_only_there() {
        let numbers = |values: &[f64]| {
            let more = Hypothesis::known(&door(), &[0]).with("backlash", Some("hinge"), values).unwrap();
            (more.x.len() - more.known, more.model_at(&more.x).document.effects.pop().unwrap().parameters.len())
        };
        assert_eq!(numbers(&[0.01, 0.02, sagci_dynamics::effects::RIGID_TEETH, 0.0, 0.0]), (2, 2));
        assert_eq!(numbers(&[0.01, 0.02, 3e3, 4.0, 0.0]), (4, 4));
    }
}
