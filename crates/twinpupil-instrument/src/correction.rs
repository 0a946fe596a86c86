//! What is left of a band's images when everything that has a name is taken off: a smooth field over the sensor.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::{ValueError, positive, within};

/// `correction` of a band: how much farther its light lands on the plane across the axis at `sensor.distance_mm` than
/// `distortion` says, in circle polynomials.
///
/// A point that an ideal lens images at (x, y) from the axis is displaced by (Δx, Δy),
///
/// ```text
/// Δx + i Δy = Σ (xₖ + i yₖ) Zₖ        Z = R(ρ) exp(i m φ),  ρ exp(i φ) = (x + i y)/radius
/// R = Σₛ (−1)ˢ (n − s)!/(s! (a − s)! (b − s)!) ρⁿ⁻²ˢ        a, b = (n ± m)/2,  s = 0 … min(a, b)
/// ```
///
/// where k counts (n, m) = (0, 0), (1, 1), (1, −1), (2, 2), (2, 0), (2, −2), (3, 3), …: R is Zernike's, in M. Born and
/// E. Wolf, Principles of Optics, section 9.2.1, at most 1 within the circle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Correction {
    /// Radius of the circle about the axis, mm.
    pub radius_mm: f64,
    /// The coefficients' parts along x, mm: of every term up to some order n, 1, 3, 6, 10, … of them.
    pub x_mm: Vec<f64>,
    /// Their parts along y, as many.
    pub y_mm: Vec<f64>,
}

/// A complex number.
type Complex = [f64; 2];

fn times([a, b]: Complex, [c, d]: Complex) -> Complex {
    [a * c - b * d, a * d + b * c]
}

impl Correction {
    /// The highest order that a correction may have.
    pub const DEGREE_MAX: usize = 8;

    /// That which displaces nothing, with all terms up to an order.
    pub fn none(radius_mm: f64, degree: usize) -> Self {
        let zeros = vec![0.0; Self::terms(degree)];
        Self { radius_mm, x_mm: zeros.clone(), y_mm: zeros }
    }

    /// Whether it displaces nothing.
    pub fn is_none(&self) -> bool {
        self.x_mm.iter().chain(&self.y_mm).all(|coefficient| *coefficient == 0.0)
    }

    /// Number of terms up to an order.
    pub fn terms(degree: usize) -> usize {
        (degree + 1) * (degree + 2) / 2
    }

    /// n and m of a term.
    pub fn orders(term: usize) -> (usize, i32) {
        let (a, b) = powers(term);
        (a + b, a as i32 - b as i32)
    }

    /// Z of every term at a point, its real and its imaginary part.
    pub fn polynomials(&self, at_mm: [f64; 2]) -> Vec<[f64; 2]> {
        let powers = Powers::of(at_mm.map(|mm| mm / self.radius_mm));
        let sum = |[re, im]: Complex, (a, b, factor): (usize, usize, f64)| {
            let [x, y] = powers.product(a, b);
            [re + factor * x, im + factor * y]
        };
        (0..self.x_mm.len()).map(|term| monomials(term).fold([0.0; 2], sum)).collect()
    }

    /// The highest order of its terms.
    pub fn degree(&self) -> usize {
        self.x_mm.len().checked_sub(1).map_or(0, |last| Self::orders(last).0)
    }

    /// The same with terms up to a higher order, which displace nothing.
    pub fn up_to(mut self, degree: usize) -> Self {
        let count = self.x_mm.len().max(Self::terms(degree));
        self.x_mm.resize(count, 0.0);
        self.y_mm.resize(count, 0.0);
        self
    }

    /// Ready to be evaluated.
    pub fn displacement(&self) -> Displacement {
        let degree = self.degree();
        let mut powers = vec![Plane::one(degree)];
        for power in 0..degree {
            powers.push(powers[power].times_w());
        }
        let mut sum = Plane::zero(degree);
        for (term, (x_mm, y_mm)) in self.x_mm.iter().zip(&self.y_mm).enumerate() {
            for (a, b, factor) in monomials(term) {
                sum.add(
                    &(0..b).fold(powers[a].clone(), |own, _| own.times_conjugate()),
                    [factor * x_mm, factor * y_mm],
                );
            }
        }
        let sum = sum.in_mm(self.radius_mm);
        let [by_x, by_y] = [sum.by_x(), sum.by_y()];
        let second = [by_x.by_x(), by_x.by_y(), by_y.by_y()];
        Displacement { sum, first: [by_x, by_y], second }
    }

