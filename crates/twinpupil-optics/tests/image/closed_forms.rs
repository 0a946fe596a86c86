//! What textbooks say of simple lenses.

use std::f64::consts::PI;

use twinpupil_instrument::{Prescription, PrescriptionSpec, Shape, SurfaceSpec};
use twinpupil_optics::{Field, Imager, PupilFunction, SeidelSums, Sight, Train};

const WAVELENGTH_NM: f64 = 550.0;
const WAVELENGTH_MM: f64 = 1e-6 * WAVELENGTH_NM;

const ON_AXIS: Field = Field::Infinite { slope: [0.0; 2] };

fn made(surfaces: Vec<SurfaceSpec>) -> Prescription {
    Prescription::new(PrescriptionSpec { surfaces, ..PrescriptionSpec::default() }).expect("a legal lens")
}

fn imager(lens: &Prescription, stop: Option<usize>, radius_mm: f64) -> Imager {
    let train = Train::new(lens, &[], WAVELENGTH_NM).expect("glasses that ship");
    Imager::through_stop(train, WAVELENGTH_NM, stop, radius_mm)
}

/// An ideal lens of f = 100 mm, its stop in front of it.
fn ideal(defocus_mm: f64) -> Prescription {
    let stop = SurfaceSpec { gap_mm: 30.0, stop: true, ..SurfaceSpec::default() };
    let shape = Shape::ThinLens { focal_length_mm: 100.0 };
    made(vec![stop, SurfaceSpec { shape, gap_mm: 100.0 + defocus_mm, ..SurfaceSpec::default() }])
}

/// A parabolic mirror, f = 200 mm.
fn parabola() -> Prescription {
    let shape = Shape::Conic { radius_mm: -400.0, conic_constant: -1.0 };
    made(vec![SurfaceSpec { shape, mirror: true, stop: true, gap_mm: -200.0, ..SurfaceSpec::default() }])
}

fn sight(imager: &Imager, field: Field) -> Sight<'_> {
    imager.sight(field).expect("a chief ray")
}

#[test]
fn defocus_is_w020_and_its_rays_miss_by_its_slope() {
    for defocus_mm in [-0.2, 0.05, 0.5] {
        let imager = imager(&ideal(defocus_mm), Some(0), 2.0);
        let sight = sight(&imager, ON_AXIS);
        // W = W₀₂₀ ρ², W₀₂₀ = δ/8N², N = 25; rays miss by −δ ρ/2N: they come from above and go on down.
        for rho in [-1.0, -0.5, 0.3, 1.0] {
            let deviation = sight.deviations(&[[0.0, rho]])[0].expect("a ray");
            let expected_mm = defocus_mm / (8.0 * 25.0 * 25.0) * rho * rho;
            // What is left out is of the fourth order in the aperture, 1/50, and of second order in δ/f.
            assert!((deviation.opd_mm / expected_mm - 1.0).abs() < 0.01, "{} {expected_mm}", deviation.opd_mm);
            assert!((deviation.error_mm[1] + defocus_mm * rho / 50.0).abs() < 1e-12 * 50.0);
            assert!(deviation.error_mm[0].abs() < 1e-15);
        }
    }
}

#[test]
fn a_lens_without_aberrations_has_an_airy_disc() {
    // N = 25: the first dark ring has the radius 1.22 λ N, and holds 83.8 % of the light [Goodman, sec. 4.4.2].
    let imager = imager(&ideal(0.0), Some(0), 2.0);
    let pupil = sight(&imager, ON_AXIS).pupil_function(256).expect("light");
    let psf = pupil.psf();
    assert!((pupil.strehl_ratio(&psf) - 1.0).abs() < 1e-9);
    assert!(pupil.rms_opd_mm() < 1e-12 && (pupil.filled_share() - 1.0).abs() < 1e-3);
    let dark_mm = 1.2196698912665045 * WAVELENGTH_MM * 25.0;
    for axis in [0, 1] {
        let light = pupil.section(axis, &[0.0, 0.5 * dark_mm, 0.97 * dark_mm, dark_mm, 1.03 * dark_mm, -0.5 * dark_mm]);
        assert!((light[0] - 1.0).abs() < 1e-12 && light[3] < 1e-6, "{light:?}");
        assert!(light[2] > light[3] && light[4] > light[3]);
        // (2 J₁(v)/v)², v = 1.91585.
        let half: f64 = 2.0 * 0.5814999 / 1.9158530;
        assert!((light[1] - half * half).abs() < 1e-3 && (light[5] - light[1]).abs() < 1e-12, "{light:?}");
    }
    let encircled = psf.encircled([0.0; 2]);
    assert!((encircled.share(dark_mm) - 0.8378).abs() < 5e-4, "{}", encircled.share(dark_mm));
    assert!((encircled.share(encircled.radius_mm(0.5)) - 0.5).abs() < 1e-4);
    assert!((psf.intensity.iter().copied().fold(0.0, f64::max) - 1.0).abs() < 1e-12);
}

