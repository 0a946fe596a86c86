//! Snell's law for vectors.

pub(crate) type Vector = [f64; 3];

#[inline(always)]
pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Direction behind a surface, as long as the one before it; NaN for total internal reflection.
///
/// ```text
/// d' = η d + (√(η² (d·n)² + (1 − η²) D² N²) − η d·n) n/N²,    η = n₁/n₂
/// ```
///
/// with a direction d of length D and a normal n of length N that faces the way the light goes; with the other sense
/// the root changes its sign. For D = N = 1 it is the form of [Welford, Aberrations of Optical Systems, sec. 4.4]; any
/// lengths will do, which saves the square roots that would make them 1.
#[inline(always)]
pub(crate) fn refract(direction: Vector, normal: Vector, index_ratio: f64) -> Vector {
    let along = index_ratio * dot(direction, normal);
    let normal_squared = dot(normal, normal);
    let square = along * along + (1.0 - index_ratio * index_ratio) * dot(direction, direction) * normal_squared;
    let bend = (square.sqrt().copysign(along) - along) / normal_squared;
    [0, 1, 2].map(|k| index_ratio * direction[k] + bend * normal[k])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn unit(v: Vector) -> Vector {
        v.map(|component| component / dot(v, v).sqrt())
    }

    fn cross(a: Vector, b: Vector) -> Vector {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    proptest! {
        #[test]
        fn n_sin_theta_is_kept_in_the_plane_of_incidence(
            d in prop::array::uniform3(-1.0..1.0_f64), n in prop::array::uniform3(-1.0..1.0_f64), ratio in 0.5..2.0_f64,
        ) {
            prop_assume!(dot(d, d) > 1e-3 && dot(n, n) > 1e-3);
            let (d, n) = (unit(d), unit(n));
            prop_assume!(dot(d, n).abs() > 1e-3);
            let (before, sine) = (cross(d, n), dot(cross(d, n), cross(d, n)).sqrt());
            let out = refract(d, n, ratio);
            if out[2].is_nan() {
                prop_assert!(ratio * sine > 1.0 - 1e-12);
                return Ok(());
            }
            prop_assert!((dot(out, out) - 1.0).abs() < 1e-12);
            // n₁ d×n = n₂ d'×n holds for the vectors, so for the sines and for the plane.
            for (after, before) in cross(out, n).into_iter().zip(before) {
                prop_assert!((after - ratio * before).abs() < 1e-12);
            }
            prop_assert!(dot(out, n) * dot(d, n) > 0.0);
            let back = refract(out.map(|c| -c), n, 1.0 / ratio);
            for (back, d) in back.into_iter().zip(d) {
                prop_assert!((back + d).abs() < 1e-9);
            }
            let long = refract(d.map(|c| 3.0 * c), n.map(|c| -0.2 * c), ratio);
            for (long, out) in long.into_iter().zip(out) {
                prop_assert!((long - 3.0 * out).abs() < 1e-9);
            }
        }
    }
}
