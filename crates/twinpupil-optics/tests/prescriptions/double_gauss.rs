//! A double Gauss F/2 against CODE V 10.8.
//!
//! The lens and every number of CODE V come from ray-optics 0b1dc26, `src/rayoptics/codev/tests/ag_dblgauss.{seq,lis}`; none
//! is ever regenerated. Tolerances are the digits that the listing prints.

use twinpupil_instrument::{ParaxialRay, Prescription, paraxial_rays};
use twinpupil_optics::{ChromaticSums, Fate, Field, Ray, SeidelSums, Train};

/// Half a unit of the last digit printed, and a little for rounding.
const SIX_DIGITS: f64 = 6e-7;
const FOUR_DIGITS: f64 = 6e-5;

const WAVELENGTHS_NM: [f64; 3] = [486.1, 587.6, 656.3];
const STOP: usize = 5;

fn train(wavelength_nm: f64) -> Train {
    let lens = Prescription::from_toml(include_str!("../lenses/double-gauss.toml")).expect("a lens");
    Train::new(&lens, &[], wavelength_nm).expect("glasses that ship")
}

fn near(found: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((found - expected).abs() <= tolerance, "{what}: {found}, CODE V has {expected}");
}

/// Marginal ray of an entrance pupil 50 mm wide, and chief ray of 14°.
fn first_order_rays(train: &Train) -> [ParaxialRay; 2] {
    let lens = train.first_order(Some(STOP));
    [lens.marginal_ray(50.0, None), lens.chief_ray(14_f64.to_radians().tan())]
}

#[test]
fn focal_lengths_and_pupils_are_code_vs() {
    let lens = train(587.6).first_order(Some(STOP));
    let (entrance, exit) = (lens.entrance_pupil.unwrap(), lens.exit_pupil.unwrap());
    let stop_diameter_mm = 50.0 / entrance.magnification;
    for (found, expected, what) in [
        (lens.focal_length_mm, 100.0038, "EFL"),
        (lens.rear_focus_mm, 61.4875, "BFL"),
        (lens.front_focus_mm, -29.3208, "FFL"),
        (lens.focal_length_mm / 50.0, 2.0001, "FNO"),
        (entrance.position_mm, 57.912, "ENP THI"),
        (exit.position_mm, -53.1569, "EXP THI"),
        (stop_diameter_mm * exit.magnification, 57.3201, "EXP DIA"),
        (lens.focal_length_mm * 14_f64.to_radians().tan(), 24.9337, "HT"),
    ] {
        near(found, expected, FOUR_DIGITS, what);
    }
    near(lens.rear_principal_mm, lens.rear_focus_mm - lens.focal_length_mm, 1e-10, "H'");
    near(lens.front_principal_mm, lens.front_focus_mm + lens.focal_length_mm, 1e-10, "H");
}

#[test]
fn paraxial_rays_are_code_vs() {
    // HMY, UMY, HCY, UCY behind each surface.
    let listing = [
        [25.000000, -0.170628, -14.439084, 0.252237],
        [23.507005, -0.180751, -12.232008, 0.359218],
        [23.416630, -0.347265, -12.052399, 0.344338],
        [19.075817, -0.348123, -7.748170, 0.345189],
        [17.752950, -0.116096, -6.436452, 0.393199],
        [15.852527, -0.116096, 0.000000, 0.393199],
        [14.256448, 0.116660, 5.405685, 0.316914],
        [14.699756, 0.115437, 6.609960, 0.313591],
        [15.969559, -0.074185, 10.059465, 0.343587],
        [15.932466, -0.080166, 10.231259, 0.189957],
        [15.371307, -0.249991, 11.560961, 0.217488],
    ];
    let train = train(587.6);
    let [marginal, chief] = first_order_rays(&train).map(|ray| paraxial_rays(&train.paraxial_surfaces(), 1.0, ray));
    assert_eq!(marginal.len(), listing.len());
    for (k, expected) in listing.iter().enumerate() {
        let found = [marginal[k].height_mm, marginal[k].slope, chief[k].height_mm, chief[k].slope];
        for (found, expected) in found.into_iter().zip(expected) {
            near(found, *expected, SIX_DIGITS, &format!("surface {k}"));
        }
    }
}

/// CODE V prints what the sums do to rays in the image: SA, TCO, TAS, SAS, PTB, DST.
fn transverse(sums: &SeidelSums, scale: f64) -> [f64; 6] {
    let (s3, s4) = (sums.astigmatism_mm, sums.field_curvature_mm);
    [sums.spherical_mm, 3.0 * sums.coma_mm, 3.0 * s3 + s4, s3 + s4, s4, sums.distortion_mm].map(|sum| sum * scale)
}

