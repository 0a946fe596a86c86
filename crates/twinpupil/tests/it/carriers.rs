//! Every way in which planes reach a file, from command to command.

use crate::program::Workplace;

/// A shipped instrument with a sensor of 160 × 120 pixels.
fn small(workplace: &Workplace, name: &str) {
    let text = workplace.succeed(&format!("instrument {name}"));
    let text = text.replace("[1920, 1200]", "[160, 120]").replace("[959.5, 599.5]", "[79.5, 59.5]");
    workplace.write("small.toml", text);
}

fn flat_scene(workplace: &Workplace) {
    workplace.write("flat.toml", "schema = 1\nname = \"flat\"\nbackground_e = 20000\nbrightness_e = 20000\n");
}

fn comes_back(name: &str, output: &str, frame: &str, bands: usize) {
    let workplace = Workplace::new();
    let summary =
        workplace.succeed(&format!("simulate --instrument {name} --scene paper {output} --samples 64 --json"));
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["dots"], 60);
    let reconstruct = format!("reconstruct {frame} --instrument {name} -o p.csv --rejected r.csv --json");
    let summary: serde_json::Value = serde_json::from_str(&workplace.succeed(&reconstruct)).unwrap();
    let points = summary["points"].as_u64().unwrap();
    assert!(points > 45, "{summary}");
    assert_eq!(summary["frames"][0]["frame"], frame.replace(' ', " + "));
    // In each band, found = points + rejected, and detection finds as many.
    let features = workplace.succeed(&format!("detect {frame} --instrument {name} --rejected d.csv"));
    let rejected = workplace.read("d.csv");
    assert_eq!(summary["bands"].as_array().unwrap().len(), bands);
    for band in summary["bands"].as_array().unwrap() {
        let start = format!("{},", band["band"].as_str().unwrap());
        let rows = |table: &str| table.lines().filter(|line| line.starts_with(&start)).count() as u64;
        assert_eq!(band["found"].as_u64().unwrap(), rows(&features) + rows(&rejected), "{summary}");
        assert!(band["points"].as_u64().unwrap() + 4 >= points, "{summary}");
    }
    let fit: serde_json::Value = serde_json::from_str(&workplace.succeed("fit plane p.csv --json")).unwrap();
    let z_mm = fit["parameters"][1]["value"].as_f64().unwrap();
    assert!((z_mm - 300.0).abs() < 0.05, "{fit}");
}

#[test]
fn a_plate_comes_back_from_two_files_in_order() {
    comes_back("two-sensors", "-o r.png -o b.tiff", "r.png b.tiff", 2);
}

#[test]
fn a_plate_comes_back_from_files_by_pattern() {
    comes_back("two-sensors", "-o f-{band}.png", "f-{band}.png", 2);
}

#[test]
fn a_plate_comes_back_from_a_cube() {
    comes_back("hyperspectral", "-o f.bil", "f.hdr", 3);
}

#[test]
fn a_plate_comes_back_from_polarizers() {
    comes_back("polarizer", "-o f.png", "f.png", 2);
}

#[test]
fn shipped_instruments_print_and_read_back() {
    let workplace = Workplace::new();
    for name in ["paper", "polarizer", "hyperspectral", "two-sensors", "three-bands"] {
        workplace.succeed(&format!("instrument {name} -o {name}.toml"));
        assert_eq!(
            workplace.succeed(&format!("instrument show {name}.toml")),
            workplace.succeed(&format!("instrument show {name}"))
        );
        workplace.succeed(&format!("instrument print {name}.toml -o printed.toml"));
        assert_eq!(workplace.succeed("instrument print printed.toml"), workplace.read("printed.toml"));
    }
}

