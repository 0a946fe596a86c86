//! Wavefronts, foci and contrast of two lenses where Optiland 0.6.3 has them. `tests/published/record_images.py` recorded them.

use twinpupil_instrument::Prescription;
use twinpupil_optics::{Field, Imager, Train};

/// Where the chief ray is.
const CHIEF_MM: f64 = 1e-9;

/// Optiland's close rays are 1e-5 of the pupil apart: rounding moves their crossing so far.
const FOCUS_MM: f64 = 2e-6;

/// At the primary wavelength.
const OPD_WAVES: f64 = 1e-7;

/// At the others, where Optiland has the exit pupil of the primary one.
const OTHER_COLOURS_WAVES: f64 = 5e-5;

/// What sums over 200 rays across tell of contrast.
const CONTRAST: f64 = 0.003;

/// What Optiland's own contrast is off for taking directions in proportion to places in the pupil, through an F/3 that is not
/// corrected.
const PROPORTION: f64 = 0.02;

struct Row<'a> {
    lens: &'a str,
    radius_mm: f64,
    slope: f64,
    wavelength_nm: f64,
    kind: &'a str,
    numbers: [f64; 3],
}

impl<'a> Row<'a> {
    fn of(line: &'a str) -> Self {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |k: usize| cells[k].parse::<f64>().expect("a number");
        Self {
            lens: cells[0],
            radius_mm: 0.5 * number(1),
            slope: number(2).to_radians().tan(),
            wavelength_nm: number(3),
            kind: cells[4],
            numbers: [number(5), number(6), number(7)],
        }
    }
}

/// The lens, its stop and its primary wavelength.
fn lens(name: &str) -> (Prescription, usize, f64) {
    let (text, wavelength_nm) = match name {
        "cooke-triplet" => (include_str!("../lenses/cooke-triplet.toml"), 550.0),
        _ => (include_str!("../lenses/double-gauss.toml"), 587.6),
    };
    let lens = Prescription::from_toml(text).expect("a lens");
    let stop = lens.stop().expect("a stop");
    (lens, stop, wavelength_nm)
}

#[test]
fn wavefronts_foci_and_contrast_are_where_optiland_has_them() {
    let (mut seen, mut last) = ([0; 3], None);
    for row in include_str!("../published/optiland-images.csv").lines().skip(6).map(Row::of) {
        let (lens, stop, primary_nm) = lens(row.lens);
        // Optiland's stop is as wide as a real ray from the rim of the entrance pupil has it.
        let primary = Train::new(&lens, &[], primary_nm).expect("glasses that ship");
        let on_axis = Field::Infinite { slope: [0.0; 2] };
        let stop_radius_mm = primary.height_at_stop_mm(stop, on_axis, row.radius_mm).expect("a marginal ray");
        let train = Train::new(&lens, &[], row.wavelength_nm).expect("glasses that ship");
        let imager = Imager::through_stop(train, row.wavelength_nm, Some(stop), stop_radius_mm);
        let sight = imager.sight(Field::Infinite { slope: [0.0, row.slope] }).expect("a chief ray");
        let is_near = |found: f64, expected: f64, tolerance: f64| {
            assert!(
                (found - expected).abs() < tolerance,
                "{} {} {} nm: {found} {expected}",
                row.lens,
                row.slope,
                row.wavelength_nm
            );
        };
        let [a, b, c] = row.numbers;
        match row.kind {
            "chief" => {
                let foci = sight.foci().expect("rays");
                is_near(sight.chief_mm()[1], a, CHIEF_MM);
                is_near(foci.tangential_mm, b, FOCUS_MM);
                is_near(foci.sagittal_mm, c, FOCUS_MM);
                seen[0] += 1;
            }
            "opd" => {
                let deviation = sight.deviations(&[[a, b]])[0].expect("a ray");
                let tolerance = if row.wavelength_nm == primary_nm { OPD_WAVES } else { OTHER_COLOURS_WAVES };
                is_near(deviation.opd_mm / sight.wavelength_mm(), c, tolerance);
                seen[1] += 1;
            }
            kind => {
                let tolerance = if kind == "sum" { CONTRAST } else { PROPORTION };
                // Rows of one point of the field follow each other.
                let point = (row.lens, row.slope);
                let (_, pupil) = match last.take().filter(|(of, _)| *of == point) {
                    Some(known) => last.insert(known),
                    None => last.insert((point, sight.pupil_function(256).expect("light"))),
                };
                let contrast = pupil.contrasts(&[a])[0];
                is_near(contrast.tangential, b, tolerance);
                is_near(contrast.sagittal, c, tolerance);
                seen[2] += 1;
            }
        }
    }
    assert_eq!(seen, [18, 144, 40]);
}
