//! Numbers that other programs have printed. None is ever regenerated.

use twinpupil_instrument::{Catalogue, Prescription, PrescriptionSpec, Shape, SurfaceSpec};
use twinpupil_optics::{Fate, Field, Imager, Ray, SeidelSums, Train};

/// OpticSim.jl's tolerance against its source, relative.
const OPTIC_SIM: f64 = 1e-11;

/// The AGF coefficients of OpticSim.jl's glasses, `test/TestData/TestData.jl`: what SCHOTT's catalogue has.
const N_BK7: &str =
    "NM N-BK7 2\nCD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653\nLD 0.3 2.5\n";

fn lens(surfaces: Vec<SurfaceSpec>) -> Prescription {
    Prescription::new(PrescriptionSpec { surfaces, ..PrescriptionSpec::default() }).expect("a legal lens")
}

fn sphere(radius_mm: f64) -> Shape {
    if radius_mm.is_finite() { Shape::Sphere { radius_mm } } else { Shape::Plane }
}

/// A lens 10 mm thick, 57.8 mm before the image, in front of which rays start 1 mm away.
fn singlet(front: Shape, back: Shape) -> Train {
    let surface = |shape, gap_mm, medium: &str| SurfaceSpec {
        shape,
        gap_mm,
        medium: medium.to_owned(),
        semi_diameter_mm: Some(9.0),
        ..SurfaceSpec::default()
    };
    let lens = lens(vec![surface(front, 10.0, "N-BK7"), surface(back, 57.8, "air")]);
    let catalogue = Catalogue::from_agf(N_BK7.as_bytes()).expect("a catalogue");
    Train::new(&lens, &[&catalogue], 550.0).expect("a lens in a known glass")
}

/// The rays of `test/testsets/Comparison.jl`. There z runs against the light; here along it.
fn rays() -> [Ray; 5] {
    [
        ([0.0, 0.0], [0.0, 0.0, 1.0]),
        ([2.0, 2.0], [0.0, 0.0, 1.0]),
        ([5.0, 5.0], [0.0, 0.0, 1.0]),
        ([0.0, -5.0], [0.0, 0.08715574274765818, 0.9961946980917454]),
        ([-5.0, -5.0], [0.08715574274765818, -0.01738599476176408, 0.9960429728140486]),
    ]
    .map(|([x, y], direction)| Ray::new([x, y, -1.0], direction))
}

/// x, y and path length in the image. Without them the ray ends at the second surface, from within.
fn compare(train: &Train, expected: [Option<[f64; 3]>; 5]) {
    for (k, (ray, expected)) in rays().iter().zip(expected).enumerate() {
        let (met, fate) = train.path(ray);
        let Some(expected) = expected else {
            assert_eq!(fate, Fate::TotalInternalReflection { surface: 1 }, "ray {k}");
            continue;
        };
        assert_eq!(fate, Fate::Arrived, "ray {k}");
        let image = met.last().expect("an image");
        let found = [image.position_mm[0], image.position_mm[1], image.path_mm];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() <= OPTIC_SIM * expected.abs().max(1.0), "ray {k}: {found} {expected}");
        }
    }
}

