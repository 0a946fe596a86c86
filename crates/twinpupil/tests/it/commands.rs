//! Good input, from file to file.

use std::io::Read;
use std::process::Stdio;

use crate::program::Workplace;

#[test]
fn wrong_usage_is_code_2_and_help_is_code_0() {
    let workplace = Workplace::new();
    let wrong = [
        "",
        "unknown",
        "instrument show",
        "simulate --instrument paper",
        "instrument paper --threads 0",
        "simulate --instrument paper --scene paper -o f.png --samples 0",
        "reconstruct f.png --instrument paper --json",
        "detect f.png",
        "detect f.png --mosaic rggb",
        "detect f.png --mosaic xyz --plane r",
        "target dot-grid --rows 3 --columns 4 --pitch-mm 2",
        "target dot-grid --rows 3 --columns 4 --pitch-mm 2 --dot-diameter-mm 1 --missing 1",
        "target dot-grid --rows 3 --columns 4 --pitch-mm 2 --dot-diameter-mm 1 --larger 1,1",
        "target dot-grid --rows 3 --columns 4 --pitch-mm 2 --dot-diameter-mm 1 --dark-on-light --light-on-dark",
        "analyze precision --instrument paper --z 350:250",
        "analyze precision --instrument paper --achieved 0",
    ];
    for arguments in wrong {
        let output = workplace.run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{arguments}");
    }
    for arguments in ["--help", "--version", "help fit", "simulate --help"] {
        assert!(!workplace.succeed(arguments).is_empty());
    }
}

#[test]
fn instruments_and_scenes_are_printed_and_read_back() {
    let workplace = Workplace::new();
    workplace.succeed("instrument paper -o paper.toml");
    assert_eq!(workplace.read("paper.toml"), twinpupil_instrument::paper::INSTRUMENT_TOML);
    let printed = workplace.succeed("instrument print paper.toml");
    workplace.write("printed.toml", &printed);
    assert_eq!(workplace.succeed("instrument print printed.toml"), printed);
    assert_eq!(workplace.succeed("instrument show printed.toml"), workplace.succeed("instrument show paper"));

    let scene = workplace.succeed("scene paper");
    workplace.write("scene.toml", &scene);
    assert_eq!(workplace.succeed("scene print scene.toml"), scene);
    for command in ["instrument schema", "scene schema", "target schema", "instrument show paper --json"] {
        let json: serde_json::Value = serde_json::from_str(&workplace.succeed(command)).unwrap();
        assert!(json.is_object(), "{command}");
    }
}

#[test]
fn a_target_is_drawn_and_its_file_read_back() {
    let workplace = Workplace::new();
    let grid = "target dot-grid --rows 3 --columns 4 --pitch-mm 2 --dot-diameter-mm 1 --missing 0,0 --larger 2,3,1.5";
    let svg = workplace.succeed(&format!("{grid} --file target.toml"));
    assert_eq!(svg.matches("<circle").count(), 11);
    workplace.succeed(&format!("{grid} -q -o grid.svg"));
    assert_eq!(workplace.read("grid.svg"), svg);
    let target = workplace.read("target.toml");
    assert_eq!(workplace.succeed("target print target.toml"), target);
    assert!(target.contains("name = \"4 x 3 dots, 2 mm apart\"") && target.contains("diameter_mm = 1.5"), "{target}");

    let output = workplace.run(&format!("{grid} --light-on-dark --margin-mm 3 --name t -o grid.pdf"));
    let note = String::from_utf8(output.stderr).unwrap();
    assert!(note.starts_with("grid.pdf: 13.5 × ") && note.ends_with(" mm, 11 dots\n"), "{note}");
    assert!(std::fs::read(workplace.path("grid.pdf")).unwrap().starts_with(b"%PDF-"));
}

