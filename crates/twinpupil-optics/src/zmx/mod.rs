//! Sequential lenses of `.zmx` files.
//!
//! A file is a list of lines with a keyword and values; what follows `SURF n` belongs to surface n. Solves and pickups are
//! not followed: a file also holds the numbers that they came to.

mod surface;

use std::collections::BTreeMap;

use twinpupil_instrument::check::{SyntaxError, ValueError};
use twinpupil_instrument::text::decode;
use twinpupil_instrument::{Prescription, PrescriptionSpec, SURFACES_MAX};

use surface::Entry;

/// What a `.zmx` file says.
#[derive(Debug, Clone, PartialEq)]
pub struct ZmxLens {
    /// The lens, in mm. Surface 0 of the file is the object, its last one the image; a coordinate break whose tilts come
    /// before its shift takes several breaks here, so later surfaces may count higher.
    pub prescription: Prescription,
    /// Wavelengths, nm, the primary one first.
    pub wavelengths_nm: Vec<f64>,
    /// What limits the beam, if the file says so.
    pub beam: Option<Beam>,
    /// Whether the file aims its rays at a stop as wide as the paraxial marginal ray has it, and not as a real one does.
    pub has_paraxial_stop: bool,
    /// Points of the field.
    pub fields: Vec<FieldPoint>,
    /// Catalogues in which its glasses are to be found, by name.
    pub catalogues: Vec<String>,
    /// Line on which the medium behind each surface of the lens is stated, or on which the surface begins.
    pub medium_lines: Vec<usize>,
    /// What the file says beyond the lens that is read, line by line.
    pub notes: Vec<SyntaxError>,
}

/// What limits the beam of a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beam {
    /// Diameter of the entrance pupil, mm.
    EntrancePupil {
        /// mm.
        diameter_mm: f64,
    },
    /// Focal length over the diameter of the entrance pupil.
    FNumber {
        /// That ratio.
        f_number: f64,
    },
    /// One over twice the slope at which the paraxial marginal ray meets the image.
    WorkingFNumber {
        /// That ratio.
        f_number: f64,
    },
    /// Sine of the half angle of the beam from the object.
    ObjectAperture {
        /// The sine.
        sine: f64,
    },
    /// As large as the stop is.
    Stop,
}

/// A point of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldPoint {
    /// Angles against the axis along x and y, degrees.
    Angle([f64; 2]),
    /// Height of the object, mm.
    Object([f64; 2]),
    /// Height of the image, mm.
    Image([f64; 2]),
}

/// Most fields and wavelengths of a file.
const LIST_MAX: usize = 1000;

/// Kinds of field: angles, heights of the object, of the paraxial and of the real image.
const FIELD_KIND_MAX: usize = 3;

/// Wavelengths that are legal, µm.
const WAVELENGTHS_UM: [f64; 2] = [0.001, 1000.0];

impl ZmxLens {
    /// Reads a file.
    pub fn read(bytes: &[u8]) -> Result<Self, SyntaxError> {
        let text = decode(bytes)?;
        let mut file = File::default();
        for (number, line) in (1..).zip(text.lines()) {
            file.take(&Line::new(line, number))?;
        }
        file.lens()
    }
}

/// One line: a keyword and what follows.
struct Line<'a> {
    number: usize,
    keyword: &'a str,
    values: Vec<&'a str>,
    /// All that follows, as it stands.
    rest: &'a str,
}

impl<'a> Line<'a> {
    fn new(text: &'a str, number: usize) -> Self {
        let text = text.trim_matches(|c: char| c.is_whitespace() || c == '\u{1a}' || c == '\u{feff}');
        let (keyword, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        Self { number, keyword, values: rest.split_whitespace().collect(), rest: rest.trim() }
    }

    fn error(&self, message: String) -> SyntaxError {
        SyntaxError { line: self.number, message }
    }

    /// The value at `place`, which must be there.
    fn word(&self, place: usize) -> Result<&'a str, SyntaxError> {
        let lacks = || self.error(format!("{} lacks its value {}", self.keyword, place + 1));
        self.values.get(place).copied().ok_or_else(lacks)
    }