#[test]
fn spherical_lenses_are_optic_sims() {
    // OpticSim.jl e10f6c8, `test/testsets/Comparison.jl`, "Refraction", from another program.
    let infinite = f64::INFINITY;
    let on_axis = [0.0, 0.0, 73.9852238762079];
    for (front_mm, back_mm, expected) in [
        (
            infinite,
            infinite,
            [
                on_axis,
                [2.0, 2.0, 73.9852238762079],
                [5.0, 5.0, 73.9852238762079],
                [0.0, 0.7192321011619232, 74.234903851062],
                [0.7200535362928893, -6.141047252697188, 74.2448952769065],
            ],
        ),
        (
            -41.0,
            infinite,
            [
                on_axis,
                [3.633723967570758, 3.633723967570758, 74.0772722321026],
                [9.153654757938119, 9.153654757938119, 74.5695599263722],
                [0.0, -3.401152468994745, 74.1609946836496],
                [-3.457199906282556, -10.32836827735406, 74.5393056652617],
            ],
        ),
        (
            -41.0,
            41.0,
            [
                on_axis,
                [5.235579681684886, 5.235579681684886, 74.2624909340242],
                [13.42351905137007, 13.42351905137007, 75.8131310483928],
                [0.0, -6.904467939352202, 74.3286918571586],
                [-7.089764102262856, -14.61837033417989, 75.4286280772859],
            ],
        ),
        (
            60.0,
            infinite,
            [
                on_axis,
                [0.886789151936829, 0.886789151936829, 73.9698941263224],
                [2.212067233969831, 2.212067233969831, 73.8895474037682],
                [0.0, 3.489759589087602, 74.4310036252394],
                [3.491858246934857, -3.331802834115089, 74.344370622227],
            ],
        ),
        (
            60.0,
            -60.0,
            [
                on_axis,
                [-0.06191521590711035, -0.06191521590711035, 73.987421926598],
                [-0.2491105067897657, -0.2491105067897657, 74.0110871422915],
                [0.0, 5.639876913179362, 74.6758349889372],
                [5.705452331562673, -0.7679713587894854, 74.6175821043825],
            ],
        ),
    ] {
        compare(&singlet(sphere(front_mm), sphere(back_mm)), expected.map(Some));
    }
}

#[test]
fn a_conic_is_optic_sims() {
    // "Complex Lenses", `conicsystemA`: the conic comes first and is hollow.
    let conic = Shape::Conic { radius_mm: -15.0, conic_constant: -5.0 };
    compare(
        &singlet(Shape::Plane, conic),
        [
            [0.0, 0.0, 73.9852238762079],
            [-1.80279270185495, -1.80279270185495, 74.1000975813922],
            [-2.8229241607807, -2.8229241607807, 74.282094499601],
            [0.0, 9.01421545841289, 75.2211078071893],
            [8.13946939328266, 2.23006981338816, 75.1025133542546],
        ]
        .map(Some),
    );
}

#[test]
fn aspheres_are_optic_sims() {
    // "Complex Lenses": `asphericsystem`, `evenasphericsystem`, `oddasphericsystem`. Rays that OpticSim.jl reflects within
    // the glass end there.
    let on_axis = Some([0.0, 0.0, 73.9852238762079]);
    let flat = Shape::EvenAsphere { radius_mm: None, conic_constant: 0.0, coefficients: vec![0.0, -0.001] };
    compare(
        &singlet(Shape::Plane, flat),
        [
            on_axis,
            Some([0.0735282671574837, 0.0735282671574837, 74.0161411455851]),
            None,
            Some([0.0, 11.9748998399885, 76.0760286320348]),
            None,
        ],
    );
    let even = Shape::EvenAsphere { radius_mm: Some(-50.0), conic_constant: 0.0, coefficients: vec![0.0, -0.001] };
    compare(
        &singlet(Shape::Plane, even),
        [
            on_axis,
            Some([-1.1537225076569997, -1.153722507656998, 74.08191763367685]),
            None,
            Some([0.0, 15.887441944041871, 77.14042689028618]),
            None,
        ],
    );
    let coefficients = vec![0.0, 0.0, 0.001, 0.0, -0.0001];
    let odd = Shape::OddAsphere { radius_mm: Some(-50.0), conic_constant: 0.0, coefficients };
    compare(
        &singlet(Shape::Plane, odd),
        [
            on_axis,
            Some([0.6256581890889898, 0.6256581890889894, 73.97868203031574]),
            None,
            Some([0.0, 7.485281534548376, 75.07125754375438]),
            None,
        ],
    );
}

