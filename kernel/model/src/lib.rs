//! The object model: what the system knows about one thing it can handle or move.
//!
//! An object model is a folder: `object.urdf` says what URDF can say (links, joints, shapes, inertia), `model.yaml`
//! says the rest (named effects, grasp hints, regions, the robot's own facts, provenance), `meshes/` holds shapes.
//! A robot arm is an object model too, with a `robot` section.
//!
//! Frames, in Drake's monogram notation: `W` world, `O` the object's root link, `L` a link, `P` a joint's parent link,
//! `J` the joint's fixed frame on its parent, `G` a shape. `X_AB` is the pose of `B` in `A`; `p_AB` a position.
//! SI units and radians throughout. A passive joint is shut at its lower end and opens in the positive direction.
#![forbid(unsafe_code)]

mod document;
mod error;
mod mesh;
mod model;
mod shape;
mod stated;
mod text;
mod urdf;
mod validate;
mod xml;

pub use document::{
    Actuator, ActuatorLaw, BarGrasp, Camera, Configuration, Document, EffectEntry, Evidence, Finger, GraspHint, Gripper, JointHypotheses,
    JointHypothesis, Origin, Provenance, RefitTolerance, Region, RimGrasp, Robot, SCHEMA, XyzRpy,
};
pub use error::ModelError;
pub use mesh::TriangleMesh;
pub use model::{DOCUMENT_FILE, Inertial, Joint, JointKind, JointLimits, Link, Mimic, ObjectModel, URDF_FILE};
pub use shape::{Geometry, Shape};
pub use text::{did_you_mean, nearest};
