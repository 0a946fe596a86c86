//! A camera as it is built: the drawing with every number off by what was drawn for it.
//!
//! # Where things stand
//!
//! A thin lens stands fast, and everything counts from it. Of a lens surface by surface the first vertex stands
//! fast in the housing, surfaces follow it gap by gap, and the sensor and masks in front of the lens or behind it keep
//! their places in the housing whatever the lens does. What is read counts from where the front principal plane of the
//! drawing is.
//!
//! # Temperature
//!
//! Gaps of air, the distance of the sensor and the places of masks grow with the mount, glass and its radii with the
//! glass, and indices change by dn/dT. Masks themselves and pixels keep their size.

use std::collections::BTreeMap;

use anyhow::{Context, Result, bail};
use twinpupil_instrument::{
    Formula, Glass, Instrument, InstrumentSpec, Lens, LensStand, MediumSpec, PrescriptionLens, PrescriptionSpec, Shape,
    SurfaceSpec,
};

use super::element::Element;
use super::source::{Source, Toleranced};
use super::tolerances::{Temperature, Tolerances};

/// A camera as drawn, made ready to be built otherwise.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// As drawn; a lens surface by surface at the size that it has.
    pub instrument: Instrument,
    /// Elements of its lens.
    pub elements: Vec<Element>,
    /// What it may be off by.
    pub sources: Vec<Toleranced>,
    /// What temperature does to it.
    temperature: Temperature,
    /// Where its lens stands.
    stand: Option<LensStand>,
}

/// A camera as built.
#[derive(Debug, Clone)]
pub struct Built {
    /// What it is.
    pub instrument: Instrument,
    /// Front principal plane of the drawing to its own, mm towards the sensor: objects are so much farther away.
    pub farther_mm: f64,
    /// Signal in every plane from unit light of every other band, beyond what is stated.
    pub leak: Vec<Vec<f64>>,
}

impl Drawing {
    /// Of an instrument.
    pub fn new(instrument: &Instrument, tolerances: &Tolerances) -> Result<Self> {
        let mut spec = instrument.clone().into_spec();
        if matches!(spec.lens, Lens::Fresnel(_)) {
            bail!(
                "`lens.model` is fresnel, of which a calibration from images alone knows one focal length for bands that have \
                 two; legal: thin, or prescription with a surface of kind facets, which is the same lens"
            );
        }
        spec.calibration = None;
        let mut stand = None;
        let mut elements = Vec::new();
        if let Lens::Prescription(lens) = &mut spec.lens {
            let own = lens.stand(spec.sensor.distance_mm)?;
            let lens_spec = PrescriptionSpec::clone(&own.prescription);
            elements = Element::of(&lens_spec);
            (lens.prescription, lens.focal_length_mm) = (Some(lens_spec), None);
            stand = Some(own);
        }
        let instrument = Instrument::new(spec)?;
        let sources = super::source::sources(&instrument, &elements, tolerances);
        Ok(Self { instrument, elements, sources, temperature: tolerances.temperature.clone(), stand })
    }

