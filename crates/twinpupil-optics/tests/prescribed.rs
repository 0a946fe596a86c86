//! Cameras whose lens is given surface by surface.

use twinpupil_instrument::{
    Grid, ImagePoint, Instrument, InstrumentError, Lens, Prescription, PrescriptionLens, Projection, paper,
};
use twinpupil_optics::{BandOptics, Camera, ObjectRays, RayLedger, RayStarts, Train, response_table};

/// Of the design of the double Gauss, nm.
const DESIGN_NM: f64 = 587.6;

/// The paper's camera with another `[lens]`, and other replacements.
fn camera(lens: &str, replaced: &[(&str, &str)]) -> Result<Instrument, InstrumentError> {
    let (before, rest) = paper::INSTRUMENT_TOML.split_once("[lens]").expect("a lens");
    let (_, behind) = rest.split_once("[sensor]").expect("a sensor");
    let text = format!("{before}[lens]\nmodel = \"prescription\"\n{lens}\n[sensor]{behind}");
    Instrument::from_toml(&replaced.iter().fold(text, |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replacen(from, to, 1)
    }))
}

/// The double Gauss with the entocentric mask at its stop and the telecentric one in its focal plane.
fn double_gauss(replaced: &[(&str, &str)]) -> Instrument {
    let lens = include_str!("lenses/double-gauss.toml").replace("[[surface]]", "[[lens.prescription.surface]]");
    let lens = lens.replace("name = \"double Gauss F/2\"", "");
    let masks = [
        ("position_mm = 0.0", "position_mm = 0.0\nsurface = 5"),
        ("position_mm = 100.0", "position_mm = 61.4875\nsurface = 10"),
    ];
    camera(&lens, &[&masks, replaced].concat()).expect("a legal camera")
}

const SINGLET: &str = r#"
[[lens.prescription.surface]]
shape = { kind = "sphere", radius_mm = 100.0 }
gap_mm = 6.0
medium = "N-BK7"
[[lens.prescription.surface]]
shape = { kind = "sphere", radius_mm = -100.0 }
"#;

const IDEAL: &str = r#"
[[lens.prescription.surface]]
shape = { kind = "thin-lens", focal_length_mm = 100.0 }
"#;

#[test]
fn an_ideal_lens_as_a_prescription_is_the_thin_lens() {
    let front = "\n[[aperture]]\nposition_mm = -12.0\ncentre_mm = [0.3, -0.2]\n\
                 zones = [{ radius_mm = 9.0, pass = [\"red\", \"blue\"] }]\n";
    let thin = Instrument::from_toml(&(paper::INSTRUMENT_TOML.to_owned() + front)).expect("legal");
    let mut spec = camera(IDEAL, &[]).expect("legal").into_spec();
    spec.apertures.clone_from(&thin.apertures);
    let prescribed = Instrument::new(spec).expect("legal");
    let grids = [Grid::spanning(0.5, 9.0, 18), Grid::spanning(240.0, 360.0, 4), Grid::spanning(0.0, 6.0, 5)];
    let [ideal, found] = [&thin, &prescribed]
        .map(|instrument| response_table(&Camera::new(instrument).expect("legal"), grids[0], grids[1], grids[2]));
    for (ideal, found) in ideal.bands.iter().zip(&found.bands) {
        assert!((ideal.focal_length_mm - found.focal_length_mm).abs() < 1e-12);
        for (a, b) in ideal.nodes.iter().zip(&found.nodes) {
            assert!((a.throughput - b.throughput).abs() < 1e-9, "{a:?} {b:?}");
            assert!((a.radial_deviation_mm - b.radial_deviation_mm).abs() < 1e-9, "{a:?} {b:?}");
            let spread = [b.spread.growth_mm, b.spread.stretch_mm, b.spread.spherical_mm];
            let added_mm = spread.into_iter().chain(b.spread.coma_mm).chain([b.aberration_mm]);
            assert!(added_mm.into_iter().all(|mm| mm.abs() < 1e-9), "{b:?}");
        }
        assert_eq!(ideal.ground, found.ground);
    }
}

