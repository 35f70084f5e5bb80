//! A multibody with the effects on its joints: what one simulates and plans with.

use std::ops::Range;

use sagci_model::EffectEntry;

use crate::contact::Contacts;
use crate::effects::{self, Effect, Instant, Resistance};
use crate::error::check;
use crate::multibody::length;
use crate::residual::{Placed, Residual};
use crate::{Coriolis, DynamicsError, ExternalWrench, JointInfo, Multibody, Part, StepWorkspace};

/// A multibody with its effects.
///
/// The damping and dry friction of the URDF stand among the effects, as `viscous_friction` and `coulomb_friction`; entries of
/// `model.yaml` come on top of them. A URDF limit stops the joint dead, unless a `hard_stop` on that side takes its place.
#[derive(Debug, Clone)]
pub struct System {
    multibody: Multibody,
    placements: Vec<Placement>,
    /// Parameters of all effects, one after the other.
    theta: Vec<f64>,
    states: usize,
    /// Positions between which each degree of freedom is kept by the URDF's limits; infinite where it is not.
    pub(crate) walls: Vec<[f64; 2]>,
    pub(crate) stops: usize,
    pub(crate) coriolis: Coriolis,
    pub(crate) residual: Option<Placed>,
    /// What touches; nothing if there is none.
    pub(crate) contacts: Option<Box<Contacts>>,
}

/// One effect at its place.
#[derive(Debug, Clone)]
pub struct Placement {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Name of the joint's part.
    pub part: String,
    /// The joint.
    pub joint: String,
    /// The joint's entry in `q`, where it has one degree of freedom.
    pub q: Option<usize>,
    /// The degree of freedom.
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
            placements: Vec::new(),
            theta: Vec::new(),
            states: 0,
            walls: Vec::new(),
            stops: 0,
            coriolis: Coriolis::default(),
            residual: None,
            contacts: None,
            multibody,
        };
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

    /// Adds an effect to a joint of a part.
    ///
    /// # Errors
    /// An effect, parameter or joint that does not exist; a parameter out of its bounds; a joint that has several degrees of
    /// freedom or follows another one.
    pub fn add_effect(&mut self, part: &str, entry: &EffectEntry) -> Result<(), DynamicsError> {
        let fault = |message: &str| DynamicsError::Build { part: part.into(), place: entry.effect.clone(), message: message.into() };
        let name = entry.joint.as_deref().ok_or_else(|| fault("acts on no joint; name one under `joint`"))?;
        let joint = self.multibody.joint(&format!("{part}/{name}"))?.clone();
        if joint.v.len() != 1 {
            return Err(fault("acts on joints of one degree of freedom only"));
        }
        self.place(entry, &joint, joint.v.start)
    }

    fn place(&mut self, entry: &EffectEntry, joint: &JointInfo, v: usize) -> Result<(), DynamicsError> {
        let (effect, theta) = effects::parameters_of(entry).map_err(|e| DynamicsError::Build {
            part: joint.part.clone(),
            place: joint.name.clone(),
            message: e.to_string(),
        })?;
        let (start, first) = (self.theta.len(), self.states);
        self.theta.extend(theta);
        self.states += effect.states();
        self.placements.push(Placement {
            effect,
            part: joint.part.clone(),
            joint: joint.name.clone(),
            q: (joint.v.len() == 1).then_some(joint.q.start),
            v,
            theta: start..self.theta.len(),
            z: first..self.states,
        });
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
            let at = Instant { q: 0.0, v: 0.0, input: 0.0, load: 0.0, time: 0.0, z: &vec![0.0; placed.z.len()] };
            placed.effect.resist(&self.theta[placed.theta.clone()], &at, &mut resistance);
            if let Some(stop) = resistance.stop {
                self.stops += 1;
                if stop.side > 0.0 {
                    self.walls[placed.v][1] = f64::INFINITY;
                } else {
                    self.walls[placed.v][0] = f64::NEG_INFINITY;
                }
            }
        }
    }

    /// The rigid bodies.
    pub fn multibody(&self) -> &Multibody {
        &self.multibody
    }

    /// The rigid bodies, to set gravity, inertias and armatures.
    pub fn multibody_mut(&mut self) -> &mut Multibody {
        &mut self.multibody
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
    pub fn parameters_mut(&mut self) -> &mut [f64] {
        &mut self.theta
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
        ws.load.fill(0.0);
        for placed in &self.placements {
            let resistance = self.resistance(placed, state, &[], &ws.load);
            tau[placed.v] += resistance.total(state.v[placed.v]).value;
        }
        Ok(())
    }

    pub(crate) fn check_state(&self, state: &State) -> Result<(), DynamicsError> {
        length("q", state.q.len(), self.multibody.nq())?;
        length("v", state.v.len(), self.multibody.nv())?;
        check("z", &state.z, self.states)
    }

    /// What one effect adds in a state.
    pub(crate) fn resistance(&self, placed: &Placement, state: &State, tau: &[f64], load: &[f64]) -> Resistance {
        let mut resistance = Resistance::default();
        let at = Instant {
            q: placed.q.map_or(0.0, |q| state.q[q]),
            v: state.v[placed.v],
            input: tau.get(placed.v).copied().unwrap_or(0.0),
            load: load[placed.v],
            time: state.time,
            z: &state.z[placed.z.clone()],
        };
        placed.effect.resist(&self.theta[placed.theta.clone()], &at, &mut resistance);
        resistance
    }
}