    /// The camera that is off by these numbers, in the order of the sources, at the temperature among them or, if `is_cold`,
    /// at that at which it was built.
    pub fn built(&self, off: &[f64], is_cold: bool) -> Result<Built> {
        let mut spec = self.instrument.clone().into_spec();
        let mut leak = vec![vec![0.0; spec.bands.len()]; spec.bands.len()];
        let mut change_k = 0.0;
        let mut masks_mm = vec![0.0; spec.apertures.len()];
        let mut sensor_mm = 0.0;
        for (Toleranced { source, .. }, off) in self.sources.iter().zip(off) {
            match *source {
                Source::SensorDistance => sensor_mm = *off,
                Source::SensorCentre(axis) => spec.sensor.axis_px[axis] += off / spec.sensor.pitch_mm,
                Source::SensorTilt(axis) => spec.sensor.tilt_deg[axis] += off,
                Source::MaskPosition(index) => masks_mm[index] = *off,
                Source::MaskCentre(index, axis) => spec.apertures[index].centre_mm[axis] += off,
                Source::MaskRadius(index) => {
                    let radii = spec.apertures[index].zones.iter_mut().filter_map(|zone| zone.radius_mm.as_mut());
                    radii.for_each(|radius_mm| *radius_mm += off);
                }
                Source::FocalLength => scale_focal_lengths(&mut spec, None, 1.0 + 0.01 * off),
                Source::BandFocalLength(band) => scale_focal_lengths(&mut spec, Some(band), 1.0 + 0.01 * off),
                Source::Temperature => change_k = if is_cold { 0.0 } else { *off },
                Source::Leak(plane, band) => leak[plane][band] = self.leak(plane, band, *off),
                Source::ElementDecentre(..)
                | Source::ElementTilt(..)
                | Source::Thickness(_)
                | Source::AirGap(_)
                | Source::Radius(_)
                | Source::Index(_)
                | Source::Noise => {}
            }
        }
        let mount = 1.0 + self.temperature.mount_expansion_per_k * change_k;
        let farther_mm = if let Lens::Prescription(lens) = &spec.lens {
            let lens = self.lens(lens, off, change_k)?;
            let (moved, farther_mm) = self.housed(spec, lens, mount, sensor_mm, &masks_mm)?;
            spec = moved;
            farther_mm
        } else {
            scale_focal_lengths(&mut spec, None, 1.0 + self.temperature.focal_length_per_k * change_k);
            spec.sensor.distance_mm = mount * spec.sensor.distance_mm + sensor_mm;
            for (mask, off_mm) in spec.apertures.iter_mut().zip(&masks_mm) {
                mask.position_mm = mount * mask.position_mm + off_mm;
            }
            0.0
        };
        Ok(Built { instrument: Instrument::new(spec)?, farther_mm, leak })
    }

    /// A leak is never less than no light.
    fn leak(&self, plane: usize, band: usize, off: f64) -> f64 {
        let stated = self.instrument.crosstalk.as_ref().map_or(0.0, |stated| stated.matrix[plane][band]);
        if stated > 0.0 { off.max(-stated) } else { off.abs() }
    }

    /// The lens with everything off that is its own.
    fn lens(&self, lens: &PrescriptionLens, off: &[f64], change_k: f64) -> Result<PrescriptionLens> {
        let mut spec = lens.prescription.clone().context("a lens without surfaces")?;
        let mut index_off = vec![0.0; spec.surfaces.len()];
        let mut moves = vec![Move::default(); self.elements.len()];
        for (Toleranced { source, .. }, off) in self.sources.iter().zip(off) {
            match *source {
                Source::ElementDecentre(index, axis) => moves[index].decentre_mm[axis] = *off,
                Source::ElementTilt(index, axis) => moves[index].tilt_deg[axis] = *off,
                Source::Thickness(surface) | Source::AirGap(surface) => spec.surfaces[surface].gap_mm += off,
                Source::Radius(surface) => {
                    if let Some(radius_mm) = spec.surfaces[surface].shape.radius_mm_mut() {
                        *radius_mm *= 1.0 + 0.01 * off;
                    }
                }
                Source::Index(surface) => index_off[surface] = *off,
                _ => {}
            }
        }
        self.warm(&mut spec, change_k);
        for (element, moved) in self.elements.iter().zip(&moves) {
            moved.apply(&mut spec, element);
        }
        let index_off = self.index_changes(&spec, index_off, change_k);
        self.give_indices(&mut spec, lens.design_wavelength_nm, &index_off)?;
        Ok(PrescriptionLens { prescription: Some(spec), focal_length_mm: None, ..lens.clone() })
    }

    /// Lets glass and air grow.
    fn warm(&self, spec: &mut PrescriptionSpec, change_k: f64) {
        let mut before = 0.0;
        for surface in &mut spec.surfaces {
            let is_air = surface.medium.eq_ignore_ascii_case("air");
            let own = if is_air { 0.0 } else { self.temperature.of_glass(&surface.medium).expansion_per_k };
            // Two glasses that are cemented share their surface.
            let of_surface = if before > 0.0 && own > 0.0 { 0.5 * (before + own) } else { before + own };
            if let Some(radius_mm) = surface.shape.radius_mm_mut() {
                *radius_mm *= 1.0 + of_surface * change_k;
            }
            let of_gap = if is_air { self.temperature.mount_expansion_per_k } else { own };
            surface.gap_mm *= 1.0 + of_gap * change_k;
            before = own;
        }
    }

