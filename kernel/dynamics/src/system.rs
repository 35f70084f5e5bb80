//! A multibody with the effects on its joints: what one simulates and plans with.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use sagci_model::{EffectEntry, JointKind};

use crate::contact::Contacts;
use crate::effects::{self, Acts, Effect, HISTORY, Instant, Resistance};
use crate::error::check;
use crate::multibody::length;
use crate::placed::{MultibodyMut, ParametersMut, SwayPlace, Taken};
use crate::residual::{Placed, Residual};
use crate::{Coriolis, DynamicsError, ExternalWrench, JointInfo, Multibody, Part, StepWorkspace};

/// A multibody with its effects.
///
/// The damping and dry friction of the URDF stand among the effects, as `viscous_friction` and `coulomb_friction`; entries of
/// `model.yaml` come on top of them. A URDF limit stops the joint dead, unless a `hard_stop` on that side takes its place.
#[derive(Debug, Clone)]
pub struct System {
    pub(crate) multibody: Multibody,
    /// The rigid bodies without the effects that change them, where there are such.
    pub(crate) given: Option<Box<Multibody>>,
    placements: Vec<Placement>,
    /// Parameters of all effects, one after the other.
    pub(crate) theta: Vec<f64>,
    states: usize,
    /// Placements on the command and on the measurement, in the order of their stages; those that scale losses.
    pub(crate) commands: Vec<usize>,
    pub(crate) measurements: Vec<usize>,
    pub(crate) wears: Vec<usize>,
    /// Effects that act on joints.
    pub(crate) resisting: Vec<usize>,
    pub(crate) sways: Vec<SwayPlace>,
    /// Is the force of some effect no linear function of the next velocity?
    pub(crate) nonlinear: bool,
    /// Positions between which each degree of freedom is kept by the URDF's limits; infinite where it is not.
    pub(crate) walls: Vec<[f64; 2]>,
    pub(crate) stops: usize,
    pub(crate) coriolis: Coriolis,
    pub(crate) residual: Option<Placed>,
    /// What touches; nothing if there is none.
    pub(crate) contacts: Option<Box<Contacts>>,
    /// Tells systems with other inertias, joints and shapes apart, in all of a program: what is derived from them is kept by it.
    pub(crate) stamp: u64,
}

/// One effect at its place.
#[derive(Debug, Clone)]
pub struct Placement {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Name of the joint's part.
    pub part: String,
    /// The joint; none where it acts on the part's base or on all of its joints.
    pub joint: String,
    /// The joint's entry in `q`, where it has one degree of freedom.
    pub q: Option<usize>,
    /// The degree of freedom; the part's first where no joint is named.
    pub v: usize,
    /// Its parameters in [`System::parameters`].
    pub theta: Range<usize>,
    /// Its inner states in [`State::z`].
    pub z: Range<usize>,
}

/// State of a system.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Positions.
    pub q: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
    /// Inner states of effects.
    pub z: Vec<f64>,
    /// Time, s.
    pub time: f64,
}

/// What acts on a system from outside over one step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Input<'a> {
    /// Drive efforts by velocity, N m or N; empty for none.
    pub tau: &'a [f64],
    /// Forces on links.
    pub external: &'a [ExternalWrench],
}