#[test]
fn its_contrast_is_the_overlap_of_two_discs() {
    // Also seen at a slant, where the pupil is farther away and looks narrower: across the field by cos θ, along it by cos³ θ.
    // The chief ray meets the lens 30 mm behind the stop, which bends it by three tenths of its slope.
    for slope in [0.0_f64, 0.3] {
        let imager = imager(&ideal(0.0), Some(0), 2.0);
        let pupil = sight(&imager, Field::Infinite { slope: [0.0, slope] }).pupil_function(256).expect("light");
        let cos = 1.0 / (1.0 + (0.7 * slope).powi(2)).sqrt();
        let cutoffs = pupil.cutoffs_per_mm();
        let full_per_mm = 1.0 / (WAVELENGTH_MM * 25.0);
        assert!((cutoffs.sagittal / (full_per_mm * cos) - 1.0).abs() < 1e-3, "{cutoffs:?}");
        assert!((cutoffs.tangential / (full_per_mm * cos.powi(3)) - 1.0).abs() < 1e-3, "{cutoffs:?}");
        if slope > 0.0 {
            continue;
        }
        for nu in [0.0, 0.1, 0.35, 0.6, 0.9, 1.2] {
            let expected = overlap(nu / COSINE);
            let contrast = pupil.contrasts(&[nu * full_per_mm])[0];
            assert!((contrast.sagittal - expected).abs() < CONTRAST, "{nu}: {contrast:?} {expected}");
            assert!((contrast.tangential - expected).abs() < CONTRAST, "{nu}: {contrast:?} {expected}");
        }
    }
}

/// 2/π (acos ν − ν √(1 − ν²)) [Goodman, eq. 6-32].
fn overlap(nu: f64) -> f64 {
    if nu < 1.0 { 2.0 / PI * (f64::acos(nu) - nu * (1.0 - nu * nu).sqrt()) } else { 0.0 }
}

/// What the sine of the beam's angle is less than its tangent, 1/2N, by: cos(atan 0.02).
const COSINE: f64 = 0.999_800_06;

/// What a pupil of 256 places across tells of contrast: on its rim places count by how much of them is lit.
const CONTRAST: f64 = 1e-4;

#[test]
fn the_least_grid_tells_how_light_and_contrast_are_spread() {
    // That from which the program starts. 1 − J₀² − J₁² of the light are within v [Born & Wolf, sec. 8.5.2]; Bessel functions
    // from [Abramowitz and Stegun, table 9.1].
    const GRID: usize = 128;
    let imager = imager(&ideal(0.0), Some(0), 2.0);
    let pupil = sight(&imager, ON_AXIS).pupil_function(GRID).expect("light");
    let encircled = pupil.psf().encircled([0.0; 2]);
    for (v, j0, j1) in [
        (0.5, 0.938_469_807_2, 0.242_268_457_7),
        (1.0, 0.765_197_686_6, 0.440_050_585_7),
        (2.0, 0.223_890_779_1, 0.576_724_807_8),
        (2.5, -0.048_383_776_5, 0.497_094_102_5),
        (3.8, -0.402_556_410_2, 0.012_821_002_9),
        (5.0, -0.177_596_771_3, -0.327_579_137_6),
        (10.0, -0.245_935_764_5, 0.043_472_746_2),
    ] {
        let expected = 1.0 - j0 * j0 - j1 * j1;
        // v = π r/(λ N).
        let found = encircled.share(v * WAVELENGTH_MM * 25.0 / (PI * COSINE));
        assert!((found - expected).abs() < 5e-4, "{v}: {found} {expected}");
    }
    for nu in [0.003, 0.1, 0.25, 0.5, 0.75, 0.95] {
        let expected = overlap(nu / COSINE);
        let contrast = pupil.contrasts(&[nu / (WAVELENGTH_MM * 25.0)])[0];
        assert!((contrast.sagittal - expected).abs() < CONTRAST, "{nu}: {contrast:?} {expected}");
        assert!((contrast.tangential - expected).abs() < CONTRAST, "{nu}: {contrast:?} {expected}");
    }
}

