//! From a lens file to points: the walk-through of docs/real-lens.md, at a smaller size.

use crate::program::Workplace;

/// Pixels four times as wide, of which a sixteenth of the number.
fn coarse_instrument() -> String {
    twinpupil_instrument::paper::INSTRUMENT_TOML
        .replace("size_px = [1920, 1200]", "size_px = [480, 300]")
        .replace("pitch_mm = 0.00586", "pitch_mm = 0.02344")
        .replace("axis_px = [959.5, 599.5]", "axis_px = [239.5, 149.5]")
}

/// A grid of dots in a pose.
fn pose(distance_mm: f64, tilt_deg: f64, tilt_axis: &str, turn_deg: f64) -> String {
    format!(
        "schema = 1\nname = \"pose\"\nseed = 5\n[plate]\ndistance_mm = {distance_mm}\ntilt_deg = {tilt_deg}\n\
         tilt_axis = \"{tilt_axis}\"\npattern = \"grid\"\nrows = 5\ncolumns = 7\npitch_mm = 2.0\ndiameter_mm = 1.2\n\
         centre_mm = [0.4, -0.3]\nturn_deg = {turn_deg}\n[[plate.fiducial]]\nrow = 0\ncolumn = 0\n"
    )
}

/// Numbers of a column of a CSV table.
fn column(table: &str, name: &str) -> Vec<f64> {
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let at = lines.next().unwrap().split(',').position(|head| head == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

#[test]
fn a_lens_file_becomes_a_camera_that_measures_depth() {
    let workplace = Workplace::new();
    workplace.write("coarse.toml", coarse_instrument());
    workplace.write("lens.zmx", include_bytes!("../../../../docs/lenses/double-gauss.zmx"));
    let wishes = "--like coarse.toml --distance-mm 300 --radii-mm 0.33 0.61 -o camera -q";
    let shown = workplace.succeed(&format!("design lens.zmx {wishes}"));
    assert!(shown.contains("telecentric mask: 61.6065 mm behind surface 10"), "{shown}");
    let sheet = workplace.read("camera/instrument.toml");
    let built = sheet
        .replace("distance_mm = 150.0951", "distance_mm = 150.4951")
        .replace("axis_px = [239.5, 149.5]", "axis_px = [241.0, 148.0]");
    assert_ne!(built, sheet);
    workplace.write("built.toml", built);
    workplace.succeed(
        "target dot-grid --rows 5 --columns 7 --pitch-mm 2 --dot-diameter-mm 1.2 --missing 0,0 -o grid.svg \
         --file target.toml -q",
    );
    let poses = [
        pose(268.0, 25.0, "y", 0.0),
        pose(285.0, -25.0, "x", 20.0),
        pose(312.0, 28.0, "y", 90.0),
        pose(330.0, -28.0, "x", 45.0),
    ];
    for (n, scene) in poses.iter().enumerate() {
        workplace.write(&format!("pose{n}.toml"), scene);
        workplace
            .succeed(&format!("simulate --instrument built.toml --scene pose{n}.toml --samples 64 -o pose{n}.png -q"));
    }
    workplace.succeed(
        "calibrate --instrument camera/instrument.toml --target target.toml pose0.png pose1.png pose2.png pose3.png -o \
         calibrated.toml -q",
    );
    workplace.write(
        "plate.toml",
        "schema = 1\nname = \"plate\"\nseed = 7\n[plate]\ndistance_mm = 308.0\ntilt_deg = 30.0\npattern = \"random-dots\"\n\
         count = 40\ndiameter_mm = 1.0\nr_min_mm = 2.0\nr_max_mm = 6.0\ngap_mm = 0.4\n",
    );
    workplace
        .succeed("simulate --instrument built.toml --scene plate.toml --samples 64 -o plate.png --truth truth.csv -q");
    let rms_mm = |instrument: &str| {
        workplace.succeed(&format!("reconstruct --instrument {instrument} plate.png -o points.csv -q"));
        rms_of_z_mm(&workplace.read("truth.csv"), &workplace.read("points.csv"))
    };
    let [own_mm, calibrated_mm, sheet_mm] = ["built.toml", "calibrated.toml", "camera/instrument.toml"].map(rms_mm);
    // So few pixels and frames tell the scale of depth to a tenth of a millimetre.
    assert!(own_mm < 0.03 && calibrated_mm < 0.2 && sheet_mm > 0.5, "{own_mm} {calibrated_mm} {sheet_mm} mm");
}

/// Root mean square error of z over the points that belong to a dot, most of all dots.
fn rms_of_z_mm(truth: &str, points: &str) -> f64 {
    let [truth, points] = [truth, points].map(|table| ["x_mm", "y_mm", "z_mm"].map(|axis| column(table, axis)));
    let errors_mm: Vec<f64> = (0..points[0].len())
        .filter_map(|n| {
            let beside = |m: &usize| (truth[0][*m] - points[0][n]).hypot(truth[1][*m] - points[1][n]);
            let nearest = (0..truth[0].len()).min_by(|a, b| beside(a).total_cmp(&beside(b)))?;
            (beside(&nearest) < 0.5).then(|| points[2][n] - truth[2][nearest])
        })
        .collect();
    assert!(10 * errors_mm.len() >= 9 * truth[0].len(), "{} points", errors_mm.len());
    (errors_mm.iter().map(|mm| mm * mm).sum::<f64>() / errors_mm.len() as f64).sqrt()
}
