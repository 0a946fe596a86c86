//! `calibrate axis` of cameras that are not what their file says.

use serde_json::Value;
use twinpupil_instrument::paper::INSTRUMENT_TOML;

use crate::program::Workplace;

const TRUE_PX: [f64; 2] = [965.1, 595.3];

/// A file with another axis than the paper's, and edits.
fn camera(axis_px: [f64; 2], edits: &[(&str, &str)]) -> String {
    let moved = INSTRUMENT_TOML.replace("[959.5, 599.5]", &format!("{axis_px:?}"));
    edits.iter().fold(moved, |text, (from, to)| text.replace(from, to))
}

/// Masks off centre by 0.03 mm along y and 0.05 mm along x.
const OFF_CENTRE: [(&str, &str); 2] = [
    ("position_mm = 0.0", "position_mm = 0.0\ncentre_mm = [0.0, 0.03]"),
    ("position_mm = 100.0", "position_mm = 100.0\ncentre_mm = [0.05, 0.0]"),
];

/// `frame.png` of dots well before focus, as a camera sees it that is the paper's but for these edits.
fn seen(edits: &[(&str, &str)]) -> Workplace {
    let workplace = Workplace::new();
    workplace.write("built.toml", camera(TRUE_PX, edits));
    workplace.write(
        "scene.toml",
        "schema = 1\nname = \"dots\"\n[plate]\ndistance_mm = 265\npattern = \"grid\"\nrows = 7\ncolumns = 9\n\
         pitch_mm = 1.5\ndiameter_mm = 0.9\nturn_deg = 5\n",
    );
    workplace.succeed("simulate -q --instrument built.toml --scene scene.toml --samples 512 --seed 3 -o frame.png");
    workplace
}

fn numbers(json: &Value) -> [f64; 2] {
    [0, 1].map(|k| json[k].as_f64().unwrap())
}

#[test]
fn an_axis_of_masks_off_centre_is_as_uncertain_as_they_are() {
    let workplace = seen(&OFF_CENTRE);
    let axis = |instrument: &str| -> Value {
        let text = workplace.succeed(&format!("calibrate axis --json -q --instrument {instrument} frame.png"));
        serde_json::from_str(&text).unwrap()
    };
    let sheet = axis("paper");
    let (found_px, mask_std_px) = (numbers(&sheet["axis_px"]), numbers(&sheet["mask_std_px"]));
    // Along u the mask in the back focal plane, L/d of its offset; along v the one on the lens, 1 − L/d of it.
    let expected_px = [-1.51 * 0.05 / 0.00586, 0.51 * 0.03 / 0.00586];
    for k in [0, 1] {
        let off_px = found_px[k] - TRUE_PX[k];
        assert!((off_px - expected_px[k]).abs() < 0.1, "{found_px:?}");
        assert!(numbers(&sheet["std_px"])[k] < 0.05, "{sheet}");
        let tolerance_px = 0.2 * 1.51_f64.hypot(0.51) / 0.00586;
        assert!((mask_std_px[k] / tolerance_px - 1.0).abs() < 1e-3, "{mask_std_px:?}");
    }
    assert_eq!(sheet["masks"][1]["key"], "aperture[1].centre_mm");
    let moves =
        "by 0.87 px for each 0.01 mm of aperture[0].centre_mm, by 2.58 px for each 0.01 mm of aperture[1].centre_mm";
    let text = workplace.succeed("calibrate axis -q --instrument paper frame.png");
    assert!(text.contains("from noise, ± 54.") && text.trim_end().ends_with(moves), "{text}");

    workplace.write("known.toml", camera([959.5, 599.5], &OFF_CENTRE));
    let known = numbers(&axis("known.toml")["axis_px"]);
    assert!((known[0] - TRUE_PX[0]).hypot(known[1] - TRUE_PX[1]) < 0.05, "{known:?}");
}

#[test]
fn frames_that_the_instrument_does_not_explain_are_refused() {
    let workplace = seen(&[(
        "\nfocal_length_mm = 100.0",
        "\nfocal_length_mm = 100.0\nfocal_length_mm_by_band = { red = 100.9, blue = 98.6 }\n#",
    )]);
    workplace.write(
        "swapped.toml",
        INSTRUMENT_TOML.replace("\"r\"", "\"x\"").replace("\"b\"", "\"r\"").replace("\"x\"", "\"b\""),
    );
    for instrument in ["paper", "swapped.toml"] {
        let reason = workplace.fail(&format!("calibrate axis --instrument {instrument} frame.png -o axis.toml"));
        assert!(
            reason.contains("does not explain the dots: χ²") && reason.contains("calibrate the camera first"),
            "{reason}"
        );
    }
    workplace.succeed("calibrate axis -q --instrument built.toml frame.png -o axis.toml");
    assert!(workplace.read("axis.toml").contains("axis_px"));
}
