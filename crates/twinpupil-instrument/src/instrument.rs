//! The camera: what the user states in `instrument.toml`, checked once.

use std::ops::Deref;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::check::{self, SyntaxError, ValueError, within};
use crate::ideal::IdealBand;
use crate::{
    Aperture, Band, CalibrationSpec, CrosstalkSpec, CubePlane, FrameError, FrameView, Lens, Mosaic, Page, PixelPoint,
    PlaneView, Projection, ResponseMatrix, Role, Sensor, Site, SpectraSpec,
};

/// An instrument file that is not legal.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum InstrumentError {
    /// Not the TOML that was expected.
    #[error(transparent)]
    Syntax(#[from] SyntaxError),
    /// A value outside its range.
    #[error(transparent)]
    Value(#[from] ValueError),
}

/// `instrument.toml` as it is written; [`Instrument`] is the same, checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InstrumentSpec {
    /// Version of this format: 1.
    pub schema: u32,
    /// What the user calls the camera.
    pub name: String,
    /// The lens.
    pub lens: Lens,
    /// The sensor.
    pub sensor: Sensor,
    /// The bands: one telecentric, one entocentric, and any number of intermediate ones.
    #[serde(rename = "band")]
    pub bands: Vec<Band>,
    /// The masks and stops.
    #[serde(rename = "aperture")]
    pub apertures: Vec<Aperture>,
    /// Distances at which objects may be; 0.8 to 1.25 of the in-focus distance if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_range: Option<DepthRange>,
    /// Spectral curves, for crosstalk between the bands.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectra: Option<SpectraSpec>,
    /// Crosstalk between the bands, where it is known as such.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crosstalk: Option<CrosstalkSpec>,
    /// How the numbers were determined, and how well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationSpec>,
}

/// `[depth_range]`: the distances between which objects may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DepthRange {
    /// Nearest distance, mm.
    pub near_mm: f64,
    /// Farthest distance, mm.
    pub far_mm: f64,
}

/// A checked camera; reads like its [`InstrumentSpec`].
#[derive(Debug, Clone, PartialEq)]
pub struct Instrument {
    spec: InstrumentSpec,
    /// What every band is to first order.
    ideal: Vec<IdealBand>,
}

impl Deref for Instrument {
    type Target = InstrumentSpec;

    fn deref(&self) -> &InstrumentSpec {
        &self.spec
    }
}

impl Instrument {
    /// Checks every value of `spec`.
    pub fn new(mut spec: InstrumentSpec) -> Result<Self, ValueError> {
        check::schema(spec.schema)?;
        spec.lens.settle()?;
        spec.sensor.settle_polarizers()?;
        spec.sensor.check()?;
        check_bands(&spec)?;
        check_crosstalk(&spec)?;
        check_apertures(&spec)?;
        check_focal_lengths(&spec)?;
        check_tilt(&spec)?;
        if let Some(DepthRange { near_mm, far_mm }) = spec.depth_range {
            within("depth_range.near_mm", near_mm, 1.0, 1e6)?;
            within("depth_range.far_mm", far_mm, 1.0, 1e6)?;
            if far_mm <= near_mm {
                return Err(ValueError::new("depth_range.far_mm", far_mm, format!("above near_mm = {near_mm}")));
            }
        }
        let ideal = IdealBand::of(&spec)?;
        check_pupils(&spec, &ideal)?;
        let instrument = Self { spec, ideal };
        for (index, band) in instrument.bands.iter().enumerate() {
            instrument.page(band).check(&instrument.sensor, band, index)?;
        }
        if let Some(calibration) = &instrument.spec.calibration {
            calibration.check(&instrument)?;
        }
        Ok(instrument)
    }

    /// Reads and checks an instrument file.
    pub fn from_toml(text: &str) -> Result<Self, InstrumentError> {
        Ok(Self::new(check::parse_toml(text)?)?)
    }

