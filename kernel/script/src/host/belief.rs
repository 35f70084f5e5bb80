//! What changes in the belief about a scene when something in it is moved.

use std::sync::Arc;

use nalgebra::Isometry3;
use sagci_model::ObjectModel;
use sagci_signal::SceneBelief;
use sagci_skill::BeliefChange;

use super::geometry;

/// Objects this near to a region's box ride with its link, m.
pub(super) const RIDES: f64 = 0.02;

/// The place of a moving joint in `q`.
pub(super) fn joint_slot(model: &ObjectModel, joint: &str) -> Option<usize> {
    model.moving_joints().position(|j| model.joints[j].name == joint)
}

/// Believes a change, and what follows from it. `models` stand in the order of the belief's objects. Changes of what is not
/// in the scene are nothing.
pub(super) fn apply(belief: &mut SceneBelief, models: &[Arc<ObjectModel>], change: &BeliefChange) {
    let (BeliefChange::Joint { object, .. } | BeliefChange::Held { object, .. } | BeliefChange::Released { object, .. }) = change;
    let Some(i) = belief.objects.iter().position(|o| o.name == *object) else { return };
    match change {
        BeliefChange::Joint { joint, position, .. } => {
            let mut q = belief.objects[i].q.clone();
            if let Some(entry) = models.get(i).and_then(|m| joint_slot(m, joint)).and_then(|slot| q.get_mut(slot)) {
                *entry = *position;
                move_joints(belief, models, i, q);
            }
        }
        BeliefChange::Held { X_TO, .. } => belief.objects[i].X_TO = Some(*X_TO),
        BeliefChange::Released { X_WO, .. } => {
            belief.objects[i].X_TO = None;
            belief.objects[i].X_WO = *X_WO;
        }
    }
}

/// Sets an object's joints; what stands in its moving parts moves along.
fn move_joints(belief: &mut SceneBelief, models: &[Arc<ObjectModel>], i: usize, q: Vec<f64>) {
    let X_WO = belief.objects[i].X_WO;
    move_object(belief, models, i, X_WO, q, &[]);
}

/// Sets an object's pose and joints; what stands in its regions moves along, except the objects in `known`.
pub(super) fn move_object(
    belief: &mut SceneBelief,
    models: &[Arc<ObjectModel>],
    i: usize,
    X_WO: Isometry3<f64>,
    q: Vec<f64>,
    known: &[usize],
) {
    let model = &models[i];
    let (X_WO_before, before, after) = (belief.objects[i].X_WO, model.X_OL(&belief.objects[i].q), model.X_OL(&q));
    for (j, (other, moved)) in belief.objects.iter_mut().zip(models).enumerate() {
        if j == i || other.X_TO.is_some() || !moved.document.movable || known.contains(&j) {
            continue;
        }
        let (least, most) = geometry::bounds(moved, &other.X_WO, &other.q);
        let center = nalgebra::center(&least, &most);
        let carrier = model.document.regions.iter().find_map(|region| {
            let link = model.link(&region.link)?;
            let [x, y, z] = region.center;
            let X_WG = X_WO_before * before[link] * Isometry3::translation(x, y, z);
            (geometry::outside(region, &X_WG, &center) <= RIDES).then_some(link)
        });
        if let Some(link) = carrier {
            other.X_WO = X_WO * after[link] * before[link].inverse() * X_WO_before.inverse() * other.X_WO;
            // It may have slid on the way.
            other.seen = false;
        }
    }
    belief.objects[i].X_WO = X_WO;
    belief.objects[i].q = q;
}