#[test]
fn a_mask_at_the_stop_appears_where_the_pupil_of_the_lens_is() {
    let instrument = double_gauss(&[("wavelength_nm = 450.0", "wavelength_nm = 587.6")]);
    let Lens::Prescription(lens) = &instrument.lens else { panic!("a prescription") };
    let prescription = Prescription::new(lens.prescription.clone().expect("surfaces")).expect("legal");
    let first_order = Train::new(&prescription, &[], DESIGN_NM).expect("glasses").first_order(prescription.stop());
    let pupil = first_order.entrance_pupil.expect("a stop");
    let blue = instrument.projection(&instrument.bands[1]);
    assert!((blue.focal_length_mm - first_order.focal_length_mm).abs() < 1e-10);
    assert!((blue.pupil_position_mm - (pupil.position_mm - first_order.front_principal_mm)).abs() < 1e-10);
    assert!((blue.pupil_radius_mm - pupil.magnification).abs() < 1e-12);
}

#[test]
fn rays_near_the_axis_go_where_first_order_says() {
    let instrument = double_gauss(&[
        ("wavelength_nm = 450.0", "wavelength_nm = 587.6"),
        ("wavelength_nm = 680.0", "wavelength_nm = 587.6"),
    ]);
    for (band, optics) in instrument.bands.iter().zip(Camera::new(&instrument).expect("legal").bands()) {
        let projection: Projection = instrument.projection(band);
        for z_mm in [250.0, 340.0] {
            let image = projection.image([0.01, -0.02, z_mm]);
            let starts =
                RayStarts { image_x_mm: &[image.x_mm], image_y_mm: &[image.y_mm], pupil_x: &[0.0], pupil_y: &[0.0] };
            let mut rays = ObjectRays::default();
            optics.trace(starts, &mut rays, &mut RayLedger::default());
            let at = [rays.x_mm[0] + z_mm * rays.slope_x[0], rays.y_mm[0] + z_mm * rays.slope_y[0]];
            assert!((at[0] - 0.01).hypot(at[1] + 0.02) < 1e-6, "{} {z_mm}: {at:?}", band.name);
        }
    }
}

#[test]
fn rays_are_aimed_at_the_whole_pupil_and_at_nothing_else() {
    // The pupil alone, so that it alone can stop a ray.
    let mut spec = double_gauss(&[]).into_spec();
    spec.apertures.truncate(1);
    spec.apertures[0].zones[0].pass = vec!["red".to_owned(), "blue".to_owned()];
    spec.apertures[0].zones.truncate(1);
    let instrument = Instrument::new(spec).expect("legal");
    for optics in Camera::new(&instrument).expect("legal").bands() {
        for image_mm in [[0.0, 0.0], [3.0, -2.0], [5.6, 3.5]] {
            let rim = |radius: f64| {
                let angles: Vec<f64> = (0..64).map(|k| f64::from(k) / 64.0 * std::f64::consts::TAU).collect();
                let along = |of: fn(f64) -> f64| angles.iter().map(|angle| radius * of(*angle)).collect::<Vec<_>>();
                let (pupil_x, pupil_y) = (along(f64::cos), along(f64::sin));
                let (x, y) = (vec![image_mm[0]; 64], vec![image_mm[1]; 64]);
                let starts = RayStarts { image_x_mm: &x, image_y_mm: &y, pupil_x: &pupil_x, pupil_y: &pupil_y };
                let mut ledger = RayLedger::default();
                optics.trace(starts, &mut ObjectRays::default(), &mut ledger);
                assert_eq!((ledger.launched, ledger.total()), (64, 64));
                ledger.arrived
            };
            assert_eq!((rim(0.999_999), rim(1.000_001)), (64, 0), "{} {image_mm:?}", optics.name());
        }
    }
}

/// Pupil points all over the disc, and the same ray from one image point to each.
fn traced(optics: &BandOptics, image: ImagePoint) -> ([Vec<f64>; 2], ObjectRays, RayLedger) {
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let place = |k: u32, of: fn(f64) -> f64| (f64::from(k) / 500.0).sqrt() * of(golden_angle * f64::from(k));
    let pupil = [f64::cos, f64::sin].map(|of| (0..500).map(|k| place(k, of)).collect::<Vec<f64>>());
    let [x, y] = [image.x_mm, image.y_mm].map(|mm| vec![mm; 500]);
    let starts = RayStarts { image_x_mm: &x, image_y_mm: &y, pupil_x: &pupil[0], pupil_y: &pupil[1] };
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    optics.trace(starts, &mut rays, &mut ledger);
    (pupil, rays, ledger)
}

