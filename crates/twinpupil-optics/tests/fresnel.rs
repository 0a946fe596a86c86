//! The Fresnel lens as a camera: rays kept count of, first order in the limit, and the response of points.

use proptest::prelude::*;
use twinpupil_instrument::{
    FresnelLens, Glass, GrooveSide, ImagePoint, Instrument, Lens, Prescription, PrescriptionLens, PrescriptionSpec,
    paper,
};
use twinpupil_optics::{
    BandOptics, Camera, Fate, ObjectRays, Ray, RayLedger, RayStarts, Rays, Train, response_grids, response_table_for,
};

fn instrument(grooves: &str) -> Instrument {
    let lens = format!("model = \"fresnel\"\ngrooves = \"{grooves}\"");
    Instrument::from_toml(&paper::INSTRUMENT_TOML.replacen("model = \"thin\"", &lens, 1)).expect("a legal lens")
}

fn trace(optics: &BandOptics, image_mm: [f64; 2], pupil: &[[f64; 2]]) -> (ObjectRays, RayLedger) {
    let (pupil_x, pupil_y): (Vec<f64>, Vec<f64>) = pupil.iter().map(|[x, y]| (*x, *y)).unzip();
    let (image_x_mm, image_y_mm) = (vec![image_mm[0]; pupil.len()], vec![image_mm[1]; pupil.len()]);
    let starts = RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
    let (mut rays, mut ledger) = (ObjectRays::default(), RayLedger::default());
    optics.trace(starts, &mut rays, &mut ledger);
    (rays, ledger)
}

/// Uniform points of the unit disc.
fn spiral(count: usize) -> Vec<[f64; 2]> {
    let point = |k: usize| {
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let azimuth = 2.399_963_229_728_653 * k as f64;
        [radius * azimuth.cos(), radius * azimuth.sin()]
    };
    (0..count).map(point).collect()
}

#[test]
fn every_ray_has_one_fate() {
    for grooves in ["object", "image"] {
        for optics in Camera::new(&instrument(grooves)).unwrap().bands() {
            let mut sum = RayLedger::default();
            for k in 0..40_i32 {
                let (rays, ledger) =
                    trace(optics, [0.17 * f64::from(k) - 3.0, 0.11 * f64::from(k) - 2.2], &spiral(500));
                let alive = rays.weight.iter().filter(|weight| **weight > 0.0).count();
                assert_eq!(alive as u64, ledger.arrived);
                sum.merge(&ledger);
            }
            assert_eq!((sum.launched, sum.total()), (20_000, 20_000));
            assert!(sum.arrived > 15_000, "{sum:?}");
        }
    }
}

#[test]
fn near_the_axis_the_camera_images_to_first_order_at_its_own_focal_length() {
    for grooves in ["object", "image"] {
        let instrument = instrument(grooves);
        let camera = Camera::new(&instrument).unwrap();
        for (band, optics) in instrument.bands.iter().zip(camera.bands()) {
            let focal_length_mm = optics.focal_length_mm();
            let own = twinpupil_instrument::Projection { focal_length_mm, ..instrument.projection(band) };
            // In the clear field; aberrations grow with the cube of the height.
            let image = own.image([3.0, 0.0, 320.0]);
            let (rays, _) = trace(optics, [image.x_mm, image.y_mm], &[[0.0, 0.0]]);
            let x_mm = rays.x_mm[0] + 320.0 * rays.slope_x[0];
            assert!((x_mm - 3.0).abs() < 0.01, "{grooves} {}: {x_mm}", band.name);
        }
    }
}

#[test]
fn a_point_image_is_where_a_dense_bundle_says() {
    // Monte Carlo over sensor and pupil against rays aimed at the point: a small disc stands in for the point.
    let instrument = instrument("object");
    for optics in Camera::new(&instrument).unwrap().bands() {
        let object_mm = [2.6, 0.0, 330.0];
        let expected = optics.point_image(object_mm);
        let pupil = spiral(200);
        let (mut light, mut moment) = (0.0, 0.0);
        let (reach_mm, cells, spot_mm) = (0.3, 90, 0.05);
        for k in 0..cells * cells {
            let at = |i: i32| reach_mm * (2.0 * (f64::from(i) + 0.5) / f64::from(cells) - 1.0);
            let image_mm = [expected.centroid.x_mm + at(k % cells), expected.centroid.y_mm + at(k / cells)];
            let (rays, _) = trace(optics, image_mm, &pupil);
            for j in 0..pupil.len() {
                let x = rays.x_mm[j] + object_mm[2] * rays.slope_x[j] - object_mm[0];
                if x.hypot(rays.y_mm[j] + object_mm[2] * rays.slope_y[j]) < spot_mm {
                    light += rays.weight[j];
                    moment += rays.weight[j] * image_mm[0];
                }
            }
        }
        let cell_mm2 = (2.0 * reach_mm / f64::from(cells)).powi(2);
        let magnification = optics.projection().magnification(object_mm[2]);
        let unclipped = std::f64::consts::PI * (spot_mm * magnification).powi(2) / cell_mm2 * pupil.len() as f64;
        assert!((moment / light - expected.centroid.x_mm).abs() < 2e-3, "{} {expected:?}", moment / light);
        assert!((light / unclipped - expected.throughput).abs() < 0.05, "{} {expected:?}", light / unclipped);
    }
}