    /// The instrument as a file that [`Instrument::from_toml`] reads back to the same.
    pub fn to_toml(&self) -> String {
        let text = toml::to_string(&self.spec).expect("a checked instrument is plain data");
        let mut document: toml_edit::DocumentMut = text.parse().expect("it was printed just now");
        for (tables, key) in [("band", "distortion"), ("band", "correction"), ("aperture", "zones")] {
            for table in document[tables].as_array_of_tables_mut().into_iter().flat_map(|tables| tables.iter_mut()) {
                put_on_one_line(table, key);
            }
        }
        let prescription = document["lens"].as_table_mut().and_then(|lens| lens.get_mut("prescription"));
        let surfaces = prescription.and_then(|lens| lens.as_table_mut()).and_then(|lens| lens.get_mut("surface"));
        let surfaces = surfaces.and_then(|surfaces| surfaces.as_array_of_tables_mut());
        for surface in surfaces.into_iter().flat_map(|surfaces| surfaces.iter_mut()) {
            put_on_one_line(surface, "shape");
        }
        document.to_string()
    }

    /// JSON schema of the instrument file.
    pub fn json_schema() -> schemars::Schema {
        schemars::schema_for!(InstrumentSpec)
    }

    /// What the user stated.
    pub fn into_spec(self) -> InstrumentSpec {
        self.spec
    }

    /// Index of the first band with a role; the telecentric and the entocentric one are always there.
    ///
    /// # Panics
    /// If there is no intermediate band and one is asked for.
    pub fn band_index(&self, role: Role) -> usize {
        self.bands.iter().position(|band| band.role == role).expect("checked: one band for each role of the pair")
    }

    /// Indices of all bands: the telecentric one, the entocentric one, then the others in the order of the file.
    pub fn bands_by_role(&self) -> Vec<usize> {
        let pair = [Role::Telecentric, Role::Entocentric].map(|role| self.band_index(role));
        pair.into_iter().chain((0..self.bands.len()).filter(|index| !pair.contains(index))).collect()
    }

    /// The band with a role.
    pub fn band(&self, role: Role) -> &Band {
        &self.bands[self.band_index(role)]
    }

    /// First-order projection of a band through the aperture that is its pupil, with the focal length that the
    /// instrument file states; of a lens surface by surface with the band's own.
    pub fn projection(&self, band: &Band) -> Projection {
        let ideal = self.ideal(band);
        let (index, pupil_radius_mm) = pupil(&self.spec, ideal, band).expect("checked: every band has a pupil");
        let aperture = &ideal.apertures[index];
        Projection {
            focal_length_mm: ideal.focal_length_mm,
            sensor_distance_mm: ideal.sensor_distance_mm,
            pupil_position_mm: aperture.position_mm,
            pupil_centre_mm: aperture.centre_mm,
            pupil_radius_mm,
        }
    }

    /// Where the image of a band lies on its page, with the focal length that the instrument file states.
    pub fn page(&self, band: &Band) -> Page {
        Page::new(&self.sensor, band, &self.projection(band))
    }

    /// The projections of the telecentric and the entocentric band.
    pub fn projections(&self) -> [Projection; 2] {
        [Role::Telecentric, Role::Entocentric].map(|role| self.projection(self.band(role)))
    }

    /// Index of the aperture that is a band's pupil.
    pub fn pupil_index(&self, band: &Band) -> usize {
        pupil(&self.spec, self.ideal(band), band).expect("checked: every band has a pupil").0
    }

    /// The apertures as they stand about the ideal lens of [`Instrument::projection`]: those of the file, but for masks
    /// among the surfaces of a lens their images behind it or in front of it.
    pub fn ideal_apertures(&self, band: &Band) -> &[Aperture] {
        &self.ideal(band).apertures
    }

    fn ideal(&self, band: &Band) -> &IdealBand {
        let index = self.bands.iter().position(|own| own.name == band.name).unwrap_or(0);
        &self.ideal[index]
    }

    /// Distance at which the data sheet's focal length images sharply, `L f/(L − f)`, mm.
    pub fn focus_distance_mm(&self) -> f64 {
        let (l, f) = (self.sensor.distance_mm, self.lens.focal_length_mm());
        l * f / (l - f)
    }

    /// Distance of the farthest corner of the sensor from the axis, mm.
    pub fn corner_radius_mm(&self) -> f64 {
        let sensor = &self.sensor;
        let reach_px = |k: usize| {
            let last_px = (sensor.size_px[k] - 1) as f64;
            sensor.axis_px[k].abs().max((last_px - sensor.axis_px[k]).abs()) + 0.5
        };
        sensor.pitch_mm * reach_px(0).hypot(reach_px(1))
    }

    /// The distances between which objects may be.
    pub fn depth_range(&self) -> DepthRange {
        let focus_mm = self.focus_distance_mm();
        self.spec.depth_range.unwrap_or(DepthRange { near_mm: 0.8 * focus_mm, far_mm: 1.25 * focus_mm })
    }