#[test]
fn a_ray_map_says_what_tracing_does() {
    // Masks off the axis and a lens that leans, so that nothing is symmetric.
    let leaning = SINGLET.replacen("gap_mm = 6.0", "tilt_deg = [1.0, -0.5, 0.0]\ngap_mm = 6.0", 1);
    let singlet =
        camera(&leaning, &[("position_mm = 0.0", "position_mm = 3.0\ncentre_mm = [0.2, -0.1]")]).expect("legal");
    for instrument in [double_gauss(&[]), singlet] {
        let (mut clipped, mut clear) = (0, 0);
        for optics in Camera::new(&instrument).expect("legal").bands() {
            for (x_mm, y_mm) in [(0.3, 0.2), (1.2, -1.0), (-5.0, 3.0), (5.3, 3.2)] {
                let map = optics.ray_map(ImagePoint { x_mm, y_mm }, 0.27).expect("a smooth lens");
                for (dx_mm, dy_mm) in [(0.0, 0.0), (0.19, 0.19), (-0.26, 0.03)] {
                    let image = ImagePoint { x_mm: x_mm + dx_mm, y_mm: y_mm + dy_mm };
                    let ([u, v], expected, counted) = traced(optics, image);
                    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
                    map.trace(image, [&u, &v], &mut rays, &mut ledger);
                    assert_eq!(ledger, counted, "{} {image:?}", optics.name());
                    *if ledger.arrived < ledger.launched { &mut clipped } else { &mut clear } += 1;
                    for k in (0..500).filter(|k| expected.weight[*k] > 0.0) {
                        let off = |a: &[f64], b: &[f64]| (a[k] - b[k]).abs();
                        assert!(off(&rays.x_mm, &expected.x_mm) < 2e-7 && off(&rays.y_mm, &expected.y_mm) < 2e-7);
                        assert!(off(&rays.slope_x, &expected.slope_x) < 2e-9);
                        assert!(off(&rays.slope_y, &expected.slope_y) < 2e-9);
                        assert!(off(&rays.weight, &expected.weight) < 2e-7);
                    }
                }
            }
        }
        assert!(clipped > 0 && clear > 0, "{clipped} {clear}");
    }
}

#[test]
fn a_lens_that_stops_rays_has_no_ray_map() {
    let map = |surface: &str| {
        let lens = SINGLET.replacen("medium = \"N-BK7\"", &format!("medium = \"N-BK7\"\n{surface}"), 1);
        let instrument = camera(&lens, &[("position_mm = 0.0", "position_mm = 3.0")]).expect("legal");
        let made =
            Camera::new(&instrument).expect("legal").bands()[1].ray_map(ImagePoint { x_mm: 4.0, y_mm: 0.0 }, 0.2);
        made.is_some()
    };
    assert!(map("semi_diameter_mm = 3.0"));
    assert!(!map("semi_diameter_mm = 0.9"));
    assert!(!map("hole_radius_mm = 0.1"));
    // Nor has one that is not traced surface by surface.
    let thin = Camera::new(&paper::instrument()).expect("legal");
    assert!(thin.bands()[0].ray_map(ImagePoint { x_mm: 1.0, y_mm: 0.0 }, 0.2).is_none());
}

#[test]
fn a_point_image_is_where_a_dense_bundle_says() {
    // Monte Carlo over sensor and pupil against rays aimed at the point: a small disc stands in for the point.
    let instrument = double_gauss(&[]);
    for optics in Camera::new(&instrument).expect("legal").bands() {
        let object_mm = [2.6, 0.0, 330.0];
        let expected = optics.point_image(object_mm);
        let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let point = |k: u32| {
            let (sin, cos) = (golden_angle * f64::from(k)).sin_cos();
            let radius = ((f64::from(k) + 0.5) / 200.0).sqrt();
            (radius * cos, radius * sin)
        };
        let (pupil_x, pupil_y): (Vec<f64>, Vec<f64>) = (0..200).map(point).unzip();
        let (mut light, mut moment) = (0.0, 0.0);
        let (reach_mm, cells, spot_mm) = (0.3, 90, 0.05);
        let mut rays = ObjectRays::default();
        for k in 0..cells * cells {
            let at = |i: i32| reach_mm * (2.0 * (f64::from(i) + 0.5) / f64::from(cells) - 1.0);
            let x = vec![expected.centroid.x_mm + at(k % cells); pupil_x.len()];
            let y = vec![expected.centroid.y_mm + at(k / cells); pupil_x.len()];
            let starts = RayStarts { image_x_mm: &x, image_y_mm: &y, pupil_x: &pupil_x, pupil_y: &pupil_y };
            optics.trace(starts, &mut rays, &mut RayLedger::default());
            for (j, x_mm) in x.iter().enumerate() {
                let off_x = rays.x_mm[j] + object_mm[2] * rays.slope_x[j] - object_mm[0];
                if off_x.hypot(rays.y_mm[j] + object_mm[2] * rays.slope_y[j]) < spot_mm {
                    light += rays.weight[j];
                    moment += rays.weight[j] * x_mm;
                }
            }
        }
        let cell_mm2 = (2.0 * reach_mm / f64::from(cells)).powi(2);
        let magnification = optics.projection().magnification(object_mm[2]);
        let unclipped = std::f64::consts::PI * (spot_mm * magnification).powi(2) / cell_mm2 * pupil_x.len() as f64;
        assert!((moment / light - expected.centroid.x_mm).abs() < 1e-3, "{} {expected:?}", moment / light);
        assert!((light / unclipped - expected.throughput).abs() < 0.02, "{} {expected:?}", light / unclipped);
    }
}

