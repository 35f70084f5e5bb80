//! The gripper's drive: a position servo with limited speed and limited force, like a Franka hand's `grasp` and `move`.
//!
//! A reference slides as long as the opening is not the commanded one; each finger is pulled to it by a spring and a
//! damper whose force is clipped at the commanded one. Pressed on something, the reference runs ahead until the force is
//! the commanded one, and no further: also a wall of 1 mm is held with the whole force.

use sagci_signal::GripperCommand;

/// Speed of each finger, m/s: Franka hand's data sheet gives 50 mm/s.
const SPEED: f64 = 0.05;
/// Stiffness of the servo, N/m. With the armature below: 25 Hz, damping ratio 0.95.
const STIFFNESS: f64 = 5000.0;
/// Damping of the servo, N s/m.
const DAMPING: f64 = 60.0;
/// How fast the reference goes for an opening that is off, 1/s.
const INTEGRAL: f64 = 20.0;
/// Mass of motor and gear as each finger feels it, kg (engineering estimate).
pub(super) const ARMATURE: f64 = 0.2;

/// The drive's memory.
#[derive(Debug, Clone, Copy)]
pub(super) struct GripperServo {
    reference: f64,
}

impl GripperServo {
    /// Starts at rest with each finger at `position`, m.
    pub(super) fn new(position: f64) -> Self {
        Self { reference: position }
    }

    /// Force along each finger's joint (positive opens) for the next `period`, from the fingers' mean position and speed.
    pub(super) fn force(&mut self, command: &GripperCommand, position: f64, speed: f64, period: f64) -> f64 {
        let goal = command.width / 2.0;
        self.reference += (INTEGRAL * (goal - position)).clamp(-SPEED, SPEED) * period;
        // No further ahead than the force needs.
        let lead = command.force / STIFFNESS;
        self.reference = self.reference.clamp(position - lead, position + lead);
        (STIFFNESS * (self.reference - position) - DAMPING * speed).clamp(-command.force, command.force)
    }
}