    fn number(&self, place: usize) -> Result<f64, SyntaxError> {
        let word = self.word(place)?;
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.error(format!("value {} of {} is {word}; legal: a number", place + 1, self.keyword)))
    }

    /// The number at `place`, which must be `is_legal`.
    fn legal(&self, place: usize, legal: &str, is_legal: impl Fn(f64) -> bool) -> Result<f64, SyntaxError> {
        let number = self.number(place)?;
        if is_legal(number) {
            return Ok(number);
        }
        Err(self.error(format!("value {} of {} is {number}; legal: {legal}", place + 1, self.keyword)))
    }

    /// The number at `place`, which must be above 0.
    fn positive(&self, place: usize) -> Result<f64, SyntaxError> {
        self.legal(place, "above 0", |number| number > 0.0)
    }

    /// The number at `place`, or 0 where the line ends before it.
    fn number_or_zero(&self, place: usize) -> Result<f64, SyntaxError> {
        if place < self.values.len() { self.number(place) } else { Ok(0.0) }
    }

    /// A count or an index.
    fn count(&self, place: usize, max: usize) -> Result<usize, SyntaxError> {
        let number = self.number(place)?;
        if (0.0..=max as f64).contains(&number) && number.fract() == 0.0 {
            return Ok(number as usize);
        }
        Err(self.error(format!(
            "value {} of {} is {number}; legal: a whole number up to {max}",
            place + 1,
            self.keyword
        )))
    }

    /// A number of a list.
    fn count_from_1(&self, place: usize, max: usize) -> Result<usize, SyntaxError> {
        self.legal(place, &format!("a whole number from 1 to {max}"), |number| number >= 1.0)?;
        self.count(place, max)
    }

    fn numbers(&self) -> Result<Vec<f64>, SyntaxError> {
        (0..self.values.len().min(LIST_MAX)).map(|place| self.number(place)).collect()
    }

    /// What limits the beam.
    fn beam(&self) -> Result<Beam, SyntaxError> {
        let is_second_kind = self.number_or_zero(1)? == 1.0;
        Ok(match self.keyword {
            "ENPD" => Beam::EntrancePupil { diameter_mm: self.positive(0)? },
            "FNUM" if is_second_kind => Beam::WorkingFNumber { f_number: self.positive(0)? },
            "FNUM" => Beam::FNumber { f_number: self.positive(0)? },
            "OBNA" if is_second_kind => {
                let half_deg = self.legal(0, "above 0 and below 90, degrees", |deg| deg > 0.0 && deg < 90.0)?;
                Beam::ObjectAperture { sine: half_deg.to_radians().sin() }
            }
            _ => Beam::ObjectAperture { sine: self.legal(0, "above 0 and below 1", |sine| sine > 0.0 && sine < 1.0)? },
        })
    }
}

/// What has been read so far.
#[derive(Default)]
struct File {
    name: String,
    /// mm in a unit of the file.
    unit_mm: Option<f64>,
    beam: Option<Beam>,
    has_paraxial_stop: bool,
    field_kind: usize,
    /// Where that is stated.
    field_kind_line: usize,
    field_count: Option<usize>,
    wavelength_count: Option<usize>,
    /// Along x and y, each with its line.
    fields: [(usize, Vec<f64>); 2],
    /// By their numbers, each with its line, µm.
    wavelengths_um: BTreeMap<usize, (usize, f64)>,
    /// The number of the primary one, with its line.
    primary: Option<(usize, usize)>,
    notes: Vec<SyntaxError>,
    catalogues: Vec<String>,
    surfaces: Vec<Entry>,
    last_line: usize,
}

