//! Forces at a joint. `dtau` resists: it is subtracted. Dry friction is a bound for each direction, so that a joint can stick.
//!
//! Most terms are the catalogue's; those of [`super::OUTSIDE`] are not, on purpose.

/// Where a joint is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct At {
    pub q: f64,
    pub v: f64,
    /// Effort that the drive or the hand puts on the joint.
    pub effort: f64,
    /// Generalised force of gravity and Coriolis acting on the joint.
    pub load: f64,
    /// Time, s.
    pub t: f64,
}

/// What a term does.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Resistance {
    /// A force of the state.
    pub smooth: f64,
    /// Greatest dry friction for motion forwards and backwards.
    pub dry: [f64; 2],
}

impl Resistance {
    fn smooth(force: f64) -> Self {
        Self { smooth: force, dry: [0.0; 2] }
    }

    fn dry(bound: f64) -> Self {
        Self { smooth: 0.0, dry: [bound.max(0.0); 2] }
    }
}

/// One term with its numbers.
#[derive(Debug, Clone)]
pub(crate) enum Term {
    Viscous {
        damping: f64,
    },
    Coulomb {
        friction: f64,
    },
    Asymmetric {
        friction: [f64; 2],
        damping: [f64; 2],
    },
    Stribeck {
        friction: f64,
        static_friction: f64,
        velocity: f64,
        exponent: f64,
    },
    Drag {
        drag: f64,
    },
    LuGre {
        stiffness: f64,
        micro_damping: f64,
        friction: f64,
        static_friction: f64,
        velocity: f64,
    },
    Load {
        coefficient: f64,
    },
    Place {
        friction: f64,
        amplitude: f64,
        position: f64,
        width: f64,
    },
    Spring {
        stiffness: f64,
        rest: f64,
    },
    Tilt {
        amplitude: f64,
        phase: f64,
    },
    Cable {
        stiffness: f64,
        rest: f64,
        force: f64,
        length: f64,
        damping: f64,
    },
    Bias {
        bias: f64,
    },
    Gasket {
        force: f64,
        width: f64,
        inverse_square: bool,
    },
    Air {
        stiffness: f64,
        time_constant: f64,
        seal: f64,
    },
    Latch {
        opening: f64,
        closing: f64,
        position: f64,
        width: f64,
    },
    Detent {
        force: f64,
        position: f64,
        width: f64,
    },
    SoftClose {
        damping: f64,
        position: f64,
        stiffness: f64,
    },
    HardStop {
        stiffness: f64,
        dissipation: f64,
        position: f64,
        side: f64,
    },
    Ripple {
        amplitude: f64,
        cycles: f64,
        phase: f64,
    },
    // Not in the catalogue:
    /// Damping that grows with the distance from a place: c |q - position| v.
    PlacedDamping {
        damping: f64,
        position: f64,
    },
    /// A spring whose stiffness swings through zero in time: k sin(w t) (q - rest).
    Parametric {
        stiffness: f64,
        rest: f64,
        pace: f64,
    },
    /// c v^3.
    Cubic {
        drag: f64,
    },
    /// Dry friction that comes and goes at random times; it is on between `times[2k]` and `times[2k + 1]`.
    Binding {
        friction: f64,
        times: Vec<f64>,
    },
    /// A sin(w t + phase).
    TimedSine {
        amplitude: f64,
        pace: f64,
        phase: f64,
    },
    /// A sgn(sin(w t)).
    TimedSquare {
        amplitude: f64,
        pace: f64,
    },
    /// A spring of two stiffnesses, with a kink.
    Kink {
        below: f64,
        above: f64,
        position: f64,
    },
    /// c v / (1 + (v / v0)^2).
    Brake {
        damping: f64,
        velocity: f64,
    },
    /// A mass that is loose by `gap` each way and rattles.
    Loose {
        inertia: f64,
        gap: f64,
        stiffness: f64,
        damping: f64,
    },
    /// Break-away friction that grows while the joint stands.
    Dwell {
        friction: f64,
        growth: f64,
        time_constant: f64,
        velocity: f64,
    },
}