#[test]
fn the_response_table_is_bright_and_smooth_outside_the_clip_radius() {
    let instrument = instrument("object");
    let table = response_table_for(&instrument).unwrap();
    assert_eq!((table.r_mm, table.z_mm), response_grids(&instrument));
    for band in 0..2 {
        let deviation_mm = |r_mm: f64| table.at(band, r_mm, 300.0).radial_deviation_mm;
        for r_mm in (30..80).map(|k| f64::from(k) * 0.1) {
            let throughput = table.at(band, r_mm, 300.0).throughput;
            assert!((0.93..1.02).contains(&throughput), "{r_mm}: {throughput}");
            let bend_mm = deviation_mm(r_mm + 0.1) - 2.0 * deviation_mm(r_mm) + deviation_mm(r_mm - 0.1);
            assert!(bend_mm.abs() < 2e-3, "{r_mm}: {bend_mm}");
        }
    }
}

#[test]
fn a_pupil_in_front_of_the_lens_is_filled() {
    let mut spec = instrument("object").into_spec();
    spec.apertures[0].position_mm = -15.0;
    let camera = Camera::new(&Instrument::new(spec).expect("legal")).unwrap();
    let blue = &camera.bands()[1];
    let (rays, ledger) = trace(blue, [3.0, 1.0], &spiral(4000));
    assert_eq!(ledger.total(), 4000);
    let mean = rays.weight.iter().sum::<f64>() / 4000.0;
    // cos⁴ of 1.2 degrees, the losses in the grooves, and the distortion of the pupil by its image through the lens.
    assert!((mean - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn what_cannot_be_traced_is_refused_with_one_sentence() {
    let edited = |to: &str| {
        let text = paper::INSTRUMENT_TOML.replacen("model = \"thin\"", &format!("model = \"fresnel\"\n{to}"), 1);
        Camera::new(&Instrument::from_toml(&text).unwrap()).expect_err("must be refused").to_string()
    };
    let message = edited("material = \"glass\"");
    assert!(message.starts_with("`lens.material` is glass; legal: one of"), "{message}");
    assert!(edited("design_wavelength_nm = 300.0").contains("300 nm is outside"));
    assert!(edited("thickness_mm = 0.01").contains("`lens.thickness_mm` is 0.01"));
}

proptest! {
    #[test]
    fn rays_stay_in_their_footprint(
        object in any::<bool>(), band in 0..2_usize, x in -5.6..5.6_f64, y in -3.5..3.5_f64, radius in 0.0..0.5_f64,
        rho in 0.0..1.0_f64, pupil_azimuth in 0.0..6.3_f64, sigma in 0.0..1.0_f64, azimuth in 0.0..6.3_f64,
        z_mm in 220.0..400.0_f64,
    ) {
        let side = if object { GrooveSide::Object } else { GrooveSide::Image };
        let camera = Camera::new(&instrument(if side == GrooveSide::Object { "object" } else { "image" })).unwrap();
        let optics = &camera.bands()[band];
        let centre = ImagePoint { x_mm: x, y_mm: y };
        let image = [x + radius * sigma * azimuth.cos(), y + radius * sigma * azimuth.sin()];
        let (rays, _) = trace(optics, image, &[[rho * pupil_azimuth.cos(), rho * pupil_azimuth.sin()]]);
        let pencil = optics.pencil(centre, radius);
        let point = pencil.part(ImagePoint { x_mm: image[0], y_mm: image[1] }, 0.0);
        for footprint in [pencil.footprint(z_mm), point.footprint(z_mm)] {
            let (dx, dy) = (
                rays.x_mm[0] + z_mm * rays.slope_x[0] - footprint.x_mm,
                rays.y_mm[0] + z_mm * rays.slope_y[0] - footprint.y_mm,
            );
            prop_assert!(rays.weight[0] == 0.0 || dx.hypot(dy) <= footprint.radius_mm);
        }
        prop_assert!(!optics.is_unclipped(centre, radius));
    }

    #[test]
    fn turning_everything_about_the_axis_turns_the_ray(
        band in 0..2_usize, x in -4.0..4.0_f64, y in -2.0..2.0_f64, u in -0.6..0.6_f64, v in -0.6..0.6_f64,
        angle in 0.0..6.3_f64,
    ) {
        let camera = Camera::new(&instrument("object")).unwrap();
        let (sin, cos) = angle.sin_cos();
        let turn = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let optics = &camera.bands()[band];
        let (straight, ledger) = trace(optics, [x, y], &[[u, v]]);
        let (turned, _) = trace(optics, turn([x, y]), &[turn([u, v])]);
        prop_assume!(ledger.arrived == 1);
        let expected = turn([straight.x_mm[0], straight.y_mm[0]]);
        prop_assert!((turned.x_mm[0] - expected[0]).abs() < 1e-9 && (turned.y_mm[0] - expected[1]).abs() < 1e-9);
        prop_assert!((turned.weight[0] - straight.weight[0]).abs() < 1e-12);
    }
}

/// The lens of the camera as a prescription, with an image behind it.
fn prescription(lens: &FresnelLens, image_behind_mm: f64) -> Prescription {
    let grooves = format!(
        "[[surface]]\nshape = {{ kind = \"facets\", focal_length_mm = {:?}, pitch_mm = {:?}, draft_deg = {:?}, \
         design_wavelength_nm = {:?} }}\nhalf_size_mm = {:?}\n",
        lens.focal_length_mm,
        lens.groove_pitch_mm,
        lens.draft_deg,
        lens.design_wavelength_nm,
        lens.size_mm.map(|mm| 0.5 * mm)
    );
    let flat = format!("[[surface]]\nhalf_size_mm = {:?}\n", lens.size_mm.map(|mm| 0.5 * mm));
    let [first, last] = match lens.grooves {
        GrooveSide::Object => [grooves, flat],
        GrooveSide::Image => [flat, grooves],
    };
    let inside = format!("medium = \"PMMA\"\ngap_mm = {:?}\n", lens.thickness_mm);
    Prescription::from_toml(&format!("{first}{inside}{last}gap_mm = {image_behind_mm:?}\n")).expect("a lens")
}

/// The same facets among other surfaces.
#[test]
fn a_train_of_facets_has_the_rays_of_the_camera() {
    for side in ["object", "image"] {
        let instrument = instrument(side);
        let Lens::Fresnel(lens) = &instrument.lens else { panic!("a Fresnel lens") };
        let n_d = Glass::built_in("pmma", "").unwrap().index(lens.design_wavelength_nm).unwrap();
        // Principal planes behind the first face: one in the plane of the peaks, the other thickness/n from the flat face.
        let [front_mm, rear_mm] = match lens.grooves {
            GrooveSide::Object => [0.0, lens.thickness_mm * (1.0 - 1.0 / n_d)],
            GrooveSide::Image => [lens.thickness_mm / n_d, lens.thickness_mm],
        };
        let (l_mm, mut walls) = (instrument.sensor.distance_mm, 0);
        // The pupil in the focal plane, 51 mm in front of the sensor.
        let band = instrument.bands.iter().position(|band| band.name == "red").unwrap();
        let camera = Camera::new(&instrument).unwrap();
        let prescription = prescription(lens, rear_mm + l_mm - lens.thickness_mm);
        let forward = Train::new(&prescription, &[], instrument.bands[band].wavelength_nm).expect("a lens");
        let train = forward.reversed();
        for k in 0..60_i32 {
            let image_mm = [0.17 * f64::from(k) - 5.0, 0.11 * f64::from(k) - 3.2];
            let pupil = spiral(100);
            let (found, _) = trace(&camera.bands()[band], image_mm, &pupil);
            let to_pupil = |[u, v]: &[f64; 2]| {
                let away = [0.5 * u + image_mm[0], 0.5 * v + image_mm[1], 100.0 - l_mm];
                Ray::new([-image_mm[0], -image_mm[1], 0.0], away)
            };
            let starts: Vec<Ray> = pupil.iter().map(to_pupil).collect();
            let mut rays: Rays = starts.iter().copied().collect();
            let ledger = train.trace(&mut rays);
            assert_eq!((ledger.launched, ledger.total()), (100, 100));
            for (n, (ray, fate)) in rays.iter().enumerate() {
                walls += usize::from(matches!(fate, Fate::GrooveWall { .. }));
                if found.weight[n] == 0.0 {
                    continue;
                }
                assert_eq!(fate, Fate::Arrived, "{side} {k} {n}");
                let ([x, y, z], [dx, dy, dz]) = (ray.position_mm, ray.direction);
                let at = |c: f64, d: f64| c + (front_mm - z) * d / dz;
                for (found, expected) in [
                    (found.x_mm[n], at(x, dx)),
                    (found.y_mm[n], at(y, dy)),
                    (found.slope_x[n], -dx / dz),
                    (found.slope_y[n], -dy / dz),
                ] {
                    assert!((found - expected).abs() < 1e-9, "{side} {k} {n}: {found} {expected}");
                }
                // And back, by the same way.
                let (met, fate) = forward.path(&Ray { direction: [-dx, -dy, -dz], path_mm: 0.0, ..ray });
                assert_eq!(fate, Fate::Arrived);
                let home = met[met.len() - 1];
                for c in 0..3 {
                    assert!((home.position_mm[c] - starts[n].position_mm[c]).abs() < 1e-8, "{home:?} {:?}", starts[n]);
                }
                assert!((home.path_mm - ray.path_mm).abs() < 1e-8, "{home:?} {ray:?}");
            }
        }
        assert!(walls > 0);
    }
}

/// The camera of a Fresnel lens, and the same one with the lens surface by surface.
#[test]
fn a_camera_of_facets_sees_as_the_fresnel_lens_does() {
    let fresnel = instrument("image");
    let Lens::Fresnel(lens) = &fresnel.lens else { panic!("a Fresnel lens") };
    let mut spec = fresnel.clone().into_spec();
    spec.lens = Lens::Prescription(Box::new(PrescriptionLens {
        prescription: Some(PrescriptionSpec::clone(&prescription(lens, 100.0))),
        design_wavelength_nm: lens.design_wavelength_nm,
        ..PrescriptionLens::default()
    }));
    let facets = Instrument::new(spec).expect("a legal camera");
    let [known, own] = [&fresnel, &facets].map(|instrument| Camera::new(instrument).expect("a camera"));
    for (known, own) in known.bands().iter().zip(own.bands()) {
        assert!((known.focal_length_mm() / own.focal_length_mm() - 1.0).abs() < 1e-9);
        for k in 0..20_i32 {
            let image_mm = [0.31 * f64::from(k) - 3.0, 0.17 * f64::from(k) - 1.2];
            let [known, own] = [known, own].map(|band| trace(band, image_mm, &spiral(100)).0);
            let arrived = (0..100).filter(|n| known.weight[*n] > 0.0 && own.weight[*n] > 0.0).collect::<Vec<_>>();
            // At most a ray that grazes the edge of a mask or a wall may end otherwise.
            let lost = |rays: &ObjectRays| rays.weight.iter().filter(|weight| **weight == 0.0).count();
            assert!(lost(&known).abs_diff(lost(&own)) <= 1, "{image_mm:?}");
            for n in arrived {
                for (known, own) in [
                    (known.x_mm[n], own.x_mm[n]),
                    (known.y_mm[n], own.y_mm[n]),
                    (known.slope_x[n], own.slope_x[n]),
                    (known.slope_y[n], own.slope_y[n]),
                    (known.weight[n], own.weight[n]),
                ] {
                    assert!((known - own).abs() < 1e-6, "{image_mm:?} {n}: {known} {own}");
                }
            }
        }
    }
}

#[test]
fn a_train_of_facets_is_a_lens_of_its_focal_length() {
    for side in ["object", "image"] {
        let Lens::Fresnel(lens) = &instrument(side).lens.clone() else { panic!("a Fresnel lens") };
        let train = Train::new(&prescription(lens, 98.0), &[], lens.design_wavelength_nm).expect("a lens");
        let first_order = train.first_order(None);
        assert!((first_order.focal_length_mm - 100.0).abs() < 1e-9, "{first_order:?}");
        // On the axis facets hold what the profile of the lens does.
        let (met, fate) = train.path(&Ray::new([0.1, 0.0, -1.0], [0.0, 0.0, 1.0]));
        assert_eq!(fate, Fate::Arrived);
        let slope = met[2].direction[0] / met[2].direction[2];
        assert!((slope + 0.001).abs() < 1e-8, "{slope}");
    }
}

#[test]
fn facets_that_cannot_be_are_refused_with_their_key() {
    let said = |text: &str| {
        let lens = Prescription::from_toml(text).expect("legal by itself");
        Train::new(&lens, &[], 587.6).unwrap_err().to_string()
    };
    let shape = "shape = { kind = \"facets\", focal_length_mm = 100.0, pitch_mm = 0.25 }";
    assert_eq!(
        said(&format!("[[surface]]\n{shape}\nsemi_diameter_mm = 20.0")),
        "`surface[0].medium` is air; legal: glass on one side of facets and air on the other"
    );
    let glass = "medium = \"PMMA\"\ngap_mm = 2.0\n[[surface]]";
    assert!(said(&format!("[[surface]]\n{shape}\n{glass}")).starts_with("`surface[0].semi_diameter_mm` is missing"));
    let thin = glass.replace("2.0", "0.01");
    let deep = said(&format!("[[surface]]\n{shape}\nsemi_diameter_mm = 20.0\n{thin}"));
    assert!(deep.contains("0.01") && deep.contains("deeper"), "{deep}");
}