    pub(crate) fn check(&self, key: &str) -> Result<(), ValueError> {
        const LARGEST_MM: f64 = 1e3;
        positive(&format!("{key}.radius_mm"), self.radius_mm, 1e6)?;
        let (count, other) = (self.x_mm.len(), self.y_mm.len());
        if !(0..=Self::DEGREE_MAX).any(|degree| Self::terms(degree) == count) {
            let legal = "1, 3, 6, 10, 15, 21, 28, 36 or 45: all terms up to an order of 0 to 8";
            return Err(ValueError::new(format!("{key}.x_mm"), format!("{count} values"), legal));
        }
        if other != count {
            return Err(ValueError::new(format!("{key}.y_mm"), format!("{other} values"), format!("{count}, as x_mm")));
        }
        for (name, values) in [("x_mm", &self.x_mm), ("y_mm", &self.y_mm)] {
            for (term, value) in values.iter().enumerate() {
                within(&format!("{key}.{name}[{term}]"), *value, -LARGEST_MM, LARGEST_MM)?;
            }
        }
        Ok(())
    }
}

/// a and b of a term, the powers of w and its conjugate that lead it: its place counts up b after b.
fn powers(term: usize) -> (usize, usize) {
    let degree = (0..).find(|degree| term < Correction::terms(*degree)).unwrap_or(0);
    let b = term - degree * (degree + 1) / 2;
    (degree - b, b)
}

/// The products of powers of w and of its conjugate that make a term: both powers, and the factor.
fn monomials(term: usize) -> impl Iterator<Item = (usize, usize, f64)> {
    let (a, b) = powers(term);
    let factorial = |k: usize| (1..=k).map(|factor| factor as f64).product::<f64>();
    (0..=a.min(b)).map(move |s| {
        let sign = if s % 2 == 0 { 1.0 } else { -1.0 };
        let factor = sign * factorial(a + b - s) / (factorial(s) * factorial(a - s) * factorial(b - s));
        (a - s, b - s, factor)
    })
}

/// Powers of a complex number.
struct Powers([Complex; Correction::DEGREE_MAX + 1]);

impl Powers {
    fn of(w: Complex) -> Self {
        let mut all = [[1.0, 0.0]; Correction::DEGREE_MAX + 1];
        for power in 1..all.len() {
            all[power] = times(all[power - 1], w);
        }
        Self(all)
    }

    /// wᵃ times the b-th power of its conjugate.
    fn product(&self, a: usize, b: usize) -> Complex {
        let [re, im] = self.0[b];
        times(self.0[a], [re, -im])
    }
}

/// A correction, ready to be evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct Displacement {
    sum: Plane,
    /// By x and by y; by x twice, by x and y, by y twice.
    first: [Plane; 2],
    second: [Plane; 3],
}

impl Displacement {
    /// Δx and Δy at a point, mm.
    #[inline]
    pub fn at(&self, at_mm: [f64; 2]) -> [f64; 2] {
        self.sum.at(at_mm)
    }

    /// How that changes with x and y, row by row.
    #[inline]
    pub fn jacobian(&self, at_mm: [f64; 2]) -> [[f64; 2]; 2] {
        let [by_x, by_y] = [self.first[0].at(at_mm), self.first[1].at(at_mm)];
        [0, 1].map(|k| [by_x[k], by_y[k]])
    }

    /// Second derivatives of both coordinates: by x twice, by x and y, by y twice, 1/mm.
    #[inline]
    pub fn second_derivatives(&self, at_mm: [f64; 2]) -> [[f64; 3]; 2] {
        let [xx, xy, yy] = [0, 1, 2].map(|k| self.second[k].at(at_mm));
        [0, 1].map(|k| [xx[k], xy[k], yy[k]])
    }
}

/// Two polynomials of x and y, as the parts of a complex one.
#[derive(Debug, Clone, PartialEq)]
struct Plane {
    degree: usize,
    /// Of xⁱ yʲ, j after j: first those of i = degree − j, last those of i = 0.
    coefficients: Vec<Complex>,
}