impl File {
    fn take(&mut self, line: &Line<'_>) -> Result<(), SyntaxError> {
        self.last_line = line.number;
        match line.keyword {
            "MODE" if line.word(0)? != "SEQ" => {
                return Err(line.error(format!("MODE is {}; legal: SEQ, a sequential lens", line.word(0)?)));
            }
            "NAME" => self.name = line.rest.to_owned(),
            "UNIT" => self.unit_mm = Some(unit_mm(line)?),
            "ENPD" | "FNUM" | "OBNA" => self.beam = Some(line.beam()?),
            "FLOA" => self.beam = Some(Beam::Stop),
            // Its second value: 0, rays are not aimed; 1, at the paraxial stop; 2, at the real one.
            "RAIM" => self.has_paraxial_stop = line.number_or_zero(1)? == 1.0,
            "FTYP" => self.take_counts(line)?,
            "XFLN" | "XFLD" => self.fields[0] = (line.number, line.numbers()?),
            "YFLN" | "YFLD" => self.fields[1] = (line.number, line.numbers()?),
            "WAVM" => {
                self.wavelengths_um.insert(line.count_from_1(0, LIST_MAX)?, (line.number, line.number(1)?));
            }
            "WAVL" => {
                let with_line = line.numbers()?.into_iter().map(|um| (line.number, um));
                self.wavelengths_um = (1..).zip(with_line).collect();
            }
            "PWAV" => self.primary = Some((line.number, line.count_from_1(0, LIST_MAX)?)),
            "MNUM" | "ENVD" | "VDXN" | "VDYN" | "VCXN" | "VCYN" | "VANN" => self.notes.extend(note(line)?),
            "GCAT" => self.catalogues = line.values.iter().map(|name| (*name).to_owned()).collect(),
            "SURF" => {
                if self.surfaces.len() > SURFACES_MAX {
                    return Err(line.error(format!("there are more than {SURFACES_MAX} surfaces")));
                }
                let number = line.count(0, SURFACES_MAX + 2)?;
                if number != self.surfaces.len() {
                    return Err(line.error(format!("SURF is {number}; legal: {}, the next", self.surfaces.len())));
                }
                self.surfaces.push(Entry::new(line.number));
            }
            _ => {
                if let Some(surface) = self.surfaces.last_mut() {
                    surface.take(line)?;
                }
            }
        }
        Ok(())
    }

    /// FTYP: kind of field, whether telecentric, number of fields, number of wavelengths.
    fn take_counts(&mut self, line: &Line<'_>) -> Result<(), SyntaxError> {
        (self.field_kind, self.field_kind_line) = (line.count(0, FIELD_KIND_MAX)?, line.number);
        if line.number_or_zero(1)? != 0.0 {
            return Err(line.error("value 2 of FTYP says that the object is seen telecentrically; legal: 0".to_owned()));
        }
        if line.values.len() > 3 {
            self.field_count = Some(line.count(2, LIST_MAX)?);
            self.wavelength_count = Some(line.count(3, LIST_MAX)?);
        }
        Ok(())
    }

    fn lens(self) -> Result<ZmxLens, SyntaxError> {
        let at_end = |message: &str| SyntaxError { line: self.last_line.max(1), message: message.to_owned() };
        let scale_mm = self.unit_mm.unwrap_or(1.0);
        let wavelengths_nm = self.wavelengths_nm()?;
        let fields = self.fields(scale_mm)?;
        let [object, surfaces @ .., image] = &self.surfaces[..] else {
            return Err(at_end("the file ends without a lens: it has no surface between object and image"));
        };
        let mut media = BTreeMap::new();
        let (mut made, mut lines, mut medium_lines) = (Vec::new(), Vec::new(), Vec::new());
        for entry in surfaces {
            let before = made.len();
            entry.surfaces(scale_mm, &mut media, &mut made)?;
            lines.extend(std::iter::repeat_n(entry.line, made.len() - before));
            medium_lines.extend(std::iter::repeat_n(entry.medium_line(), made.len() - before));
        }
        let spec = PrescriptionSpec {
            name: self.name.clone(),
            object_distance_mm: object.distance.map(|distance| distance * scale_mm),
            surfaces: made,
            image: image.shape(scale_mm)?,
            media,
        };
        if !image.is_image() {
            let last = self.surfaces.len() - 1;
            let message = format!(
                "the file ends within the lens: surface {last} is no image, whose DISZ is 0 and which has no GLAS; is it cut?"
            );
            return Err(at_end(&message));
        }
        let image_line = image.line;
        let object_line = object.line;
        let prescription = Prescription::new(spec).map_err(|error| SyntaxError {
            line: line_of(&error, &lines).unwrap_or(if error.key.starts_with("image") {
                image_line
            } else {
                object_line
            }),
            message: error.to_string(),
        })?;
        Ok(ZmxLens {
            prescription,
            wavelengths_nm,
            beam: self.beam.map(|beam| match beam {
                Beam::EntrancePupil { diameter_mm } => Beam::EntrancePupil { diameter_mm: diameter_mm * scale_mm },
                other => other,
            }),
            has_paraxial_stop: self.has_paraxial_stop,
            fields,
            catalogues: self.catalogues,
            medium_lines,
            notes: self.notes,
        })
    }

