//! Derivatives of the contacts' part of a step.
