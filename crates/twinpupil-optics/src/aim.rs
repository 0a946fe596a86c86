//! Where rays from the sensor are sent so that they meet their places in the pupil, however the lens images that.
//!
//! To first order it is the pupil's ideal image. What a real lens adds is a smooth function of the image point p and the
//! pupil point u, a polynomial of both:
//!
//! ```text
//! a(p, u) = ideal + Σ c p_xⁱ p_yʲ u_xᵏ u_yˡ        i + j + k + l ≤ 5
//! ```
//!
//! fitted to rays that Newton's method has aimed. Nothing is assumed of its symmetry, for surfaces may be off the axis.

use crate::least_squares::least_squares;

/// Highest power of the polynomial.
const ORDER: usize = 5;

/// Powers of u: pairs with a sum up to [`ORDER`].
const PUPIL_TERMS: usize = (ORDER + 1) * (ORDER + 2) / 2;

/// What the lens adds to the ideal place.
#[derive(Debug, Clone)]
pub(crate) struct Aim {
    /// Image radius that counts as 1, mm.
    unit_mm: f64,
    /// The powers of every term, and its coefficients for x and y, mm.
    terms: Vec<Term>,
}

#[derive(Debug, Clone, Copy)]
struct Term {
    image: [usize; 2],
    /// Index of its powers of u.
    pupil: usize,
    factors_mm: [f64; 2],
}

/// The polynomial of u at one image point: coefficients for x and y.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AimAt {
    coefficients_mm: [[f64; 2]; PUPIL_TERMS],
}

/// A place, and its changes with the pupil point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Aimed {
    pub(crate) place_mm: [f64; 2],
    pub(crate) slopes_mm: [[f64; 2]; 2],
}

/// A ray that has been aimed.
pub(crate) struct Sample {
    pub(crate) image_mm: [f64; 2],
    pub(crate) pupil: [f64; 2],
    /// What the lens adds there, mm.
    pub(crate) added_mm: [f64; 2],
}

impl Aim {
    /// Nothing.
    pub(crate) const IDEAL: Self = Self { unit_mm: 1.0, terms: Vec::new() };

    /// The polynomial that comes nearest to the samples; nothing if they are too few.
    pub(crate) fn through(samples: &[Sample], unit_mm: f64) -> Self {
        let terms: Vec<Term> = terms().collect();
        if samples.len() < 2 * terms.len() {
            return Self::IDEAL;
        }
        let value = |term: &Term, sample: &Sample| {
            let image = sample.image_mm.map(|mm| mm / unit_mm);
            product(image, term.image) * product(sample.pupil, pupil_powers(term.pupil))
        };
        let columns: Vec<Vec<f64>> =
            terms.iter().map(|term| samples.iter().map(|sample| value(term, sample)).collect()).collect();
        let [x, y] = [0, 1].map(|k| samples.iter().map(|sample| sample.added_mm[k]).collect());
        let factors_mm = least_squares(columns, [x, y]);
        let with = |(term, factors_mm): (Term, [f64; 2])| Term { factors_mm, ..term };
        Self { unit_mm, terms: terms.into_iter().zip(factors_mm).map(with).collect() }
    }

    /// Whether the lens adds nothing.
    pub(crate) fn is_ideal(&self) -> bool {
        self.terms.is_empty()
    }

    /// The polynomial at an image point.
    pub(crate) fn at(&self, image_mm: [f64; 2]) -> AimAt {
        let powers = image_mm.map(|mm| powers(mm / self.unit_mm));
        let mut coefficients_mm = [[0.0; 2]; PUPIL_TERMS];
        for Term { image: [i, j], pupil, factors_mm } in &self.terms {
            let share = powers[0][*i] * powers[1][*j];
            coefficients_mm[*pupil][0] += share * factors_mm[0];
            coefficients_mm[*pupil][1] += share * factors_mm[1];
        }
        AimAt { coefficients_mm }
    }
}

impl AimAt {
    /// What the lens adds at a pupil point, by Horner's scheme in both directions.
    #[inline(always)]
    pub(crate) fn at(&self, [u, v]: [f64; 2]) -> Aimed {
        let (mut place_mm, mut by_u, mut by_v) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let mut end = PUPIL_TERMS;
        for power in (0..=ORDER).rev() {
            let row = &self.coefficients_mm[end - (ORDER + 1 - power)..end];
            end -= row.len();
            for axis in 0..2 {
                let (mut sum, mut slope) = (0.0_f64, 0.0_f64);
                for factors in row.iter().rev() {
                    slope = slope.mul_add(v, sum);
                    sum = sum.mul_add(v, factors[axis]);
                }
                by_u[axis] = f64::mul_add(by_u[axis], u, place_mm[axis]);
                by_v[axis] = f64::mul_add(by_v[axis], u, slope);
                place_mm[axis] = f64::mul_add(place_mm[axis], u, sum);
            }
        }
        Aimed { place_mm, slopes_mm: [[by_u[0], by_v[0]], [by_u[1], by_v[1]]] }
    }
}

/// Powers from 0.
fn powers(x: f64) -> [f64; ORDER + 1] {
    let mut powers = [1.0; ORDER + 1];
    for k in 1..=ORDER {
        powers[k] = powers[k - 1] * x;
    }
    powers
}

fn product(at: [f64; 2], exponents: [usize; 2]) -> f64 {
    powers(at[0])[exponents[0]] * powers(at[1])[exponents[1]]
}

/// All terms, without their coefficients.
fn terms() -> impl Iterator<Item = Term> {
    (0..PUPIL_TERMS).flat_map(|pupil| {
        let [k, l] = pupil_powers(pupil);
        let left = ORDER - k - l;
        (0..=left).flat_map(move |i| (0..=left - i).map(move |j| Term { image: [i, j], pupil, factors_mm: [0.0; 2] }))
    })
}

/// The powers of u in the order of [`AimAt`].
fn pupil_powers(index: usize) -> [usize; 2] {
    let pairs = (0..=ORDER).flat_map(|k| (0..=ORDER - k).map(move |l| [k, l]));
    pairs.into_iter().nth(index).unwrap_or([0, 0])
}