#[test]
fn a_calibration_makes_an_instrument_and_a_page() {
    let workplace = Workplace::new();
    // The paper's camera as it came off the line.
    let camera = twinpupil_instrument::paper::INSTRUMENT_TOML
        .replace("distance_mm = 151.0", "distance_mm = 151.7")
        .replace("[959.5, 599.5]", "[965.1, 595.3]")
        .replace("position_mm = 0.0", "position_mm = 0.0\ncentre_mm = [0.03, -0.04]")
        .replace("position_mm = 100.0", "position_mm = 100.0\ncentre_mm = [-0.04, -0.03]");
    workplace.write("camera.toml", camera);
    let grid = "--rows 7 --columns 9 --pitch-mm 1.5 --dot-diameter-mm 0.9";
    workplace.succeed(&format!("target dot-grid {grid} --file target.toml"));
    let poses = [(258, 0, "y", 3), (286, -30, "y", 8), (300, 30, "y", 0), (314, -28, "x", -10), (342, -15, "y", 2)];
    for (k, (distance_mm, tilt_deg, tilt_axis, turn_deg)) in poses.into_iter().enumerate() {
        let scene = format!(
            "schema = 1\nname = \"pose\"\n[plate]\ndistance_mm = {distance_mm}\ntilt_deg = {tilt_deg}\n\
             tilt_axis = \"{tilt_axis}\"\npattern = \"grid\"\nrows = 7\ncolumns = 9\npitch_mm = 1.5\ndiameter_mm = 0.9\nturn_deg = {turn_deg}\n"
        );
        workplace.write("scene.toml", scene);
        let simulate = "simulate -q --instrument camera.toml --scene scene.toml --samples 64";
        workplace.succeed(&format!("{simulate} --seed {k} -o frame{k}.png"));
    }
    let fixed = "--fix sensor.tilt_deg[0] --fix sensor.tilt_deg[1] \
                 --fix band[0].distortion.k1_per_mm2 --fix band[1].distortion.k1_per_mm2";
    let frames = "frame0.png frame1.png frame2.png frame3.png frame4.png";
    let files = "--instrument paper --target target.toml -o calibrated.toml --report report.html";
    workplace.succeed(&format!("calibrate {frames} {files} {fixed} -q"));
    assert!(workplace.read("calibrated.toml").contains("[calibration]"));
    workplace.succeed("instrument show calibrated.toml");
    let page = workplace.read("report.html");
    assert!(page.starts_with("<!doctype html>") && page.contains("5 of 5") && page.contains("<td>frame3.png</td>"));
    assert!(!page.contains("NaN"));
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let workplace = Workplace::new();
    workplace.write(
        "scene.toml",
        "schema = 1\nname = \"s\"\n[[dot]]\nx_mm = 0.1\ny_mm = 0\nz_mm = 310\ndiameter_mm = 0.2\n",
    );
    let simulate = |rest: &str| {
        workplace.succeed(&format!("simulate --instrument small.toml --scene scene.toml --samples 16 -q {rest}"));
    };
    simulate("-o a.png --threads 1");
    simulate("-o b.png --threads 3");
    simulate("-o c.png --seed 5");
    let bytes = |name: &str| std::fs::read(workplace.path(name)).unwrap();
    assert_eq!(bytes("a.png"), bytes("b.png"));
    assert_ne!(bytes("a.png"), bytes("c.png"));
    simulate("-o d.png --standard-error one.tif --threads 1");
    simulate("-o d.png --standard-error three.tif --threads 3");
    assert!(bytes("one.tif").starts_with(b"II*\0") && bytes("one.tif") == bytes("three.tif"));
    assert!(bytes("one.tif").len() > 4 * 64 * 48);
}