#[test]
fn the_contrast_is_the_spectrum_of_the_point_spread() {
    // By a sum over the image instead of one over the pupil, through an uncorrected lens.
    let imager = imager(&singlet(), Some(0), 4.0);
    let pupil = sight(&imager, Field::Infinite { slope: [0.0, 0.05] }).pupil_function(64).expect("light");
    assert!(pupil.steepest_step() < 0.5, "{}", pupil.steepest_step());
    let psf = pupil.psf();
    // All light, by what a small circle has of it.
    let small_mm = 0.01 * psf.pitch_mm;
    let middle = psf.intensity[psf.size / 2 * (psf.size + 1)];
    let light = middle * PI * (small_mm / psf.pitch_mm).powi(2) / psf.encircled([0.0; 2]).share(small_mm);
    // Of places on the rim, a twelfth of all, the image knows the share that is lit, contrast also where: it matters where the
    // rim moves along itself, by less than a place.
    const RIM: f64 = 0.01;
    for k in [1, 5, 20, 50] {
        let per_mm = f64::from(k) / (psf.pitch_mm * psf.size as f64);
        let spectrum = |axis: usize| {
            let [mut re, mut im] = [0.0; 2];
            for (n, intensity) in psf.intensity.iter().enumerate() {
                let place = [n % psf.size, n / psf.size][axis] as f64;
                let (sin, cos) = (2.0 * PI * f64::from(k) * place / psf.size as f64).sin_cos();
                (re, im) = (re + intensity * cos, im + intensity * sin);
            }
            re.hypot(im) / light
        };
        let contrast = pupil.contrasts(&[per_mm])[0];
        let off = [contrast.sagittal - spectrum(0), contrast.tangential - spectrum(1)];
        assert!(off.iter().all(|off| off.abs() < RIM / f64::from(k)), "{k}: {contrast:?} {off:?}");
    }
}

#[test]
fn a_parabolic_mirror_has_no_aberration_on_its_axis() {
    let imager = imager(&parabola(), Some(0), 40.0);
    let sight = sight(&imager, ON_AXIS);
    for deviation in sight.deviations(&[[0.0, 1.0], [0.6, -0.7], [-1.0, 0.0], [0.1, 0.2]]) {
        let deviation = deviation.expect("a ray");
        assert!(deviation.opd_mm.abs() < 1e-12 && deviation.error_mm[1].abs() < 1e-12, "{deviation:?}");
    }
    let pupil = sight.pupil_function(64).expect("light");
    assert!((pupil.strehl_ratio(&pupil.psf()) - 1.0).abs() < 1e-12);
    // Its directions have the sine h/f / (1 + h²/4f²), h = 40.
    let sine = 0.2 / (1.0 + 0.01);
    assert!(pupil.apertures().iter().all(|aperture| (aperture - sine).abs() < 1e-9), "{:?}", pupil.apertures());
}

/// A bent singlet, f ≈ 100 mm, its stop a little in front of it, the image in the paraxial focus.
fn singlet() -> Prescription {
    let surfaces = |gap_mm: f64| {
        let sphere = |radius_mm: f64| Shape::Sphere { radius_mm };
        vec![
            SurfaceSpec { gap_mm: 10.0, stop: true, ..SurfaceSpec::default() },
            SurfaceSpec { shape: sphere(70.0), medium: "N-BK7".to_owned(), gap_mm: 3.0, ..SurfaceSpec::default() },
            SurfaceSpec { shape: sphere(-200.0), gap_mm, ..SurfaceSpec::default() },
        ]
    };
    let train = Train::new(&made(surfaces(100.0)), &[], WAVELENGTH_NM).expect("glasses that ship");
    made(surfaces(train.first_order(Some(0)).rear_focus_mm))
}