impl Plane {
    fn zero(degree: usize) -> Self {
        Self { degree, coefficients: vec![[0.0; 2]; Correction::terms(degree)] }
    }

    fn one(degree: usize) -> Self {
        let mut one = Self::zero(degree);
        *one.of(0, 0) = [1.0, 0.0];
        one
    }

    /// The coefficient of xⁱ yʲ.
    fn of(&mut self, i: usize, j: usize) -> &mut Complex {
        let before = (0..j).map(|j| self.degree - j + 1).sum::<usize>();
        &mut self.coefficients[before + self.degree - j - i]
    }

    /// i and j of all coefficients.
    fn orders(&self) -> Vec<(usize, usize)> {
        (0..=self.degree).flat_map(|j| (0..=self.degree - j).rev().map(move |i| (i, j))).collect()
    }

    fn add(&mut self, other: &Self, factor: Complex) {
        for (own, other) in self.coefficients.iter_mut().zip(&other.coefficients) {
            let [re, im] = times(*other, factor);
            *own = [own[0] + re, own[1] + im];
        }
    }

    /// Times x + i y; what it has of its highest degree must be none.
    fn times_w(&self) -> Self {
        self.times(1.0)
    }

    /// Times x − i y.
    fn times_conjugate(&self) -> Self {
        self.times(-1.0)
    }

    fn times(&self, sign: f64) -> Self {
        let mut product = Self::zero(self.degree);
        for ((i, j), [re, im]) in self.orders().into_iter().zip(&self.coefficients) {
            if i + j < self.degree {
                let by_x = product.of(i + 1, j);
                *by_x = [by_x[0] + re, by_x[1] + im];
                let by_y = product.of(i, j + 1);
                *by_y = [by_y[0] - sign * im, by_y[1] + sign * re];
            }
        }
        product
    }

    /// Of x and y in mm, if they were in units of a radius.
    fn in_mm(mut self, radius_mm: f64) -> Self {
        for (i, j) in self.orders() {
            let scale = radius_mm.powi(-((i + j) as i32));
            let own = self.of(i, j);
            *own = own.map(|part| scale * part);
        }
        self
    }

    fn by_x(&self) -> Self {
        self.derivative(|(i, j)| (i > 0).then(|| (i - 1, j, i as f64)))
    }

    fn by_y(&self) -> Self {
        self.derivative(|(i, j)| (j > 0).then(|| (i, j - 1, j as f64)))
    }

    fn derivative(&self, to: impl Fn((usize, usize)) -> Option<(usize, usize, f64)>) -> Self {
        let mut derivative = Self::zero(self.degree.saturating_sub(1));
        for (orders, own) in self.orders().into_iter().zip(&self.coefficients) {
            if let Some((i, j, factor)) = to(orders) {
                *derivative.of(i, j) = own.map(|part| factor * part);
            }
        }
        derivative
    }