#[test]
fn a_simulated_plate_comes_back() {
    let workplace = Workplace::new();
    let summary =
        workplace.succeed("simulate --instrument paper --scene paper -o f.tiff --truth t.csv --samples 64 --json");
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["dots"], 60);
    let rays = &summary["rays"];
    let blocked: u64 =
        rays["blocked_by_aperture"].as_array().unwrap().iter().filter_map(serde_json::Value::as_u64).sum();
    assert_eq!(rays["launched"].as_u64(), rays["arrived"].as_u64().map(|arrived| arrived + blocked));
    assert_eq!(workplace.read("t.csv").lines().count(), 61);

    let reconstruct = "reconstruct f.tiff --instrument paper --rejected r.csv";
    let summary = workplace.succeed(&format!("{reconstruct} -o p.csv --json"));
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    let points = summary["points"].as_u64().unwrap();
    assert!(points > 45, "{summary}");
    assert_eq!(workplace.read("p.csv").lines().count() as u64, points + 1);
    assert_eq!(workplace.succeed(reconstruct), workplace.read("p.csv"));
    assert_eq!(workplace.succeed(&format!("{reconstruct} -o p.ply")), "");
    assert!(std::fs::read(workplace.path("p.ply")).unwrap().starts_with(b"ply\nformat binary_little_endian 1.0\n"));

    let fit = workplace.succeed("fit plane p.csv --json");
    let fit: serde_json::Value = serde_json::from_str(&fit).unwrap();
    let z_mm = fit["parameters"][1]["value"].as_f64().unwrap();
    assert!((z_mm - 300.0).abs() < 0.05, "{fit}");
    assert_eq!(workplace.succeed(&format!("{reconstruct} -o p.parquet")), "");
    for other in ["p.ply", "p.parquet"] {
        let same: serde_json::Value =
            serde_json::from_str(&workplace.succeed(&format!("fit plane {other} --json"))).unwrap();
        // CSV rounds to a nanometre.
        assert!((same["parameters"][1]["value"].as_f64().unwrap() - z_mm).abs() < 1e-6, "{other}: {same}");
    }
    let features = workplace.succeed("detect f.tiff --instrument paper");
    assert!(features.lines().filter(|line| line.starts_with("red,")).count() as u64 >= points);
}

#[test]
fn a_reader_who_leaves_early_is_no_failure() {
    let workplace = Workplace::new();
    let mut command = workplace.command("instrument schema");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let status = child.wait().unwrap();
    let mut errors = String::new();
    child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
    assert_eq!((status.code(), errors.as_str()), (Some(0), ""));
}

