//! The skill open.
