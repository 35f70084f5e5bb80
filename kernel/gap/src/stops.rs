//! Which of the URDF's limits stop a joint: of a joint that reaches one, those that it does not go past.
//!
//! A limit is often written down with room, or by guess. A motion that goes past one shows that nothing stops the joint there; a simulator that
//! does would be off by all of the motion beyond. A real stop gives way a little as well: there the motion ends at once, or rests.

use sagci_model::ObjectModel;

use crate::noise;
use crate::trajectory::Trajectory;

/// Whether the lower and the upper limit of a joint are kept.
pub(crate) type Stops = [bool; 2];

/// No limits.
#[cfg(test)]
pub(crate) const OPEN: Stops = [false; 2];

/// Deviations of the noise by which a position is past a limit.
const PAST: f64 = 6.0;
/// Share of a joint's range, of 10 rad or m at the most, by which a stop gives way.
const GIVES_WAY: f64 = 0.02;
/// How many times the accelerations of free motion a stop slows.
const ABRUPT: f64 = 2.0;
/// Time over which velocities and accelerations are taken, s, and that around a limit which is no free motion.
const STRIDE: f64 = 0.02;
const AROUND: f64 = 0.1;
/// The share of the trajectory's accelerations that are less than what is taken for its largest.
const LARGEST: f64 = 0.97;
/// Share of the way past a limit over which it is seen whether the joint rests.
const NEAR_THE_END: f64 = 0.1;

/// Are the URDF's limits of a joint reached in the data?
fn reached(model: &ObjectModel, joint: usize, trajectories: &[Trajectory], column: usize) -> bool {
    let limits = &model.joints[joint].limits;
    let margin = 0.002 * limits.range().min(10.0);
    trajectories.iter().flat_map(|t| t.positions(column)).any(|y| y < limits.lower + margin || y > limits.upper - margin)
}

/// Which limits of a joint are kept. Says which one a motion goes past: `others` may do so as well.
pub(crate) fn kept(
    model: &ObjectModel,
    (joint, column): (usize, usize),
    trajectories: &[Trajectory],
    others: &[Trajectory],
    notes: &mut Vec<String>,
) -> Stops {
    let is_reached = reached(model, joint, trajectories, column);
    let joint = &model.joints[joint];
    let limits = joint.limits;
    let gives_way = GIVES_WAY * limits.range().min(10.0);
    [("lower", -1.0, limits.lower), ("upper", 1.0, limits.upper)].map(|(name, sign, limit)| {
        if !limit.is_finite() {
            return is_reached;
        }
        let mut farthest: Option<(f64, &str)> = None;
        for data in [trajectories, others] {
            let noise = noise::of_positions(data, column);
            for trajectory in data {
                for excursion in excursions(trajectory, column, |y| sign * (y - limit)) {
                    if excursion.depth <= PAST * noise {
                        continue;
                    }
                    if excursion.depth < gives_way && excursion.is_stopped(trajectory, noise) {
                        return is_reached;
                    }
                    if farthest.is_none_or(|(depth, _)| excursion.depth > depth) {
                        farthest = Some((excursion.depth, &trajectory.source));
                    }
                }
            }
        }
        let Some((depth, source)) = farthest else { return is_reached };
        notes.push(format!(
            "{}: goes to {:.4} in {source}, past the {name} limit of {limit} in the URDF, and nothing stops it there: that limit is taken as not \
             there; set it right in the URDF if the joint goes so far",
            joint.name,
            limit + sign * depth
        ));
        false
    })
}

/// Shares of a joint's range, of 10 rad or m at the most, by which a stop gives way that is as good as rigid.
const RIGID: f64 = 0.001;
/// Deviations of the noise before a limit from which on a joint may touch it.
const TOUCHES: f64 = 3.0;

/// A limit that stops a joint and gives way: how it does is nothing that a URDF says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Soft {
    /// Of the joint among the degrees of freedom.
    column: usize,
    /// Minus one for the lower limit.
    side: f64,
    limit: f64,
}

