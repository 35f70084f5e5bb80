//! The skill place.
