//! URDF in and out.

mod read;
mod vocabulary;
mod write;

pub(crate) use read::read;
pub(crate) use write::to_urdf;