fn side(v: f64) -> usize {
    usize::from(v < 0.0)
}

/// Bristle force at which sliding is steady.
fn lugre_level(friction: f64, static_friction: f64, velocity: f64, v: f64) -> f64 {
    friction + (static_friction - friction) * (-(v / velocity).powi(2)).exp()
}

impl Term {
    /// Number of inner states.
    pub(crate) fn states(&self) -> usize {
        match self {
            Self::LuGre { .. } | Self::Cable { .. } | Self::Air { .. } | Self::Latch { .. } | Self::Dwell { .. } => 1,
            Self::Loose { .. } => 2,
            _ => 0,
        }
    }

    /// Inner states of a joint that has rested at `q` for long.
    pub(crate) fn start(&self, q: f64, v: f64, z: &mut [f64]) {
        match self {
            Self::Latch { position, .. } => z[0] = if q < *position { 1.0 } else { -1.0 },
            Self::Loose { .. } => {
                z[0] = q;
                z[1] = v;
            }
            _ => z.fill(0.0),
        }
    }

    /// Can it hold a joint that stands?
    pub(crate) fn is_dry(&self) -> bool {
        matches!(
            self,
            Self::Coulomb { .. }
                | Self::Asymmetric { .. }
                | Self::Stribeck { .. }
                | Self::Load { .. }
                | Self::Place { .. }
                | Self::Binding { .. }
                | Self::Dwell { .. }
        )
    }

    /// Does heat change it?
    pub(crate) fn wears(&self) -> bool {
        self.is_dry() || matches!(self, Self::Viscous { .. } | Self::LuGre { .. })
    }

    /// The force in a state.
    pub(crate) fn resist(&self, at: &At, z: &[f64]) -> Resistance {
        let At { q, v, .. } = *at;
        let smooth = match *self {
            Self::Viscous { damping } => damping * v,
            Self::Coulomb { friction } => return Resistance::dry(friction),
            Self::Asymmetric { friction, damping } => return Resistance { smooth: damping[side(v)] * v, dry: friction },
            Self::Stribeck { friction, static_friction, velocity, exponent } => {
                return Resistance::dry(friction + (static_friction - friction) * (-(v / velocity).abs().powf(exponent)).exp());
            }
            Self::Drag { drag } => drag * v * v.abs(),
            Self::LuGre { stiffness, micro_damping, friction, static_friction, velocity } => {
                let level = lugre_level(friction, static_friction, velocity, v);
                stiffness * z[0] + micro_damping * (v - stiffness * v.abs() * z[0] / level)
            }
            Self::Load { coefficient } => return Resistance::dry(coefficient * (at.effort - at.load).abs()),
            Self::Place { friction, amplitude, position, width } => {
                let x = (q - position) / width;
                return Resistance::dry(friction + amplitude * (-0.5 * x * x).exp());
            }
            Self::Spring { stiffness, rest } => stiffness * (q - rest),
            Self::Tilt { amplitude, phase } => amplitude * (q + phase).sin(),
            Self::Cable { stiffness, rest, force, damping, .. } => stiffness * (q - rest) + force * z[0] + damping * v,
            Self::Bias { bias } => bias,
            Self::Gasket { force, width, inverse_square } => {
                let x = q.max(0.0) / width;
                force * if inverse_square { (1.0 + x).powi(-2) } else { (-x).exp() }
            }
            Self::Air { stiffness, seal, .. } => {
                if seal == 0.0 || q < seal {
                    -stiffness * z[0]
                } else {
                    0.0
                }
            }
            Self::Latch { opening, closing, position, width } => {
                let x = (q - position) / width;
                let bump = if x > 0.0 && x < 1.0 { 16.0 * (x * (1.0 - x)).powi(2) } else { 0.0 };
                bump * if z[0] > 0.0 { opening } else { -closing }
            }
            Self::Detent { force, position, width } => {
                let x = (q - position) / width;
                force * x * (0.5 - 0.5 * x * x).exp()
            }
            Self::SoftClose { damping, position, stiffness } => {
                if q < position {
                    damping * v.min(0.0) + stiffness * q
                } else {
                    0.0
                }
            }
            Self::HardStop { stiffness, dissipation, position, side } => {
                let depth = side * (q - position);
                if depth > 0.0 { side * (stiffness * depth + dissipation * depth * side * v).max(0.0) } else { 0.0 }
            }
            Self::Ripple { amplitude, cycles, phase } => amplitude * (cycles * q + phase).sin(),
            Self::PlacedDamping { damping, position } => damping * (q - position).abs() * v,
            Self::Parametric { stiffness, rest, pace } => stiffness * (pace * at.t).sin() * (q - rest),
            Self::Cubic { drag } => drag * v.powi(3),
            Self::Binding { friction, ref times } => {
                let passed = times.partition_point(|&t| t <= at.t);
                return Resistance::dry(if passed % 2 == 1 { friction } else { 0.0 });
            }
            Self::TimedSine { amplitude, pace, phase } => amplitude * (pace * at.t + phase).sin(),
            Self::TimedSquare { amplitude, pace } => amplitude * (pace * at.t).sin().signum(),
            Self::Kink { below, above, position } => (q - position) * if q < position { below } else { above },
            Self::Brake { damping, velocity } => damping * v / (1.0 + (v / velocity).powi(2)),
            Self::Loose { gap, stiffness, damping, .. } => -mesh(z[0] - q, z[1] - v, gap, stiffness, damping),
            Self::Dwell { friction, growth, velocity, .. } => {
                return Resistance::dry(friction + growth * z[0] * (-(v / velocity).powi(2)).exp());
            }
        };
        Resistance::smooth(smooth)
    }

