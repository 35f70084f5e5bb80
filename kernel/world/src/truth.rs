//! What is true in the measured world. Nothing of this leaves the crate but through a recording or the judge.

use nalgebra::Isometry3;

/// Everything that moves, at one instant.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TrueFrame {
    /// Time since the reset, s.
    pub time: f64,
    /// Pose in the world of every link, by `object/link`; the robot goes by its model's name.
    pub frames: Vec<(String, Isometry3<f64>)>,
    /// Position and velocity of every moving joint, by `object/joint`; rad and rad/s, or m and m/s.
    pub joints: Vec<(String, f64, f64)>,
}

/// A world whose true state can be written down by a recorder inside this crate.
pub(crate) trait TrueState {
    /// The state now; empty before the first reset.
    fn true_frame(&self) -> TrueFrame;
}
