//! The skill pick.