    /// Rates of the inner states.
    pub(crate) fn rates(&self, at: &At, z: &[f64], dz: &mut [f64]) {
        let At { q, v, .. } = *at;
        match *self {
            Self::LuGre { stiffness, friction, static_friction, velocity, .. } => {
                dz[0] = v - stiffness * v.abs() * z[0] / lugre_level(friction, static_friction, velocity, v);
            }
            Self::Cable { length, .. } => {
                dz[0] = (v - v.abs() * z[0]) / length;
            }
            Self::Air { time_constant, seal, .. } => {
                dz[0] = if seal == 0.0 || q < seal { -z[0] / time_constant - v } else { 0.0 };
            }
            Self::Loose { inertia, gap, stiffness, damping } => {
                dz[0] = z[1];
                dz[1] = -mesh(z[0] - q, z[1] - v, gap, stiffness, damping) / inertia;
            }
            Self::Dwell { time_constant, velocity, .. } => {
                // Grows at rest, is wiped off by sliding.
                dz[0] = (1.0 - z[0]) / time_constant - 20.0 * (v / velocity).abs().min(20.0) * z[0];
            }
            _ => dz.fill(0.0),
        }
    }

    /// Inner states that jump, after a step.
    pub(crate) fn settle(&self, q: f64, z: &mut [f64]) {
        match *self {
            Self::Latch { position, width, .. } => {
                let stays = if z[0] > 0.0 { q <= position + width } else { q < position };
                z[0] = if stays { 1.0 } else { -1.0 };
            }
            // Open air has no pressure.
            Self::Air { seal, .. } if seal != 0.0 && q >= seal => z[0] = 0.0,
            _ => {}
        }
    }
}

/// Force across a play of `gap` each way, for a twist and its rate: a spring and a damper beyond it that never pull.
pub(crate) fn mesh(twist: f64, rate: f64, gap: f64, stiffness: f64, damping: f64) -> f64 {
    if twist > gap {
        (stiffness * (twist - gap) + damping * rate).max(0.0)
    } else if twist < -gap {
        (stiffness * (twist + gap) + damping * rate).min(0.0)
    } else {
        0.0
    }
}