/// The wavefront at ρ (x, y) = (a, b) of the pupil and the field that the sums are for, mm
/// [Welford, Aberrations of Optical Systems, eq. 8.23].
fn seidel_mm(sums: &SeidelSums, [x, y]: [f64; 2]) -> f64 {
    let square = x * x + y * y;
    0.125 * sums.spherical_mm * square * square
        + 0.5 * sums.coma_mm * square * y
        + 0.5 * sums.astigmatism_mm * y * y
        + 0.25 * (sums.astigmatism_mm + sums.field_curvature_mm) * square
}

#[test]
fn small_wavefronts_are_those_of_seidel() {
    let lens = singlet();
    let train = Train::new(&lens, &[], WAVELENGTH_NM).expect("glasses that ship");
    let first_order = train.first_order(Some(0));
    let places = [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [0.6, 0.7], [0.0, 0.5]];
    // The smaller aperture and field, the nearer: what is left is of sixth order.
    let misses = [1.0, 0.5].map(|small| {
        let (radius_mm, slope) = (4.0 * small, 0.05 * small);
        let imager = imager(&lens, Some(0), radius_mm);
        let sight = sight(&imager, Field::Infinite { slope: [0.0, slope] });
        let sums = train.seidel(first_order.marginal_ray(2.0 * radius_mm, None), first_order.chief_ray(slope));
        let sums = sums.into_iter().fold(SeidelSums::default(), |sum, one| sum + one);
        let largest = seidel_mm(&sums, [0.0, 1.0]).abs().max(seidel_mm(&sums, [0.0, -1.0]).abs());
        let found = sight.deviations(&places);
        let miss = |(place, found): (&[f64; 2], Option<twinpupil_optics::Deviation>)| {
            (found.expect("a ray").opd_mm - seidel_mm(&sums, *place)).abs() / largest
        };
        // Spherical aberration alone on the axis.
        let alone = self::sight(&imager, ON_AXIS).deviations(&[[0.0, 1.0]])[0].expect("a ray");
        assert!((alone.opd_mm / (0.125 * sums.spherical_mm) - 1.0).abs() < 0.02, "{alone:?} {sums:?}");
        places.iter().zip(found).map(miss).fold(0.0, f64::max)
    });
    assert!(misses[0] < 0.03 && misses[1] < 0.3 * misses[0], "{misses:?}");
}

#[test]
fn close_rays_focus_on_seidels_surfaces() {
    // Behind the image by −h² (3 S_III + S_IV)/2 H² n' … and − (S_III + S_IV), in marginal slopes: δ = −W₂/(n' u'²/2).
    let lens = singlet();
    let train = Train::new(&lens, &[], WAVELENGTH_NM).expect("glasses that ship");
    let first_order = train.first_order(Some(0));
    let (radius_mm, slope) = (1.0, 0.02);
    let imager = imager(&lens, Some(0), radius_mm);
    let foci = sight(&imager, Field::Infinite { slope: [0.0, slope] }).foci().expect("rays");
    let sums = train.seidel(first_order.marginal_ray(2.0 * radius_mm, None), first_order.chief_ray(slope));
    let sums = sums.into_iter().fold(SeidelSums::default(), |sum, one| sum + one);
    let square = (radius_mm / first_order.focal_length_mm).powi(2);
    let expected = [
        -(3.0 * sums.astigmatism_mm + sums.field_curvature_mm) / (2.0 * square),
        -(sums.astigmatism_mm + sums.field_curvature_mm) / (2.0 * square),
    ];
    assert!((foci.tangential_mm / expected[0] - 1.0).abs() < 0.01, "{foci:?} {expected:?}");
    assert!((foci.sagittal_mm / expected[1] - 1.0).abs() < 0.01, "{foci:?} {expected:?}");
    // The ideal lens has a flat image.
    let flat = imager_foci(&ideal(0.0), 0.2);
    assert!(flat[0].abs() < 1e-6 && flat[1].abs() < 1e-6, "{flat:?}");
}

