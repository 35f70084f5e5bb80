//! One joint with everything that acts on it: losses, terms, the drive's way to the joint, the sensor.

use sagci_model::EffectEntry;

use super::term::{At, Resistance, Term, mesh};
use crate::EvaluationError;

/// What is put on a joint until something else is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Hold {
    /// An effort, N m or N: a hand's, or a commanded one.
    Effort(f64),
    /// `stiffness (target - q) - damping v`.
    Servo {
        /// N m/rad or N/m.
        stiffness: f64,
        /// N m s/rad or N s/m.
        damping: f64,
        /// rad or m.
        target: f64,
    },
}

impl Hold {
    fn effort(self, q: f64, v: f64) -> f64 {
        match self {
            Self::Effort(u) => u,
            Self::Servo { stiffness, damping, target } => stiffness * (target - q) - damping * v,
        }
    }
}

/// Between motor and link.
#[derive(Debug, Clone, Copy)]
struct Transmission {
    half_gap: f64,
    stiffness: f64,
    damping: f64,
    rotor_inertia: f64,
}

/// Everything that acts at one joint beside the rigid bodies.
#[derive(Debug, Clone, Default)]
pub(crate) struct JointPhysics {
    pub damping: f64,
    pub friction: f64,
    pub armature: f64,
    pub terms: Vec<Term>,
    pub delay: f64,
    limit: Option<f64>,
    lag: Option<f64>,
    gain_error: f64,
    transmission: Option<Transmission>,
    wear: Option<[f64; 2]>,
    pub sensor: Sensor,
}

/// What the readings do not say rightly.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Sensor {
    pub offset: f64,
    pub scale_error: f64,
    /// Bias and rate on the position.
    pub position_drift: [f64; 2],
    /// Bias and rate on the effort.
    pub effort_drift: [f64; 2],
    pub skew: f64,
    pub on_motor: bool,
}

/// What acts on a joint in a state.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Acting {
    /// Effort that arrives at the link, less every smooth resistance but the joint's own damping.
    pub effort: f64,
    /// Damping of the joint's own, N m s/rad or N s/m.
    pub damping: f64,
    /// Greatest dry friction, forwards and backwards.
    pub dry: [f64; 2],
    /// What the drive gives.
    pub delivered: f64,
}

impl JointPhysics {
    pub(crate) fn new(damping: f64, friction: f64) -> Self {
        Self { damping, friction, ..Self::default() }
    }

