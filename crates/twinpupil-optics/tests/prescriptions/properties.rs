//! What must hold of rays through any lens.

use proptest::prelude::*;
use twinpupil_instrument::{Across, Annulus, Prescription, PrescriptionSpec, Shape, SurfaceSpec};
use twinpupil_optics::{Fate, Field, Mask, Ray, Rays, Train};

/// A surface of any kind that can be refracted at, not too strongly curved for a ray within 6 mm of the axis.
fn shape() -> impl Strategy<Value = Shape> {
    let radius = prop_oneof![25.0..500.0_f64, -500.0..-25.0_f64];
    let even = (radius.clone(), -2.0..1.0_f64, prop::collection::vec(-1e-6..1e-6_f64, 1..5)).prop_map(
        |(radius_mm, conic_constant, coefficients)| Shape::EvenAsphere {
            radius_mm: Some(radius_mm),
            conic_constant,
            coefficients: (2..).zip(coefficients).map(|(power, a)| a * 30_f64.powi(4 - 2 * power)).collect(),
        },
    );
    let odd = (radius.clone(), -2.0..1.0_f64, -1e-4..1e-4_f64).prop_map(|(radius_mm, conic_constant, cubic)| {
        Shape::OddAsphere { radius_mm: Some(radius_mm), conic_constant, coefficients: vec![0.0, 0.0, cubic] }
    });
    prop_oneof![
        Just(Shape::Plane),
        radius.clone().prop_map(|radius_mm| Shape::Sphere { radius_mm }),
        (radius.clone(), -3.0..1.0_f64)
            .prop_map(|(radius_mm, conic_constant)| Shape::Conic { radius_mm, conic_constant }),
        (radius, any::<bool>()).prop_map(|(radius_mm, is_x)| Shape::Cylinder {
            radius_mm,
            curved: if is_x { Across::X } else { Across::Y },
        }),
        even,
        odd,
    ]
}

fn glass() -> impl Strategy<Value = String> {
    prop::sample::select(vec!["N-BK7", "N-SF11", "F2", "air", "PMMA"]).prop_map(str::to_owned)
}

/// A lens of a few surfaces, some of them askew.
fn lens() -> impl Strategy<Value = Prescription> {
    let surface = (shape(), 0.5..12.0_f64, glass(), -0.3..0.3_f64, -4.0..4.0_f64, any::<bool>()).prop_map(
        |(shape, gap_mm, medium, decentre_mm, tilt_deg, askew)| SurfaceSpec {
            shape,
            gap_mm,
            medium,
            decentre_mm: if askew { [decentre_mm, -0.5 * decentre_mm] } else { [0.0; 2] },
            tilt_deg: if askew { [tilt_deg, -tilt_deg, 3.0 * tilt_deg] } else { [0.0; 3] },
            ..SurfaceSpec::default()
        },
    );
    prop::collection::vec(surface, 1..7).prop_map(made)
}

fn made(surfaces: Vec<SurfaceSpec>) -> Prescription {
    Prescription::new(PrescriptionSpec { surfaces, ..PrescriptionSpec::default() }).expect("a legal lens")
}

fn train(lens: &Prescription) -> Train {
    Train::new(lens, &[], 550.0).expect("glasses that ship")
}

fn ray() -> impl Strategy<Value = Ray> {
    (prop::array::uniform2(-5.0..5.0_f64), prop::array::uniform2(-0.2..0.2_f64), -30.0..-3.0_f64)
        .prop_map(|([x, y], [gx, gy], z)| Ray::new([x + gx * z, y + gy * z, z], [gx, gy, 1.0]))
}

