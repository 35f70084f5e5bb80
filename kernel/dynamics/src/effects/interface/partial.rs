//! A value with its partial derivatives, as a number: forward-mode differentiation with a fixed set of variables
//! (Griewank and Walther 2008, chapter 3). A term that is written once with these numbers carries its exact partials.

use super::number::{Number, Variable};

/// No effect has more parameters than this.
pub const MAX_PARAMETERS: usize = 8;

/// No effect has more inner states than this, beside a history of its input.
pub const MAX_STATES: usize = 2;

/// A value with its partial derivatives by everything that an effect can depend on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Partial {
    /// The value.
    pub value: f64,
    /// By the position at the start of the step.
    pub d_q: f64,
    /// By the velocity at the start of the step.
    pub d_v: f64,
    /// By the next velocity, at which a step takes its forces.
    pub d_next: f64,
    /// By the input.
    pub d_input: f64,
    /// By the load.
    pub d_load: f64,
    /// By the inner states at the start of the step.
    pub d_z: [f64; MAX_STATES],
    /// By the parameters.
    pub d_theta: [f64; MAX_PARAMETERS],
}

impl Partial {
    /// A number that depends on nothing.
    #[inline]
    pub fn constant(value: f64) -> Self {
        Self { value, ..Self::default() }
    }

    /// Parameters alone as numbers that carry their derivatives.
    pub(in crate::effects) fn parameters(theta: &[f64]) -> [Self; MAX_PARAMETERS] {
        parameters(theta)
    }
}

/// Parameters as numbers; those that an effect does not have are no variables.
#[inline]
pub(in crate::effects) fn parameters<N: Number>(theta: &[f64]) -> [N; MAX_PARAMETERS] {
    std::array::from_fn(|i| theta.get(i).map_or_else(N::default, |value| N::variable(*value, Variable::Theta(i))))
}

impl Number for Partial {
    const COMPLETE: bool = true;

    #[inline]
    fn constant(value: f64) -> Self {
        Self { value, ..Self::default() }
    }

    #[inline]
    fn variable(value: f64, which: Variable) -> Self {
        let mut out = Self::constant(value);
        match which {
            Variable::Q => out.d_q = 1.0,
            Variable::V => out.d_v = 1.0,
            Variable::Next => out.d_next = 1.0,
            Variable::Input => out.d_input = 1.0,
            Variable::Load => out.d_load = 1.0,
            Variable::Z(i) => out.d_z[i] = 1.0,
            Variable::Theta(i) => out.d_theta[i] = 1.0,
        }
        out
    }

    #[inline]
    fn known<const K: usize>(value: f64, d_q: f64, d_next: f64, d_theta: [f64; K]) -> Self {
        let mut out = Self { value, d_q, d_next, ..Self::default() };
        for (out, d) in out.d_theta.iter_mut().zip(d_theta) {
            *out = d;
        }
        out
    }

    #[inline]
    fn value(&self) -> f64 {
        self.value
    }

    #[inline]
    fn d_next(&self) -> f64 {
        self.d_next
    }

    #[inline]
    fn mix(&self, a: f64, other: &Self, b: f64, value: f64) -> Self {
        let mut out = Self {
            value,
            d_q: a * self.d_q + b * other.d_q,
            d_v: a * self.d_v + b * other.d_v,
            d_next: a * self.d_next + b * other.d_next,
            d_input: a * self.d_input + b * other.d_input,
            d_load: a * self.d_load + b * other.d_load,
            d_z: [0.0; MAX_STATES],
            d_theta: [0.0; MAX_PARAMETERS],
        };
        for i in 0..MAX_STATES {
            out.d_z[i] = a * self.d_z[i] + b * other.d_z[i];
        }
        for i in 0..MAX_PARAMETERS {
            out.d_theta[i] = a * self.d_theta[i] + b * other.d_theta[i];
        }
        out
    }

    #[inline]
    fn chain(&self, value: f64, slope: f64) -> Self {
        let mut out = Self {
            value,
            d_q: slope * self.d_q,
            d_v: slope * self.d_v,
            d_next: slope * self.d_next,
            d_input: slope * self.d_input,
            d_load: slope * self.d_load,
            d_z: self.d_z,
            d_theta: self.d_theta,
        };
        out.d_z.iter_mut().for_each(|d| *d *= slope);
        out.d_theta.iter_mut().for_each(|d| *d *= slope);
        out
    }
}
