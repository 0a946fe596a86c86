//! Snell's law for vectors.

pub(crate) type Vector = [f64; 3];

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn unit(v: Vector) -> Vector {
    let length = dot(v, v).sqrt();
    v.map(|component| component / length)
}

/// Direction behind a surface, or `None` for total internal reflection.
///
/// ```text
/// d' = η d + (η cos θ − √(1 − η² (1 − cos² θ))) n,    η = n₁/n₂
/// ```
///
/// with unit direction d and unit normal n, of either sense  [Welford, Aberrations of Optical Systems, sec. 4.4].
pub(crate) fn refract(direction: Vector, normal: Vector, index_ratio: f64) -> Option<Vector> {
    let along = dot(direction, normal);
    // Below, the normal faces the incoming ray: cos θ = −d·n > 0.
    let (cos, sense) = (along.abs(), -along.signum());
    let square = 1.0 - index_ratio * index_ratio * (1.0 - cos * cos);
    if square < 0.0 {
        return None;
    }
    let bend = sense * (index_ratio * cos - square.sqrt());
    Some([0, 1, 2].map(|k| index_ratio * direction[k] + bend * normal[k]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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
            match refract(d, n, ratio) {
                Some(out) => {
                    prop_assert!((dot(out, out) - 1.0).abs() < 1e-12);
                    // n₁ d×n = n₂ d'×n holds for the vectors, so for the sines and for the plane.
                    for (after, before) in cross(out, n).into_iter().zip(before) {
                        prop_assert!((after - ratio * before).abs() < 1e-12);
                    }
                    prop_assert!(dot(out, n) * dot(d, n) > 0.0);
                    let back = refract(out.map(|c| -c), n, 1.0 / ratio).expect("light goes back the way it came");
                    for (back, d) in back.into_iter().zip(d) {
                        prop_assert!((back + d).abs() < 1e-9);
                    }
                }
                None => prop_assert!(ratio * sine > 1.0 - 1e-12),
            }
        }
    }
}