    /// Adds a named effect. `inertia` is about that of the joint: contact inside a gear is made as stiff as it allows.
    pub(crate) fn add(&mut self, entry: &EffectEntry, inertia: f64) -> Result<(), EvaluationError> {
        let p = |name: &str| {
            entry.parameters.get(name).copied().filter(|v| v.is_finite()).ok_or_else(|| EvaluationError::Effect {
                effect: entry.effect.clone(),
                message: format!("lacks its parameter '{name}', or it is not a number"),
            })
        };
        let word = |name: &str, is: &str| entry.choices.get(name).is_some_and(|w| w == is);
        let term = match entry.effect.as_str() {
            "viscous_friction" => Term::Viscous { damping: p("damping")? },
            "coulomb_friction" => Term::Coulomb { friction: p("friction")? },
            "asymmetric_friction" => Term::Asymmetric {
                friction: [p("friction_positive")?, p("friction_negative")?],
                damping: [p("damping_positive")?, p("damping_negative")?],
            },
            "stribeck_friction" => Term::Stribeck {
                friction: p("friction")?,
                static_friction: p("static_friction")?,
                velocity: p("stribeck_velocity")?,
                exponent: p("exponent")?,
            },
            "quadratic_drag" => Term::Drag { drag: p("drag")? },
            "presliding_hysteresis" => Term::LuGre {
                stiffness: p("stiffness")?,
                micro_damping: p("micro_damping")?,
                friction: p("friction")?,
                static_friction: p("static_friction")?,
                velocity: p("stribeck_velocity")?,
            },
            "load_dependent_friction" => Term::Load { coefficient: p("load_coefficient")? },
            "position_dependent_friction" => {
                Term::Place { friction: p("friction")?, amplitude: p("amplitude")?, position: p("position")?, width: p("width")? }
            }
            "joint_spring" => Term::Spring { stiffness: p("stiffness")?, rest: p("rest_position")? },
            "hinge_tilt" => Term::Tilt { amplitude: p("amplitude")?, phase: p("phase")? },
            "cable_hysteresis" => Term::Cable {
                stiffness: p("stiffness")?,
                rest: p("rest_position")?,
                force: p("loop_force")?,
                length: p("loop_length")?,
                damping: p("damping")?,
            },
            "torque_bias" => Term::Bias { bias: p("bias")? },
            "magnetic_gasket" => Term::Gasket { force: p("force")?, width: p("width")?, inverse_square: word("shape", "inverse_square") },
            "air_suction" => Term::Air { stiffness: p("stiffness")?, time_constant: p("time_constant")?, seal: p("seal_position")? },
            "latch" => {
                Term::Latch { opening: p("opening_force")?, closing: p("closing_force")?, position: p("position")?, width: p("width")? }
            }
            "detent" => Term::Detent { force: p("force")?, position: p("position")?, width: p("width")? },
            "soft_close_damper" => Term::SoftClose { damping: p("damping")?, position: p("position")?, stiffness: p("stiffness")? },
            "hard_stop" => Term::HardStop {
                stiffness: p("stiffness")?,
                dissipation: p("dissipation")?,
                position: p("position")?,
                side: p("side")?.signum(),
            },
            "torque_ripple" => Term::Ripple { amplitude: p("amplitude")?, cycles: p("cycles_per_turn")?, phase: p("phase")? },
            "backlash" => {
                let rotor = p("rotor_inertia")?;
                // Rigid teeth are stiff ones that hardly rebound: 1500 rad/s, twice critically damped.
                let reduced = rotor * inertia / (rotor + inertia);
                let pace = 1500.0;
                self.transmission = Some(Transmission {
                    half_gap: p("half_gap")?,
                    stiffness: reduced * pace * pace,
                    damping: 4.0 * reduced * pace,
                    rotor_inertia: rotor,
                });
                self.sensor.on_motor = word("encoder", "motor");
                return Ok(());
            }
            "joint_elasticity" => {
                self.transmission = Some(Transmission {
                    half_gap: 0.0,
                    stiffness: p("stiffness")?,
                    damping: p("damping")?,
                    rotor_inertia: p("rotor_inertia")?,
                });
                self.sensor.on_motor = word("encoder", "motor");
                return Ok(());
            }
            "transport_delay" => {
                self.delay = p("delay")?;
                return Ok(());
            }
            "actuator_lag" => {
                self.lag = Some(p("time_constant")?);
                return Ok(());
            }
            "actuator_saturation" => {
                self.limit = Some(p("limit")?);
                return Ok(());
            }
            "torque_gain" => {
                self.gain_error = p("gain_error")?;
                return Ok(());
            }
            "armature_inertia" => {
                self.armature += p("inertia")?;
                return Ok(());
            }
            "encoder_offset" => {
                (self.sensor.offset, self.sensor.scale_error) = (p("offset")?, p("scale_error")?);
                return Ok(());
            }
            "sensor_drift" => {
                let drift = [p("bias")?, p("rate")?];
                if word("of", "effort") {
                    self.sensor.effort_drift = drift;
                } else {
                    self.sensor.position_drift = drift;
                }
                return Ok(());
            }
            "clock_skew" => {
                self.sensor.skew = p("skew")?;
                return Ok(());
            }
            "thermal_wear" => {
                self.wear = Some([p("amplitude")?, p("time_constant")?]);
                return Ok(());
            }
            other => {
                return Err(EvaluationError::Effect { effect: other.to_owned(), message: "is not an effect of a joint".into() });
            }
        };
        self.terms.push(term);
        Ok(())
    }

    /// Number of inner states: the lag, the rotor, then the terms'.
    pub(crate) fn states(&self) -> usize {
        usize::from(self.lag.is_some()) + 2 * usize::from(self.transmission.is_some()) + self.terms.iter().map(Term::states).sum::<usize>()
    }

    pub(crate) fn start(&self, q: f64, v: f64, z: &mut [f64]) {
        let mut next = 0;
        if self.lag.is_some() {
            z[0] = 0.0;
            next = 1;
        }
        if self.transmission.is_some() {
            z[next] = q;
            z[next + 1] = v;
            next += 2;
        }
        for term in &self.terms {
            let end = next + term.states();
            term.start(q, v, &mut z[next..end]);
            next = end;
        }
    }

