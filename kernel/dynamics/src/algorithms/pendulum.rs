//! One body on a joint of one degree of freedom that stands on the world: most doors, drawers and knobs.
//!
//! Its axis does not move, so its mass matrix is a constant, Coriolis and centrifugal forces do no work on the joint, and gravity asks for
//! `g(q) = cosine cos q + sine sin q` of a hinge (the weight's moment about a fixed axis) and for a constant of a slide. That is all of
//! its inverse dynamics: `ID(q, v, a) = mass a + g(q)`. Its momentum along a line is of the same form, `p(q) v`, and what turns it is
//! `p'(q) v^2`: all that a base which gives way feels of it.

use sagci_model::JointKind;

use crate::{Multibody, Workspace};

/// The constants of such a body, for one set of inertias and origins.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pendulum {
    /// Of which system: [`crate::System`]'s stamp.
    pub stamp: u64,
    pub mass: f64,
    gravity: Turning,
    /// Where gravity was asked for last, and its effort there: a step and its half begin at the same place.
    last: Option<[f64; 2]>,
}

/// What is `constant + cosine cos q + sine sin q`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Turning {
    constant: f64,
    cosine: f64,
    sine: f64,
}

impl Turning {
    /// Of a hinge, from its values at nothing and at a quarter of a turn; of a slide it is a constant.
    pub fn new(kind: JointKind, [here, across]: [f64; 2]) -> Self {
        match kind {
            JointKind::Prismatic => Self { constant: here, ..Self::default() },
            _ => Self { constant: 0.0, cosine: here, sine: across },
        }
    }

    /// Its value and its derivative by the position.
    #[inline]
    pub fn at(&self, q: f64) -> [f64; 2] {
        if self.cosine == 0.0 && self.sine == 0.0 {
            return [self.constant, 0.0];
        }
        let (sin, cos) = q.sin_cos();
        [self.constant + self.cosine * cos + self.sine * sin, self.sine * cos - self.cosine * sin]
    }
}

/// The positions that tell such a form.
pub(crate) const ACROSS: [f64; 2] = [0.0, std::f64::consts::FRAC_PI_2];

impl Multibody {
    /// Is it one body, on a joint of one degree of freedom that stands on the world?
    pub(crate) fn is_pendulum(&self) -> bool {
        self.bodies.len() == 2 && self.nv == 1 && self.tree == 1 && !self.has_followers
    }

    pub(crate) fn pendulum(&self, ws: &mut Workspace, stamp: u64) -> Pendulum {
        let gravity = ACROSS.map(|q| {
            let mut gravity = [0.0];
            self.stand_at(ws, q, &mut gravity);
            gravity[0]
        });
        self.composite(ws);
        let mass = ws.M[(0, 0)];
        Pendulum { stamp, mass, gravity: Turning::new(self.bodies[1].motion.kind, gravity), last: None }
    }

    /// Puts it at rest at a position, with the effort of gravity there.
    pub(crate) fn stand_at(&self, ws: &mut Workspace, q: f64, gravity: &mut [f64; 1]) {
        (ws.q[0], ws.v[0]) = (q, 0.0);
        self.kinematics(ws);
        ws.external.fill(crate::SpatialVector::zeros());
        self.newton_euler(ws, None, false, gravity);
    }
}

impl Pendulum {
    /// Gravity's effort, and its derivative by the position.
    #[inline]
    pub fn gravity(&self, q: f64) -> [f64; 2] {
        self.gravity.at(q)
    }

    /// Gravity's effort, kept until another position is asked for.
    #[inline]
    pub fn gravity_again(&mut self, q: f64) -> f64 {
        match self.last {
            Some([last, effort]) if last == q => effort,
            _ => {
                let effort = self.gravity.at(q)[0];
                self.last = Some([q, effort]);
                effort
            }
        }
    }
}
