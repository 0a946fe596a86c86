//! From a lens file to points: the walk-through of docs/real-lens.md.

use crate::program::Workplace;

/// Files of the walk-through.
const POSES: [&str; 8] = [
    include_str!("../../../../docs/real-lens/pose1.toml"),
    include_str!("../../../../docs/real-lens/pose2.toml"),
    include_str!("../../../../docs/real-lens/pose3.toml"),
    include_str!("../../../../docs/real-lens/pose4.toml"),
    include_str!("../../../../docs/real-lens/pose5.toml"),
    include_str!("../../../../docs/real-lens/pose6.toml"),
    include_str!("../../../../docs/real-lens/pose7.toml"),
    include_str!("../../../../docs/real-lens/pose8.toml"),
];
const PLATES: [&str; 3] = [
    include_str!("../../../../docs/real-lens/near.toml"),
    include_str!("../../../../docs/real-lens/plate.toml"),
    include_str!("../../../../docs/real-lens/far.toml"),
];

/// Most that z of the dots of a plate may be off, rms.
const Z_RMS_MM: f64 = 0.02;

/// Numbers of a column of a CSV table.
fn column(table: &str, name: &str) -> Vec<f64> {
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let at = lines.next().unwrap().split(',').position(|head| head == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().parse().unwrap()).collect()
}

#[test]
fn a_lens_file_becomes_a_camera_that_measures_depth() {
    let workplace = Workplace::new();
    workplace.write("lens.zmx", include_bytes!("../../../../docs/lenses/double-gauss.zmx"));
    let shown = workplace.succeed("design lens.zmx --distance-mm 300 -o camera -q");
    assert!(shown.contains("telecentric mask: 61.6065 mm behind surface 10, radius 0.33 mm"), "{shown}");
    let sheet = workplace.read("camera/instrument.toml");
    // The camera that is built is not the one on the data sheet.
    let line = |line: &str| match line.split_once(" = ") {
        Some(("focal_length_mm", _)) => "focal_length_mm = 100.3038".to_owned(),
        Some(("distance_mm", _)) => "distance_mm = 150.4951".to_owned(),
        Some(("axis_px", _)) => "axis_px = [968.0, 591.0]".to_owned(),
        _ => line.to_owned(),
    };
    let built = sheet.lines().map(line).collect::<Vec<_>>().join("\n");
    workplace.write("built.toml", built);
    workplace.succeed(
        "target dot-grid --rows 7 --columns 9 --pitch-mm 1.5 --dot-diameter-mm 0.9 --missing 0,0 -o grid.svg \
         --file target.toml -q",
    );
    let simulate = |name: &str, scene: &str| {
        workplace.write(&format!("{name}.toml"), scene);
        workplace.succeed(&format!(
            "simulate --instrument built.toml --scene {name}.toml --samples 64 -o {name}.png --truth {name}.csv -q"
        ));
    };
    for (n, scene) in POSES.iter().enumerate() {
        simulate(&format!("pose{n}"), scene);
    }
    let frames = (0..POSES.len()).map(|n| format!("pose{n}.png")).collect::<Vec<_>>().join(" ");
    workplace.succeed(&format!(
        "calibrate --instrument camera/instrument.toml --target target.toml {frames} -o calibrated.toml -q"
    ));
    for (n, scene) in PLATES.iter().enumerate() {
        simulate(&format!("plate{n}"), scene);
        let rms_mm = |instrument: &str| {
            workplace.succeed(&format!("reconstruct --instrument {instrument} plate{n}.png -o points.csv -q"));
            rms_of_z_mm(&workplace.read(&format!("plate{n}.csv")), &workplace.read("points.csv"))
        };
        let [own_mm, calibrated_mm, sheet_mm] = ["built.toml", "calibrated.toml", "camera/instrument.toml"].map(rms_mm);
        assert!(
            own_mm < 0.01 && calibrated_mm < Z_RMS_MM && sheet_mm > 0.5,
            "{n}: {own_mm} {calibrated_mm} {sheet_mm} mm"
        );
    }
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