    /// Where the rotor's position and velocity stand among the inner states; empty without one.
    pub(crate) fn rotor(&self) -> std::ops::Range<usize> {
        let from = usize::from(self.lag.is_some());
        from..from + 2 * usize::from(self.transmission.is_some())
    }

    /// Can it stick?
    pub(crate) fn is_dry(&self) -> bool {
        self.friction > 0.0 || self.terms.iter().any(Term::is_dry)
    }

    /// Does a term ask for the load?
    pub(crate) fn needs_load(&self) -> bool {
        self.terms.iter().any(|t| matches!(t, Term::Load { .. }))
    }

    fn wear(&self, t: f64) -> f64 {
        self.wear.map_or(1.0, |[amplitude, time_constant]| 1.0 + amplitude * (-t.max(0.0) / time_constant).exp())
    }

    /// The drive's effort, what passes on to the link, and where the terms' states begin. Rates go into `dz`.
    fn drive(&self, at: &At, hold: Hold, z: &[f64], dz: Option<&mut [f64]>) -> (f64, f64, usize) {
        let mut next = 0;
        let asked = hold.effort(at.q, at.v);
        let clipped = self.limit.map_or(asked, |limit| asked.clamp(-limit, limit));
        let lagged = match self.lag {
            Some(_) => {
                next = 1;
                z[0]
            }
            None => clipped,
        };
        let delivered = (1.0 - self.gain_error) * lagged;
        let mut passed = delivered;
        let mut rotor = None;
        if let Some(t) = self.transmission {
            let (twist, rate) = (z[next] - at.q, z[next + 1] - at.v);
            passed = if t.half_gap > 0.0 {
                mesh(twist, rate, t.half_gap, t.stiffness, t.damping)
            } else {
                t.stiffness * twist + t.damping * rate
            };
            rotor = Some((next, z[next + 1], (delivered - passed) / t.rotor_inertia));
            next += 2;
        }
        if let Some(dz) = dz {
            if let Some(lag) = self.lag {
                dz[0] = (clipped - z[0]) / lag;
            }
            if let Some((place, speed, acceleration)) = rotor {
                dz[place] = speed;
                dz[place + 1] = acceleration;
            }
        }
        (delivered, passed, next)
    }

    /// Everything that acts. `at.effort` is filled in.
    pub(crate) fn acting(&self, mut at: At, hold: Hold, z: &[f64]) -> Acting {
        let (delivered, passed, mut next) = self.drive(&at, hold, z, None);
        at.effort = delivered;
        let wear = self.wear(at.t);
        let mut out = Acting { effort: passed, damping: self.damping * wear, dry: [self.friction * wear; 2], delivered };
        for term in &self.terms {
            let end = next + term.states();
            let Resistance { smooth, dry } = term.resist(&at, &z[next..end]);
            let factor = if term.wears() { wear } else { 1.0 };
            out.effort -= factor * smooth;
            out.dry[0] += factor * dry[0];
            out.dry[1] += factor * dry[1];
            next = end;
        }
        out
    }

    /// Rates of the inner states.
    pub(crate) fn rates(&self, mut at: At, hold: Hold, z: &[f64], dz: &mut [f64]) {
        let (delivered, _, mut next) = self.drive(&at, hold, z, Some(dz));
        at.effort = delivered;
        for term in &self.terms {
            let end = next + term.states();
            term.rates(&at, &z[next..end], &mut dz[next..end]);
            next = end;
        }
    }

    /// Inner states that jump.
    pub(crate) fn settle(&self, q: f64, z: &mut [f64]) {
        let mut next = usize::from(self.lag.is_some()) + 2 * usize::from(self.transmission.is_some());
        for term in &self.terms {
            let end = next + term.states();
            term.settle(q, &mut z[next..end]);
            next = end;
        }
    }

    /// What the encoder sees, without noise.
    pub(crate) fn reading(&self, q: f64, v: f64, z: &[f64], t: f64) -> (f64, f64) {
        let (q, v) = match self.transmission {
            Some(_) if self.sensor.on_motor => {
                let place = usize::from(self.lag.is_some());
                (z[place], z[place + 1])
            }
            _ => (q, v),
        };
        let s = &self.sensor;
        let [bias, rate] = s.position_drift;
        ((1.0 + s.scale_error) * q + s.offset + bias + rate * t, (1.0 + s.scale_error) * v + rate)
    }
}
