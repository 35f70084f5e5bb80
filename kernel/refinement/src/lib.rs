//! refinement
#![forbid(unsafe_code)]
