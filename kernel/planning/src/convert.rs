//! nalgebra to parry's glam types: the only place where the two meet.

use nalgebra::{Isometry3, Vector3};
use parry3d_f64::math::{Pose3, Rot3, Vec3};

pub(crate) fn pose(X: &Isometry3<f64>) -> Pose3 {
    let r = X.rotation.quaternion();
    Pose3::from_parts(vector(&X.translation.vector), Rot3::from_xyzw(r.i, r.j, r.k, r.w))
}

pub(crate) fn vector(v: &Vector3<f64>) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}