    /// The pixels of a frame that carry a band.
    pub fn site(&self, band: &Band) -> Site {
        site(&self.spec, band).expect("checked: every band has a plane")
    }

    /// The pixels of one band of a frame, on their own sub-lattice and never interpolated.
    pub fn plane<'f>(&self, frame: impl Into<FrameView<'f>>, band: &Band) -> Result<PlaneView<'f>, FrameError> {
        frame.into().plane(self.site(band))
    }

    /// The planes of this camera's frames, by their names.
    pub fn planes(&self) -> Vec<String> {
        if self.sensor.mosaic.has_page_for_each_band() {
            return self.bands.iter().map(|band| band.plane.clone()).collect();
        }
        self.sensor.mosaic.planes()
    }

    /// The plane that pixel (column, row) of a page belongs to.
    pub fn plane_of(&self, page: usize, column: usize, row: usize) -> String {
        match self.sensor.mosaic {
            Mosaic::Cube => self.bands[page].plane.clone(),
            mosaic => mosaic.plane_of(page, column, row),
        }
    }

    /// The band whose page this is, where every band has a page of its own.
    pub fn band_of_page(&self, page: usize) -> Option<&Band> {
        let own = |band: &&Band| self.sensor.mosaic.has_page_for_each_band() && self.site(band).page == page;
        self.bands.iter().find(own)
    }

    /// Where the optical axis meets the page of a band, px.
    pub fn axis_px(&self, band: &Band) -> [f64; 2] {
        let [u, v] = self.sensor.axis_px;
        if band.registration.is_identity() {
            return [u, v];
        }
        let own = band.registration.inverse().map(PixelPoint { u, v });
        [own.u, own.v]
    }

    /// Signal in every plane from every band, as far as this file alone states it: from `[crosstalk]`, or the law of
    /// polarizers; otherwise every plane sees its own band and nothing else. The curves of `[spectra]` are in files of
    /// their own.
    pub fn response_matrix(&self) -> ResponseMatrix {
        match (&self.crosstalk, self.sensor.mosaic) {
            (Some(crosstalk), _) => ResponseMatrix::from_rows(&self.bands, &crosstalk.matrix),
            (None, Mosaic::Polarizer(_)) => {
                ResponseMatrix::of_polarizers(&self.bands, self.sensor.extinction_ratio.unwrap_or(f64::INFINITY))
            }
            (None, _) => ResponseMatrix::ideal(&self.bands),
        }
    }

    /// Number of pages that a frame of this camera has.
    pub fn pages(&self) -> usize {
        self.sensor.mosaic.pages(self.bands.len())
    }
}

/// Prints what a key of a table holds beside the key: zones of a mask and coefficients read best so.
fn put_on_one_line(table: &mut toml_edit::Table, key: &str) {
    if let Some((mut key, item)) = table.get_key_value_mut(key) {
        item.make_value();
        key.leaf_decor_mut().set_suffix(" ");
        if let Some(value) = item.as_value_mut() {
            value.decor_mut().set_prefix(" ");
        }
    }
}

/// The aperture that limits a band for points in focus, with the outermost radius that passes there.
fn pupil(spec: &InstrumentSpec, ideal: &IdealBand, band: &Band) -> Option<(usize, f64)> {
    let l = spec.sensor.distance_mm;
    let f = spec.lens.focal_length_mm();
    let focus_mm = l * f / (l - f);
    // Width at the aperture of the cone between the lens and a sensor point on the axis, relative to the lens.
    let cone = |d: f64| if d >= 0.0 { 1.0 - d / l } else { 1.0 + d / focus_mm };
    let on_lens = |(index, radius_mm): &(usize, f64)| radius_mm / cone(ideal.apertures[*index].position_mm).abs();
    (ideal.apertures.iter().enumerate())
        .filter_map(|(index, aperture)| Some((index, aperture.annuli(&band.name).last()?.outer_mm)))
        .min_by(|a, b| on_lens(a).total_cmp(&on_lens(b)))
        .filter(|(_, radius_mm)| radius_mm.is_finite())
}

