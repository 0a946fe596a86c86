//! What the paper's text leaves open, and what is chosen here.

use twinpupil_instrument::{FresnelLens, GrooveSide, Lens};

use super::Rig;

/// One sentence for each choice that an experiment of the paper needs and its text does not give.
pub fn choices(thin: &Rig, fresnel: &Rig, step_mm: u32, seed: u64) -> Vec<String> {
    let mut choices = vec![
        "22 dots: azimuths spread evenly on the inner ring and over ±40° about ±x on the outer one, where the sensor \
         holds whole dots; taken in three exposures of every third dot, so that blurred neighbours do not overlap; \
         noiseless."
            .to_owned(),
        format!(
            "Plate: 60 dots of 1 mm at random with 0.3 mm between edges, seed {seed}, the same plate at every distance; \
             bright dots of 20 000 electrons on black, read noise {} e⁻, photon noise.",
            thin.instrument.sensor.read_noise_e
        ),
        format!("Distances of 250 to 350 mm in steps of {step_mm} mm."),
        "Stop of 16 mm diameter 40 mm from the lens: behind it, towards the sensor.".to_owned(),
        "Filters are ideal: each band reaches its own pixels only.".to_owned(),
        format!(
            "L = {} mm, as the paper states it, with both lenses; its equations always take f = 100 mm.",
            thin.instrument.sensor.distance_mm
        ),
        format!(
            "Rays over the pupil for every pixel and band: {} with the thin lens, {} with the Fresnel lens.",
            thin.pupil_samples(),
            fresnel.pupil_samples()
        ),
    ];
    if let Lens::Fresnel(lens) = &fresnel.instrument.lens {
        choices.insert(4, fresnel_lens(lens));
    }
    choices
}

fn fresnel_lens(lens: &FresnelLens) -> String {
    let side = match lens.grooves {
        GrooveSide::Object => "object",
        GrooveSide::Image => "sensor",
    };
    format!(
        "Fresnel lens: {}, f = {} mm at {} nm, {} mm thick, grooves towards the {side}, pitch {} mm, draft {}°.",
        lens.material.to_uppercase(),
        lens.focal_length_mm,
        lens.design_wavelength_nm,
        lens.thickness_mm,
        lens.groove_pitch_mm,
        lens.draft_deg,
    )
}