#[test]
fn a_mirror_behind_glass_is_optic_sims() {
    // "Reflection", `planoconcaverefl`: through the plane, back from the sphere, out through the plane, image 47.8 in front.
    let bk7 = Catalogue::from_agf(N_BK7.as_bytes()).expect("a catalogue");
    let surface = |shape, gap_mm, medium: &str, mirror| SurfaceSpec {
        shape,
        gap_mm,
        medium: medium.to_owned(),
        mirror,
        ..SurfaceSpec::default()
    };
    let lens = lens(vec![
        surface(Shape::Plane, 10.0, "N-BK7", false),
        surface(sphere(-41.0), -10.0, "air", true),
        surface(Shape::Plane, -47.8, "air", false),
    ]);
    compare(
        &Train::new(&lens, &[&bk7], 550.0).expect("a lens"),
        [
            [0.0, 0.0, 79.1704477524159],
            [-6.19723306038804, -6.19723306038804, 80.0979229417755],
            [-17.7546255175372, -17.7546255175372, 86.2063094599075],
            [0.0, 19.5349836031196, 83.5364646376395],
            [21.2477706541112, 17.3463704045055, 87.4033932087711],
        ]
        .map(Some),
    );
}

fn near(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found} {expected}");
}

fn from_file(text: &str, wavelength_nm: f64) -> Train {
    Train::new(&Prescription::from_toml(text).expect("a lens"), &[], wavelength_nm).expect("glasses that ship")
}

#[test]
fn a_cooke_triplet_has_the_focal_length_that_optic_studio_has() {
    // Optiland PR #709 and issue #710 (OpticStudio 2025 R2.02 agrees): EFL at 550 nm with Hikari's SK16. The pupils are those
    // of optiland 0.6.3.
    let lens = from_file(include_str!("../lenses/cooke-triplet.toml"), 550.0).first_order(Some(3));
    let (entrance, exit) = (lens.entrance_pupil.expect("a stop"), lens.exit_pupil.expect("a stop"));
    near(lens.focal_length_mm, 49.99978307143194, 1e-11, "EFL");
    near(entrance.position_mm, 11.512158673746795, 1e-11, "EPL");
    near(exit.position_mm - 42.20778, -50.961347703805274, 1e-11, "XPL");
    near(10.0 / entrance.magnification * exit.magnification, 10.233729452318345, 1e-11, "XPD");
}

#[test]
fn a_singlet_is_optic_studios() {
    // Optiland issue #710, `SingletStopSurf2`: OpticStudio 2025 R2.02, LAC9 of Hoya's catalogue, 587.5618 nm; BFP is Optiland's.
    let surface = |radius_mm, gap_mm, medium: &str, stop| SurfaceSpec {
        shape: sphere(radius_mm),
        gap_mm,
        medium: medium.to_owned(),
        stop,
        ..SurfaceSpec::default()
    };
    let lens = lens(vec![surface(63.73364157, 10.0, "LAC9", false), surface(653.2939232, 92.7383463, "air", true)]);
    let lens = Train::new(&lens, &[], 587.5618).expect("a lens").first_order(Some(1));
    let (entrance, exit) = (lens.entrance_pupil.expect("a stop"), lens.exit_pupil.expect("a stop"));
    near(lens.focal_length_mm, 101.501826, 5e-7, "EFL");
    near(entrance.position_mm, 6.318809, 5e-7, "EPL");
    near(25.0 / entrance.magnification * exit.magnification, 23.39711, 5e-6, "XPD");
    near(exit.position_mm - 92.7383463, -92.73835, 5e-6, "XPL");
    near(lens.focal_length_mm / 25.0, 4.060073, 5e-7, "FNO");
    near(lens.rear_focus_mm - 92.7383463, 2.255622, 5e-7, "BFP");
}

/// Optiland 5ef9d47, `tests/test_cross_tool_validation.py`: OpticStudio 2023 R1.02, 550 nm, half field 0.15°, no ray aiming.
mod hubble {
    use super::*;

    const HUBBLE: &str = include_str!("../lenses/hubble.toml");
    const SLOPE: f64 = 0.002617999860811094;

    fn telescope() -> Train {
        from_file(HUBBLE, 550.0)
    }