impl System {
    /// Builds the multibody and places all effects.
    ///
    /// # Errors
    /// As [`Multibody::new`]; an effect, parameter or joint that does not exist; a parameter out of its bounds.
    pub fn new(parts: &[Part<'_>]) -> Result<Self, DynamicsError> {
        let multibody = Multibody::new(parts)?;
        let mut system = Self {
            given: None,
            placements: Vec::new(),
            theta: Vec::new(),
            states: 0,
            commands: Vec::new(),
            measurements: Vec::new(),
            wears: Vec::new(),
            resisting: Vec::new(),
            sways: Vec::new(),
            nonlinear: false,
            walls: Vec::new(),
            stops: 0,
            coriolis: Coriolis::default(),
            residual: None,
            contacts: None,
            stamp: 0,
            multibody,
        };
        system.changed();
        for joint in system.multibody.joints().to_vec() {
            let [lower, upper] = [joint.limits.lower, joint.limits.upper];
            if lower.is_nan() || upper.is_nan() || lower > upper {
                let message = format!("its limits {lower} and {upper} leave no room (those of joints that follow it count)");
                return Err(DynamicsError::Build { part: joint.part.clone(), place: joint.name.clone(), message });
            }
            for (name, value) in [("viscous_friction", joint.damping), ("coulomb_friction", joint.friction)] {
                if value != 0.0 {
                    let parameter = effects::find(name)?.description().parameters[0].name;
                    let entry = EffectEntry {
                        effect: name.into(),
                        joint: Some(joint.name.clone()),
                        parameters: [(parameter.into(), value)].into(),
                        ..EffectEntry::default()
                    };
                    for v in joint.v.clone() {
                        system.place(&entry, &joint, v)?;
                    }
                }
            }
        }
        for part in parts {
            for entry in &part.model.document.effects {
                system.add_effect(&part.name, entry)?;
            }
        }
        system.rebuild_walls();
        Ok(system)
    }

    /// Adds an effect to a joint of a part, to all of them where it may be one for all and no joint is named, or to the part's base where it acts on
    /// that. Workspaces made before do not fit afterwards.
    ///
    /// # Errors
    /// An effect, parameter or joint that does not exist; a parameter out of its bounds; a joint that has several degrees of
    /// freedom or follows another one; a base that is not fixed to the world.
    pub fn add_effect(&mut self, part: &str, entry: &EffectEntry) -> Result<(), DynamicsError> {
        let fault = |message: &str| DynamicsError::Build { part: part.into(), place: entry.effect.clone(), message: message.into() };
        let description = effects::find(&entry.effect).ok().map(|e| e.description());
        let first = || self.multibody.joints().iter().find(|j| j.part == part).cloned();
        if description.is_some_and(|d| d.shared) && entry.joint.is_none() {
            let first = first().ok_or_else(|| fault("acts on all joints of a part that has some"))?;
            return self.place_on_part(entry, &first);
        }
        if description.is_some_and(|d| d.acts == Acts::Base) {
            if entry.joint.is_some() {
                return Err(fault("acts on the base of the part; leave `joint` out"));
            }
            let first = first().ok_or_else(|| fault("acts on the base of a part that has joints"))?;
            if first.kind == JointKind::Floating && first.name == part {
                return Err(fault("acts on a base that is fixed to the world; this one is free"));
            }
            let bodies = self.carried_by_base(part);
            if self.multibody.bodies.iter().zip(&bodies).any(|(b, carried)| *carried && !bodies[b.parent] && b.parent != 0) {
                return Err(fault("acts on a base that is fixed to the world; this one is held by another part"));
            }
            self.place_on_part(entry, &first)?;
            self.sways.push(SwayPlace { placement: self.placements.len() - 1, bodies });
            return Ok(());
        }
        let name = entry.joint.as_deref().ok_or_else(|| fault("acts on no joint; name one under `joint`"))?;
        let joint = self.multibody.joint(&format!("{part}/{name}"))?.clone();
        if joint.v.len() != 1 {
            return Err(fault("acts on joints of one degree of freedom only"));
        }
        self.place(entry, &joint, joint.v.start)
    }

    /// Places an effect on no joint of a part, whose first one is given.
    fn place_on_part(&mut self, entry: &EffectEntry, first: &JointInfo) -> Result<(), DynamicsError> {
        self.place(entry, first, first.v.start)?;
        if let Some(placed) = self.placements.last_mut() {
            (placed.joint, placed.q) = (String::new(), None);
        }
        Ok(())
    }

    /// Does a sensor's effect, by its placement, act on what is read on a degree of freedom?
    pub(crate) fn acts_on_reading(&self, placement: usize, v: usize) -> bool {
        let placed = &self.placements[placement];
        let of_part = || self.multibody.joints().iter().any(|j| j.part == placed.part && j.v.contains(&v));
        if placed.joint.is_empty() { of_part() } else { placed.v == v }
    }

    /// The bodies that a part's base carries: its own, and all behind them.
    fn carried_by_base(&self, part: &str) -> Vec<bool> {
        let bodies = &self.multibody.bodies;
        let mut carried = vec![false; bodies.len()];
        for (i, body) in bodies.iter().enumerate().skip(1) {
            carried[i] = carried[body.parent] || self.multibody.joints()[body.joint].part == part;
        }
        carried
    }

    fn place(&mut self, entry: &EffectEntry, joint: &JointInfo, v: usize) -> Result<(), DynamicsError> {
        let (effect, theta) = effects::parameters_of(entry).map_err(|e| DynamicsError::Build {
            part: joint.part.clone(),
            place: joint.name.clone(),
            message: e.to_string(),
        })?;
        let (start, first, index) = (self.theta.len(), self.states, self.placements.len());
        self.theta.extend(theta);
        self.states += effect.states() + if effect.keeps_history() { 2 * HISTORY } else { 0 };
        self.placements.push(Placement {
            effect,
            part: joint.part.clone(),
            joint: joint.name.clone(),
            q: (joint.v.len() == 1).then_some(joint.q.start),
            v,
            theta: start..self.theta.len(),
            z: first..self.states,
        });
        let stage = |i: &usize| match self.placements[*i].effect.description().acts {
            Acts::Command(stage) | Acts::Measurement(stage) => stage,
            _ => 0,
        };
        let description = effect.description();
        match description.acts {
            Acts::Command(_) => {
                self.commands.push(index);
                self.commands.sort_by_key(stage);
            }
            Acts::Joint => self.resisting.push(index),
            Acts::Losses => self.wears.push(index),
            Acts::Bodies => {
                if self.given.is_none() {
                    self.given = Some(Box::new(self.multibody.clone()));
                }
                self.apply_reshapes();
            }
            _ => {}
        }
        // Motor and link can be measured apart.
        if matches!(description.acts, Acts::Measurement(_)) || description.parameter("encoder").is_some() {
            self.measurements.push(index);
            self.measurements.sort_by_key(|i| match self.placements[*i].effect.description().acts {
                Acts::Measurement(stage) => stage,
                _ => 0,
            });
        }
        self.nonlinear |= !description.linear;
        self.rebuild_walls();
        Ok(())
    }

    /// Limits stand where no stop is given on their side.
    fn rebuild_walls(&mut self) {
        self.walls = vec![[f64::NEG_INFINITY, f64::INFINITY]; self.multibody.nv()];
        for joint in self.multibody.joints() {
            if joint.v.len() == 1 {
                self.walls[joint.v.start] = [joint.limits.lower, joint.limits.upper];
            }
        }
        self.stops = 0;
        for placed in &self.placements {
            let mut resistance = Resistance::default();
            let z = vec![0.0; placed.z.len()];
            let at = Instant { dt: 1.0, ..Instant::at(0.0, 0.0, 0.0, 0.0, 0.0, &z) };
            placed.effect.resist(&self.theta[placed.theta.clone()], &at, &mut resistance);
            for stop in resistance.stops.iter().flatten() {
                self.stops += 1;
                if stop.limit && stop.side > 0.0 {
                    self.walls[placed.v][1] = f64::INFINITY;
                } else if stop.limit {
                    self.walls[placed.v][0] = f64::NEG_INFINITY;
                }
            }
        }
    }

    /// The rigid bodies, with what effects change of them.
    pub fn multibody(&self) -> &Multibody {
        &self.multibody
    }

    /// The rigid bodies as they are given, to set gravity, inertias and armatures; effects that change them come on top.
    pub fn multibody_mut(&mut self) -> MultibodyMut<'_> {
        MultibodyMut(self)
    }

