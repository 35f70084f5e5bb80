//! Finds where simulation and measurement disagree, names the missing effect, adds it to the model and shows the gap shrink.
#![forbid(unsafe_code)]