proptest! {
    #[test]
    fn light_goes_back_the_way_it_came(lens in lens(), ray in ray()) {
        let there = train(&lens);
        let (met, fate) = there.path(&ray);
        prop_assume!(fate == Fate::Arrived);
        let image = met[met.len() - 1];
        let start = Ray { direction: image.direction.map(|c| -c), path_mm: 0.0, ..image };
        let (back, fate) = there.reversed().path(&start);
        prop_assert_eq!(fate, Fate::Arrived);
        // At each surface, and so at the first.
        for (back, met) in back.iter().rev().zip(&met) {
            for k in 0..3 {
                prop_assert!((back.position_mm[k] - met.position_mm[k]).abs() < 1e-9, "{:?} {:?}", back, met);
            }
        }
        let home = back[back.len() - 1];
        let first_mm = met[0].path_mm;
        prop_assert!((home.path_mm - (image.path_mm - first_mm)).abs() < 1e-9);
    }

    #[test]
    fn places_lie_on_the_surfaces_that_are_drawn(lens in lens(), ray in ray()) {
        let upright = lens.surfaces.iter().map(|surface| SurfaceSpec {
            decentre_mm: [0.0; 2],
            tilt_deg: [0.0; 3],
            ..surface.clone()
        });
        let train = train(&made(upright.collect()));
        let flat = Ray::new([0.0, ray.position_mm[1], ray.position_mm[2]], [0.0, ray.direction[1], ray.direction[2]]);
        let (met, _) = train.path(&flat);
        for (k, place) in train.in_lens_axes(&met).into_iter().enumerate() {
            let height_mm = met[k].position_mm[1].abs();
            let section = train.section(k, height_mm, 2);
            let is_on = section.iter().any(|point| (0..3).all(|c| (point[c] - place[c]).abs() < 1e-9));
            prop_assert!(is_on, "{section:?} {place:?}");
        }
    }

    #[test]
    fn directions_stay_of_unit_length(lens in lens(), ray in ray()) {
        for met in train(&lens).path(&ray).0 {
            let square: f64 = met.direction.iter().map(|c| c * c).sum();
            prop_assert!((square - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn n_sin_theta_is_kept_in_the_plane_of_incidence(shape in shape(), ray in ray()) {
        let lens = made(vec![SurfaceSpec { shape: shape.clone(), medium: "N-BK7".to_owned(), ..SurfaceSpec::default() }]);
        let (met, fate) = train(&lens).path(&ray);
        prop_assume!(fate == Fate::Arrived);
        let index = twinpupil_instrument::Glass::built_in("N-BK7", "").unwrap().index(550.0).unwrap();
        // A normal by finite differences of the shape that the rays themselves see: a neighbour's place.
        let normal = normal(&shape, met[0].position_mm);
        let (before, behind) = (cross(ray.direction, normal), cross(met[0].direction, normal));
        for k in 0..3 {
            prop_assert!((before[k] - index * behind[k]).abs() < 1e-12, "{before:?} {behind:?}");
        }
    }

    #[test]
    fn a_lens_turned_about_its_axis_is_the_same(
        shapes in prop::collection::vec((20.0..200.0_f64, -2.0..0.5_f64), 1..5), ray in ray(), turn_rad in 0.0..6.3_f64,
    ) {
        let surfaces = shapes.iter().enumerate().map(|(k, (radius_mm, conic_constant))| SurfaceSpec {
            shape: Shape::Conic { radius_mm: *radius_mm, conic_constant: *conic_constant },
            gap_mm: 3.0,
            medium: if k % 2 == 0 { "F2".to_owned() } else { "air".to_owned() },
            ..SurfaceSpec::default()
        });
        let train = train(&made(surfaces.collect()));
        let (sin, cos) = turn_rad.sin_cos();
        let turned = |[x, y, z]: [f64; 3]| [cos * x - sin * y, sin * x + cos * y, z];
        let aside = Ray { position_mm: turned(ray.position_mm), direction: turned(ray.direction), ..ray };
        let ((met, fate), (met_aside, fate_aside)) = (train.path(&ray), train.path(&aside));
        prop_assert_eq!(fate, fate_aside);
        for (met, aside) in met.iter().zip(&met_aside) {
            for (found, expected) in aside.position_mm.into_iter().zip(turned(met.position_mm)) {
                prop_assert!((found - expected).abs() < 1e-11);
            }
            prop_assert!((aside.path_mm - met.path_mm).abs() < 1e-11);
        }
    }

    #[test]
    fn no_ray_knows_its_neighbours(lens in lens(), rays in prop::collection::vec(ray(), 1..150)) {
        let train = train(&lens);
        let mut together: Rays = rays.iter().copied().collect();
        let ledger = train.trace(&mut together);
        prop_assert_eq!((ledger.launched, ledger.total()), (rays.len() as u64, rays.len() as u64));
        let mut parallel: Rays = rays.iter().copied().collect();
        prop_assert_eq!(train.trace_parallel(&mut parallel), ledger);
        for (k, ray) in rays.iter().enumerate() {
            let (met, fate) = train.path(ray);
            prop_assert_eq!(together.fate(k), fate);
            prop_assert_eq!(parallel.fate(k), fate);
            if fate == Fate::Arrived {
                prop_assert_eq!(together.ray(k), met[met.len() - 1]);
                prop_assert_eq!(parallel.ray(k), met[met.len() - 1]);
            }
        }
    }

    /// Fermat: beside the true way through a surface, the path from point to point grows only in second order.
    #[test]
    fn the_path_is_stationary(shape in shape(), ray in ray(), aside in prop::array::uniform2(-1.0..1.0_f64)) {
        let image = SurfaceSpec { gap_mm: 20.0, medium: "N-SF11".to_owned(), shape: shape.clone(), ..SurfaceSpec::default() };
        let (met, fate) = train(&made(vec![image])).path(&ray);
        prop_assume!(fate == Fate::Arrived);
        let index = twinpupil_instrument::Glass::built_in("N-SF11", "").unwrap().index(550.0).unwrap();
        let [x, y, _] = met[0].position_mm;
        let end = [met[1].position_mm[0], met[1].position_mm[1], met[1].position_mm[2] + 20.0];
        let path = |x: f64, y: f64| {
            let at = [x, y, depth(&shape, x, y)];
            distance(ray.position_mm, at) + index * distance(at, end)
        };
        let step = 1e-4;
        let slope = (path(x + step * aside[0], y + step * aside[1]) - path(x - step * aside[0], y - step * aside[1]))
            / (2.0 * step);
        prop_assert!(slope.abs() < 1e-8, "{slope}");
        prop_assert!((path(x, y) - met[1].path_mm).abs() < 1e-11);
    }

    #[test]
    fn aimed_rays_meet_their_places_in_the_stop(
        slope in prop::array::uniform2(-0.3..0.3_f64), places in prop::collection::vec(prop::array::uniform2(-1.0..1.0_f64), 1..40),
        distance_mm in prop::option::of(50.0..2000.0_f64),
    ) {
        const STOP: usize = 5;
        let lens = Prescription::from_toml(include_str!("../lenses/double-gauss.toml")).unwrap();
        let train = train(&lens);
        let field = match distance_mm {
            None => Field::Infinite { slope },
            Some(mm) => Field::Point { position_mm: [-slope[0] * mm, -slope[1] * mm, -mm] },
        };
        let places_mm: Vec<[f64; 2]> = places.iter().map(|place| place.map(|c| 4.0 * c)).collect();
        for (ray, place_mm) in train.aim(STOP, field, &places_mm, 4.0).into_iter().zip(&places_mm) {
            let ray = ray.expect("a double Gauss sees 16 degrees");
            let (met, _) = train.path(&ray);
            for (found_mm, place_mm) in met[STOP].position_mm.into_iter().zip(place_mm) {
                prop_assert!((found_mm - place_mm).abs() < 1e-10);
            }
            if let Field::Point { position_mm } = field {
                prop_assert_eq!(ray.position_mm, position_mm);
            }
        }
    }
}

/// The depth of a surface, by its equation.
fn depth(shape: &Shape, x: f64, y: f64) -> f64 {
    let conic = |radius_mm: f64, k: f64, square: f64| {
        let c = 1.0 / radius_mm;
        c * square / (1.0 + (1.0 - (1.0 + k) * c * c * square).sqrt())
    };
    let square = x * x + y * y;
    match shape {
        Shape::Sphere { radius_mm } => conic(*radius_mm, 0.0, square),
        Shape::Conic { radius_mm, conic_constant } => conic(*radius_mm, *conic_constant, square),
        Shape::Cylinder { radius_mm, curved: Across::X } => conic(*radius_mm, 0.0, x * x),
        Shape::Cylinder { radius_mm, curved: Across::Y } => conic(*radius_mm, 0.0, y * y),
        Shape::EvenAsphere { radius_mm, conic_constant, coefficients } => {
            let powers = (1..).zip(coefficients).map(|(power, a)| a * square.powi(power));
            conic(radius_mm.expect("curved"), *conic_constant, square) + powers.sum::<f64>()
        }
        Shape::OddAsphere { radius_mm, conic_constant, coefficients } => {
            let powers = (1..).zip(coefficients).map(|(power, a)| a * square.sqrt().powi(power));
            conic(radius_mm.expect("curved"), *conic_constant, square) + powers.sum::<f64>()
        }
        _ => 0.0,
    }
}

/// A unit normal, by differences of four steps each way: their error is that of rounding.
fn normal(shape: &Shape, [x, y, _]: [f64; 3]) -> [f64; 3] {
    let slope = |along: [f64; 2]| {
        let at = |steps: f64| depth(shape, x + 0.01 * steps * along[0], y + 0.01 * steps * along[1]);
        let odd = |steps: f64| at(steps) - at(-steps);
        (4.0 / 5.0 * odd(1.0) - odd(2.0) / 5.0 + 4.0 / 105.0 * odd(3.0) - odd(4.0) / 280.0) / 0.01
    };
    let (gx, gy) = (slope([1.0, 0.0]), slope([0.0, 1.0]));
    let length = (1.0 + gx * gx + gy * gy).sqrt();
    [gx / length, gy / length, -1.0 / length]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn masks_count_what_they_block() {
    let lens = Prescription::from_toml(include_str!("../lenses/double-gauss.toml")).expect("a lens");
    let ring = |inner_mm, outer_mm| Annulus { inner_mm, outer_mm };
    let mask = |surface, behind_mm, rings| Mask { surface, behind_mm, centre_mm: [0.0; 2], rings };
    let train = train(&lens)
        .with_mask(0, &mask(5, 2.0, vec![ring(0.0, 1.0), ring(2.0, 3.0)]))
        .with_mask(1, &mask(0, -10.0, vec![ring(0.0, 8.0)]));
    let mut rays: Rays = (0..1000).map(|k| Ray::new([0.01 * f64::from(k), 0.0, -20.0], [0.0, 0.0, 1.0])).collect();
    let ledger = train.trace(&mut rays);
    assert_eq!((ledger.launched, ledger.total()), (1000, 1000));
    // The one in front takes what starts beyond 8 mm; the ray heights at the stop are 0.63 of those in front.
    assert_eq!(ledger.blocked[1], 200);
    for (k, (_, fate)) in rays.iter().enumerate() {
        let height_mm = 0.01 * k as f64;
        let at_stop_mm = 0.6341 * height_mm - 2.0 * 0.1161 / 25.0 * height_mm;
        let passes = at_stop_mm < 0.99 || (2.01..2.98).contains(&at_stop_mm);
        let is_blocked = (1.01..1.99).contains(&at_stop_mm) || at_stop_mm > 3.02;
        let expected = if height_mm >= 8.0 { Fate::Blocked { mask: 1 } } else { Fate::Blocked { mask: 0 } };
        assert!(!passes || fate == Fate::Arrived, "{height_mm} {fate:?}");
        assert!(!is_blocked || fate == expected, "{height_mm} {fate:?}");
    }
}

#[test]
fn a_thin_lens_images_a_point_into_a_point() {
    let surface =
        SurfaceSpec { shape: Shape::ThinLens { focal_length_mm: 50.0 }, gap_mm: 75.0, ..SurfaceSpec::default() };
    let train = train(&made(vec![surface]));
    for (slope_x, slope_y) in [(0.0, 0.1), (-0.05, 0.02), (0.2, 0.0)] {
        // 1/150 + 1/75 = 1/50.
        let (met, fate) = train.path(&Ray::new([4.0, 2.0, -150.0], [slope_x, slope_y, 1.0]));
        assert_eq!(fate, Fate::Arrived);
        assert!((met[1].position_mm[0] + 2.0).abs() < 1e-12 && (met[1].position_mm[1] + 1.0).abs() < 1e-12);
    }
    // Along the axis it is in phase at the focal point.
    let focus = Train::new(&made(vec![SurfaceSpec { gap_mm: 50.0, ..train_surface() }]), &[], 550.0).expect("a lens");
    for height_mm in [0.0, 1.0, 10.0] {
        let (met, _) = focus.path(&Ray::new([height_mm, 0.0, 0.0], [0.0, 0.0, 1.0]));
        assert!((met[1].path_mm - 50.0).abs() < 1e-12);
    }
}

fn train_surface() -> SurfaceSpec {
    SurfaceSpec { shape: Shape::ThinLens { focal_length_mm: 50.0 }, ..SurfaceSpec::default() }
}

#[test]
fn a_fresnel_surface_bends_as_its_profile_does() {
    // Parallel light into the flat face of a lens whose plane of facets has the slopes of a hyperboloid, k = −n², meets in
    // one point but for the depth that the plane lacks: to third order at a distance f of the plane.
    let index = twinpupil_instrument::Glass::built_in("PMMA", "").expect("PMMA").index(550.0).expect("transparent");
    let radius_mm = -50.0 * (index - 1.0);
    let lens = made(vec![
        SurfaceSpec { gap_mm: 2.0, medium: "PMMA".to_owned(), ..SurfaceSpec::default() },
        SurfaceSpec {
            shape: Shape::Fresnel { radius_mm, conic_constant: -index * index, coefficients: Vec::new() },
            gap_mm: 50.0,
            ..SurfaceSpec::default()
        },
    ]);
    let focal_length_mm = train(&lens).first_order(None).focal_length_mm;
    assert!((focal_length_mm - 50.0).abs() < 1e-9, "{focal_length_mm}");
    let (met, _) = train(&lens).path(&Ray::new([0.01, 0.0, 0.0], [0.0, 0.0, 1.0]));
    assert!(met[2].position_mm[0].abs() < 1e-8);
    // The angle behind it is that of a prism as steep as the profile: n sin α = sin(α + δ).
    let height_mm = 10.0_f64;
    let c = 1.0 / radius_mm;
    let slope = c * height_mm / (1.0 - (1.0 - index * index) * c * c * height_mm * height_mm).sqrt();
    let tilt_rad = slope.abs().atan();
    let bent_rad = (index * tilt_rad.sin()).asin() - tilt_rad;
    let (met, _) = train(&lens).path(&Ray::new([height_mm, 0.0, 0.0], [0.0, 0.0, 1.0]));
    assert!((met[1].direction[0] + bent_rad.sin()).abs() < 1e-12);
    assert!((met[1].position_mm[0] - height_mm).abs() < 1e-12 && met[1].position_mm[2].abs() < 1e-12);
}
