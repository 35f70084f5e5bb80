//! Models for the tests.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, dead_code)]

use std::path::PathBuf;

use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use sagci_dynamics::{Multibody, Part};
use sagci_model::ObjectModel;

pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The arm that ships.
pub fn panda() -> ObjectModel {
    let folder = root().join("world-models/panda");
    let head = std::fs::read_to_string(folder.join("HEAD")).unwrap();
    ObjectModel::read(folder.join(head.trim())).unwrap()
}

/// A model from the inside of a `<robot>` element.
pub fn model(name: &str, inside: &str) -> ObjectModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("object.urdf");
    std::fs::write(&path, format!("<robot name='{name}'>{inside}</robot>")).unwrap();
    ObjectModel::read_urdf(path).unwrap()
}

/// A link with mass properties.
pub fn link(name: &str, mass: f64, center: [f64; 3], inertia: [f64; 6]) -> String {
    let ([x, y, z], [xx, xy, xz, yy, yz, zz]) = (center, inertia);
    format!(
        "<link name='{name}'><inertial><origin xyz='{x} {y} {z}'/><mass value='{mass}'/>\
         <inertia ixx='{xx}' ixy='{xy}' ixz='{xz}' iyy='{yy}' iyz='{yz}' izz='{zz}'/></inertial></link>"
    )
}

/// A joint; `more` goes inside it.
pub fn joint(name: &str, kind: &str, parent: &str, child: &str, axis: [f64; 3], origin: [f64; 6], more: &str) -> String {
    let ([ax, ay, az], [x, y, z, r, p, w]) = (axis, origin);
    format!(
        "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/><axis xyz='{ax} {ay} {az}'/>\
         <origin xyz='{x} {y} {z}' rpy='{r} {p} {w}'/>{more}</joint>"
    )
}

/// Wide limits, which URDF demands of revolute and prismatic joints.
pub const WIDE: &str = "<limit lower='-1e3' upper='1e3' velocity='1e3' effort='1e3'/>";

/// A tree with every kind of joint, branches, and masses that lie off the joints. `followers` lets two joints mimic others.
pub fn menagerie(followers: bool) -> ObjectModel {
    let body = |name: &str, k: f64| {
        link(name, 0.5 + 0.3 * k, [0.05 * k - 0.1, 0.03, -0.04 * k], [0.02 + 0.004 * k, 0.001, -0.002, 0.03, 0.0015 * k, 0.025])
    };
    let mimic = |of: &str, m: f64, o: f64| {
        if followers { format!("{WIDE}<mimic joint='{of}' multiplier='{m}' offset='{o}'/>") } else { WIDE.into() }
    };
    let mut urdf = body("base", 0.0);
    for (k, name) in ["a", "b", "c", "d", "e", "f", "g", "h"].iter().enumerate() {
        urdf += &body(name, k as f64);
    }
    urdf += &joint("ja", "revolute", "base", "a", [0.3, -0.5, 0.8], [0.1, 0.2, 0.3, 0.4, -0.2, 0.9], WIDE);
    urdf += &joint("jb", "prismatic", "a", "b", [0.2, 0.9, -0.1], [-0.1, 0.1, 0.2, 1.2, 0.3, -0.4], WIDE);
    urdf += &joint("jc", "planar", "b", "c", [0.1, 0.4, 0.7], [0.2, -0.3, 0.1, 0.5, 0.6, 0.7], "");
    urdf += &joint("jd", "floating", "a", "d", [1.0, 0.0, 0.0], [0.3, 0.1, -0.2, 0.1, 0.2, 0.3], "");
    urdf += &joint("je", "continuous", "d", "e", [0.0, 1.0, 0.2], [0.1, 0.1, 0.1, -0.3, 0.8, 0.2], "");
    urdf += &joint("jf", "fixed", "e", "f", [1.0, 0.0, 0.0], [0.2, 0.0, 0.1, 0.7, 0.1, -0.6], "");
    urdf += &joint("jg", "revolute", "f", "g", [0.6, 0.0, 0.8], [0.1, -0.2, 0.3, 0.0, 0.4, 0.0], &mimic("ja", -0.7, 0.2));
    urdf += &joint("jh", "prismatic", "c", "h", [0.0, 0.6, 0.8], [0.0, 0.1, 0.0, 0.3, 0.0, 0.2], &mimic("jb", 1.5, -0.1));
    model("menagerie", &urdf)
}

/// A single hinge about the world's y axis, a rod of mass m with its centre at `l` below the hinge and inertia `I` about it.
pub fn pendulum(m: f64, l: f64, I: f64, more: &str) -> ObjectModel {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("rod", m, [0.0, 0.0, -l], [I, 0.0, 0.0, I, 0.0, I])
        + &joint("hinge", "revolute", "base", "rod", [0.0, 1.0, 0.0], [0.0; 6], &format!("{WIDE}{more}"));
    model("pendulum", &urdf)
}

/// A slide along the world's x axis: no gravity acts on it.
pub fn slide(m: f64, more: &str) -> ObjectModel {
    let urdf = link("base", 1.0, [0.0; 3], [1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
        + &link("block", m, [0.0; 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1])
        + &joint("slide", "prismatic", "base", "block", [1.0, 0.0, 0.0], [0.0; 6], more);
    model("slide", &urdf)
}

/// One rigid body.
pub fn brick(inertia: [f64; 6]) -> ObjectModel {
    model("brick", &link("brick", 2.0, [0.1, -0.2, 0.15], inertia))
}

pub fn welded(model: &ObjectModel) -> Part<'_> {
    Part::welded(model, Isometry3::identity())
}

pub fn random(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// Random positions (each joint moved from neutral by up to 1 in each direction) and velocities.
pub fn random_state(multibody: &Multibody, rng: &mut Pcg64) -> (Vec<f64>, Vec<f64>) {
    let mut q = vec![0.0; multibody.nq()];
    multibody.neutral_positions(&mut q);
    let step: Vec<f64> = random_vector(multibody.nv(), 1.0, rng);
    multibody.integrate(&mut q, &step, 1.0).unwrap();
    (q, random_vector(multibody.nv(), 1.0, rng))
}

pub fn random_vector(n: usize, size: f64, rng: &mut Pcg64) -> Vec<f64> {
    (0..n).map(|_| rng.random_range(-size..size)).collect()
}

pub fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()))
}
