//! The motions that a workflow may ask for, by the names and numbers of its `FORMAT.md`.

use std::f64::consts::TAU;

use serde_json::Value;

use super::bench::Leads;

/// Rests before a motion begins and between its parts, s.
const REST: f64 = 0.5;
/// Time in which a joint is led to where it is let go, s.
const APPROACH: f64 = 1.5;
/// Sines of a ladder.
const RUNGS: i32 = 6;
/// Steps there and back.
const STEPS: usize = 4;

/// Where the hand leads, row by row: position, velocity, and a factor on its stiffness; zero lets go.
#[derive(Debug, Clone)]
pub(super) struct Path {
    rows: Vec<[f64; 3]>,
    period: f64,
    gain: f64,
}

impl Path {
    /// Held at a position for so many rows.
    pub fn held(q: f64, rows: usize, period: f64) -> Self {
        Self { rows: vec![[q, 0.0, 1.0]; rows], period, gain: 1.0 }
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    fn at(q: f64, period: f64) -> Self {
        Self::held(q, 1, period).rest(REST)
    }

    fn here(&self) -> f64 {
        self.rows.last().map_or(0.0, |row| row[0])
    }

    fn rest(mut self, seconds: f64) -> Self {
        let row = [self.here(), 0.0, self.gain];
        self.rows.extend(std::iter::repeat_n(row, (seconds / self.period).round() as usize));
        self
    }

    fn step(mut self, to: f64, dwell: f64) -> Self {
        self.rows.push([to, 0.0, self.gain]);
        self.rest(dwell)
    }

    fn go(self, to: f64, speed: f64) -> Self {
        let way = to - self.here();
        let rows = (way.abs() / (speed.max(1e-9) * self.period)).ceil().max(1.0);
        let seconds = rows * self.period;
        self.along(seconds, |t| [to - way * (1.0 - t / seconds), way / seconds])
    }

    /// Positions and velocities by time since here.
    fn along(mut self, seconds: f64, law: impl Fn(f64) -> [f64; 2]) -> Self {
        let rows = (seconds / self.period).round() as usize;
        self.rows.extend((1..=rows).map(|k| law(k as f64 * self.period)).map(|[q, v]| [q, v, self.gain]));
        self
    }

    fn gained(mut self, gain: f64) -> Self {
        self.gain = gain;
        self
    }

    /// Of what is asked for; none where that is no motion.
    pub fn of(reference: &Value, period: f64) -> Option<Self> {
        let x = |name: &str| reference[name].as_f64();
        let sweep = |path: Self, low: f64, high: f64, speed: f64| path.go(high, speed).go(low, speed);
        let stairs = |path: Self, [low, high]: [f64; 2], dwell: f64| {
            (0..STEPS).fold(path, |path, i| path.step(if i % 2 == 0 { high } else { low }, dwell))
        };
        Some(match reference["kind"].as_str()? {
            "quasi_static_sweep" => sweep(Self::at(x("low")?, period), x("low")?, x("high")?, x("speed")?),
            "two_speeds" => {
                let fast = sweep(Self::at(x("low")?, period), x("low")?, x("high")?, x("speed")?).go(x("slow_low")?, x("speed")?);
                sweep(fast.rest(REST), x("slow_low")?, x("slow_high")?, x("slow_speed")?)
            }
            "amplitude_ladder" => {
                let (middle, first, last) = (x("middle")?, x("first_amplitude")?, x("last_amplitude")?);
                let (w, cycles) = (TAU * x("frequency")?, x("cycles")?);
                (0..RUNGS).fold(Self::at(middle, period), |path, rung| {
                    let amplitude = first * (last / first).powf(f64::from(rung) / f64::from(RUNGS - 1));
                    path.along(cycles * TAU / w, |t| [middle + amplitude * (w * t).sin(), amplitude * w * (w * t).cos()])
                })
            }
            "free_decay" => {
                let (first, second, seconds) = (x("first")?, x("second")?, x("seconds")?);
                let let_go = |path: Self, to: f64| {
                    let speed = (to - path.here()).abs() / APPROACH;
                    path.go(to, speed).rest(REST).gained(0.0).rest(seconds).gained(1.0)
                };
                let_go(let_go(Self::at(0.5 * (first + second), period), first), second)
            }
            "chirp" => {
                let (middle, amplitude, speed) = (x("middle")?, x("amplitude")?, x("speed")?);
                let (first, seconds) = (TAU * x("first_frequency")?, x("seconds")?);
                let rate = (TAU * x("last_frequency")? / first).ln() / seconds;
                Self::at(middle, period).along(seconds, |t| {
                    let w = first * (rate * t).exp();
                    let (amplitude, phase) = (amplitude.min(speed / w), (w - first) / rate);
                    [middle + amplitude * phase.sin(), amplitude * w * phase.cos()]
                })
            }
            "steps" => {
                let [low, high] = [x("low")?, x("high")?];
                stairs(Self::at(0.5 * (low + high), period), [low, high], x("dwell")?)
            }
            "dwell_then_open" => {
                let (shut, open, speed) = (x("position")?, x("open")?, x("speed")?);
                let once = |path: Self, dwell: f64| sweep(path.rest(dwell), shut, open, speed);
                once(once(Self::held(shut, 1, period), x("first_dwell")?), x("second_dwell")?)
            }
            "two_controller_gains" => {
                let ([low, high], dwell) = ([x("low")?, x("high")?], x("dwell")?);
                let soft = stairs(Self::at(0.5 * (low + high), period).gained(x("first_gain")?), [low, high], dwell);
                stairs(soft.gained(x("second_gain")?), [low, high], dwell)
            }
            _ => return None,
        })
    }
}

/// A joint led along a path.
#[derive(Debug, Clone)]
pub(super) struct Led {
    pub path: Path,
    /// Pace of the hand, rad/s.
    pub follow: f64,
}

impl Led {
    fn row(&self, t: f64) -> [f64; 3] {
        let k = (t / self.path.period).round().max(0.0) as usize;
        self.path.rows.get(k).or(self.path.rows.last()).copied().unwrap_or_default()
    }
}

impl Leads for Led {
    fn start(&self) -> f64 {
        self.row(0.0)[0]
    }