    #[test]
    fn it_is_to_first_order_what_optic_studio_has() {
        let lens = telescope().first_order(Some(1));
        let (entrance, exit) = (lens.entrance_pupil.expect("a stop"), lens.exit_pupil.expect("a stop"));
        near(lens.focal_length_mm, 57600.079948, 2e-3, "f2");
        near(entrance.position_mm, 4910.01, 5e-3, "EPL");
        near(2400.0 * exit.magnification.abs(), 289.9321, 5e-5, "XPD");
        near(exit.position_mm - 6365.20955, -6958.364, 1e-3, "XPL");
        near(lens.focal_length_mm / 2400.0, 24.00003, 1e-5, "FNO");
    }

    #[test]
    fn its_seidel_sums_are_optic_studios() {
        let train = telescope();
        let lens = train.first_order(Some(1));
        let sums = train.seidel(lens.marginal_ray(2400.0, None), lens.chief_ray(SLOPE));
        let sum = sums.into_iter().fold(SeidelSums::default(), |sum, one| sum + one);
        let found = [sum.spherical_mm, sum.coma_mm, sum.astigmatism_mm, sum.field_curvature_mm, sum.distortion_mm];
        // Magnitudes: its signs are not told.
        for (found, expected) in found.into_iter().zip([0.000003, 0.000337, 0.001452, 0.012841, 0.000760]) {
            near(found.abs(), expected, 5.5e-7, "Seidel sum");
        }
    }

    #[test]
    fn its_rays_are_optic_studios() {
        let train = telescope();
        // Hy, Px, Py, then x, y and the direction's x and y in the image.
        for (field, px, py, expected) in [
            (0.0, 0.0, 1.0, [0.0, 0.000292798, 0.0, -0.020832193]),
            (0.0, 0.0, 0.7, [0.0, 0.000224337, 0.0, -0.014582932]),
            (1.0, 0.0, 1.0, [0.0, 150.415481283, 0.0, 0.000731952]),
            (1.0, 0.0, -1.0, [0.0, 150.483684128, 0.0, 0.042499115]),
            (0.7, 0.7, 0.0, [0.011252785, 105.43303112, -0.014598926, 0.015153183]),
        ] {
            let slope = (0.15 * field * std::f64::consts::PI / 180.0).tan();
            let at_mm = [1200.0 * px, 1200.0 * py - slope * 4910.01016, 0.0];
            let (met, fate) = train.path(&Ray::new(at_mm, [0.0, slope, 1.0]));
            assert_eq!(fate, Fate::Arrived);
            let image = met.last().expect("an image");
            let found = [image.position_mm[0], image.position_mm[1], image.direction[0], image.direction[1]];
            for (found, expected) in found.into_iter().zip(expected) {
                near(found, expected, 2e-8, "ray");
            }
        }
    }

    #[test]
    fn its_chief_ray_and_foci_are_optic_studios() {
        // OpticStudio follows the chief ray through the mirror's hole as if there was none.
        let mut whole = PrescriptionSpec::clone(&Prescription::from_toml(HUBBLE).expect("a lens"));
        whole.surfaces.iter_mut().for_each(|surface| surface.hole_radius_mm = 0.0);
        let train = Train::new(&Prescription::new(whole).expect("a legal lens"), &[], 550.0).expect("mirrors");
        let imager = Imager::through_stop(train, 550.0, Some(1), 1200.0);
        let sight = |slope: f64| imager.sight(Field::Infinite { slope: [0.0, slope] }).expect("a chief ray");
        let edge = sight(SLOPE);
        near(edge.chief_mm()[1], 150.423380108, 1e-6, "chief ray");
        let [middle, edge] = [sight(0.0), edge].map(|sight| sight.foci().expect("foci"));
        near(middle.sagittal_mm, 0.01686423, 1e-6, "focus on the axis");
        near(edge.sagittal_mm, 1.65273862, 1e-6, "sagittal focus");
    }

    #[test]
    fn light_beside_its_hole_is_lost_there() {
        let (_, fate) = telescope().path(&Ray::new([0.0, 100.0, 0.0], [0.0, 0.0, 1.0]));
        assert_eq!(fate, Fate::Vignetted { surface: 1 });
    }
}
