//! The wrench that contacts put on the hand, from the solver's impulses.
//!
//! Only the points that a manifold's `solver_contacts` name were solved in the last step; others hold stale impulses. A
//! point's normal impulse is the sum over the step; its friction is kept from the last of the solver's iterations, each
//! of which is `dt / iterations` long.

use nalgebra::{Isometry3, Vector3};
use rapier3d_f64::geometry::ColliderHandle;
use rapier3d_f64::pipeline::PhysicsWorld;
use sagci_signal::Wrench;

use super::build::Owner;
use crate::convert;

/// Bits of a contact's index; the highest of 32 says that it is new.
const INDEX: u64 = 0x7fff_ffff;

/// Wrench of all contacts on the colliders that `on_hand` accepts, in frame `S` and about its origin.
pub(super) fn on_hand(world: &PhysicsWorld, X_WS: &Isometry3<f64>, on_hand: impl Fn(Owner) -> bool) -> Wrench {
    let period = world.integration_parameters.dt;
    let iteration = period / world.integration_parameters.num_solver_iterations.max(1) as f64;
    let origin = X_WS.translation.vector;
    let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
    for pair in world.narrow_phase.contact_pairs() {
        let owner = |handle: ColliderHandle| world.colliders.get(handle).map(|c| (Owner::unpack(c.user_data), *c.position()));
        let (Some((owner1, X_W1)), Some((owner2, _))) = (owner(pair.collider1), owner(pair.collider2)) else { continue };
        let sign = match (on_hand(owner1), on_hand(owner2)) {
            (true, false) => 1.0,
            (false, true) => -1.0,
            _ => continue,
        };
        for manifold in pair.solver_manifolds() {
            for contact in &manifold.data.solver_contacts {
                let Some(point) = manifold.points.get((contact.contact_id[0] & INDEX) as usize) else { continue };
                let on_first = -manifold.data.normal * (point.data.impulse / period) + point.data.warmstart_tangent_world / iteration;
                let f = sign * convert::vector3(on_first);
                let p = convert::vector3(X_W1 * point.local_p1);
                force += f;
                torque += (p - origin).cross(&f);
            }
        }
    }
    let R_SW = X_WS.rotation.inverse();
    Wrench { force: R_SW * force, torque: R_SW * torque }
}