fn check_bands(spec: &InstrumentSpec) -> Result<(), ValueError> {
    for role in [Role::Telecentric, Role::Entocentric] {
        let count = spec.bands.iter().filter(|band| band.role == role).count();
        if count != 1 {
            let value = format!("{count} times {}", role.name());
            return Err(ValueError::new("band.role", value, "one telecentric and one entocentric band"));
        }
    }
    for (i, band) in spec.bands.iter().enumerate() {
        within(&format!("band[{i}].wavelength_nm"), band.wavelength_nm, 200.0, 20_000.0)?;
        let earlier = &spec.bands[..i];
        if band.name.is_empty() || earlier.iter().any(|other| other.name == band.name) {
            return Err(ValueError::new(format!("band[{i}].name"), &band.name, "a name of its own"));
        }
        let pages = spec.sensor.mosaic.pages(spec.bands.len());
        if site(spec, band).is_none_or(|site| site.page >= pages) {
            let legal = match spec.sensor.mosaic {
                Mosaic::Mono | Mosaic::Sensors => format!("a page number, 0 to {}", pages - 1),
                Mosaic::Polarizer(_) => "0, 45, 90 or 135".to_owned(),
                Mosaic::Cube => "the number of a plane from 0, or a wavelength such as 680 nm".to_owned(),
                _ => "r, g or b".to_owned(),
            };
            return Err(ValueError::new(format!("band[{i}].plane"), &band.plane, legal));
        }
        if earlier.iter().any(|other| other.plane == band.plane) {
            return Err(ValueError::new(format!("band[{i}].plane"), &band.plane, "a plane of its own"));
        }
        check_registration(spec, i)?;
        band.distortion.check(&format!("band[{i}].distortion"))?;
        if let Some(correction) = &band.correction {
            correction.check(&format!("band[{i}].correction"))?;
        }
    }
    Ok(())
}

fn check_registration(spec: &InstrumentSpec, band: usize) -> Result<(), ValueError> {
    let registration = spec.bands[band].registration;
    let key = format!("band[{band}].registration");
    if registration.is_identity() {
        return Ok(());
    }
    if !spec.sensor.mosaic.has_page_for_each_band() {
        let legal = "left out where several bands share one page";
        return Err(ValueError::new(key, format!("stated for a sensor {}", spec.sensor.mosaic.name()), legal));
    }
    registration.check(&key, spec.sensor.size_px)
}

/// The pixels that carry a band.
fn site(spec: &InstrumentSpec, band: &Band) -> Option<Site> {
    match spec.sensor.mosaic {
        // A frame holds the planes of a cube in the order of the bands.
        Mosaic::Cube => {
            CubePlane::parse(&band.plane)?;
            spec.bands.iter().position(|other| other.name == band.name).map(Site::of_page)
        }
        mosaic => mosaic.site(&band.plane),
    }
}

fn check_crosstalk(spec: &InstrumentSpec) -> Result<(), ValueError> {
    let Some(crosstalk) = &spec.crosstalk else { return Ok(()) };
    if spec.spectra.is_some() {
        return Err(ValueError::new("crosstalk", "stated beside spectra", "one of the two"));
    }
    if let Some(ratio) = spec.sensor.extinction_ratio {
        return Err(ValueError::new("sensor.extinction_ratio", ratio, "left out beside crosstalk"));
    }
    crosstalk.check(spec.bands.len())
}

fn check_apertures(spec: &InstrumentSpec) -> Result<(), ValueError> {
    for (i, aperture) in spec.apertures.iter().enumerate() {
        let key = |name: &str| format!("aperture[{i}].{name}");
        let (position_mm, sensor_mm) = (aperture.position_mm, spec.sensor.distance_mm);
        // Also false for NaN.
        if !(position_mm > -1e5 && position_mm < sensor_mm) {
            let legal = format!("in front of the sensor, below sensor.distance_mm = {sensor_mm}");
            return Err(ValueError::new(key("position_mm"), position_mm, legal));
        }
        if let (Some(surface), Lens::Thin(_) | Lens::Fresnel(_)) = (aperture.surface, &spec.lens) {
            return Err(ValueError::new(key("surface"), surface, "left out unless lens.model is prescription"));
        }
        within(&key("centre_mm[0]"), aperture.centre_mm[0], -1e3, 1e3)?;
        within(&key("centre_mm[1]"), aperture.centre_mm[1], -1e3, 1e3)?;
        if aperture.zones.is_empty() {
            return Err(ValueError::new(key("zones"), "empty", "at least one zone"));
        }
        let mut inner_mm = 0.0;
        for (k, zone) in aperture.zones.iter().enumerate() {
            let key = |name: &str| format!("aperture[{i}].zones[{k}].{name}");
            match zone.radius_mm {
                Some(radius_mm) if radius_mm.is_finite() && radius_mm > inner_mm => inner_mm = radius_mm,
                Some(radius_mm) => {
                    return Err(ValueError::new(key("radius_mm"), radius_mm, format!("finite and above {inner_mm}")));
                }
                None if k + 1 == aperture.zones.len() => {}
                None => return Err(ValueError::new(key("radius_mm"), "missing", "left out in the last zone only")),
            }
            if let Some(name) = zone.pass.iter().find(|name| spec.bands.iter().all(|band| band.name != **name)) {
                return Err(ValueError::new(key("pass"), name, "names of bands"));
            }
        }
    }
    for (i, band) in spec.bands.iter().enumerate() {
        if let Some(k) = spec.apertures.iter().position(|aperture| aperture.annuli(&band.name).is_empty()) {
            let value = format!("blocked by aperture[{k}]");
            return Err(ValueError::new(format!("band[{i}]"), value, "passed by a zone of every aperture"));
        }
    }
    Ok(())
}

