//! A value with its partial derivatives, as a number: forward-mode differentiation with a fixed set of variables
//! (Griewank and Walther 2008, chapter 3). A term that is written once with these numbers carries its exact partials.

use std::ops::{Add, Div, Mul, Neg, Sub};

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
        let mut out = [Self::default(); MAX_PARAMETERS];
        for (i, (out, theta)) in out.iter_mut().zip(theta).enumerate() {
            out.value = *theta;
            out.d_theta[i] = 1.0;
        }
        out
    }

    /// `value`, with the derivatives `a` of this and `b` of the other.
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

    /// A function of this number with the given value and slope.
    #[inline]
    pub fn chain(&self, value: f64, slope: f64) -> Self {
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

    /// Sine.
    pub fn sin(self) -> Self {
        let (sin, cos) = self.value.sin_cos();
        self.chain(sin, cos)
    }

    /// Exponential. Far below zero it is zero with all its derivatives.
    pub fn exp(self) -> Self {
        let e = self.value.exp();
        if e == 0.0 { Self::default() } else { self.chain(e, e) }
    }

    /// Magnitude; its slope at zero is zero.
    pub fn abs(self) -> Self {
        self.chain(self.value.abs(), sign(self.value))
    }

    /// This number where it is positive, and zero.
    pub fn positive(self) -> Self {
        if self.value > 0.0 { self } else { Self::default() }
    }

    /// This number kept between two others.
    pub fn clamp(self, least: Self, most: Self) -> Self {
        if self.value > most.value {
            most
        } else if self.value < least.value {
            least
        } else {
            self
        }
    }

    /// `exp(-|self|^exponent)`. At zero its slopes are zero.
    pub fn bell(self, exponent: Self) -> Self {
        let x = self.value.abs();
        if x == 0.0 {
            return Self::constant(1.0);
        }
        let power = x.powf(exponent.value);
        let e = (-power).exp();
        if e == 0.0 {
            return Self::default();
        }
        let by_self = -e * exponent.value * x.powf(exponent.value - 1.0) * sign(self.value);
        self.mix(by_self, &exponent, -e * power * x.ln(), e)
    }

    /// `(1 - exp(-x)) / x`, the mean of a decay over its time; 1 at zero. For `x >= 0`.
    pub fn mean_decay(self) -> Self {
        let x = self.value;
        if x.abs() < 1e-2 {
            let value = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))));
            let slope = -1.0 / 2.0 + x * (1.0 / 3.0 - x * (1.0 / 8.0 - x * (1.0 / 30.0 - x * (1.0 / 144.0 - x / 840.0))));
            return self.chain(value, slope);
        }
        let e = (-x).exp();
        // x e^-x would be infinity times zero for an infinite x.
        let tail = if e == 0.0 { 0.0 } else { e * (x + 1.0) };
        self.chain(-(-x).exp_m1() / x, (tail - 1.0) / x / x)
    }
}

/// -1, 0 or 1.
#[inline]
pub(in crate::effects) fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

impl Add for Partial {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.mix(1.0, &other, 1.0, self.value + other.value)
    }
}

impl Sub for Partial {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.mix(1.0, &other, -1.0, self.value - other.value)
    }
}

impl Mul for Partial {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.mix(other.value, &other, self.value, self.value * other.value)
    }
}

impl Div for Partial {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.mix(1.0 / other.value, &other, -value / other.value, value)
    }
}

impl Mul<f64> for Partial {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }
}

impl Add<f64> for Partial {
    type Output = Self;
    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl Neg for Partial {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self * -1.0
    }
}
