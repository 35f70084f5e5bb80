//! A hash grid: the points near a place, in constant time.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::{Point3, Vector3};

/// Multiplies and mixes; the keys are small integers, and nobody chooses them to collide. (Fx, as in rustc.)
#[derive(Default)]
pub(crate) struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        // A product's low bits know its factors' low bits alone, and the table is indexed by those.
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|b| self.write_u64(u64::from(*b)));
    }

    fn write_u64(&mut self, n: u64) {
        self.0 = (self.0.rotate_left(5) ^ n).wrapping_mul(0x517c_c1b7_2722_0a95);
    }
}

pub(crate) type Cells<V> = HashMap<u64, V, BuildHasherDefault<Mix>>;

/// Cells along each axis from the origin that keys tell apart.
const REACH: i64 = 1 << 20;

fn along(c: f64, size: f64) -> i64 {
    // Beyond the grid all fall into its outermost cells: slower, and still right.
    ((c / size).floor() as i64).clamp(-REACH, REACH - 1)
}

fn key(x: i64, y: i64, z: i64) -> u64 {
    let part = |c: i64| (c + REACH) as u64;
    (part(x) << 42) | (part(y) << 21) | part(z)
}

/// Where a place is, counted in cells along each axis.
pub(crate) fn steps(p: &Point3<f64>, size: f64) -> [i64; 3] {
    [along(p.x, size), along(p.y, size), along(p.z, size)]
}

/// The cell of a place.
pub(crate) fn cell(p: &Point3<f64>, size: f64) -> u64 {
    let [x, y, z] = steps(p, size);
    key(x, y, z)
}

/// Points by cells of one size, those of a cell beside one another.
pub(crate) struct Grid {
    size: f64,
    /// First and last but one of a cell's points.
    cells: Cells<(u32, u32)>,
    points: Vec<(Point3<f64>, u32)>,
}

impl Grid {
    pub(crate) fn new(points: &[Point3<f64>], size: f64) -> Self {
        let mut order: Vec<(u64, u32)> = points.iter().enumerate().map(|(i, p)| (cell(p, size), i as u32)).collect();
        order.sort_unstable();
        let mut cells: Cells<(u32, u32)> = Cells::default();
        for (at, (key, _)) in order.iter().enumerate() {
            let at = at as u32;
            cells.entry(*key).and_modify(|c| c.1 = at + 1).or_insert((at, at + 1));
        }
        let points = order.iter().map(|(_, i)| (points[*i as usize], *i)).collect();
        Self { size, cells, points }
    }

    /// Calls with every point nearer than `radius`, and its squared distance.
    pub(crate) fn near(&self, p: &Point3<f64>, radius: f64, mut call: impl FnMut(usize, f64)) {
        let r = Vector3::repeat(radius);
        let (low, high) = (steps(&(p - r), self.size), steps(&(p + r), self.size));
        let square = radius * radius;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let Some((from, to)) = self.cells.get(&key(x, y, z)) else { continue };
                    for (q, i) in &self.points[*from as usize..*to as usize] {
                        let d = (q - p).norm_squared();
                        if d <= square {
                            call(*i as usize, d);
                        }
                    }
                }
            }
        }
    }

    /// The nearest point within a radius.
    pub(crate) fn nearest(&self, p: &Point3<f64>, radius: f64) -> Option<usize> {
        let mut best: Option<(usize, f64)> = None;
        self.near(p, radius, |i, d| {
            if best.is_none_or(|b| (d, i) < (b.1, b.0)) {
                best = Some((i, d));
            }
        });
        best.map(|b| b.0)
    }
}