/// Limits that give way in some of the data. Says which.
pub(crate) fn soft(model: &ObjectModel, data: &[&Trajectory], notes: &mut Vec<String>) -> Vec<Soft> {
    let mut found = Vec::new();
    for (column, index) in model.moving_joints().enumerate() {
        let joint = &model.joints[index];
        let [least, most] = [RIGID, GIVES_WAY].map(|share| share * joint.limits.range().min(10.0));
        for (at, (name, side, limit)) in [("lower", -1.0, joint.limits.lower), ("upper", 1.0, joint.limits.upper)].into_iter().enumerate() {
            let mut deepest = 0.0f64;
            for trajectory in data.iter().copied().filter(|_| limit.is_finite()) {
                let one = std::slice::from_ref(trajectory);
                let noise = noise::of_positions(one, column);
                let gives_way = |e: &Excursion| e.depth > least.max(PAST * noise) && e.depth < most && e.is_stopped(trajectory, noise);
                let into = || excursions(trajectory, column, |y| side * (y - limit));
                if kept(model, (index, column), one, &[], &mut Vec::new())[at] {
                    deepest = into().iter().filter(|e| gives_way(e)).map(|e| e.depth).fold(deepest, f64::max);
                }
            }
            if deepest > 0.0 {
                notes.push(format!(
                    "{}: goes up to {deepest:.4} past its {name} limit of {limit}, which stops it and gives way; how it does is nothing that a URDF \
                     says, and what happens there is left out",
                    joint.name
                ));
                found.push(Soft { column, side, limit });
            }
        }
    }
    found
}

/// The same recording without the rows in which a joint touches a limit that gives way, or may by its noise.
pub(crate) fn clear_of(soft: &[Soft], trajectory: &Trajectory) -> Trajectory {
    let n = trajectory.joints;
    let mut touches = vec![false; trajectory.rows()];
    for Soft { column, side, limit } in soft {
        let noise = noise::of_positions(std::slice::from_ref(trajectory), *column);
        for k in 0..trajectory.rows() {
            if side * (trajectory.position[k * n + column] - limit) > -TOUCHES * noise {
                // It touched after the row before, and let go before the row behind.
                touches[k.saturating_sub(1)..(k + 2).min(trajectory.rows())].fill(true);
            }
        }
    }
    let rows: Vec<usize> = (0..trajectory.rows()).filter(|k| !touches[*k]).collect();
    trajectory.of_rows(&rows)
}

/// A stretch of motion past a limit.
struct Excursion {
    /// Time and how far past the limit, of its samples.
    beyond: Vec<[f64; 2]>,
    depth: f64,
    /// Velocity with which it went past; none where it was there from the start.
    speed: Option<f64>,
    /// The largest acceleration of the trajectory elsewhere.
    free: f64,
}

impl Excursion {
    /// Did it end at once, or in a rest?
    fn is_stopped(&self, trajectory: &Trajectory, noise: f64) -> bool {
        let is_abrupt = self.speed.is_some_and(|v| v > 0.0 && v * v / (2.0 * self.depth) > ABRUPT * self.free);
        // A smooth turn is near its end for the root of the share of the way.
        let near = (NEAR_THE_END + 2.0 * noise / self.depth).min(1.0);
        let rests = self.beyond.iter().filter(|[_, d]| *d >= (1.0 - near) * self.depth).count() as f64;
        let lasts = self.beyond.len() as f64;
        is_abrupt || lasts * trajectory.period() > STRIDE && rests > 0.5 * (1.0 + near.sqrt()) * lasts
    }
}