fn check_pupils(spec: &InstrumentSpec, ideal: &[IdealBand]) -> Result<(), ValueError> {
    for (i, (band, ideal)) in spec.bands.iter().zip(ideal).enumerate() {
        if pupil(spec, ideal, band).is_none() {
            let legal = "a zone with a radius in at least one aperture";
            return Err(ValueError::new(format!("band[{i}]"), "not limited by any aperture", legal));
        }
    }
    Ok(())
}

/// Every corner of a tilted sensor must lie behind the lens and all apertures.
fn check_tilt(spec: &InstrumentSpec) -> Result<(), ValueError> {
    let sensor = &spec.sensor;
    let reach_mm = |axis: usize| {
        let (first_mm, last_mm) = (sensor.axis_px[axis], sensor.size_px[axis] as f64 - sensor.axis_px[axis]);
        sensor.pitch_mm * first_mm.abs().max(last_mm.abs())
    };
    let [a, b] = sensor.slope();
    let nearest_mm = sensor.distance_mm - a.abs() * reach_mm(0) - b.abs() * reach_mm(1);
    let last_mm = spec.apertures.iter().map(|aperture| aperture.position_mm).fold(0.0, f64::max);
    if sensor.tilt_deg == [0.0; 2] || nearest_mm > last_mm {
        return Ok(());
    }
    let legal = format!("tilts at which all of the sensor lies behind the last aperture at {last_mm} mm");
    Err(ValueError::new("sensor.tilt_deg", format!("{:?}", sensor.tilt_deg), legal))
}

