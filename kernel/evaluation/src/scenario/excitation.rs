//! How a mechanism is moved: families of trajectories, and the hand or the controller that carries them out.

use std::f64::consts::TAU;

use crate::random::Random;

/// A family of trajectories.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Family {
    /// Slowly from end to end and back.
    Ramp,
    /// A sum of three sines.
    Sines,
    /// A sine whose frequency rises.
    Chirp,
    /// Jumps between places.
    Steps,
    /// A sine whose amplitude doubles again and again, from a thousandth of the range.
    Ladder,
    /// Pushes of random size and length.
    Pushes,
    /// Let go, displaced or with a shove.
    FreeDecay,
    /// Stands for longer and longer, then is moved.
    Dwell,
}

impl Family {
    pub(crate) const ALL: [Self; 8] =
        [Self::Ramp, Self::Sines, Self::Chirp, Self::Steps, Self::Ladder, Self::Pushes, Self::FreeDecay, Self::Dwell];

    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Ramp => "ramp",
            Self::Sines => "sines",
            Self::Chirp => "chirp",
            Self::Steps => "steps",
            Self::Ladder => "amplitude_ladder",
            Self::Pushes => "pushes",
            Self::FreeDecay => "free_decay",
            Self::Dwell => "dwell",
        }
    }
}

/// The motion that is asked of one joint.
#[derive(Debug, Clone)]
pub(crate) struct Reference {
    family: Family,
    low: f64,
    high: f64,
    /// Times and levels of steps or pushes, or frequencies and phases of sines.
    list: Vec<[f64; 2]>,
    duration: f64,
    pace: f64,
    phase: f64,
    /// Pace of the controller, rad/s.
    follow: f64,
}

/// What is asked at an instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    pub r: f64,
    pub v: f64,
    pub a: f64,
    /// Effort of a push, as an acceleration; `None` where the position is controlled.
    pub push: Option<f64>,
}

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
}

impl Reference {
    pub(crate) fn draw(family: Family, range: [f64; 2], duration: f64, follow: f64, rng: &mut Random) -> Self {
        let size = range[1] - range[0];
        let (mut low, mut high) = (range[0], range[1]);
        if !matches!(family, Family::Ramp | Family::Dwell) {
            // Some way off the ends.
            low += size * rng.between(0.02, 0.15);
            high -= size * rng.between(0.02, 0.15);
        }
        let mut list = Vec::new();
        match family {
            Family::Sines => list.extend([[0.11, 0.3], [0.3, 0.8], [0.8, 1.8]].map(|[a, b]| [rng.between(a, b), rng.between(0.0, TAU)])),
            Family::Steps => {
                let mut t = 0.0;
                while t < duration {
                    list.push([t, rng.between(low, high)]);
                    t += rng.between(0.6, 1.4);
                }
            }
            Family::Pushes => {
                let mut t = 0.3;
                while t < duration {
                    let length = rng.between(0.1, 0.5);
                    list.push([t, rng.sign() * rng.between(0.3, 1.0)]);
                    list.push([t + length, 0.0]);
                    t += length + rng.between(0.1, 0.7);
                }
            }
            Family::FreeDecay => {
                let mut t = rng.between(0.2, 0.5);
                while t < duration {
                    list.push([t, rng.sign() * rng.between(0.5, 1.0)]);
                    list.push([t + 0.25, 0.0]);
                    t += rng.between(2.5, 4.0);
                }
            }
            _ => {}
        }
        let pace = match family {
            Family::Ladder => rng.between(0.8, 1.6),
            Family::Chirp => rng.between(3.0, 7.0),
            Family::Ramp => (duration / rng.between(5.0, 8.5)).round().max(1.0),
            _ => 1.0,
        };
        Self { family, low, high, list, duration, pace, phase: rng.between(0.0, TAU), follow }
    }

    /// Where it should be. What swings about the middle begins there and at rest, so that no start asks for a jerk.
    fn place(&self, t: f64) -> f64 {
        let center = (self.low + self.high) / 2.0;
        match self.family {
            Family::Sines | Family::Chirp | Family::Ladder => center + smooth(t / 1.2) * (self.path(t) - center),
            _ => self.path(t),
        }
    }