    /// With what temperature adds to the indices behind surfaces.
    fn index_changes(&self, spec: &PrescriptionSpec, index_off: Vec<f64>, change_k: f64) -> Vec<f64> {
        let change = |(surface, off): (&twinpupil_instrument::SurfaceSpec, f64)| {
            if surface.medium.eq_ignore_ascii_case("air") {
                0.0
            } else {
                off + self.temperature.of_glass(&surface.medium).index_per_k * change_k
            }
        };
        spec.surfaces.iter().zip(index_off).map(change).collect()
    }

    /// Gives glasses whose index is off materials of their own, known at the wavelengths that are used.
    fn give_indices(&self, spec: &mut PrescriptionSpec, design_wavelength_nm: f64, index_off: &[f64]) -> Result<()> {
        let mut wavelengths_nm: Vec<f64> = self.instrument.bands.iter().map(|band| band.wavelength_nm).collect();
        wavelengths_nm.push(design_wavelength_nm);
        wavelengths_nm.extend(spec.surfaces.iter().filter_map(|surface| match surface.shape {
            Shape::Facets { design_wavelength_nm, .. } => Some(design_wavelength_nm),
            _ => None,
        }));
        wavelengths_nm.sort_by(f64::total_cmp);
        wavelengths_nm.dedup();
        let mut media = BTreeMap::new();
        for (index, off) in index_off.iter().enumerate().filter(|of| *of.1 != 0.0) {
            let glass = Glass::named(&spec.surfaces[index].medium, &spec.media, &[], "medium")?;
            keep_facets(&mut spec.surfaces, index, &glass, *off)?;
            let surface = &mut spec.surfaces[index];
            let known = wavelengths_nm.iter().map(|nm| Ok([*nm, glass.index(*nm)? + off]));
            let mut coefficients: Vec<[f64; 2]> = known.collect::<Result<_>>()?;
            // A table has two rows at least.
            if let [[nm, index]] = coefficients[..] {
                coefficients.push([nm + 1.0, index]);
            }
            let name = format!("behind surface {index}");
            surface.medium.clone_from(&name);
            let medium = MediumSpec {
                formula: Formula::Table,
                coefficients: coefficients.into_flattened(),
                wavelengths_nm: glass.wavelengths_nm(),
            };
            media.insert(name, medium);
        }
        spec.media.append(&mut media);
        Ok(())
    }

    /// The camera with this lens in its housing, and how much farther away objects are from its front principal plane.
    fn housed(
        &self,
        mut spec: InstrumentSpec,
        lens: PrescriptionLens,
        mount: f64,
        sensor_mm: f64,
        masks_mm: &[f64],
    ) -> Result<(InstrumentSpec, f64)> {
        let drawn = self.stand.as_ref().context("a lens without surfaces")?;
        let own = lens.stand(spec.sensor.distance_mm)?;
        let sensor_behind_mm = mount * (drawn.rear_principal_mm + spec.sensor.distance_mm) + sensor_mm;
        spec.sensor.distance_mm = sensor_behind_mm - own.rear_principal_mm;
        for (mask, off_mm) in spec.apertures.iter_mut().zip(masks_mm) {
            match mask.surface {
                Some(surface) => {
                    let at = within_gaps(&lens, surface, mount * mask.position_mm + off_mm, mask.position_mm, drawn);
                    (mask.surface, mask.position_mm) = (Some(at.0), at.1);
                }
                None if mask.position_mm < 0.0 => {
                    let place_mm = mount * (drawn.front_principal_mm + mask.position_mm) + off_mm;
                    mask.position_mm = place_mm - own.front_principal_mm;
                }
                None => {
                    let place_mm = mount * (drawn.rear_principal_mm + mask.position_mm) + off_mm;
                    mask.position_mm = place_mm - own.rear_principal_mm;
                }
            }
        }
        spec.lens = Lens::Prescription(Box::new(lens));
        Ok((spec, own.front_principal_mm - drawn.front_principal_mm))
    }
}

