//! A hash grid: the points near a place, in constant time.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use nalgebra::{Point3, Vector3};

/// Multiplies and mixes; the keys are small integers, and nobody chooses them to collide. (Fx, as in rustc.)
#[derive(Default)]
pub(crate) struct Mix(u64);

impl Hasher for Mix {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|b| self.write_u64(u64::from(*b)));
    }

    fn write_i32(&mut self, n: i32) {
        self.write_u64(n as u32 as u64);
    }

    fn write_u64(&mut self, n: u64) {
        self.0 = (self.0.rotate_left(5) ^ n).wrapping_mul(0x517c_c1b7_2722_0a95);
    }
}

pub(crate) type Cells<V> = HashMap<[i32; 3], V, BuildHasherDefault<Mix>>;

/// The cell of a place.
pub(crate) fn cell(p: &Point3<f64>, size: f64) -> [i32; 3] {
    [p.x, p.y, p.z].map(|c| (c / size).floor() as i32)
}

/// Points by cells of one size.
pub(crate) struct Grid<'a> {
    points: &'a [Point3<f64>],
    size: f64,
    first: Cells<u32>,
    next: Vec<u32>,
}

const END: u32 = u32::MAX;

impl<'a> Grid<'a> {
    pub(crate) fn new(points: &'a [Point3<f64>], size: f64) -> Self {
        let mut first: Cells<u32> = Cells::default();
        let mut next = vec![END; points.len()];
        // Backwards, so that each chain runs forwards.
        for (i, p) in points.iter().enumerate().rev() {
            let head = first.entry(cell(p, size)).or_insert(END);
            next[i] = *head;
            *head = i as u32;
        }
        Self { points, size, first, next }
    }

    /// Calls with every point nearer than `radius`, and its squared distance.
    pub(crate) fn near(&self, p: &Point3<f64>, radius: f64, mut call: impl FnMut(usize, f64)) {
        let r = Vector3::repeat(radius);
        let (low, high) = (cell(&(p - r), self.size), cell(&(p + r), self.size));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let mut i = self.first.get(&[x, y, z]).copied().unwrap_or(END);
                    while i != END {
                        let d = (self.points[i as usize] - p).norm_squared();
                        if d <= radius * radius {
                            call(i as usize, d);
                        }
                        i = self.next[i as usize];
                    }
                }
            }
        }
    }

    /// The nearest point within a radius.
    pub(crate) fn nearest(&self, p: &Point3<f64>, radius: f64) -> Option<usize> {
        let mut best: Option<(usize, f64)> = None;
        self.near(p, radius, |i, d| {
            if best.is_none_or(|b| d < b.1) {
                best = Some((i, d));
            }
        });
        best.map(|b| b.0)
    }
}