#[test]
fn a_lens_is_shown_and_drawn() {
    // The numbers of CODE V's listing, as `twinpupil-optics/tests/prescriptions/double_gauss.rs` has them.
    let workplace = Workplace::new();
    workplace.write("lens.toml", include_str!("../../../twinpupil-optics/tests/lenses/double-gauss.toml"));
    let used = "--wavelength-nm 587.6 --wavelength-nm 486.1 --wavelength-nm 656.3 --pupil-mm 50 --field-deg 14";
    let text = workplace.succeed(&format!("optics show lens.toml {used} --svg lens.svg"));
    for expected in ["100.0038", "-29.3208", "61.4875", "57.9120", "-53.1569", "57.3201", "f/2.0001", "0.217488"] {
        assert!(text.contains(expected), "{expected}: {text}");
    }
    assert!(workplace.read("lens.svg").starts_with("<svg"));
    let shown: serde_json::Value =
        serde_json::from_str(&workplace.succeed(&format!("optics show lens.toml {used} --json"))).unwrap();
    assert_eq!(shown["beam"]["aberrations"].as_array().unwrap().len(), 12);

    // The chief ray at 24.588739, the paraxial one at 24.846684.
    let text = workplace.succeed(&format!("optics spot lens.toml {used} --rays 100 --svg spot.svg"));
    assert!(text.contains("-1.038") && text.contains("24.58874"), "{text}");
    assert_eq!(text.lines().count(), 1 + 5 * 3);
    // A file is what its name says.
    workplace.succeed(&format!("optics spot lens.toml {used} --rays 100 -o spot.csv"));
    let csv = workplace.read("spot.csv");
    assert!(
        csv.starts_with("field_deg,wavelength_nm,chief_mm,distortion,centre_mm,rms_mm,largest_mm,arrived,launched\n")
    );
    assert_eq!((csv.lines().count(), csv.matches(",100,100\n").count()), (1 + 5 * 3, 15), "{csv}");
    workplace.succeed(&format!("optics spot lens.toml {used} --rays 100 -o same.svg"));
    let svg = workplace.read("spot.svg");
    assert_eq!(svg, workplace.read("same.svg"));
    // Five spots of three wavelengths, some 300 rays each, and what they come to over the field.
    assert!(svg.matches("<circle").count() > 5 * 3 * 250 && svg.contains("Over the field") && !svg.contains("NaN"));
    workplace.succeed(&format!("optics show lens.toml {used} -o show.csv"));
    let csv = workplace.read("show.csv");
    assert!(csv.starts_with("quantity,wavelength_nm,surface,value\nfocal_length_mm,587.6000,,100.0037"), "{csv}");
    assert!(csv.contains("\nspherical_mm,587.6000,0,") && csv.contains("\nlateral_colour_mm,587.6000,sum,"), "{csv}");
    workplace.succeed(&format!("optics show lens.toml {used} -o show.png"));
    workplace.succeed(&format!("optics show lens.toml {used} --csv -o show.csv --png again.png"));
    let bytes = |name: &str| std::fs::read(workplace.path(name)).unwrap();
    assert!(bytes("show.png").starts_with(b"\x89PNG") && bytes("show.png") == bytes("again.png"));
    for wrong in ["psf lens.toml --picture psf.svg", "fan lens.toml --png fan.svg", "fan lens.toml --svg fan.png"] {
        let output = workplace.run(&format!("optics {wrong} {used}"));
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && error.contains("legal: a name that ends in ."), "{error}");
    }

    let error = workplace.fail("optics spot lens.toml");
    assert!(error.contains("nothing limits the beam; state --pupil-mm"), "{error}");
    workplace.write("bad.zmx", "SURF 0\nSURF 1\nTYPE BINARY_2\nSURF 2\n");
    let error = workplace.fail("optics show bad.zmx");
    assert!(error.contains("bad.zmx: line 3: surface type BINARY_2 is unknown"), "{error}");
    let double_gauss = include_str!("../../../../docs/lenses/double-gauss.zmx");
    workplace.write("glass.zmx", double_gauss.replace("GLAS N-SK2 ", "GLAS N-XX2 "));
    for command in ["optics show glass.zmx", "design glass.zmx --distance-mm 300 -o camera"] {
        let error = workplace.fail(command);
        assert!(error.starts_with("glass.zmx: line 34: `surface[2].medium` is N-XX2; legal: one of "), "{error}");
    }
    let error = workplace.fail("design lens.toml --distance-mm 30 --near-mm 20 --far-mm 40 -o camera");
    assert!(error.starts_with("lens.toml: objects must be farther from the lens"), "{error}");
    workplace.write("zoom.zmx", double_gauss.replace("MODE SEQ", "MNUM 2 1"));
    let output = workplace.run("optics show zoom.zmx");
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && warning.starts_with("zoom.zmx: line 3: MNUM is 2:"), "{warning}");
    // An F-number of 2 wherever the object is: f/2 of light from infinity.
    workplace.write("f.zmx", double_gauss.replace("ENPD 50", "FNUM 2 1"));
    assert!(workplace.succeed("optics show f.zmx").contains("f/2.0000"));
}

#[test]
fn surfaces_without_sums_of_third_order_are_told() {
    let workplace = Workplace::new();
    let lens = "[[surface]]\nshape = { kind = \"fresnel\", radius_mm = 50.0 }\nmedium = \"PMMA\"\ngap_mm = 2.0\n\
                [[surface]]\nshape = { kind = \"cylinder\", radius_mm = -80.0, curved = \"x\" }\ngap_mm = 100.0\n";
    workplace.write("lens.toml", lens);
    let text = workplace.succeed("optics show lens.toml --pupil-mm 10 --field-deg 5");
    let row = |start: &str| text.lines().find(|line| line.trim_start().starts_with(start)).unwrap_or_default();
    assert_eq!(
        (row("0 ").matches('–').count(), row("1 ").matches('–').count(), row("sum").matches('–').count()),
        (5, 0, 5)
    );
    assert!(text.contains("surface 0: facets of a Fresnel lens") && text.contains("surface 1: a cylinder"), "{text}");
    let json: serde_json::Value =
        serde_json::from_str(&workplace.succeed("optics show lens.toml --pupil-mm 10 --json")).unwrap();
    let sum = &json["beam"]["aberrations"][2];
    assert!(sum["spherical_mm"].is_null() && sum["axial_colour_mm"].is_f64(), "{json}");
}