/// Facets stay as they are cut when the index of their glass is off: 1/((n − 1) f) is their curvature at the axis.
fn keep_facets(surfaces: &mut [SurfaceSpec], index: usize, glass: &Glass, off: f64) -> Result<()> {
    for surface in surfaces.iter_mut().skip(index).take(2) {
        if let Shape::Facets { focal_length_mm, design_wavelength_nm, .. } = &mut surface.shape {
            let excess = glass.index(*design_wavelength_nm)? - 1.0;
            *focal_length_mm *= excess / (excess + off);
        }
    }
    Ok(())
}

/// Scales the focal length of a band, or of all.
fn scale_focal_lengths(spec: &mut InstrumentSpec, band: Option<usize>, factor: f64) {
    match (&mut spec.lens, band) {
        (Lens::Thin(lens), Some(band)) => {
            let name = &spec.bands[band].name;
            let focal_length_mm = factor * lens.focal_length_mm(name);
            lens.focal_length_mm_by_band.insert(name.clone(), focal_length_mm);
        }
        (Lens::Thin(lens), None) => {
            lens.focal_length_mm *= factor;
            lens.focal_length_mm_by_band.values_mut().for_each(|focal_length_mm| *focal_length_mm *= factor);
        }
        (Lens::Fresnel(lens), _) => lens.focal_length_mm *= factor,
        (Lens::Prescription(_), _) => {}
    }
}

/// Where a mask is that is so far behind a surface: glass stops it, and a surface without glass does not. One that is on
/// glass in the drawing stays there.
fn within_gaps(
    lens: &PrescriptionLens,
    surface: usize,
    behind_mm: f64,
    drawn_mm: f64,
    drawn: &LensStand,
) -> (usize, f64) {
    let surfaces = lens.prescription.as_ref().map_or(&[][..], |spec| &spec.surfaces);
    let is_air = |index: usize| surfaces[index].medium.eq_ignore_ascii_case("air");
    let (last, gap_mm) = (surfaces.len() - 1, surfaces[surface].gap_mm);
    let is_free_before = surface > 0 && is_air(surface - 1) && is_air(surface);
    let is_free_behind = surface < last && is_air(surface) && is_air(surface + 1);
    let is_on_next = surface < last && drawn_mm == drawn.prescription.surfaces[surface].gap_mm;
    match behind_mm {
        _ if is_on_next && !is_free_behind => (surface, gap_mm),
        _ if drawn_mm == 0.0 && surface > 0 && !is_free_before => (surface, 0.0),
        _ if surface == 0 && drawn_mm <= 0.0 && (is_air(0) || behind_mm < 0.0) => (surface, behind_mm),
        _ if behind_mm < 0.0 && is_free_before => (surface - 1, (surfaces[surface - 1].gap_mm + behind_mm).max(0.0)),
        _ if surface < last && behind_mm > gap_mm && is_free_behind => {
            (surface + 1, (behind_mm - gap_mm).min(surfaces[surface + 1].gap_mm))
        }
        _ if surface == last => (surface, behind_mm.max(0.0)),
        _ => (surface, behind_mm.clamp(0.0, gap_mm)),
    }
}

/// How an element is off its place, as one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Move {
    decentre_mm: [f64; 2],
    /// About x, then about y, through its middle.
    tilt_deg: [f64; 2],
}

impl Move {
    /// Moves every surface of the element. A surface s behind the middle goes across the axis by s times the third column of
    /// the rotation `Rx Ry`; along it, by less than s θ²/2, it stays.
    fn apply(&self, spec: &mut PrescriptionSpec, element: &Element) {
        if *self == Self::default() {
            return;
        }
        let gaps: f64 =
            spec.surfaces[element.surfaces.start..element.last()].iter().map(|surface| surface.gap_mm).sum();
        let [a, b] = self.tilt_deg.map(f64::to_radians);
        let across = [b.sin(), -a.sin() * b.cos()];
        let mut from_middle_mm = -0.5 * gaps;
        for surface in &mut spec.surfaces[element.surfaces.clone()] {
            for (k, across) in across.into_iter().enumerate() {
                surface.decentre_mm[k] += self.decentre_mm[k] + from_middle_mm * across;
                surface.tilt_deg[k] += self.tilt_deg[k];
            }
            from_middle_mm += surface.gap_mm;
        }
    }
}

#[cfg(test)]
mod tests {
    use twinpupil_instrument::{PixelPoint, Projection, paper};

    use super::super::sight::Sight;
    use super::super::tolerances::grade;
    use super::*;

