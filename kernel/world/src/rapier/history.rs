//! What the judge needs of a run, and the judging itself.

use nalgebra::{Isometry3, Vector3};

use super::State;
use crate::convert;
use crate::geometry::reach;
use crate::judge::{Goal, GoalVerdict, Verdict};
use crate::rapier::build::Owner;

/// Extremes of every joint of the objects since the reset.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    /// For each object, for each joint of its model: least and greatest position so far.
    extremes: Vec<Vec<[f64; 2]>>,
}

impl History {
    pub(super) fn new(state: &State) -> Self {
        let extremes = (0..state.scene.objects.len())
            .map(|i| (0..state.scene.objects[i].model.joints.len()).map(|j| [state.joint_state(i + 1, j).0; 2]).collect())
            .collect();
        Self { extremes }
    }

    /// Takes note of the state now.
    pub(super) fn note(&mut self, state: &State) {
        for (i, joints) in self.extremes.iter_mut().enumerate() {
            for (j, [least, greatest]) in joints.iter_mut().enumerate() {
                let q = state.joint_state(i + 1, j).0;
                *least = least.min(q);
                *greatest = greatest.max(q);
            }
        }
    }
}

/// A speed at which an object counts as at rest, m/s: its fastest point moves by less than 1 cm in a second.
const AT_REST: f64 = 0.01;
/// An object whose lowest point is this near to the table stands on it, m.
const ON_TABLE: f64 = 0.005;

impl State {
    /// Holds the goals against the true state.
    pub(super) fn judge(self, goals: &[Goal]) -> Verdict {
        let goals: Vec<GoalVerdict> = goals.iter().map(|goal| self.judge_one(goal)).collect();
        Verdict { met: self.broken.is_none() && goals.iter().all(|g| g.met), goals }
    }

    fn judge_one(&self, goal: &Goal) -> GoalVerdict {
        use crate::judge::Resolved;
        let resolved = match goal.resolve(&self.scene) {
            Ok(resolved) => resolved,
            Err(message) => {
                return GoalVerdict { text: format!("{}: {message}", goal.text()), met: false, value: f64::NAN, unit: String::new() };
            }
        };
        let shown = |value: f64, hinge: bool| if hinge { (value.to_degrees(), "deg") } else { (value * 100.0, "cm") };
        let (met, (value, unit)) = match resolved {
            Resolved::JointPassed { object, joint, past, hinge } => {
                let greatest = self.history.extremes[object][joint][1];
                (greatest >= past, shown(greatest, hinge))
            }
            Resolved::JointAt { object, joint, at, within, hinge } => {
                let q = self.joint_state(object + 1, joint).0;
                ((q - at).abs() <= within, shown(q, hinge))
            }
            Resolved::Inside { object, of, link, region, tolerance } => {
                let out = self.reach_out_of(object, of, link, &region);
                (out <= tolerance, (out * 100.0, "cm"))
            }
            Resolved::Outside { object, of, link, region } => {
                let (low, high) = self.extent_in_region(object, of, link, &region);
                let middle = (low + high) / 2.0;
                let half = Vector3::from(region.size) / 2.0;
                let depth = (half - middle.abs()).min();
                (depth < 0.0, (-depth * 100.0, "cm"))
            }
            Resolved::Upright { object, within } => {
                let up = self.X_WL(object + 1, 0) * Vector3::z();
                let lean = up.angle(&Vector3::z());
                (lean <= within, (lean.to_degrees(), "deg"))
            }
            Resolved::Untouched { object } => {
                let contacts = self.contacts_with_hand(object);
                (contacts == 0, (contacts as f64, "contacts"))
            }
            Resolved::Still { object } => {
                let speed = self.speed(object);
                (speed <= AT_REST, (speed * 100.0, "cm/s"))
            }
            Resolved::EffectNamed { object, joint } => return self.judge_name(goal, object, joint),
            Resolved::OnTable { object } => {
                let height = -reach(self.solids_in(object, &Isometry3::identity()), &-Vector3::z()) - self.scene.table_height;
                (height.abs() <= ON_TABLE, (height * 100.0, "cm"))
            }
        };
        GoalVerdict { text: goal.text(), met, value, unit: unit.to_owned() }
    }