#[test]
fn numbers_that_mean_nothing_are_wrong_usage() {
    let workplace = Workplace::new();
    for (command, option, value, legal) in [
        ("optics show x.zmx --pupil-mm 0", "--pupil-mm", "0", "above 0, up to 1e6"),
        ("optics psf x.zmx --pupil-mm nan", "--pupil-mm", "nan", "above 0, up to 1e6"),
        ("optics spot x.zmx --pupil-mm 1e9", "--pupil-mm", "1e9", "above 0, up to 1e6"),
        ("optics spot x.zmx --pupil-mm -2", "--pupil-mm", "-2", "above 0, up to 1e6"),
        ("optics show x.zmx --field-deg 90", "--field-deg", "90", "0 or more, below 90"),
        ("optics fan x.zmx --field-deg inf", "--field-deg", "inf", "0 or more, below 90"),
        ("optics show x.zmx --wavelength-nm nan", "--wavelength-nm", "nan", "1 to 1e6"),
        ("optics distortion x.toml --z-mm 0", "--z-mm", "0", "above 0, up to 1e7"),
        ("optics mtf x.toml --to-per-mm nan", "--to-per-mm", "nan", "above 0, up to 1e6"),
        ("design x.zmx --distance-mm nan", "--distance-mm", "nan", "above 0, up to 1e7"),
        ("design x.zmx --distance-mm 300 --clearance-mm -1", "--clearance-mm", "-1", "0 to 1e6"),
        ("design x.zmx --distance-mm 300 --brightness-e inf", "--brightness-e", "inf", "above 0, up to 1e9"),
    ] {
        let output = workplace.run(command);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{command}: {error}");
        assert!(error.contains(&format!("invalid value '{value}' for '{option}")), "{command}: {error}");
        assert!(error.contains(&format!("legal: {legal}")), "{command}: {error}");
    }
}

#[test]
fn a_lens_is_asked_about_rays_wavefront_images_and_contrast() {
    let workplace = Workplace::new();
    workplace.write("lens.toml", include_str!("../../../twinpupil-optics/tests/lenses/cooke-triplet.toml"));
    let used = "--wavelength-nm 550 --pupil-mm 10 --field-deg 20";
    // Optiland has 0.5286 at 50 cycles/mm on the axis by a transform that takes directions as even, 0.5262 by a sum of 200 rays
    // across, of which those on the rim count whole or not. Here grids of 64 to 800 places across come to 0.5255 … 0.5253.
    let text = workplace.succeed(&format!("optics mtf lens.toml {used} --to-per-mm 50 --gratings 2 --svg mtf.svg"));
    let contrast = text.lines().find_map(|line| line.split_once("50.0000")?.1.split_whitespace().next()?.parse().ok());
    assert!(contrast.is_some_and(|found: f64| (found - 0.5262).abs() < 1e-3), "{text}");
    assert_eq!(text.lines().count(), 1 + 3 * 2, "{text}");
    let csv = workplace.succeed(&format!("optics distortion lens.toml {used} --points 3 --csv --svg distortion.svg"));
    assert!(csv.starts_with("field_deg,wavelength_nm,ideal_mm,chief_mm,distortion,"), "{csv}");
    assert!(csv.contains(",0.207077"), "{csv}");
    workplace.succeed(&format!("optics fan lens.toml {used} --places 5 -o fan.csv --svg fan.svg"));
    assert_eq!(workplace.read("fan.csv").lines().count(), 1 + 3 * 5);
    let json = workplace.succeed(&format!("optics psf lens.toml {used} --json --svg psf.svg --picture psf.png"));
    let rows: serde_json::Value = serde_json::from_str(&json).unwrap();
    let ratio = rows[0]["strehl_ratio"].as_f64().unwrap();
    assert!((0.1..1.0).contains(&ratio), "{json}");
    for drawing in ["mtf.svg", "distortion.svg", "fan.svg", "psf.svg"] {
        let svg = workplace.read(drawing);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{drawing}");
    }
    let error = workplace.fail(&format!("optics mtf lens.toml {used} --z-mm 300"));
    assert!(error.contains("--z-mm and --r-mm are for an instrument file; this is a lens"), "{error}");
    workplace
        .write("ideal.toml", "[[surface]]\nshape = { kind = \"thin-lens\", focal_length_mm = 50.0 }\ngap_mm = 50.0\n");
    let error = workplace.fail("optics psf ideal.toml --pupil-mm 5 --field-deg 3 -o none.csv");
    assert!(error.contains("has a surface of kind thin-lens"), "{error}");
    assert!(workplace.succeed("optics psf ideal.toml --pupil-mm 5").contains("1.0000"));
}

