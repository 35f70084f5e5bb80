//! Joints whose measurements are stamped by clocks of their own.
//!
//! What is stamped `t` by a clock that is late by `s` was true at `t - s`. A filter that compared it with the joint at `t`, set back by `s` along its
//! velocity, would answer errors of this velocity by others. With exact positions the loop in errors of the position and of the way over a row `h` is
//!
//! ```text
//! [  0          l        ]
//! [ -g   1 - g (1 - l)   ],   l = s / h,   g = 1.27 the gain of the way,
//! ```
//!
//! which is stable for `-0.28 < l < 0.79` (Jury 1964). So each measurement is taken in a row near the instant at which it was true: no more than
//! a quarter of a row before that, and three quarters behind it. What is left of `s` there is within what the filter bears.

use std::borrow::Cow;

use crate::trajectory::Trajectory;

/// Share of a row by which a measurement may be taken before it was true, and behind.
const BEFORE: f64 = 0.25;
const BEHIND: f64 = 1.0 - BEFORE;

/// Measurements in the rows at which they were true.
#[derive(Debug, Clone)]
pub(crate) struct OnTime {
    /// How long before its row each measurement was true, s, by row and joint.
    late: Vec<f64>,
    /// Factor on the errors of each joint by which those that are left count as much as all did: some were true before the first row or after the
    /// last, and a clock must not seem right for taking its errors out of the data.
    weight: Vec<f64>,
}

impl OnTime {
    /// How long before its row a measurement was true, s, by its entry among rows and joints.
    pub fn late(&self, entry: usize) -> f64 {
        self.late[entry]
    }

    /// Factor on the errors of a joint.
    pub fn weight(&self, joint: usize) -> f64 {
        self.weight[joint]
    }
}