    /// Was the effect that is hidden in a joint named, and nothing else beside it?
    fn judge_name(&self, goal: &Goal, object: usize, joint: usize) -> GoalVerdict {
        let model = self.model(object + 1);
        let answers: Vec<_> = self.answers[object].iter().filter(|a| a.joint == model.joints[joint].name).collect();
        let said = match answers.as_slice() {
            [] => "nothing was named".to_owned(),
            some => {
                let sets =
                    some.iter().map(|a| [&a.name].into_iter().chain(&a.alternatives).map(String::as_str).collect::<Vec<_>>().join(" or "));
                format!("named was {}", sets.collect::<Vec<_>>().join(" and "))
            }
        };
        let hidden = self.hidden[object].as_ref().map_or("nothing", |e| e.effect.as_str());
        let met = matches!(answers.as_slice(), [only] if only.names(hidden));
        let names = answers.iter().map(|a| 1 + a.alternatives.len()).sum::<usize>();
        GoalVerdict { text: format!("{}: it is {hidden}, {said}", goal.text()), met, value: names as f64, unit: "names".into() }
    }

    /// An object's solids, in the frame whose pose in the world is `X_WF`.
    fn solids_in<'a>(
        &'a self,
        object: usize,
        X_WF: &Isometry3<f64>,
    ) -> impl Iterator<Item = (Isometry3<f64>, &'a parry3d_f64::shape::SharedShape)> {
        let X_FW = X_WF.inverse();
        self.solids[object + 1].iter().map(move |s| (X_FW * self.X_WL(object + 1, s.link) * s.X_LG, &s.shape))
    }

    /// Least and greatest coordinates of an object in a region's frame, which is centred in it.
    fn extent_in_region(&self, object: usize, of: usize, link: usize, region: &sagci_model::Region) -> (Vector3<f64>, Vector3<f64>) {
        let X_WG = self.X_WL(of + 1, link) * nalgebra::Translation3::from(Vector3::from(region.center));
        let along = |axis: Vector3<f64>| reach(self.solids_in(object, &X_WG), &axis);
        let high = Vector3::new(along(Vector3::x()), along(Vector3::y()), along(Vector3::z()));
        let low = -Vector3::new(along(-Vector3::x()), along(-Vector3::y()), along(-Vector3::z()));
        (low, high)
    }

    /// How far an object reaches out of a region; negative where all of it lies within.
    fn reach_out_of(&self, object: usize, of: usize, link: usize, region: &sagci_model::Region) -> f64 {
        let (low, high) = self.extent_in_region(object, of, link, region);
        let half = Vector3::from(region.size) / 2.0;
        (high - half).max().max((-half - low).max())
    }

    /// Number of points at which the hand touches an object.
    fn contacts_with_hand(&self, object: usize) -> usize {
        let hand = |o: Owner| o.thing == 0 && self.hand.get(o.link as usize).copied().unwrap_or(false);
        let thing = |o: Owner| o.thing == object as u32 + 1;
        self.physics
            .narrow_phase
            .contact_pairs()
            .filter(|pair| {
                let owner = |handle| self.physics.colliders.get(handle).map(|c| Owner::unpack(c.user_data));
                matches!((owner(pair.collider1), owner(pair.collider2)), (Some(a), Some(b)) if (hand(a) && thing(b)) || (hand(b) && thing(a)))
            })
            .flat_map(|pair| pair.manifolds())
            .flat_map(|manifold| &manifold.points)
            .filter(|point| point.dist <= 0.0)
            .count()
    }

    /// Speed of the fastest point of an object's bodies, from their true velocities.
    fn speed(&self, object: usize) -> f64 {
        self.things[object + 1]
            .bodies
            .iter()
            .filter_map(|handle| self.physics.bodies.get(*handle))
            .map(|body| {
                // Every point of a hand-sized thing lies within 15 cm of its centre.
                convert::vector3(body.linvel()).norm() + 0.15 * convert::vector3(body.angvel()).norm()
            })
            .fold(0.0, f64::max)
    }
}
