//! What a term is written with: numbers that carry as much as who asks needs. One text of a term gives its value alone, its value
//! with the slope that a step needs, or its value with all partial derivatives, and the value is the same to the last bit.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// What an effect can depend on, as variables of derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// The position at the start of the step.
    Q,
    /// The velocity at the start of the step.
    V,
    /// The next velocity.
    Next,
    /// The input.
    Input,
    /// The load.
    Load,
    /// An inner state.
    Z(usize),
    /// A parameter.
    Theta(usize),
}

/// A value with some of its derivatives: [`Partial`](super::Partial) with all, [`Slope`] with that by the next velocity, `f64` with
/// none.
pub trait Number:
    Copy
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Mul<f64, Output = Self>
    + Add<f64, Output = Self>
{
    /// It carries derivatives by the input and the parameters: what only these need may be left out without.
    const COMPLETE: bool;

    /// A number that depends on nothing.
    fn constant(value: f64) -> Self;

    /// A variable.
    fn variable(value: f64, which: Variable) -> Self;

    /// A function of the position at the start, the next velocity and the first parameters, from its value and derivatives.
    fn known<const K: usize>(value: f64, d_q: f64, d_next: f64, d_theta: [f64; K]) -> Self;

    /// The value.
    fn value(&self) -> f64;

    /// The derivative by the next velocity; zero where it is not carried.
    fn d_next(&self) -> f64;

    /// `value`, with the derivatives `a` of this and `b` of the other.
    fn mix(&self, a: f64, other: &Self, b: f64, value: f64) -> Self;

    /// A function of this number with the given value and slope.
    fn chain(&self, value: f64, slope: f64) -> Self;

    /// Sine.
    #[inline]
    fn sin(self) -> Self {
        let (sin, cos) = self.value().sin_cos();
        self.chain(sin, cos)
    }

    /// Exponential. Far below zero it is zero with all its derivatives.
    #[inline]
    fn exp(self) -> Self {
        let e = self.value().exp();
        if e == 0.0 { Self::default() } else { self.chain(e, e) }
    }

    /// Magnitude; its slope at zero is zero.
    #[inline]
    fn abs(self) -> Self {
        self.chain(self.value().abs(), sign(self.value()))
    }

    /// This number where it is positive, and zero.
    #[inline]
    fn positive(self) -> Self {
        if self.value() > 0.0 { self } else { Self::default() }
    }

    /// This number kept between two others.
    #[inline]
    fn clamp(self, least: Self, most: Self) -> Self {
        if self.value() > most.value() {
            most
        } else if self.value() < least.value() {
            least
        } else {
            self
        }
    }

    /// `exp(-|self|^exponent)`. At zero its slopes are zero.
    #[inline]
    fn bell(self, exponent: Self) -> Self {
        let x = self.value().abs();
        if x == 0.0 {
            return Self::constant(1.0);
        }
        let n = exponent.value();
        let power = x.powf(n);
        let e = (-power).exp();
        if e == 0.0 {
            return Self::default();
        }
        let by_self = -e * n * (power / x) * sign(self.value());
        self.mix(by_self, &exponent, -e * power * x.ln(), e)
    }

    /// `(1 - exp(-x)) / x`, the mean of a decay over its time; 1 at zero. For `x >= 0`.
    #[inline]
    fn mean_decay(self) -> Self {
        let x = self.value();
        if x.abs() < 1e-2 {
            let value = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x / 720.0))));
            let slope = -1.0 / 2.0 + x * (1.0 / 3.0 - x * (1.0 / 8.0 - x * (1.0 / 30.0 - x * (1.0 / 144.0 - x / 840.0))));
            return self.chain(value, slope);
        }
        let decayed = (-x).exp_m1();
        // (1 + x) e^-x - 1, without infinity times zero for an infinite x.
        let tail = if decayed == -1.0 { -1.0 } else { decayed * (x + 1.0) + x };
        self.chain(-decayed / x, tail / x / x)
    }
}

/// -1, 0 or 1.
#[inline]
pub(in crate::effects) fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

impl Number for f64 {
    const COMPLETE: bool = false;

    #[inline]
    fn constant(value: f64) -> Self {
        value
    }

    #[inline]
    fn variable(value: f64, _which: Variable) -> Self {
        value
    }

    #[inline]
    fn known<const K: usize>(value: f64, _d_q: f64, _d_next: f64, _d_theta: [f64; K]) -> Self {
        value
    }

    #[inline]
    fn value(&self) -> f64 {
        *self
    }

    #[inline]
    fn d_next(&self) -> f64 {
        0.0
    }

    #[inline]
    fn mix(&self, _a: f64, _other: &Self, _b: f64, value: f64) -> Self {
        value
    }

    #[inline]
    fn chain(&self, value: f64, _slope: f64) -> Self {
        value
    }
}

/// A value with its derivative by the next velocity: what a step needs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Slope {
    /// The value.
    pub value: f64,
    /// By the next velocity, at which a step takes its forces.
    pub d_next: f64,
}

impl Number for Slope {
    const COMPLETE: bool = false;

    #[inline]
    fn constant(value: f64) -> Self {
        Self { value, d_next: 0.0 }
    }

    #[inline]
    fn variable(value: f64, which: Variable) -> Self {
        Self { value, d_next: if which == Variable::Next { 1.0 } else { 0.0 } }
    }

    #[inline]
    fn known<const K: usize>(value: f64, _d_q: f64, d_next: f64, _d_theta: [f64; K]) -> Self {
        Self { value, d_next }
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
        Self { value, d_next: a * self.d_next + b * other.d_next }
    }

    #[inline]
    fn chain(&self, value: f64, slope: f64) -> Self {
        Self { value, d_next: slope * self.d_next }
    }
}

/// Arithmetic of numbers with derivatives, from [`Number::mix`] and [`Number::chain`].
macro_rules! arithmetic {
    ($number:ty) => {
        impl Add for $number {
            type Output = Self;
            #[inline]
            fn add(self, other: Self) -> Self {
                self.mix(1.0, &other, 1.0, self.value + other.value)
            }
        }

        impl Sub for $number {
            type Output = Self;
            #[inline]
            fn sub(self, other: Self) -> Self {
                self.mix(1.0, &other, -1.0, self.value - other.value)
            }
        }

        impl Mul for $number {
            type Output = Self;
            #[inline]
            fn mul(self, other: Self) -> Self {
                self.mix(other.value, &other, self.value, self.value * other.value)
            }
        }

        impl Div for $number {
            type Output = Self;
            #[inline]
            fn div(self, other: Self) -> Self {
                let value = self.value / other.value;
                self.mix(1.0 / other.value, &other, -value / other.value, value)
            }
        }

        impl Mul<f64> for $number {
            type Output = Self;
            #[inline]
            fn mul(self, factor: f64) -> Self {
                self.chain(self.value * factor, factor)
            }
        }

        impl Add<f64> for $number {
            type Output = Self;
            #[inline]
            fn add(self, other: f64) -> Self {
                Self { value: self.value + other, ..self }
            }
        }

        impl Neg for $number {
            type Output = Self;
            #[inline]
            fn neg(self) -> Self {
                self * -1.0
            }
        }
    };
}

arithmetic!(Slope);
arithmetic!(super::Partial);