#[test]
fn a_camera_is_asked_in_its_bands() {
    let workplace = Workplace::new();
    workplace.write("lens.zmx", include_bytes!("../../../../docs/lenses/double-gauss.zmx"));
    workplace.succeed("design lens.zmx --distance-mm 300 --radii-mm 0.33 0.61 -o camera -q");
    let text = workplace.succeed("optics psf camera/instrument.toml --r-mm 6");
    assert_eq!((text.matches("red").count(), text.matches("blue").count()), (3, 3), "{text}");
    // A pupil of radius 0.33 mm is 88.6 mm in front of the sensor: 0.61 λ/sin u.
    assert!(text.contains("Airy") && text.contains("r = 6.000 mm"), "{text}");
    let spots = workplace.succeed("optics spot camera/instrument.toml --r-mm 6 --rays 50");
    assert!(spots.contains("50 of 50"), "{spots}");
    // What is odd about the lens file that an instrument names is told wherever the instrument is read, once.
    let camera = workplace.read("camera/instrument.toml");
    let (before, rest) = camera.split_once("[lens.prescription]").unwrap();
    let (_, sensor) = rest.split_once("[sensor]").unwrap();
    workplace.write("named.toml", format!("{before}file = \"zoom.zmx\"\n[sensor]{sensor}"));
    let double_gauss = include_str!("../../../../docs/lenses/double-gauss.zmx");
    workplace.write("zoom.zmx", double_gauss.replace("MODE SEQ", "MNUM 2 1"));
    for command in ["instrument print named.toml", "instrument show named.toml", "optics show named.toml"] {
        let output = workplace.run(command);
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success() && said.starts_with("zoom.zmx: line 3: MNUM is 2:"), "{command}: {said}");
        assert_eq!(said.lines().count(), 1, "{command}: {said}");
        assert!(workplace.run(&format!("{command} -q")).stderr.is_empty(), "{command}");
    }
    // A lens is not a camera yet, and a camera no lens any more.
    let error = workplace.fail("design tolerance lens.zmx -o none");
    assert!(error.starts_with("lens.zmx: a lens, not an instrument file; `twinpupil design lens.zmx"), "{error}");
    let error = workplace.fail("design camera/instrument.toml --distance-mm 300 -o none");
    assert!(error.starts_with("camera/instrument.toml: an instrument file, not a lens"), "{error}");
    let text = workplace.succeed("optics show camera/instrument.toml --svg camera.svg");
    assert!(text.contains("telecentric") && text.contains("to 0.61 blue; beyond red"), "{text}");
    let svg = workplace.read("camera.svg");
    // Each band passes its own pupil and is passed beside the other's: a mask of each colour, above the pupil and below it.
    let [red, blue] = ["#d55e00", "#0072b2"];
    for ink in [red, blue] {
        let (rays, others): (Vec<&str>, Vec<&str>) =
            svg.lines().filter(|line| line.contains(ink)).partition(|line| line.contains("stroke-width=\"0.85\""));
        // Two sides of a mask and the legend.
        assert_eq!((rays.len(), others.len()), (3 * 3, 2 + 2 + 1), "{ink}: {svg}");
    }
    assert!(svg.contains("mask 0") && svg.contains("mask 1") && !svg.contains("NaN"));
    let csv = workplace.succeed("optics show camera/instrument.toml --csv");
    assert!(csv.starts_with("band,role,wavelength_nm,focal_length_mm,") && csv.lines().count() == 3, "{csv}");
    let error = workplace.fail("optics psf camera/instrument.toml --field-deg 3");
    assert!(error.contains("--field-deg is for a lens"), "{error}");
    let error = workplace.fail("optics mtf paper");
    assert!(error.contains("`lens.model` is thin; legal: prescription"), "{error}");
}