/// A trajectory with its measurements in the rows at which they were true, where clocks of single joints are late by so much, s.
pub(crate) fn on_time<'t>(trajectory: &'t Trajectory, clocks: &[f64]) -> Cow<'t, Trajectory> {
    if clocks.iter().all(|late| *late == 0.0) {
        return Cow::Borrowed(trajectory);
    }
    let (n, time) = (trajectory.joints, &trajectory.time);
    let period = trajectory.period();
    let mut seen = trajectory.clone();
    let mut on_time = OnTime { late: vec![0.0; time.len() * n], weight: vec![1.0; n] };
    let mut ends = trajectory.starts.get(1..).unwrap_or_default().to_vec();
    ends.push(time.len());
    for (j, clock) in clocks.iter().enumerate().filter(|(_, late)| **late != 0.0) {
        let count =
            |t: &Trajectory| (j..t.position.len()).step_by(n).filter(|i| t.position[*i].is_finite() && t.counted[*i]).count() as f64;
        seen.position.iter_mut().skip(j).step_by(n).for_each(|y| *y = f64::NAN);
        for (start, end) in trajectory.starts.iter().copied().zip(ends.iter().copied()) {
            for from in (start..end).filter(|k| trajectory.position[k * n + j].is_finite()) {
                let was_true = time[from] - clock;
                let row = start + time[start..end].partition_point(|t| *t < was_true - BEFORE * period);
                // Nothing is known of the time before the first row, nor of that after the last.
                if row == end || row == start && time[row] - was_true > BEHIND * period {
                    continue;
                }
                let entry = row * n + j;
                seen.position[entry] = trajectory.position[from * n + j];
                seen.counted[entry] = trajectory.counted[from * n + j];
                on_time.late[entry] = time[row] - was_true;
            }
        }
        on_time.weight[j] = (count(trajectory) / count(&seen).max(1.0)).sqrt();
    }
    seen.on_time = Some(Box::new(on_time));
    Cow::Owned(seen)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use sagci_model::{EffectEntry, ObjectModel};
    use sagci_recording::{JointLog, Log, Series};

    use super::{BEFORE, BEHIND, on_time};
    use crate::hypothesis::Hypothesis;
    use crate::plant::Plant;
    use crate::plant_tests::double_pendulum;
    use crate::search::Search;
    use crate::trajectory::{Drive, Trajectory};

    /// Rows of the simulator to one of the recording, and the time between those, s.
    const DENSE: usize = 5;
    const STEP: f64 = 1e-3;

    /// Two joints at 100 Hz that move evenly, the second stamped so late.
    fn recorded(late: f64) -> Trajectory {
        let mut data = Trajectory::steady(200, 0.01, &[0.0, 0.0], vec![Drive::Given; 2]);
        for k in 0..200 {
            let t = data.time[k];
            (data.position[2 * k], data.position[2 * k + 1]) = (0.3 * t, 2.0 * (t - late));
        }
        data.counted = vec![true; 400];
        data
    }

    /// A measurement in a row at which it was not true says that its joint is elsewhere.
    #[test]
    fn measurements_of_a_late_clock_stand_where_they_were_true() {
        for late in [0.0173, -0.0173, 0.004, -0.001, 0.05] {
            let data = recorded(late);
            let seen = on_time(&data, &[0.0, late]);
            let clocks = seen.on_time.as_ref().unwrap();
            let mut found = 0;
            for k in 0..200 {
                assert_eq!(seen.position[2 * k].to_bits(), data.position[2 * k].to_bits(), "the other joint is on time");
                let (y, left) = (seen.position[2 * k + 1], clocks.late(2 * k + 1));
                if y.is_finite() {
                    found += 1;
                    assert!((y - 2.0 * (seen.time[k] - left)).abs() < 1e-12, "{late}: row {k}");
                    assert!((-BEFORE - 1e-9..=BEHIND + 1e-9).contains(&(left / 0.01)), "{late}: row {k} is {left} late");
                }
            }
            assert!(found >= 194, "{late}: {found} of 200");
            assert!((clocks.weight(1) - (200.0 / f64::from(found)).sqrt()).abs() < 1e-12);
        }
        assert!(on_time(&recorded(0.0), &[0.0, 0.0]).on_time.is_none());
    }

    /// A double pendulum under efforts, each joint stamped late by so many rows of the simulator, with noise of positions.
    fn swung(model: &ObjectModel, late: [isize; 2]) -> Log {
        use rand::SeedableRng;
        let plant = Plant::new(model, &[[false; 2]; 2], 1e-4).unwrap();
        let (mut motion, rows) = (plant.motion(), 6000);
        let push = |k: usize| {
            let t = STEP * (DENSE * (k / DENSE)) as f64;
            [0.3 * (2.1 * t).sin() + 0.1 * (17.0 * t).sin(), 0.1 * (3.7 * t).cos() + 0.05 * (23.0 * t).sin()]
        };
        let mut way = Vec::new();
        for k in 0..rows {
            way.push([motion.state.q[0], motion.state.q[1]]);
            plant.interval(&mut motion, &Trajectory::steady(2, STEP, &push(k), vec![Drive::Effort; 2]), 0).unwrap();
        }
        let mut random = rand_pcg::Pcg64::seed_from_u64(7);
        let mut joints =
            ["shoulder", "elbow"].map(|name| JointLog { name: name.into(), effort: Some(Series::default()), ..JointLog::default() });
        for k in (50..rows - 50).step_by(DENSE) {
            for (j, joint) in joints.iter_mut().enumerate() {
                let seen = way[k.checked_add_signed(-late[j]).unwrap()][j] + 5e-5 * crate::noise::normal(&mut random);
                let effort = joint.effort.as_mut().unwrap();
                for (series, value) in [(&mut joint.position, seen), (effort, push(k)[j])] {
                    series.time.push(STEP * k as f64);
                    series.value.push(value);
                }
            }
        }
        Log { source: "swung".into(), joints: joints.to_vec(), ..Log::default() }
    }

    fn skew(joint: Option<&str>, by: f64) -> EffectEntry {
        let parameters = [("skew".to_owned(), by)].into();
        EffectEntry { effect: "clock_skew".into(), joint: joint.map(str::to_owned), parameters, ..EffectEntry::default() }
    }

    /// Late by two rows and a half, a right model's filter was unstable beside one joint's clock, and a clock of all joints had no name.
    #[test]
    fn errors_are_those_of_noise_whichever_clock_is_late() {
        let folder = tempfile::tempdir().unwrap();
        let model = double_pendulum(folder.path());
        for (joint, late) in
            [(Some("elbow"), [0, 12]), (Some("elbow"), [0, -12]), (Some("shoulder"), [4, 0]), (None, [12, 12]), (None, [-7, -7])]
        {
            let data = [Trajectory::new(&swung(&model, late), &model).unwrap()];
            let search = Search::new(&model, &data).unwrap();
            let errors = |model: &ObjectModel| {
                let known = Hypothesis::known(model, &search.joints);
                (search.problem.errors(&known, &known.x).unwrap().norm_squared() / search.problem.measured() as f64).sqrt()
            };
            let by = STEP * late[if joint == Some("elbow") { 1 } else { 0 }] as f64;
            let mut told = model.clone();
            told.document.effects.push(skew(joint, by));
            let (lacks, right) = (errors(&model), errors(&told));
            assert!((0.7..1.1).contains(&right) && lacks > 1.5 * right, "{joint:?} {by}: {lacks} without, {right} with");
        }
    }

    /// A log of which all positions are late was searched joint by joint, and nothing was found.
    #[test]
    fn a_clock_of_all_joints_is_named_on_none_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let model = double_pendulum(folder.path());
        for (joint, late) in [(None, [12, 12]), (Some(1), [0, 12])] {
            let data = [Trajectory::new(&swung(&model, late), &model).unwrap()];
            let search = Search::new(&model, &data).unwrap();
            let base = search.known(&model, 1.0).unwrap();
            let first = search.stage(&base, search.scale(&base)).unwrap().swap_remove(0);
            assert_eq!((first.effect, first.joint), ("clock_skew", joint));
            let last = *first.fit.hypothesis.x.last().unwrap();
            assert!((last - 0.012).abs() < 3e-4, "{last} s");
        }
    }
}
