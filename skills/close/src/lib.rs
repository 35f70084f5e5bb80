//! The skill close.
