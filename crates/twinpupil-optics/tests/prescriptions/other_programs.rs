//! A thousand rays through each of four lenses, off the axis and in three wavelengths, where Optiland 0.6.3 and batoid 0.9.0
//! have them. `tests/published/record.py` recorded them; glasses are Optiland's own.

use twinpupil_instrument::Prescription;
use twinpupil_optics::{Fate, Ray, Rays, Train};

/// All programs trace in double precision.
const TOLERANCE_MM: f64 = 1e-9;

/// Both stop their search for an asphere sooner than we do: [`an_asphere_is_right_to_the_last_digit`].
const ASPHERE_MM: f64 = 5e-8;

const RAYS: usize = 1000;

/// A line of the file that begins a lens.
struct Beam<'a> {
    lens: &'a str,
    radius_mm: f64,
    centre_mm: [f64; 2],
    slope: [f64; 2],
}

impl<'a> Beam<'a> {
    fn of(line: &'a str) -> Self {
        let (lens, numbers) = line.split_once(',').expect("a name and numbers");
        let numbers: Vec<f64> = numbers.split(',').map(|number| number.parse().expect("a number")).collect();
        let [radius_mm, x, y, gx, gy] = numbers[..] else { panic!("five numbers") };
        Self { lens, radius_mm, centre_mm: [x, y], slope: [gx, gy] }
    }

    fn ray(&self, k: usize) -> Ray {
        let radius_mm = self.radius_mm * ((k as f64 + 0.5) / RAYS as f64).sqrt();
        let (sin, cos) = (2.399963229728653 * k as f64).sin_cos();
        let [x, y] = self.centre_mm;
        Ray::new([x + radius_mm * cos, y + radius_mm * sin, 0.0], [self.slope[0], self.slope[1], 1.0])
    }
}

#[test]
fn rays_are_where_optiland_and_batoid_have_them() {
    let mut lines = include_str!("../published/optiland-batoid.csv").lines().skip(4).peekable();
    let mut lenses = 0;
    while let Some(line) = lines.next() {
        let beam = Beam::of(line.strip_prefix("lens,").expect("a lens"));
        let rows: Vec<[f64; 5]> =
            std::iter::from_fn(|| lines.next_if(|line| !line.starts_with("lens"))).map(row).collect();
        assert_eq!(rows.len(), RAYS);
        compare(&beam, &rows);
        lenses += 1;
    }
    assert_eq!(lenses, 4);
}

fn row(line: &str) -> [f64; 5] {
    let numbers: Vec<f64> = line.split(',').map(|number| number.parse().expect("a number")).collect();
    numbers.try_into().expect("a wavelength and two places")
}

fn compare(beam: &Beam, rows: &[[f64; 5]]) {
    let (text, tolerance_mm) = match beam.lens {
        "double-gauss" => (include_str!("../lenses/double-gauss.toml"), TOLERANCE_MM),
        "cooke-triplet" => (include_str!("../lenses/cooke-triplet.toml"), TOLERANCE_MM),
        "achromat" => (include_str!("../lenses/achromat.toml"), TOLERANCE_MM),
        _ => (include_str!("../lenses/asphere.toml"), ASPHERE_MM),
    };
    let lens = Prescription::from_toml(text).expect("a lens");
    for colour in 0..3 {
        let train = Train::new(&lens, &[], rows[colour][0]).expect("glasses that ship");
        let mine: Vec<usize> = (colour..RAYS).step_by(3).collect();
        let mut rays: Rays = mine.iter().map(|k| beam.ray(*k)).collect();
        train.trace(&mut rays);
        for (k, (ray, fate)) in mine.into_iter().zip(rays.iter()) {
            assert_eq!(fate, Fate::Arrived, "{} {k}", beam.lens);
            let [_, optiland_x, optiland_y, batoid_x, batoid_y] = rows[k];
            let [x, y, _] = ray.position_mm;
            for (found, expected) in [(x, optiland_x), (y, optiland_y), (x, batoid_x), (y, batoid_y)] {
                assert!((found - expected).abs() < tolerance_mm, "{} {k}: {found} {expected}", beam.lens);
            }
        }
    }
}

#[test]
fn an_asphere_is_right_to_the_last_digit() {
    // Ray 6 of the asphere, worked out once with 40 digits (mpmath 1.3: Newton's method, Snell's law).
    let lens = Prescription::from_toml(include_str!("../lenses/asphere.toml")).expect("a lens");
    let beam = Beam { lens: "asphere", radius_mm: 4.5, centre_mm: [0.0; 2], slope: [0.02, 0.05] };
    let (met, _) = Train::new(&lens, &[], 450.0).expect("a lens").path(&beam.ray(6));
    let [x, y, _] = met[2].position_mm;
    assert!((x - 0.2549514615485383).abs() < 1e-14, "{x}");
    assert!((y - 0.6779944230927872).abs() < 1e-14, "{y}");
}

#[test]
fn an_achromat_brings_blue_and_red_together() {
    let lens = Prescription::from_toml(include_str!("../lenses/achromat.toml")).expect("a lens");
    let [blue, middle, red] =
        [486.1, 587.6, 656.3].map(|nm| Train::new(&lens, &[], nm).expect("glasses that ship").first_order(Some(0)));
    // optiland 0.6.3, f2.
    assert!((middle.focal_length_mm - 50.10425081300889).abs() < 1e-9, "{}", middle.focal_length_mm);
    // Those of a singlet would be f/V apart, a millimetre.
    assert!((blue.rear_focus_mm - red.rear_focus_mm).abs() < 0.2, "{} {}", blue.rear_focus_mm, red.rear_focus_mm);
}