    /// The paper's camera behind a lens of these surfaces.
    fn drawing(surfaces: Vec<SurfaceSpec>, edit: impl Fn(&mut Tolerances)) -> Drawing {
        let mut spec = paper::instrument().into_spec();
        let lens = PrescriptionSpec { surfaces, ..PrescriptionSpec::default() };
        spec.lens = Lens::Prescription(Box::new(PrescriptionLens { prescription: Some(lens), ..Default::default() }));
        // Behind the lens, wherever its rear principal plane is.
        spec.apertures[0].position_mm = 8.0;
        let mut tolerances = Tolerances::from_toml(grade("commercial").unwrap()).unwrap();
        edit(&mut tolerances);
        Drawing::new(&Instrument::new(spec).unwrap(), &tolerances).unwrap()
    }

    fn ideal() -> Vec<SurfaceSpec> {
        vec![SurfaceSpec { shape: Shape::ThinLens { focal_length_mm: 100.0 }, ..SurfaceSpec::default() }]
    }

    fn singlet() -> Vec<SurfaceSpec> {
        let surface = |radius_mm: f64, gap_mm: f64, medium: &str| SurfaceSpec {
            shape: Shape::Sphere { radius_mm },
            gap_mm,
            medium: medium.to_owned(),
            ..SurfaceSpec::default()
        };
        vec![surface(103.0, 4.0, "N-BK7"), surface(-103.0, 0.0, "air")]
    }

    /// Built off by one number.
    fn off_by(drawing: &Drawing, source: Source, off: f64) -> Built {
        let all: Vec<f64> = drawing.sources.iter().map(|own| if own.source == source { off } else { 0.0 }).collect();
        assert!(all.iter().filter(|off| **off != 0.0).count() == 1, "{source:?}");
        drawing.built(&all, false).unwrap()
    }

    #[test]
    fn a_decentred_lens_sees_the_world_and_its_masks_the_other_way_off() {
        const OFF_MM: f64 = 0.2;
        let drawing = drawing(ideal(), |_| ());
        for axis in [0, 1] {
            let built = off_by(&drawing, Source::ElementDecentre(0, axis), OFF_MM);
            let sight = Sight::new(&built.instrument).unwrap();
            // The axes of the prescription have y up.
            let moved: [f64; 2] = std::array::from_fn(|k| if k == axis { [OFF_MM, -OFF_MM][k] } else { 0.0 });
            let object_mm = [6.0, -4.0, 260.0];
            for (band, own) in drawing.instrument.bands.iter().enumerate() {
                let projection = drawing.instrument.projection(own);
                // About the lens; on the sensor, whose image is upside down, back by as much.
                let about = Projection { pupil_centre_mm: moved.map(|mm| -mm), ..projection };
                let image = about.image([object_mm[0] - moved[0], object_mm[1] - moved[1], object_mm[2]]);
                let sensor = &drawing.instrument.sensor;
                let expected = PixelPoint {
                    u: sensor.axis_px[0] + (image.x_mm - moved[0]) / sensor.pitch_mm,
                    v: sensor.axis_px[1] + (image.y_mm - moved[1]) / sensor.pitch_mm,
                };
                let found = sight.shown(band, object_mm).unwrap().centre;
                let off_px = (found.u - expected.u).hypot(found.v - expected.v);
                assert!(off_px < 1e-3, "{}: {found:?} {expected:?}", own.name);
            }
        }
    }

    #[test]
    fn tilting_a_thick_lens_about_its_middle_hardly_moves_the_image() {
        // The nodal points of an even lens lie about its middle: far images stay to first order [Hecht, Optics, 6.1].
        let drawing = drawing(singlet(), |_| ());
        let [still, tilted, decentred] = [
            (Source::ElementTilt(0, 1), 1e-12),
            (Source::ElementTilt(0, 1), 0.3),
            (Source::ElementDecentre(0, 0), 0.02),
        ]
        .map(|(source, off)| {
            let sight = Sight::new(&off_by(&drawing, source, off).instrument).unwrap();
            sight.shown(0, [5.0, 0.0, 300.0]).unwrap().centre
        });
        let moved = |image: PixelPoint| (image.u - still.u).hypot(image.v - still.v);
        // 0.3° over the 1.4 mm between the nodal points is 0.007 mm; its middle off by 0.02 mm counts more than once.
        assert!(moved(tilted) < 2.0 && moved(decentred) > 4.0, "{} {}", moved(tilted), moved(decentred));
    }