#[test]
fn crosstalk_is_measured_on_flats() {
    let workplace = Workplace::new();
    small(&workplace, "three-bands");
    // Without a black level the noise of dark pixels is cut off at zero, and they seem to see light.
    let text = workplace.read("small.toml").replace("bit_depth = 12", "bit_depth = 12\nblack_level = 32");
    workplace.write("small.toml", text);
    flat_scene(&workplace);
    for band in ["red", "blue", "green"] {
        let rest = format!("--scene flat.toml --samples 16 --seed 3 --lit {band} -o {band}.png");
        workplace.succeed(&format!("simulate --instrument small.toml {rest}"));
    }
    let flats = "crosstalk red.png blue.png green.png --instrument small.toml";
    let summary: serde_json::Value =
        serde_json::from_str(&workplace.succeed(&format!("{flats} -o measured.toml --json"))).unwrap();
    let stated = [[1.0, 0.02, 0.06], [0.01, 1.0, 0.08], [0.05, 0.07, 1.0]];
    let number = |table: &str, i: usize, j: usize| summary[table][i][j].as_f64().unwrap();
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        let (found, std) = (number("matrix", i, j), number("std", i, j));
        assert!((found - stated[i][j]).abs() <= 5.0 * std, "{i} {j}: {found} ± {std}");
        assert!(std < 5e-4, "{std}");
    }
    assert!(workplace.succeed(flats).contains("[crosstalk]"));
    assert!(workplace.read("measured.toml").contains("matrix = [["));
    workplace.succeed("instrument show measured.toml");

    let wrong = workplace.fail("crosstalk blue.png red.png green.png --instrument small.toml -o no.toml");
    assert!(wrong.contains("the flat of band `red` is brighter in the plane of `blue`"), "{wrong}");
    let few = workplace.fail("crosstalk red.png --instrument small.toml -o no.toml");
    assert!(few.starts_with("there are 1 flat frames; legal: 3"), "{few}");
    let unknown = workplace.fail("simulate --instrument small.toml --scene flat.toml --lit pink -o no.png");
    assert_eq!(unknown, "--lit pink: there is no such band; legal: red, blue, green");
}

#[test]
fn wrong_files_are_named() {
    let workplace = Workplace::new();
    small(&workplace, "two-sensors");
    flat_scene(&workplace);
    workplace.succeed("simulate --instrument small.toml --scene flat.toml --samples 16 -o f-{band}.png");
    let lone = workplace.fail("reconstruct f-red.png --instrument small.toml -o p.csv");
    assert!(lone.starts_with("f-red.png: a frame of this instrument has 2 files (red, blue), or one path"), "{lone}");
    let missing = workplace.fail("reconstruct g-{band}.png --instrument small.toml -o p.csv");
    assert_eq!(missing, "g-red.png: there is no such file");

    small(&workplace, "hyperspectral");
    workplace.succeed("simulate --instrument small.toml --scene flat.toml --samples 16 -o c.bip");
    let header = workplace.read("c.hdr");
    let refuse = |header: &str, expected: &str| {
        workplace.write("c.hdr", header);
        let line = workplace.fail("detect c.hdr --instrument small.toml -o p.csv");
        assert!(line.starts_with("c.hdr: ") && line.contains(expected), "{line}");
    };
    refuse(&header.replace("samples = 160", "samples = 161"), "the frame is 161 × 120");
    refuse(&header.replace("bands = 3", "bands = 4"), "`wavelength` has 3 values; legal: 4");
    refuse(&header.replace("data type = 12", "data type = 4"), "`data type` is 4; legal: 1, 2 or 12");
    refuse(&header.replace("680", "880"), "as another band's is");
    refuse(&header.replace("offset = 0", "offset = 2"), "the data has 115200 bytes; legal: 115202");
    std::fs::remove_file(workplace.path("c.bip")).unwrap();
    refuse(&header, "there is no file of samples beside it");
    let bad = workplace.fail("simulate --instrument small.toml --scene flat.toml -o c.png");
    assert_eq!(bad, "c.png: a cube is written as .hdr, .raw, .dat, .img, .bsq, .bil or .bip");
}