fn check_focal_lengths(spec: &InstrumentSpec) -> Result<(), ValueError> {
    let l = spec.sensor.distance_mm;
    let legal = format!("below sensor.distance_mm = {l}, so that something is in focus");
    if spec.lens.focal_length_mm() >= l {
        return Err(ValueError::new("lens.focal_length_mm", spec.lens.focal_length_mm(), legal));
    }
    if let Lens::Thin(lens) = &spec.lens {
        for (name, &focal_length_mm) in &lens.focal_length_mm_by_band {
            let key = format!("lens.focal_length_mm_by_band.{name}");
            if spec.bands.iter().all(|band| band.name != *name) {
                return Err(ValueError::new(key, focal_length_mm, "the name of a band"));
            }
            if focal_length_mm >= l {
                return Err(ValueError::new(key, focal_length_mm, legal));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{builtin, paper};

    /// The paper's file with one piece of text replaced.
    fn edited(from: &str, to: &str) -> Result<Instrument, InstrumentError> {
        assert!(paper::INSTRUMENT_TOML.contains(from), "{from:?} is not in the paper's file");
        Instrument::from_toml(&paper::INSTRUMENT_TOML.replacen(from, to, 1))
    }

    fn message(from: &str, to: &str) -> String {
        edited(from, to).expect_err("must be refused").to_string()
    }

    #[test]
    fn printing_and_reading_is_the_identity() {
        for instrument in [
            paper::instrument(),
            edited("mosaic = \"rggb\"", "mosaic = \"rgb\"\nblack_level = 12").unwrap(),
            edited("model = \"thin\"", "model = \"fresnel\"\ngrooves = \"image\"").unwrap(),
            edited("zones = [{ radius_mm = 0.5", "centre_mm = [0.1, -0.2]\nzones = [{ radius_mm = 0.5").unwrap(),
            edited("# focal_length_mm_by_band", "focal_length_mm_by_band").unwrap(),
            edited("pitch_mm = 0.00586", "pitch_mm = 0.00586\ntilt_deg = [0.5, -0.25]").unwrap(),
            edited("plane = \"b\"", "plane = \"b\"\ndistortion = { k1_per_mm2 = 7e-5, p2_per_mm = -1e-5 }").unwrap(),
        ] {
            let text = instrument.to_toml();
            assert_eq!(Instrument::from_toml(&text).expect("reads back"), instrument, "{text}");
        }
    }

    #[test]
    fn what_is_not_askew_is_left_out() {
        let text = paper::instrument().to_toml();
        assert!(!text.contains("tilt_deg") && !text.contains("distortion"), "{text}");
        let text = edited("plane = \"b\"", "plane = \"b\"\ndistortion = { k1_per_mm2 = 7e-5 }").unwrap().to_toml();
        assert!(text.contains("\ndistortion = { k1_per_mm2 = 0.00007 }\n"), "{text}");
    }

    #[test]
    fn each_pupil_is_the_smallest_aperture() {
        let [telecentric, entocentric] = paper::instrument().projections();
        assert_eq!((telecentric.pupil_position_mm, telecentric.pupil_radius_mm), (100.0, 0.5));
        assert_eq!((entocentric.pupil_position_mm, entocentric.pupil_radius_mm), (0.0, 1.0));
    }

    #[test]
    fn bad_values_are_named_with_what_is_legal() {
        let cases = [
            ("pitch_mm = 0.00586", "pitch_mm = -0.00586", "`sensor.pitch_mm` is -0.00586; legal: 0.00001 to 1"),
            ("focal_length_mm = 100.0", "focal_length_mm = nan", "`lens.focal_length_mm` is NaN"),
            ("focal_length_mm = 100.0", "focal_length_mm = 152", "below sensor.distance_mm = 151"),
            ("schema = 1", "schema = 2", "`schema` is 2; legal: 1"),
            (
                "position_mm = 100.0",
                "position_mm = 151.0",
                "`aperture[1].position_mm` is 151; legal: in front of the sensor",
            ),
            ("radius_mm = 0.5", "radius_mm = 0", "`aperture[1].zones[0].radius_mm` is 0"),
            ("pass = [\"blue\"]", "pass = [\"green\"]", "`aperture[0].zones[0].pass` is green"),
            ("role = \"telecentric\"", "role = \"entocentric\"", "one telecentric and one entocentric band"),
            ("plane = \"b\"", "plane = \"r\"", "`band[1].plane` is r; legal: a plane of its own"),
            ("plane = \"b\"", "plane = \"0\"", "`band[1].plane` is 0; legal: r, g or b"),
            ("far_mm = 370.0", "far_mm = 200.0", "`depth_range.far_mm` is 200; legal: above near_mm = 235"),
            ("bit_depth = 12", "bit_depth = 17", "`sensor.bit_depth` is 17; legal: 1 to 16"),
        ];
        for (from, to, expected) in cases {
            let message = message(from, to);
            assert!(message.contains(expected), "{message:?} lacks {expected:?}");
        }
    }

    /// A shipped file with one piece of text replaced.
    fn message_of(name: &str, from: &str, to: &str) -> String {
        let text = builtin::toml(name).expect("a shipped file");
        assert!(text.contains(from), "{from:?} is not in {name}");
        Instrument::from_toml(&text.replacen(from, to, 1)).expect_err("must be refused").to_string()
    }

    #[test]
    fn carriers_are_checked_against_their_planes() {
        let matrix = "[[1.0, 0.02, 0.06], [0.01, 1.0, 0.08], [0.05, 0.07, 1.0]]";
        let cases = [
            ("polarizer", "plane = \"0\"", "plane = \"30\"", "`band[0].plane` is 30; legal: 0, 45, 90 or 135"),
            (
                "polarizer",
                "[[90, 45], [135, 0]]",
                "[[90, 45], [45, 0]]",
                "`sensor.polarizer_deg` is [[90, 45], [45, 0]]",
            ),
            ("polarizer", "\"polarizer\"\npol", "\"mono\"\npol", "legal: left out unless sensor.mosaic is polarizer"),
            ("polarizer", "ratio = 300.0", "ratio = 1.0", "`sensor.extinction_ratio` is 1; legal: 1.5 to"),
            (
                "hyperspectral",
                "\"680 nm\"",
                "\"red\"",
                "`band[0].plane` is red; legal: the number of a plane from 0, or",
            ),
            ("hyperspectral", "\"intermediate\"", "\"entocentric\"", "one telecentric and one entocentric band"),
            ("two-sensors", "plane = \"1\"", "plane = \"2\"", "`band[1].plane` is 2; legal: a page number, 0 to 1"),
            ("two-sensors", "[0.0, 0.0, 1.0]]", "[0.0, 0.0, 0.0]]", "`band[1].registration` is"),
            (
                "three-bands",
                "\"g\"",
                "\"g\"\nregistration = [[1, 0, 2], [0, 1, 0], [0, 0, 1]]",
                "left out where several",
            ),
            ("three-bands", matrix, "[[1.0, 0.1], [0.1, 1.0]]", "`crosstalk.matrix` is 2 rows; legal: 3 rows of 3"),
            ("three-bands", "0.06]", "1.5]", "`crosstalk.matrix[0][2]` is 1.5; legal: 0 to 1"),
            ("three-bands", "[[1.0,", "[[0.9,", "`crosstalk.matrix[0][0]` is 0.9; legal: 1 for a band in its own"),
            (
                "three-bands",
                "[crosstalk]",
                "[spectra]\nquantum_efficiency = \"nominal\"\nfilters = \"nominal\"\n[crosstalk]",
                "`crosstalk` is stated beside spectra",
            ),
        ];
        for (name, from, to, expected) in cases {
            let message = message_of(name, from, to);
            assert!(message.contains(expected), "{message:?} lacks {expected:?}");
        }
    }

    #[test]
    fn pages_of_a_cube_are_in_the_order_of_the_bands() {
        let instrument = Instrument::from_toml(builtin::toml("hyperspectral").unwrap()).unwrap();
        let pages: Vec<usize> = instrument.bands.iter().map(|band| instrument.site(band).page).collect();
        assert_eq!((pages, instrument.pages()), (vec![0, 1, 2], 3));
        assert_eq!(instrument.plane_of(1, 0, 0), "450 nm");
        assert_eq!(instrument.bands_by_role(), [0, 1, 2]);
    }

    #[test]
    fn the_axis_of_another_sensor_lies_where_its_registration_leads_back() {
        let instrument = Instrument::from_toml(builtin::toml("two-sensors").unwrap()).unwrap();
        let blue = &instrument.bands[1];
        let [u, v] = instrument.axis_px(blue);
        let there = blue.registration.map(PixelPoint { u, v });
        assert!((there.u - 959.5).abs() < 1e-9 && (there.v - 599.5).abs() < 1e-9);
        assert_eq!(instrument.axis_px(&instrument.bands[0]), [959.5, 599.5]);
    }

    #[test]
    fn unknown_missing_and_ill_typed_keys_are_named() {
        let cases = [
            ("pitch_mm = 0.00586", "pixel_mm = 0.00586", "unknown field `pixel_mm`"),
            ("role = \"telecentric\"", "", "missing field `role`"),
            ("role = \"telecentric\"", "role = \"red\"", "unknown variant `red`"),
            ("bit_depth = 12", "bit_depth = \"12\"", "invalid type"),
            ("model = \"thin\"", "model = \"thin\"\nthickness_mm = 1.0", "unknown field `thickness_mm`"),
            ("schema = 1", "schema = ", "line 1"),
        ];
        for (from, to, expected) in cases {
            let message = message(from, to);
            assert!(message.contains(expected) && !message.contains('\n'), "{message:?} lacks {expected:?}");
        }
    }

    #[test]
    fn a_band_that_no_light_reaches_is_refused() {
        let message = message("pass = [\"red\", \"blue\"]", "pass = [\"red\"]");
        assert!(message.contains("`band[1]` is blocked by aperture[2]"), "{message}");
    }

    #[test]
    fn the_published_schema_names_every_section() {
        let schema = serde_json_text(&Instrument::json_schema());
        for key in [
            "\"lens\"",
            "\"sensor\"",
            "\"band\"",
            "\"aperture\"",
            "\"pitch_mm\"",
            "\"zones\"",
            "\"tilt_deg\"",
            "\"k1_per_mm2\"",
        ] {
            assert!(schema.contains(key), "{key}");
        }
    }

    fn serde_json_text(schema: &schemars::Schema) -> String {
        schema.as_value().to_string()
    }
}