    #[test]
    fn the_focal_length_follows_the_lens_makers_equation() {
        let drawing = drawing(singlet(), |_| ());
        let index = Glass::built_in("N-BK7", "m").unwrap().index(587.6).unwrap();
        let focal_length_mm = |index: f64, radius_mm: f64, thickness_mm: f64| {
            let (power, r) = (index - 1.0, radius_mm);
            1.0 / (power * (1.0 / r + 1.0 / 103.0 - power * thickness_mm / (index * r * 103.0)))
        };
        let of = |source: Source, off: f64| off_by(&drawing, source, off).instrument.lens.focal_length_mm();
        for (found, expected) in [
            (of(Source::Index(0), 1e-3), focal_length_mm(index + 1e-3, 103.0, 4.0)),
            (of(Source::Radius(0), 0.5), focal_length_mm(index, 103.0 * 1.005, 4.0)),
            (of(Source::Thickness(0), 0.1), focal_length_mm(index, 103.0, 4.1)),
        ] {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }

    #[test]
    fn the_sensor_keeps_its_place_in_the_housing() {
        let drawing = drawing(singlet(), |_| ());
        let vertex_to_sensor_mm = |instrument: &Instrument| {
            let Lens::Prescription(lens) = &instrument.lens else { panic!("a prescription") };
            let l = instrument.sensor.distance_mm;
            lens.stand(l).unwrap().rear_principal_mm + l
        };
        let drawn_mm = vertex_to_sensor_mm(&drawing.instrument);
        let built = off_by(&drawing, Source::Thickness(0), 0.1);
        assert!((vertex_to_sensor_mm(&built.instrument) - drawn_mm).abs() < 1e-9);
        assert!(built.instrument.sensor.distance_mm != drawing.instrument.sensor.distance_mm);
        let nearer = off_by(&drawing, Source::SensorDistance, 0.05);
        assert!((vertex_to_sensor_mm(&nearer.instrument) - drawn_mm - 0.05).abs() < 1e-9);
    }

    #[test]
    fn a_camera_of_one_material_grows_as_one() {
        let drawing = drawing(singlet(), |tolerances| {
            tolerances.temperature.mount_expansion_per_k = 7.1e-6;
            tolerances.temperature.glass.index_per_k = 0.0;
        });
        let warm = off_by(&drawing, Source::Temperature, 100.0).instrument;
        let grown = 1.0 + 7.1e-4;
        for (found, cold) in [
            (warm.lens.focal_length_mm(), drawing.instrument.lens.focal_length_mm()),
            (warm.sensor.distance_mm, drawing.instrument.sensor.distance_mm),
            (warm.apertures[1].position_mm, drawing.instrument.apertures[1].position_mm),
        ] {
            assert!((found / cold - grown).abs() < 1e-9, "{found} {cold}");
        }
    }

    #[test]
    fn masks_stop_at_glass_and_go_past_a_surface_without_any() {
        let air = |gap_mm: f64| SurfaceSpec { gap_mm, ..SurfaceSpec::default() };
        let mut surfaces = singlet();
        surfaces[1].gap_mm = 3.0;
        surfaces.extend([air(2.0), air(0.0)]);
        let drawn_lens = drawing(surfaces, |_| ());
        let Lens::Prescription(lens) = &drawn_lens.instrument.lens else { panic!("a prescription") };
        let stand = drawn_lens.stand.as_ref().unwrap();
        let at = |surface: usize, behind_mm: f64, drawn_mm: f64| within_gaps(lens, surface, behind_mm, drawn_mm, stand);
        assert_eq!(at(1, -0.1, 0.05), (1, 0.0));
        assert_eq!(at(1, 3.1, 2.95), (2, 3.1 - 3.0));
        assert_eq!(at(2, -0.1, 0.0), (1, 2.9));
        assert_eq!(at(0, -0.3, -0.2), (0, -0.3));
        assert_eq!(at(3, 4.0, 3.9), (3, 4.0));
        // On glass it stays.
        assert_eq!(at(1, 0.1, 0.0), (1, 0.0));
    }
}
