//! The program `sagci`.
fn main() {}
