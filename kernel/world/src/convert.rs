//! Between nalgebra, which the project speaks, and glam, which rapier and parry speak.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rapier3d_f64::math::{Matrix, Pose, Vector};

pub(crate) fn pose(X: &Isometry3<f64>) -> Pose {
    Pose::from(*X)
}

pub(crate) fn isometry(X: &Pose) -> Isometry3<f64> {
    Isometry3::from(*X)
}

pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

pub(crate) fn vector3(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

pub(crate) fn point3(v: Vector) -> Point3<f64> {
    Point3::new(v.x, v.y, v.z)
}

pub(crate) fn matrix(m: &Matrix3<f64>) -> Matrix {
    let column = |i: usize| Vector::new(m[(0, i)], m[(1, i)], m[(2, i)]);
    Matrix::from_cols(column(0), column(1), column(2))
}
