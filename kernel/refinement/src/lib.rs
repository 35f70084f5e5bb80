//! refinement
