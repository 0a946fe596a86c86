//! The design in words and tables.

use std::fmt::Write;

use twinpupil_instrument::Role;

use super::Designed;
use crate::design::{Choice, Design};
use crate::text_table::render;

/// Heads of the columns that tell of a choice: radii of the masks, and of the pupils that they make on the lens.
pub(super) const CHOICE: [&str; 9] = [
    "telecentric, mm",
    "its pupil, f/100",
    "entocentric, mm",
    "its pupil, f/100",
    "electrons",
    "blur near, px",
    "blur far, px",
    "blind r, mm",
    "σ_z, µm",
];

/// Heads of the columns that tell of the two bands.
pub(super) const BANDS: [&str; 7] =
    ["band", "λ, nm", "f, mm", "focus, mm", "light at rim", "displaced by, px", "astigmatism, px"];

/// From the last vertex to the sensor, mm.
pub(super) fn sensor_behind_mm(design: &Design) -> f64 {
    design.stand.rear_principal_mm + design.sensor_distance_mm - design.stand.length_mm
}

/// A choice, cell by cell.
fn choice_cells(choice: &Choice) -> [String; 9] {
    let radius = |mm: f64| if mm < 0.1 { format!("{mm:.4}") } else { format!("{mm:.2}") };
    [
        radius(choice.radii_mm[0]),
        format!("{:.2}", 100.0 * choice.shares[0]),
        radius(choice.radii_mm[1]),
        format!("{:.2}", 100.0 * choice.shares[1]),
        format!("{:.0}", choice.electrons),
        format!("{:.1}", choice.blur_px[0]),
        format!("{:.1}", choice.blur_px[1]),
        format!("{:.2}", choice.blind_mm),
        format!("{:.2}", 1000.0 * choice.z_std_mm),
    ]
}

/// The same, and at the end whether it is the one that was chosen, or `unfit`.
pub(super) fn marked_cells(choice: &Choice, chosen: &Choice, unfit: &str) -> [String; 9] {
    let mut cells = choice_cells(choice);
    cells[8] += if choice == chosen { " ←" } else { "" };
    cells[8] += if choice.is_fit { "" } else { unfit };
    cells
}

/// The bands, cell by cell.
pub(super) fn band_cells(designed: &Designed) -> [[String; 7]; 2] {
    let Designed { design, instrument, check, .. } = designed;
    [Role::Telecentric, Role::Entocentric].map(|role| {
        let (band, k) = (instrument.band(role), usize::from(role == Role::Entocentric));
        [
            band.name.clone(),
            band.wavelength_nm.to_string(),
            format!("{:.4}", design.points[k].focal_length_mm),
            format!("{:.2}", check.focus_mm[k]),
            format!("{:.3}", check.rim_light[k]),
            format!("{:.2}", check.displacement_px[k]),
            format!("{:.2}", check.astigmatism_px[k]),
        ]
    })
}

/// Where things go, a line each.
pub(super) fn places(designed: &Designed) -> Vec<String> {
    let Designed { design, chosen, .. } = designed;
    let (entocentric, image) = design.entocentric;
    let side = if image.position_mm < 0.0 { "in front of the front" } else { "behind the rear" };
    vec![
        format!(
            "entocentric mask: {:.2} mm behind surface {}, radius {} mm; it appears {:.2} mm {side} principal plane, {:.4} \
             times as large",
            entocentric.behind_mm,
            entocentric.surface,
            chosen.radii_mm[1],
            image.position_mm.abs(),
            image.scale
        ),
        format!(
            "telecentric mask: {:.4} mm behind surface {}, radius {} mm, in the rear focal plane of its band",
            design.telecentric.behind_mm, design.telecentric.surface, chosen.radii_mm[0]
        ),
        format!(
            "sensor: {:.4} mm behind the rear principal plane, {:.4} mm behind the last surface",
            design.sensor_distance_mm,
            sensor_behind_mm(design)
        ),
        format!(
            "object: {} mm in front of the front principal plane, {:.4} mm in front of the first surface",
            design.wishes.distance_mm,
            design.wishes.distance_mm - design.stand.front_principal_mm
        ),
    ]
}

/// The design as a tidy page for a terminal.
pub(super) fn tables(designed: &Designed) -> String {
    let Designed { instrument, choices, chosen, check, .. } = designed;
    let mut text = format!("{}: f = {:.4} mm\n", instrument.name, instrument.lens.focal_length_mm());
    for line in places(designed) {
        // Writing into a string does not fail.
        let _ = writeln!(text, "{line}");
    }
    text += "\n";
    text += &render(BANDS, &band_cells(designed));
    let _ = writeln!(
        text,
        "\nwithin {:.2} mm of the axis at the middle distance; focal lengths taken for one would cost {:.3} mm of depth\n",
        check.field_radius_mm, check.chromatic_error_mm
    );
    let marked = |choice: &Choice| marked_cells(choice, chosen, " unfit");
    text += &render(CHOICE, &choices.iter().map(marked).collect::<Vec<_>>());
    if check.z_std_mm.is_finite() {
        let z_std_um = 1000.0 * check.z_std_mm;
        let _ = writeln!(text, "\nthrough the real lens: σ_z {z_std_um:.2} µm, the bound of every reading");
    } else {
        text += "\nthrough the real lens no dot shows its depth: the lens lets too little of the field through\n";
    }
    text
}

/// The sweep as CSV.
pub(super) fn series(choices: &[Choice]) -> String {
    let mut text =
        "telecentric_radius_mm,entocentric_radius_mm,electrons,blur_near_px,blur_far_px,blind_mm,z_std_mm,fit\n"
            .to_owned();
    for choice in choices {
        let [telecentric, entocentric] = choice.radii_mm;
        let [near, far] = choice.blur_px;
        let Choice { electrons, blind_mm, z_std_mm, is_fit, .. } = choice;
        let _ = writeln!(
            text,
            "{telecentric},{entocentric},{electrons},{near},{far},{blind_mm},{z_std_mm},{}",
            u8::from(*is_fit)
        );
    }
    text
}
