//! Versions of object models on disk.
//!
//! ```text
//! world-models/<object>/HEAD                 the name of the current version
//!                      /LICENSE, NOTICE      the terms, for every version
//!                      /<version>/           object.urdf, model.yaml, meshes/, evidence/
//! ```
//!
//! A version's name is the hash of its bytes ([`Version`]), so it can never change: what was measured with a version
//! can be measured with it again. A new version is written beside the others, made durable, and only then becomes HEAD;
//! there is one writer at a time, and readers never wait.
#![forbid(unsafe_code)]

mod check;
mod error;
mod publish;
mod report;
mod store;
mod version;

pub use error::LibraryError;
pub use publish::Evidence;
pub use report::{
    Finding, GraspReport, JointReport, LinkReport, ModelListing, ModelReport, RegionReport, Severity, VerifyReport, VersionReport,
};
pub use store::{Library, Stored};
pub use version::Version;