    /// Its value, by Horner's scheme along x and along y.
    #[inline]
    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (mut sum, mut power, mut first) = ([0.0; 2], 1.0, 0);
        for j in 0..=self.degree {
            let end = first + self.degree - j + 1;
            let row =
                self.coefficients[first..end].iter().fold([0.0; 2], |[re, im], own| [re * x + own[0], im * x + own[1]]);
            sum = [sum[0] + power * row[0], sum[1] + power * row[1]];
            (power, first) = (power * y, end);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn some() -> Correction {
        let terms = 0..Correction::terms(Correction::DEGREE_MAX);
        let of = |shift: f64| terms.clone().map(|term| 0.01 * (term as f64 + shift).sin()).collect();
        Correction { radius_mm: 6.0, x_mm: of(1.0), y_mm: of(2.5) }
    }

    /// The table of Born and Wolf, 9.2.1.
    #[test]
    fn radial_parts_are_zernikes() {
        let of = |n: usize, m: i32, rho: f64| {
            let term = (0..45).find(|term| Correction::orders(*term) == (n, m)).expect("an order");
            let angle = 0.7_f64;
            let all = Correction::none(2.0, 8).polynomials([2.0 * rho * angle.cos(), 2.0 * rho * angle.sin()]);
            let [re, im] = all[term];
            let turn = f64::from(m) * angle;
            assert!((im * turn.cos() - re * turn.sin()).abs() < 1e-14, "{n} {m}");
            re * turn.cos() + im * turn.sin()
        };
        for rho in [0.0, 0.3, 0.8, 1.0_f64] {
            let square = rho * rho;
            for (n, m, expected) in [
                (0, 0, 1.0),
                (1, -1, rho),
                (2, 0, 2.0 * square - 1.0),
                (2, 2, square),
                (3, 1, rho * (3.0 * square - 2.0)),
                (4, 0, 6.0 * square * square - 6.0 * square + 1.0),
                (5, -1, rho * (10.0 * square * square - 12.0 * square + 3.0)),
                (6, 2, square * (15.0 * square * square - 20.0 * square + 6.0)),
                (8, 8, square.powi(4)),
            ] {
                assert!((of(n, m, rho) - expected).abs() < 1e-13, "{n} {m} {rho}");
            }
        }
    }

    #[test]
    fn terms_count_as_the_file_does() {
        let orders = [(0, 0), (1, 1), (1, -1), (2, 2), (2, 0), (2, -2), (3, 3), (3, 1), (3, -1), (3, -3)];
        assert!(orders.into_iter().enumerate().all(|(term, orders)| Correction::orders(term) == orders));
        assert_eq!((Correction::terms(0), Correction::terms(3), Correction::terms(8)), (1, 10, 45));
        let larger = Correction::none(1.0, 2).up_to(4);
        assert_eq!((larger.degree(), larger.clone().up_to(1).degree(), larger.x_mm.len()), (4, 4, 15));
    }

    #[test]
    fn a_displacement_is_the_sum_of_its_terms() {
        let (own, at_mm) = (some(), [2.0, -3.5]);
        let mut expected = [0.0; 2];
        for (polynomial, coefficient) in own.polynomials(at_mm).iter().zip(own.x_mm.iter().zip(&own.y_mm)) {
            let [x, y] = times([*coefficient.0, *coefficient.1], *polynomial);
            expected = [expected[0] + x, expected[1] + y];
        }
        let found = own.displacement().at(at_mm);
        assert!((found[0] - expected[0]).hypot(found[1] - expected[1]) < 1e-14, "{found:?} {expected:?}");
        assert!(!own.is_none() && Correction::none(6.0, 3).displacement().at(at_mm) == [0.0; 2]);
    }

    #[test]
    fn what_is_no_correction_is_refused() {
        let refused = |edit: &dyn Fn(&mut Correction)| {
            let mut own = some();
            edit(&mut own);
            own.check("band[0].correction").expect_err("must be refused").to_string()
        };
        let message = refused(&|own| own.x_mm.truncate(44));
        assert!(message.starts_with("`band[0].correction.x_mm` is 44 values; legal: 1, 3, 6"), "{message}");
        let message = refused(&|own| own.y_mm.truncate(3));
        assert_eq!(message, "`band[0].correction.y_mm` is 3 values; legal: 45, as x_mm");
        let message = refused(&|own| own.y_mm[7] = f64::NAN);
        assert_eq!(message, "`band[0].correction.y_mm[7]` is NaN; legal: -1000 to 1000");
        let message = refused(&|own| own.radius_mm = 0.0);
        assert!(message.starts_with("`band[0].correction.radius_mm` is 0; legal: above 0"), "{message}");
    }

    proptest! {
        #[test]
        fn derivatives_are_differences(x in -4.0..4.0_f64, y in -4.0..4.0_f64) {
            const STEP_MM: f64 = 1e-4;
            let own = some().displacement();
            let (slopes, second) = (own.jacobian([x, y]), own.second_derivatives([x, y]));
            for (j, [dx, dy]) in [[STEP_MM, 0.0], [0.0, STEP_MM]].into_iter().enumerate() {
                let [a, b] = [-1.0, 1.0].map(|sign| [x + sign * dx, y + sign * dy]);
                for k in 0..2 {
                    let slope = (own.at(b)[k] - own.at(a)[k]) / (2.0 * STEP_MM);
                    prop_assert!((slope - slopes[k][j]).abs() < 1e-7);
                    for i in 0..2 {
                        let bend = (own.jacobian(b)[k][i] - own.jacobian(a)[k][i]) / (2.0 * STEP_MM);
                        prop_assert!((bend - second[k][i + j]).abs() < 1e-6, "{bend} {second:?}");
                    }
                }
            }
        }
    }
}