    /// At which velocity steps take Coriolis forces.
    pub fn set_coriolis(&mut self, coriolis: Coriolis) {
        self.coriolis = coriolis;
    }

    /// Adds a learned residual, or takes it away. Workspaces made before do not fit afterwards.
    ///
    /// # Errors
    /// The residual names a joint that is not there, or was made for joints of another kind.
    pub fn set_residual(&mut self, residual: Option<&Residual>) -> Result<(), DynamicsError> {
        self.residual = residual.map(|r| r.place(&self.multibody)).transpose()?;
        Ok(())
    }

    /// The learned residual.
    pub fn residual(&self) -> Option<&Residual> {
        self.residual.as_ref().map(|r| &r.residual)
    }

    /// The learned residual, to set its weights and normalisation.
    pub fn residual_mut(&mut self) -> Option<&mut Residual> {
        self.residual.as_mut().map(|r| &mut r.residual)
    }

    /// The effects at their places.
    pub fn placements(&self) -> &[Placement] {
        &self.placements
    }

    /// Parameters of all effects; [`Placement::theta`] says which are whose.
    pub fn parameters(&self) -> &[f64] {
        &self.theta
    }

    /// The same, to be changed. Values out of their bounds are the caller's fault and give wrong motion, not a crash.
    /// [`Self::set_effect_parameters`] checks them.
    pub fn parameters_mut(&mut self) -> ParametersMut<'_> {
        ParametersMut(self)
    }

    /// Sets the parameters of all effects. On an error nothing is changed.
    ///
    /// # Errors
    /// The wrong number of values; a value that is not finite or out of its bounds, by the names of effect and parameter.
    pub fn set_effect_parameters(&mut self, values: &[f64]) -> Result<(), DynamicsError> {
        length("parameters of effects", values.len(), self.theta.len())?;
        for placed in &self.placements {
            let description = placed.effect.description();
            for (parameter, value) in description.parameters.iter().zip(&values[placed.theta.clone()]) {
                effects::check_parameter(description, parameter, *value)?;
            }
        }
        self.parameters_mut().copy_from_slice(values);
        Ok(())
    }

    /// The neutral state at rest.
    pub fn state(&self) -> State {
        let mut q = vec![0.0; self.multibody.nq()];
        self.multibody.neutral_positions(&mut q);
        State { q, v: vec![0.0; self.multibody.nv()], z: vec![0.0; self.states], time: 0.0 }
    }

    /// A workspace for stepping this system.
    pub fn workspace(&self) -> StepWorkspace {
        StepWorkspace::new(self)
    }

    /// Efforts that give the accelerations `a` in a state, effects included: `M a + c + g - J^T F_ext + dtau`. At rest dry
    /// friction counts as zero: the least and the greatest effort that hold the joint differ from this by its bound.
    ///
    /// # Errors
    /// A vector of the wrong length or with a number that is not finite.
    pub fn inverse_dynamics(
        &self,
        ws: &mut StepWorkspace,
        state: &State,
        a: &[f64],
        external: &[ExternalWrench],
        tau: &mut [f64],
    ) -> Result<(), DynamicsError> {
        self.check_state(state)?;
        length("load", ws.load.len(), self.multibody.nv()).map_err(|_| DynamicsError::ForeignWorkspace)?;
        self.multibody.set_state(&mut ws.rigid, &state.q, &state.v)?;
        self.multibody.inverse_dynamics(&mut ws.rigid, a, external, tau)?;
        // What passes through the joint is what the bodies need; what comes from gravity and Coriolis forces is its load.
        ws.tau.copy_from_slice(tau);
        self.multibody.newton_euler(&mut ws.rigid, None, true, &mut ws.load);
        ws.load.iter_mut().for_each(|load| *load = -*load);
        let taken = Taken { state, next: &state.v, tau: &ws.tau, seen: &[], load: &ws.load, dt: 0.0 };
        for placed in &self.placements {
            if !placed.effect.description().takes_input() {
                tau[placed.v] += self.resistance(placed, &taken).value;
            }
        }
        Ok(())
    }

    /// Says that inertias, joints or shapes may have changed.
    pub(crate) fn changed(&mut self) {
        static LAST: AtomicU64 = AtomicU64::new(0);
        self.stamp = 1 + LAST.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn check_state(&self, state: &State) -> Result<(), DynamicsError> {
        length("q", state.q.len(), self.multibody.nq())?;
        length("v", state.v.len(), self.multibody.nv())?;
        check("z", &state.z, self.states)
    }
}
