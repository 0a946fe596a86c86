//! The design as one page.

use anyhow::Result;
use twinpupil_instrument::DepthRange;

use super::Designed;
use super::text::{BANDS, CHOICE, band_cells, marked_cells, places};
use crate::commands::optics::camera_drawing;
use crate::design::Choice;
use crate::plot::{Chart, Colour, Stroke};
use crate::report::{Column, Figure, Headline, Report};

/// The page.
pub(super) fn page(designed: &Designed) -> Result<Report> {
    let Designed { design, instrument, choices, chosen, check, light } = designed;
    let DepthRange { near_mm, far_mm } = design.wishes.depth_range;
    let mut report = Report::new(&format!("A camera with two pupils: {}", instrument.name));
    report.lead(&format!(
        "A lens of {} surfaces, f = {:.4} mm, with two masks and a sensor for objects at {near_mm:.0} to {far_mm:.0} mm. Depth \
         is judged by dots of {} mm, with up to {:.0} electrons in a pixel.",
        design.stand.prescription.surfaces.len(),
        instrument.lens.focal_length_mm(),
        light.diameter_mm,
        chosen.electrons
    ));
    report.headlines(&[
        Headline::new(
            if check.z_std_mm.is_finite() { format!("{:.1} µm", 1000.0 * check.z_std_mm) } else { "none".to_owned() },
            "median over the working volume of σ_z that no reading can beat",
        ),
        Headline::new(format!("{:.2} mm", chosen.blind_mm), "radius about the axis without depth"),
        Headline::new(format!("{:.2} mm", check.field_radius_mm), "radius seen all round at the middle distance"),
        Headline::new(
            format!("{:.2} mm", check.chromatic_error_mm),
            "depth error if both bands were taken to have one focal length: the forward model takes it out",
        ),
    ]);
    report.heading("Where things go");
    report.figures(&[Figure::new(
        camera_drawing(instrument)?.to_svg(),
        "The lens in section, with the masks and rays of both bands from where they are in focus.",
    )]);
    report.list(&places(designed));
    let room = |room: &twinpupil_optics::Room| {
        [room.surface.to_string(), format!("{:.2}", room.from_mm), format!("{:.2}", room.to_mm)]
    };
    report.subheading("Room for masks");
    let columns = [Column::number("behind surface"), Column::number("from, mm"), Column::number("to, mm")];
    report.table(&columns, &design.rooms.iter().map(room).collect::<Vec<_>>());
    report.heading("What the lens does");
    report.table(&columns_of(&BANDS), &band_cells(designed));
    report.heading("How wide the pupils are");
    report.paragraph(
        "Wider pupils give more light and more blur, and the masks hide more of each other's light near the axis. Pairs of radii \
         are telecentric, entocentric; light is that of the band that has less. Unfit is what blurs dots away at the ends of \
         the range, or is blind too far from the axis.",
    );
    report.figures(&[Figure::new(plot(choices, chosen), "Precision over light; the choice is marked.")]);
    let row = |choice: &Choice| marked_cells(choice, chosen, " (unfit)");
    report.table(&columns_of(&CHOICE), &choices.iter().map(row).collect::<Vec<_>>());
    Ok(report)
}

fn columns_of<const N: usize>(heads: &[&str; N]) -> [Column; N] {
    heads.map(Column::number)
}

/// σ_z over light.
fn plot(choices: &[Choice], chosen: &Choice) -> String {
    let at = |choice: &Choice| [choice.electrons / 1000.0, 1000.0 * choice.z_std_mm];
    let of = |fit: bool| choices.iter().filter(move |choice| choice.is_fit == fit).map(|choice| at(choice).into());
    let [x, y] = at(chosen);
    Chart::new("electrons of a dot, thousands", "σ_z, µm")
        .points("fit", Colour::Blue, &of(true).collect::<Vec<_>>())
        .points("unfit", Colour::Grey, &of(false).collect::<Vec<_>>())
        .line("chosen", Colour::Vermilion, Stroke::Dashed, &[[x, 0.0], [x, y]])
        .into_svg()
}