    fn target(&self, t: f64) -> f64 {
        self.row(t)[0]
    }

    fn wanted(&self, t: f64, q: f64, v: f64) -> f64 {
        let [to, along, gain] = self.row(t);
        if gain == 0.0 {
            return 0.0;
        }
        let pace = self.follow * gain.sqrt();
        pace * pace * (to - q) + 1.6 * pace * (along - v)
    }

    fn lets_go(&self, t: f64) -> bool {
        self.row(t)[2] == 0.0
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use serde_json::json;

    use super::Path;

    #[test]
    fn a_motion_keeps_to_the_numbers_that_are_asked_for() {
        let of = |reference| Path::of(&reference, 0.005).unwrap().rows;
        let seen = |rows: &[[f64; 3]], k: usize| rows.iter().fold([f64::MAX, f64::MIN], |m, r| [m[0].min(r[k]), m[1].max(r[k])]);

        let sweep = of(json!({ "kind": "quasi_static_sweep", "low": 0.2, "high": 1.0, "speed": 0.1 }));
        assert!((sweep.first().unwrap()[0] - 0.2).abs() < 1e-9 && (sweep.last().unwrap()[0] - 0.2).abs() < 1e-9);
        assert!((seen(&sweep, 0)[1] - 1.0).abs() < 1e-9);
        assert!((sweep.len() as f64 * 0.005 - 16.5).abs() < 0.02, "{}", sweep.len());

        let chirp = json!({ "kind": "chirp", "middle": 0.5, "amplitude": 0.2, "first_frequency": 0.2, "last_frequency": 10.0, "seconds": 12.0, "speed": 1.0 });
        let [slowest, fastest] = seen(&of(chirp), 1);
        assert!(fastest <= 1.0 && fastest > 0.99 && slowest < -0.99, "{slowest} {fastest}");

        let ladder = json!({ "kind": "amplitude_ladder", "middle": 0.1, "first_amplitude": 1e-3, "last_amplitude": 0.5, "frequency": 1.0, "cycles": 2.0 });
        let [low, high] = seen(&of(ladder), 0);
        assert!((high - 0.6).abs() < 1e-3 && (low + 0.4).abs() < 1e-3, "{low} {high}");

        let decay = of(json!({ "kind": "free_decay", "first": 1.0, "second": -1.0, "seconds": 4.0 }));
        assert_eq!(decay.iter().filter(|r| r[2] == 0.0).count(), 1600);

        let gains = json!({ "kind": "two_controller_gains", "low": 0.1, "high": 0.3, "dwell": 1.2, "first_gain": 0.5, "second_gain": 2.0 });
        let gains = of(gains);
        assert!(gains.iter().any(|r| r[2] == 0.5) && gains.last().unwrap()[2] == 2.0 && seen(&gains, 0) == [0.1, 0.3]);
    }

    #[test]
    fn what_changes_something_outside_is_no_motion() {
        assert!(Path::of(&json!({ "kind": "change_payload" }), 0.005).is_none());
        assert!(Path::of(&json!({ "kind": "steps", "low": 0.1 }), 0.005).is_none());
    }
}
