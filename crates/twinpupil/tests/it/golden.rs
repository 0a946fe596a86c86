//! Golden files: they only show that nothing moved, never that it is right. `TWINPUPIL_BLESS=1 cargo test golden`
//! renews them; say in CHANGELOG.md under **Results changed** what moved, by how much and why.

use std::path::PathBuf;

use crate::program::Workplace;

/// Numbers may differ in the last place from one machine's mathematics to another's.
const RELATIVE_TOLERANCE: f64 = 1e-5;

const SCENE: &str = "schema = 1\nname = \"four\"\nseed = 3\n\
    [[dot]]\nx_mm = 0.9\ny_mm = 0.55\nz_mm = 280.0\ndiameter_mm = 0.3\n\
    [[dot]]\nx_mm = -0.8\ny_mm = 0.5\nz_mm = 300.0\ndiameter_mm = 0.3\n\
    [[dot]]\nx_mm = 0.85\ny_mm = -0.6\nz_mm = 320.0\ndiameter_mm = 0.3\n\
    [[dot]]\nx_mm = -0.9\ny_mm = -0.5\nz_mm = 340.0\ndiameter_mm = 0.3\n";

/// The paper's camera with a sensor of 480 × 320 pixels and small pupils, so that little is clipped near the axis.
fn camera() -> String {
    twinpupil_instrument::paper::INSTRUMENT_TOML
        .replace("[1920, 1200]", "[480, 320]")
        .replace("[959.5, 599.5]", "[239.5, 159.5]")
        .replace("radius_mm = 1.0", "radius_mm = 0.2")
        .replace("radius_mm = 0.5", "radius_mm = 0.1")
}

#[test]
fn what_the_program_prints_and_writes_has_not_moved() {
    let workplace = Workplace::new();
    workplace.write("camera.toml", camera());
    workplace.write("scene.toml", SCENE);
    let simulate = "simulate --instrument camera.toml --scene scene.toml -o frame.png --truth truth.csv";
    workplace.succeed(simulate);
    compare("instrument-show-paper.txt", &workplace.succeed("instrument show paper"));
    compare("truth.csv", &workplace.read("truth.csv"));
    compare("features.csv", &workplace.succeed("detect --instrument camera.toml frame.png"));
    workplace.succeed("reconstruct --instrument camera.toml frame.png -o points.csv");
    compare("points.csv", &workplace.read("points.csv"));
    compare("fit-plane.txt", &workplace.succeed("fit plane points.csv"));
}

#[test]
fn what_is_printed_to_calibrate_with_has_not_moved() {
    let workplace = Workplace::new();
    let grid = "target dot-grid --rows 3 --columns 4 --pitch-mm 2 --dot-diameter-mm 1 --missing 0,0 --larger 2,3,1.5";
    compare("target.svg", &workplace.succeed(&format!("{grid} --file target.toml")));
    compare("target.toml", &workplace.read("target.toml"));
}

fn compare(name: &str, found: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("TWINPUPIL_BLESS").is_some() {
        std::fs::write(&path, found).expect("the golden folder can be written");
        return;
    }
    let golden = std::fs::read_to_string(&path).expect("a golden file");
    let (expected, words) = (words(&golden), words(found));
    assert_eq!(words.len(), expected.len(), "{name}:\n{found}");
    for (word, golden) in words.into_iter().zip(expected) {
        assert!(alike(word, golden), "{name}: {word} where {golden} was");
    }
}

fn words(text: &str) -> Vec<&str> {
    text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty()).collect()
}

fn alike(word: &str, golden: &str) -> bool {
    match (word.parse::<f64>(), golden.parse::<f64>()) {
        (Ok(a), Ok(b)) => (a - b).abs() <= RELATIVE_TOLERANCE * a.abs().max(b.abs()).max(1.0),
        _ => word == golden,
    }
}