    fn path(&self, t: f64) -> f64 {
        let (center, size) = ((self.low + self.high) / 2.0, self.high - self.low);
        match self.family {
            Family::Ramp => {
                // A triangle with short rounded corners, and a rest at the start.
                let x = (t / self.duration * self.pace).fract();
                let tri = if x < 0.5 { 2.0 * x } else { 2.0 - 2.0 * x };
                let e = 0.03;
                let rounded = if tri < e {
                    tri * tri / (2.0 * e) + e / 2.0
                } else if tri > 1.0 - e {
                    1.0 - e / 2.0 - (1.0 - tri).powi(2) / (2.0 * e)
                } else {
                    tri
                };
                self.low + size * (rounded - e / 2.0) / (1.0 - e)
            }
            Family::Sines => {
                let sum: f64 = self.list.iter().enumerate().map(|(k, [f, p])| (TAU * f * t + p).sin() / (1.0 + k as f64)).sum();
                center + size * 0.5 * sum / (1.0 + 0.5 + 1.0 / 3.0)
            }
            Family::Chirp => {
                // The amplitude falls with the frequency: about as much effort throughout.
                let (f0, f1) = (0.25, self.pace);
                let f = f0 * (f1 / f0).powf(t / self.duration);
                let phase = TAU * f0 * self.duration / (f1 / f0).ln() * ((f1 / f0).powf(t / self.duration) - 1.0);
                center + 0.45 * size * (f0 / f).powf(1.3) * phase.sin()
            }
            Family::Steps => {
                let k = self.list.partition_point(|[at, _]| *at <= t).max(1) - 1;
                let before = self.list[k.saturating_sub(1)][1];
                let [at, level] = self.list[k];
                before + (level - before) * smooth((t - at) / 0.25)
            }
            Family::Ladder => {
                let rungs = 9.0;
                let rung = (t / self.duration * rungs).floor();
                let amplitude = size / 900.0 * 2f64.powf(rung);
                center + amplitude.min(0.35 * size) * (TAU * self.pace * t + self.phase).sin()
            }
            Family::Dwell => {
                // Stands at the low end for 0.4, 0.8, 1.6, ... s; then to a third of the range and back within 0.8 s.
                let (mut from, mut rest) = (0.0, 0.4);
                while t > from + rest + 0.8 {
                    from += rest + 0.8;
                    rest *= 2.0;
                }
                let x = (t - from - rest) / 0.8;
                let up = if x < 0.5 { smooth(2.0 * x) } else { smooth(2.0 - 2.0 * x) };
                self.low + 0.35 * size * up
            }
            Family::Pushes | Family::FreeDecay => center,
        }
    }

    pub(crate) fn at(&self, t: f64) -> Asked {
        let push = match self.family {
            Family::Pushes | Family::FreeDecay => {
                let k = self.list.partition_point(|[at, _]| *at <= t);
                let size = self.high - self.low;
                let level = if k == 0 { 0.0 } else { self.list[k - 1][1] };
                let strength = if self.family == Family::Pushes { 6.0 } else { 4.0 };
                Some(level * strength * size)
            }
            _ => None,
        };
        let h = 1e-3;
        let (a, b, c) = (self.place((t - h).max(0.0)), self.place(t), self.place(t + h));
        Asked { r: b, v: (c - a) / (2.0 * h), a: (a - 2.0 * b + c) / (h * h), push }
    }

    /// Acceleration that the hand or controller asks for, without gravity.
    pub(crate) fn wanted(&self, t: f64, q: f64, v: f64) -> f64 {
        let asked = self.at(t);
        match asked.push {
            Some(push) => {
                // Pushes and lets go, but does not let it run away: a soft wall at both ends.
                let pace = 9.0;
                let beyond = if q > self.high {
                    self.high - q
                } else if q < self.low {
                    self.low - q
                } else {
                    0.0
                };
                let wall = if beyond == 0.0 { 0.0 } else { pace * pace * beyond - 1.2 * pace * v };
                let toward = if self.family == Family::Pushes { 1.2 * ((self.low + self.high) / 2.0 - q) - 0.4 * v } else { 0.0 };
                push + toward + wall
            }
            None => {
                let limit = 50.0 * (self.high - self.low);
                self.follow * self.follow * (asked.r - q) + 1.6 * self.follow * (asked.v - v) + asked.a.clamp(-limit, limit)
            }
        }
    }

    /// Is gravity left to act?
    pub(crate) fn lets_go(&self) -> bool {
        self.family == Family::FreeDecay
    }

    pub(crate) fn start(&self) -> f64 {
        match self.family {
            // Displaced: it swings by itself where gravity pulls.
            Family::FreeDecay => self.low + (self.high - self.low) * (0.5 + 0.35 * (self.phase).sin()),
            _ => self.place(0.0),
        }
    }
}