    /// The primary wavelength, then the others. The file always holds a full list, of which only the first count.
    fn wavelengths_nm(&self) -> Result<Vec<f64>, SyntaxError> {
        let count = self.wavelength_count.unwrap_or(LIST_MAX).max(1);
        let mut used: Vec<(usize, f64)> = Vec::new();
        let [shortest, longest] = WAVELENGTHS_UM;
        for (k, (line, um)) in self.wavelengths_um.range(..=count) {
            if !(shortest..=longest).contains(um) {
                let message = format!("wavelength {k} is {um} µm; legal: {shortest} to {longest}");
                return Err(SyntaxError { line: *line, message });
            }
            used.push((*k, 1000.0 * um));
        }
        if let Some((line, primary)) = self.primary {
            if !used.is_empty() && !used.iter().any(|(k, _)| *k == primary) {
                let message = format!("PWAV is {primary}; legal: the number of one of the {} wavelengths", used.len());
                return Err(SyntaxError { line, message });
            }
            used.sort_by_key(|(k, _)| *k != primary);
        }
        Ok(used.into_iter().map(|(_, nm)| nm).collect())
    }

    fn fields(&self, scale_mm: f64) -> Result<Vec<FieldPoint>, SyntaxError> {
        let listed = self.fields.iter().map(|(_, list)| list.len()).max().unwrap_or(0);
        let count = self.field_count.unwrap_or(listed).min(listed);
        let used = |axis: usize| self.fields[axis].1.iter().take(count);
        for (axis, keyword) in ["XFLN", "YFLN"].into_iter().enumerate() {
            if let Some((place, deg)) =
                used(axis).enumerate().find(|(_, deg)| self.field_kind == 0 && deg.abs() >= 90.0)
            {
                let message =
                    format!("value {} of {keyword} is {deg}; legal: above -90 and below 90, degrees", place + 1);
                return Err(SyntaxError { line: self.fields[axis].0, message });
            }
        }
        let is_infinite = self.surfaces.first().is_some_and(|object| object.distance.is_none());
        if self.field_kind == 1 && is_infinite && [0, 1].into_iter().flat_map(used).any(|height| *height != 0.0) {
            let message = "value 1 of FTYP is 1, heights of the object, which is infinitely far; legal: 0, angles, or 2 or \
                           3, heights of the image";
            return Err(SyntaxError { line: self.field_kind_line, message: message.to_owned() });
        }
        let point = |k: usize| [0, 1].map(|axis| self.fields[axis].1.get(k).copied().unwrap_or(0.0));
        let points = (0..count).map(point).map(|point| match self.field_kind {
            0 => FieldPoint::Angle(point),
            1 => FieldPoint::Object(point.map(|height| height * scale_mm)),
            _ => FieldPoint::Image(point.map(|height| height * scale_mm)),
        });
        Ok(points.collect())
    }
}

/// What a line says that is not followed, if it changes the lens or its rays.
fn note(line: &Line<'_>) -> Result<Option<SyntaxError>, SyntaxError> {
    Ok(match line.keyword {
        "MNUM" => {
            let count = line.count(0, LIST_MAX)?;
            let said = format!(
                "MNUM is {count}: of a lens in {count} configurations the one is read that the file was saved in, number {}",
                line.number_or_zero(1)?.max(1.0)
            );
            (count > 1).then(|| line.error(said))
        }
        // Temperature, °C, pressure, atm, and whether indices follow them.
        "ENVD" => {
            let [temperature, pressure] = [line.number(0)?, line.number(1)?];
            let is_followed = line.number_or_zero(2)? == 1.0 && [temperature, pressure] != [20.0, 1.0];
            let said = format!(
                "ENVD is {temperature} °C, {pressure} atm: indices are those at 20 °C, 1 atm, lengths as they stand"
            );
            is_followed.then(|| line.error(said))
        }
        // Vignetting factors, field by field.
        keyword => {
            let is_used = line.numbers()?.iter().any(|factor| *factor != 0.0);
            is_used.then(|| line.error(format!("{keyword}: vignetting factors are left out; rays fill the stop")))
        }
    })
}

fn unit_mm(line: &Line<'_>) -> Result<f64, SyntaxError> {
    match line.word(0)? {
        "MM" => Ok(1.0),
        "CM" => Ok(10.0),
        "IN" => Ok(25.4),
        "M" | "METER" => Ok(1000.0),
        other => Err(line.error(format!("UNIT is {other}; legal: MM, CM, IN, M"))),
    }
}

/// The line on which a surface begins that an error is about.
fn line_of(error: &ValueError, lines: &[usize]) -> Option<usize> {
    let (index, _) = error.key.strip_prefix("surface[")?.split_once(']')?;
    lines.get(index.parse::<usize>().ok()?).copied()
}
