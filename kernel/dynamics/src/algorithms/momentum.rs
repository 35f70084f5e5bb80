//! Energy and momentum of the whole tree, without what is fixed to the world.

use nalgebra::{Point3, Vector3};

use crate::spatial::{angular, linear};
use crate::{Multibody, SpatialVector, Workspace};

/// Momentum of the whole tree in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Momentum {
    /// Total mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub center: Point3<f64>,
    /// Linear momentum, N s.
    pub linear: Vector3<f64>,
    /// Angular momentum about the centre of mass, N m s.
    pub angular: Vector3<f64>,
}

impl Multibody {
    /// Kinetic energy, J; that of armatures included.
    pub fn kinetic_energy(&self, ws: &Workspace) -> f64 {
        let bodies: f64 = (1..ws.V.len()).map(|i| ws.V[i].dot(&ws.inertia[i].times(&ws.V[i]))).sum();
        let drives: f64 = ws.v.iter().zip(&self.armature).map(|(v, a)| a * v * v).sum();
        0.5 * (bodies + drives)
    }

    /// Energy in gravity, J; zero where the centre of mass lies at the world's origin.
    pub fn potential_energy(&self, ws: &Workspace) -> f64 {
        -ws.inertia.iter().skip(1).map(|i| self.gravity.dot(&i.h)).sum::<f64>()
    }

    /// Mass, centre of mass and momentum.
    pub fn momentum(&self, ws: &Workspace) -> Momentum {
        let mut h = SpatialVector::zeros();
        let (mut mass, mut moment) = (0.0, Vector3::zeros());
        for (V, inertia) in ws.V.iter().zip(&ws.inertia).skip(1) {
            h += inertia.times(V);
            mass += inertia.mass;
            moment += inertia.h;
        }
        let center = if mass > 0.0 { moment / mass } else { Vector3::zeros() };
        Momentum { mass, center: center.into(), linear: linear(&h), angular: angular(&h) - center.cross(&linear(&h)) }
    }
}