#[test]
fn masks_in_glass_are_refused_with_what_to_state() {
    let said = |replaced: &[(&str, &str)]| camera(SINGLET, replaced).expect_err("must be refused").to_string();
    let message = said(&[]);
    let expected = "`aperture[0].position_mm` is 0; legal: below ";
    assert!(message.starts_with(expected) && message.contains("within it state `surface`"), "{message}");
    let at = |place: &str| said(&[("position_mm = 0.0", place)]);
    assert!(at("position_mm = 2.0\nsurface = 0").contains("`aperture[0].position_mm` is 2; legal: 0 or 6, for there"));
    assert!(at("position_mm = 2.0\nsurface = 2").contains("`aperture[0].surface` is 2; legal: 0 to 1"));
    assert!(at("position_mm = -2.0\nsurface = 1").contains("`aperture[0].position_mm` is -2; legal: 0 to"));
    assert!(camera(SINGLET, &[("position_mm = 0.0", "position_mm = 6.0\nsurface = 0")]).is_ok());
    let cylinder =
        SINGLET.replacen("\"sphere\", radius_mm = 100.0", "\"cylinder\", curved = \"x\", radius_mm = 100.0", 1);
    let message = camera(&cylinder, &[]).expect_err("must be refused").to_string();
    assert!(message.contains("`lens.prescription.surface[0]` is a break or a cylinder"), "{message}");
    let file = camera("file = \"lens.zmx\"", &[]).expect_err("must be refused").to_string();
    assert_eq!(file, "`lens.file` is lens.zmx; legal: a file that has been read");
}

#[test]
fn lenses_that_bend_no_light_are_refused_in_words() {
    let said = |lens: &str| camera(lens, &[]).expect_err("must be refused").to_string();
    let facets = "[[lens.prescription.surface]]\nshape = { kind = \"facets\", focal_length_mm = 100.0, pitch_mm = 0.25 }\n\
                  semi_diameter_mm = 20.0\n";
    let legal = "glass on one side of facets and air on the other";
    assert_eq!(said(facets), format!("`lens.prescription.surface[0].medium` is air; legal: {legal}"));
    let vacuum = format!(
        "{facets}medium = \"void\"\ngap_mm = 2.0\n[[lens.prescription.surface]]\n[lens.prescription.media.void]\n\
         formula = \"constant\"\ncoefficients = [1.0]"
    );
    for lens in [vacuum.as_str(), "[[lens.prescription.surface]]\nshape = { kind = \"plane\" }\n"] {
        let message = said(lens);
        assert!(message.contains("is a lens that bends no light; legal: 0.1 to 100000"), "{message}");
    }
}

#[test]
fn a_focal_length_scales_the_whole_lens() {
    let lens = format!("focal_length_mm = 50.0\n{SINGLET}");
    let replaced = [
        ("position_mm = 0.0", "position_mm = 0.0\nsurface = 0"),
        ("position_mm = 100.0", "position_mm = 50.0"),
        ("distance_mm = 151.0", "distance_mm = 70.0"),
    ];
    let instrument = camera(&lens, &replaced).expect("legal");
    let Lens::Prescription(lens) = &instrument.lens else { panic!("a prescription") };
    let stand = PrescriptionLens::stand(lens, 70.0).expect("legal");
    let own = Train::new(&stand.prescription, &[], DESIGN_NM).expect("glass").first_order(None);
    assert!((own.focal_length_mm - 50.0).abs() < 1e-12);
    assert!((own.rear_principal_mm + 70.0 - stand.prescription.surfaces[1].gap_mm).abs() < 1e-12);
    assert_eq!(Instrument::from_toml(&instrument.to_toml()).expect("reads back"), instrument);
}
