//! Finds where simulation and measurement disagree, names the missing effect, adds it to the model and shows the gap shrink.
#![forbid(unsafe_code)]

mod alike;
mod baselines;
mod between;
mod chart;
mod choice;
#[cfg(test)]
mod choice_tests;
mod climb;
mod clocks;
mod confirmed;
mod error;
mod experiment;
mod find;
mod fit;
mod flexible;
mod free;
mod gaps;
mod given;
mod hypothesis;
mod inertial;
mod inputs;
mod invent;
mod jitter;
mod left_over;
mod locked;
mod map;
mod memory;
mod near;
mod noise;
#[cfg(test)]
mod noisy_tests;
mod observer;
mod output_error;
#[cfg(test)]
mod output_error_tests;
mod page;
mod part;
mod plant;
#[cfg(test)]
mod plant_tests;
pub mod plots;
mod predict;
#[cfg(test)]
mod read_tests;
mod remainder;
pub mod report;
mod response;
#[cfg(test)]
mod rest_tests;
#[cfg(test)]
#[allow(clippy::panic)]
mod round_trip;
mod screen;
mod search;
mod second_look;
mod settled;
mod shape;
mod span;
mod starts;
#[cfg(test)]
mod starts_tests;
mod stops;
mod tangent;
#[cfg(test)]
mod tests;
mod trajectory;
mod unheeded;
mod unseen;
mod valley;
#[cfg(test)]
mod valley_tests;
mod view;
mod weigh;
mod windows;

pub use error::GapError;
pub use find::{Found, Options, find};
pub use flexible::Region;
pub use page::page;
pub use predict::{Predicted, predict, prediction_error};
pub use report::Report;
pub use windows::Figures;