fn imager_foci(lens: &Prescription, slope: f64) -> [f64; 2] {
    let imager = imager(lens, Some(0), 2.0);
    let foci = sight(&imager, Field::Infinite { slope: [0.0, slope] }).foci().expect("rays");
    [foci.tangential_mm, foci.sagittal_mm]
}

/// By how much the ideal lens of 4 mm is out of focus for W₀₂₀ in wavelengths: ½ a² (1/f − 1/(f + δ)).
fn defocus_mm(w020: f64) -> f64 {
    1.0 / (1.0 / 100.0 - 2.0 * w020 * WAVELENGTH_MM / 4.0) - 100.0
}

#[test]
fn far_out_of_focus_diffraction_is_lost_in_what_rays_do() {
    // W₀₂₀ = 20 λ: contrast is that of a blurred disc, 2 J₁(π B ν)/(π B ν), B its diameter, well within the cutoff.
    let defocus_mm = defocus_mm(20.0);
    let imager = imager(&ideal(defocus_mm), Some(0), 2.0);
    let pupil = sight(&imager, ON_AXIS).pupil_function(256).expect("light");
    let blur_mm = defocus_mm / 25.0;
    let frequencies: Vec<f64> = [0.2, 0.5, 0.8, 1.1].iter().map(|cycles| cycles / blur_mm).collect();
    let expected = [0.951_457_1, 0.721_702_8, 0.392_941_2, 0.090_239_7];
    let (waves, rays) = (pupil.contrasts(&frequencies), pupil.contrasts_by_rays(&frequencies));
    for k in 0..4 {
        assert!((rays[k].tangential - expected[k]).abs() < 3e-3, "{rays:?}");
        assert!((waves[k].tangential - rays[k].tangential).abs() < 0.02, "{waves:?} {rays:?}");
        assert!((waves[k].sagittal - waves[k].tangential).abs() < 1e-9);
    }
    assert!(pupil.strehl_ratio(&pupil.psf()) < 0.01);
}

#[test]
fn a_small_wavefront_costs_what_marechal_says() {
    // 1 − (2π σ)² + …, σ the deviation in wavelengths [Born & Wolf, sec. 9.1.3]; of defocus (sin x/x)², x = π W₀₂₀/λ.
    let w020 = 0.25;
    let imager = imager(&ideal(defocus_mm(w020)), Some(0), 2.0);
    let pupil = sight(&imager, ON_AXIS).pupil_function(256).expect("light");
    let x = PI * w020;
    let strehl = pupil.strehl_ratio(&pupil.psf());
    assert!((strehl - (x.sin() / x).powi(2)).abs() < 1e-3, "{strehl}");
    assert!((pupil.rms_opd_mm() / (w020 * WAVELENGTH_MM / 12_f64.sqrt()) - 1.0).abs() < 2e-3);
}

#[test]
fn a_vignetted_pupil_and_one_with_a_hole_let_through_their_part() {
    let lens = |hole_radius_mm: f64, semi_diameter_mm: Option<f64>| {
        let stop = SurfaceSpec { gap_mm: 30.0, stop: true, hole_radius_mm, ..SurfaceSpec::default() };
        let shape = Shape::ThinLens { focal_length_mm: 100.0 };
        made(vec![stop, SurfaceSpec { shape, gap_mm: 100.0, semi_diameter_mm, ..SurfaceSpec::default() }])
    };
    let share = |lens: &Prescription, slope: f64| {
        let imager = imager(lens, Some(0), 2.0);
        let filled = |pupil: PupilFunction| pupil.filled_share();
        sight(&imager, Field::Infinite { slope: [0.0, slope] }).pupil_function(256).map(filled).expect("light")
    };
    // The chief ray itself does not come through the hole's rim.
    assert!((share(&lens(1.0, None), 0.0) - 0.75).abs() < 2e-3);
    // Two discs of radius 2 whose middles are 2 apart: 2/π (acos ν − ν √(1 − ν²)) at ν = ½.
    let overlap = 2.0 / PI * (f64::acos(0.5) - 0.5 * 0.75_f64.sqrt());
    assert!((share(&lens(0.0, Some(2.0)), 2.0 / 30.0) - overlap).abs() < 2e-3);
}
