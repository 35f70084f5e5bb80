//! One body on a joint of one degree of freedom that stands on the world: most doors, drawers and knobs.
//!
//! Its axis does not move, so its mass matrix is a constant, Coriolis and centrifugal forces do no work on the joint, and gravity asks for
//! `g(q) = cosine cos q + sine sin q` of a hinge (the weight's moment about a fixed axis) and for a constant of a slide. That is all of
//! its inverse dynamics: `ID(q, v, a) = mass a + g(q)`.

use sagci_model::JointKind;

use crate::{Multibody, Workspace};

/// The constants of such a body, for one set of inertias and origins.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pendulum {
    /// Of which system: [`crate::System`]'s stamp.
    pub stamp: u64,
    pub mass: f64,
    constant: f64,
    cosine: f64,
    sine: f64,
}

impl Multibody {
    /// Is it one body, on a joint of one degree of freedom that stands on the world?
    pub(crate) fn is_pendulum(&self) -> bool {
        self.bodies.len() == 2 && self.nv == 1 && self.tree == 1 && !self.has_followers
    }

    pub(crate) fn pendulum(&self, ws: &mut Workspace, stamp: u64) -> Pendulum {
        let mut gravity = [0.0];
        let mut at = |q: f64| {
            (ws.q[0], ws.v[0]) = (q, 0.0);
            self.kinematics(ws);
            ws.external.fill(crate::SpatialVector::zeros());
            self.newton_euler(ws, None, false, &mut gravity);
            gravity[0]
        };
        let (here, across) = (at(0.0), at(std::f64::consts::FRAC_PI_2));
        self.composite(ws);
        let mass = ws.M[(0, 0)];
        if self.bodies[1].motion.kind == JointKind::Prismatic {
            return Pendulum { stamp, mass, constant: here, ..Pendulum::default() };
        }
        Pendulum { stamp, mass, constant: 0.0, cosine: here, sine: across }
    }
}

impl Pendulum {
    /// Gravity's effort, and its derivative by the position.
    #[inline]
    pub fn gravity(&self, q: f64) -> [f64; 2] {
        if self.cosine == 0.0 && self.sine == 0.0 {
            return [self.constant, 0.0];
        }
        let (sin, cos) = q.sin_cos();
        [self.constant + self.cosine * cos + self.sine * sin, self.sine * cos - self.cosine * sin]
    }
}