/// Stretches in which `past` is above zero.
fn excursions(trajectory: &Trajectory, column: usize, past: impl Fn(f64) -> f64) -> Vec<Excursion> {
    let n = trajectory.joints;
    let start_of = |k: usize| trajectory.starts.iter().copied().rev().find(|s| *s <= k).unwrap_or(0);
    let samples: Vec<[f64; 3]> = (0..trajectory.rows())
        .map(|k| [trajectory.time[k], past(trajectory.position[k * n + column]), start_of(k) as f64])
        .filter(|s| s[1].is_finite())
        .collect();
    if samples.iter().all(|s| s[1] <= 0.0) {
        return Vec::new();
    }
    let goes_on = |i: usize, j: usize| samples[i][2] == samples[j][2];
    // The nearest sample that is a stride away, forth or back.
    let before = |i: usize| (0..i).rev().take_while(|j| goes_on(*j, i)).find(|j| samples[i][0] - samples[*j][0] >= STRIDE);
    let after = |i: usize| (i + 1..samples.len()).take_while(|j| goes_on(*j, i)).find(|j| samples[*j][0] - samples[i][0] >= STRIDE);
    let slope = |a: usize, b: usize| (samples[b][1] - samples[a][1]) / (samples[b][0] - samples[a][0]);
    let times_past: Vec<f64> = samples.iter().filter(|s| s[1] > 0.0).map(|s| s[0]).collect();
    let is_free = |t: f64| {
        let next = times_past.partition_point(|p| *p < t - AROUND);
        times_past.get(next).is_none_or(|p| *p > t + AROUND)
    };
    let acceleration = |i: usize| {
        let (a, b) = (before(i)?, after(i)?);
        Some(((slope(i, b) - slope(a, i)) / (0.5 * (samples[b][0] - samples[a][0]))).abs())
    };
    let mut free: Vec<f64> = (0..samples.len()).filter(|i| is_free(samples[*i][0])).filter_map(acceleration).collect();
    free.sort_by(f64::total_cmp);
    let free = free.get((LARGEST * free.len() as f64) as usize).copied().unwrap_or(f64::INFINITY);
    let mut found: Vec<Excursion> = Vec::new();
    for i in (0..samples.len()).filter(|i| samples[*i][1] > 0.0) {
        let is_new = i == 0 || samples[i - 1][1] <= 0.0 || !goes_on(i - 1, i);
        if is_new {
            found.push(Excursion { beyond: Vec::new(), depth: 0.0, speed: before(i).map(|a| slope(a, i)), free });
        }
        if let Some(last) = found.last_mut() {
            last.beyond.push([samples[i][0], samples[i][1]]);
            last.depth = last.depth.max(samples[i][1]);
        }
    }
    found
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::tests::door;
    use crate::trajectory::Drive;

    /// Of the door, whose limits are -0.4 and 2, along a motion.
    fn along(position: impl Fn(f64) -> f64) -> (Stops, Vec<String>) {
        let mut notes = Vec::new();
        (kept(&door(), (0, 0), &[recorded(position)], &[], &mut notes), notes)
    }

    fn recorded(position: impl Fn(f64) -> f64) -> Trajectory {
        let mut trajectory = Trajectory::steady(4000, 0.005, &[0.0], vec![Drive::Free]);
        // Noise of about 1e-5 that is the same every time.
        let noise = |k: usize| 1e-5 * ((k as f64 * 12.9898).sin() * 43758.5453).fract();
        trajectory.position = (0..4000).map(|k| position(k as f64 * 0.005) + noise(k)).collect();
        trajectory
    }

    #[test]
    fn a_limit_that_a_motion_goes_past_smoothly_is_not_there() {
        let (stops, notes) = along(|t| 0.85 + 1.18 * (2.0 * t).sin());
        assert_eq!(stops, [true, false], "{notes:?}");
        assert!(notes.len() == 1 && notes[0].contains("past the upper limit of 2 "), "{notes:?}");
        // Far past, and with a rest there: the stop, if it is one, is elsewhere.
        assert_eq!(along(|t| (0.8 + 2.0 * (2.0 * t).sin()).min(2.2)).0, [false, false]);
        // Not reached at all.
        assert_eq!(along(|t| 0.8 + (2.0 * t).sin()).0, OPEN);
    }

    /// Thrown against the upper limit: the door slows within milliseconds, so far past it.
    fn bounce(depth: f64) -> impl Fn(f64) -> f64 {
        move |t| {
            let swing = 0.8 + 1.5 * (2.0 * t).sin();
            if swing > 2.0 { 2.0 + depth * (swing - 2.0).min(0.3) / 0.3 } else { swing }
        }
    }

    /// What happens in it is left out, and the motion begins anew behind it; as good as rigid, it tells as much as free motion.
    #[test]
    fn a_stop_that_gives_way_tells_nothing() {
        let mut notes = Vec::new();
        let trajectory = recorded(bounce(0.01));
        let found = soft(&door(), &[&trajectory], &mut notes);
        assert_eq!(found, [Soft { column: 0, side: 1.0, limit: 2.0 }]);
        assert!(notes.len() == 1 && notes[0].contains("past its upper limit of 2,"), "{notes:?}");
        let clear = clear_of(&found, &trajectory);
        assert!(clear.position.iter().all(|y| *y < 2.0) && clear.position.iter().any(|y| *y > 1.98));
        assert!(clear.rows() > trajectory.rows() / 2 && clear.starts.len() > 5, "{:?}", clear.starts);
        assert!(soft(&door(), &[&recorded(bounce(0.002))], &mut notes).is_empty());
        // Gone past without a stop, the limit is not there.
        assert!(soft(&door(), &[&recorded(|t| 0.85 + 1.18 * (2.0 * t).sin())], &mut notes).is_empty());
    }

    #[test]
    fn a_stop_that_gives_way_a_little_is_kept() {
        assert!(along(bounce(0.01)).0[1]);
        // Pressed against it slowly.
        assert_eq!(along(|t| 0.8 + 1.204 * (0.3 * t).min(1.57).sin()).0, [true, true]);
    }
}