#[test]
fn seidel_sums_are_code_vs() {
    // SA, TCO, TAS, SAS, PTB, DST, AX, LAT; the last row is the sum.
    let listing = [
        [-1.040587, 0.053227, -0.531277, -0.530672, -0.530370, 0.009048, -0.320428, 0.005463],
        [-0.002474, 0.078453, -0.633384, -0.080636, 0.195737, 0.852194, -0.017875, 0.188905],
        [-0.320986, -0.086051, -0.786925, -0.781799, -0.779236, -0.069862, -0.275440, -0.024614],
        [-0.012707, 0.037799, -0.037480, -0.012493, 0.000000, 0.012388, 0.137441, -0.136283],
        [1.363481, 0.846376, 1.382005, 1.265253, 1.206876, 0.261800, 0.433452, 0.089688],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [2.059866, -2.025339, 1.694345, 1.251814, 1.030548, -0.410277, 0.349174, -0.114441],
        [-0.001561, -0.012725, -0.034567, -0.011522, 0.000000, -0.031301, 0.039049, 0.106081],
        [-1.139327, 0.540680, -0.870024, -0.813005, -0.784496, 0.128607, -0.200884, 0.031777],
        [0.000192, 0.014807, 0.212677, -0.040909, -0.167702, -1.050920, -0.006321, -0.162376],
        [-1.212851, 0.589843, -0.470280, -0.406534, -0.374661, 0.065903, -0.173172, 0.028073],
        [-0.306954, 0.037071, -0.074910, -0.160505, -0.203302, -0.232420, -0.035003, 0.012274],
    ];
    let [blue, middle, red] = WAVELENGTHS_NM.map(train);
    let [marginal, chief] = first_order_rays(&middle);
    let image_slope = paraxial_rays(&middle.paraxial_surfaces(), 1.0, marginal).last().unwrap().slope;
    let mut sums = middle.seidel(marginal, chief);
    let mut colours = middle.chromatic(&blue, &red, marginal, chief);
    sums.push(sums.iter().copied().fold(SeidelSums::default(), |sum, one| sum + one));
    colours.push(colours.iter().copied().fold(ChromaticSums::default(), |sum, one| sum + one));
    assert_eq!(sums.len(), listing.len());
    for (k, ((sums, colours), expected)) in sums.iter().zip(&colours).zip(&listing).enumerate() {
        let third = transverse(sums, 0.5 / image_slope);
        let colour = [colours.axial_mm, colours.lateral_mm].map(|sum| sum / image_slope);
        for (j, (found, expected)) in third.iter().chain(&colour).zip(expected).enumerate() {
            near(*found, *expected, SIX_DIGITS, &format!("surface {k}, column {j}"));
        }
    }
}

#[test]
fn real_rays_are_code_vs() {
    let train = train(587.6);
    let mut traced = None;
    let mut compared = 0;
    for line in
        include_str!("../published/codev-double-gauss.csv").lines().filter(|line| line.starts_with(char::is_numeric))
    {
        let row: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        let [field_deg, pupil_x_mm, pupil_y_mm, surface] = row[..4].try_into().unwrap();
        let surface = surface as usize;
        if surface == 0 {
            traced = Some(path(&train, field_deg, [pupil_x_mm, pupil_y_mm]));
        }
        let met = traced.as_ref().unwrap();
        let ray = met[surface];
        let found = [
            ray.position_mm[0],
            ray.position_mm[1],
            ray.position_mm[2],
            ray.direction[0] / ray.direction[2],
            ray.direction[1] / ray.direction[2],
        ];
        for (found, expected) in found.iter().zip(&row[4..]) {
            near(*found, *expected, SIX_DIGITS, line);
        }
        compared += 1;
    }
    assert_eq!(compared, 9 * 11);
}

/// A ray by the place where it crosses the plane in which the aimed chief ray of its field crosses the axis.
fn path(train: &Train, field_deg: f64, pupil_mm: [f64; 2]) -> Vec<Ray> {
    let slope = field_deg.to_radians().tan();
    let chief = train.aim(STOP, Field::Infinite { slope: [0.0, slope] }, &[[0.0; 2]], 16.0)[0].expect("a chief ray");
    let pupil_depth_mm = if slope == 0.0 { 0.0 } else { -chief.position_mm[1] / slope };
    let at_mm = [pupil_mm[0], pupil_mm[1] - slope * pupil_depth_mm, 0.0];
    let (met, fate) = train.path(&Ray::new(at_mm, [0.0, slope, 1.0]));
    assert_eq!(fate, Fate::Arrived);
    met
}
