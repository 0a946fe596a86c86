//! One surface of a `.zmx` file.

use std::collections::BTreeMap;

use twinpupil_instrument::check::SyntaxError;
use twinpupil_instrument::{Across, Formula, MediumSpec, Shape, SurfaceSpec};

use super::Line;

/// What the file says of a surface so far, in its units.
pub(super) struct Entry {
    /// Where it begins.
    pub(super) line: usize,
    kind: String,
    /// Where the kind is stated.
    kind_line: usize,
    curvature: f64,
    conic_constant: f64,
    parameters: BTreeMap<usize, f64>,
    extra: BTreeMap<usize, f64>,
    /// To the next surface; none if infinite.
    pub(super) distance: Option<f64>,
    has_distance: bool,
    glass: Option<Material>,
    glass_line: usize,
    is_stop: bool,
    semi_diameter: Option<f64>,
    hole_radius: f64,
    half_size: Option<[f64; 2]>,
}

enum Material {
    Mirror,
    Named(String),
    /// By index and Abbe number.
    Model([f64; 2]),
}

/// From this distance on programs that write such files take it for infinite.
const INFINITY: f64 = 1e10;

/// Most parameters of a surface.
const PARAMETERS_MAX: usize = 500;

/// Kinds of surface that are known.
const LEGAL: &str = "STANDARD, EVENASPH, ODDASPHE, TOROIDAL without rotation, FRESNELS, PARAXIAL, COORDBRK";

impl Entry {
    pub(super) fn new(line: usize) -> Self {
        Self {
            line,
            kind: "STANDARD".to_owned(),
            kind_line: line,
            curvature: 0.0,
            conic_constant: 0.0,
            parameters: BTreeMap::new(),
            extra: BTreeMap::new(),
            distance: Some(0.0),
            has_distance: false,
            glass: None,
            glass_line: line,
            is_stop: false,
            semi_diameter: None,
            hole_radius: 0.0,
            half_size: None,
        }
    }

    pub(super) fn take(&mut self, line: &Line<'_>) -> Result<(), SyntaxError> {
        match line.keyword {
            "TYPE" => (self.kind, self.kind_line) = (line.word(0)?.to_owned(), line.number),
            "CURV" => self.curvature = line.number(0)?,
            "CONI" => self.conic_constant = line.number(0)?,
            "PARM" => {
                self.parameters.insert(line.count(0, PARAMETERS_MAX)?, line.number(1)?);
            }
            "XDAT" => {
                self.extra.insert(line.count(0, PARAMETERS_MAX)?, line.number(1)?);
            }
            "DISZ" => {
                let is_infinite = line.word(0)?.eq_ignore_ascii_case("INFINITY");
                let distance = if is_infinite { f64::INFINITY } else { line.number(0)? };
                self.distance = Some(distance).filter(|distance| distance.abs() < INFINITY);
                self.has_distance = true;
            }
            "STOP" => self.is_stop = true,
            "GLAS" => (self.glass, self.glass_line) = (Some(material(line)?), line.number),
            // Only where a person has fixed it does it stop light; else it is what the rays needed.
            "DIAM" if line.number_or_zero(1)? == 1.0 && line.number(0)? > 0.0 => {
                self.semi_diameter = Some(line.number(0)?);
            }
            "CLAP" | "FLAP" => {
                self.hole_radius = self.hole_radius.max(line.number(0)?);
                self.semi_diameter = Some(line.number(1)?);
            }
            "OBSC" => self.hole_radius = self.hole_radius.max(line.number(1)?),
            "SQAP" => self.half_size = Some([line.number(0)?, line.number(1)?]),
            "ELAP" | "USAP" | "SPID" | "ELOB" | "SQOB" | "UOBS" => {
                let legal = "CLAP, FLAP, OBSC, SQAP";
                return Err(line.error(format!("an aperture of kind {} is unknown; legal: {legal}", line.keyword)));
            }
            "SCBD" if line.numbers()?.iter().skip(1).any(|number| *number != 0.0) => {
                let message = "SCBD shifts or tilts a surface by itself; legal: surfaces of type COORDBRK about it";
                return Err(line.error(message.to_owned()));
            }
            "OBDC" if line.number(0)? != 0.0 || line.number_or_zero(1)? != 0.0 => {
                return Err(line.error("OBDC moves an aperture off its surface; legal: 0 0".to_owned()));
            }
            _ => {}
        }
        Ok(())
    }

    /// Whether it can be the image: behind that there is nothing.
    pub(super) fn is_image(&self) -> bool {
        self.has_distance && self.distance == Some(0.0) && self.glass.is_none()
    }

    /// Where the medium behind it is stated, or else where it begins.
    pub(super) fn medium_line(&self) -> usize {
        self.glass_line
    }

    /// The surface in mm, or the several breaks that it takes; its glass goes into `media` if it has no name.
    pub(super) fn surfaces(
        &self,
        scale_mm: f64,
        media: &mut BTreeMap<String, MediumSpec>,
        made: &mut Vec<SurfaceSpec>,
    ) -> Result<(), SyntaxError> {
        let gap_mm = self.distance.map(|distance| distance * scale_mm).ok_or_else(|| {
            self.error(self.line, "the distance behind a surface of the lens is infinite; legal: a number".to_owned())
        })?;
        if self.kind == "COORDBRK" {
            made.extend(self.breaks(scale_mm, gap_mm));
            return Ok(());
        }
        let surface = SurfaceSpec {
            shape: self.shape(scale_mm)?,
            gap_mm,
            mirror: matches!(self.glass, Some(Material::Mirror)),
            stop: self.is_stop,
            semi_diameter_mm: self.semi_diameter.map(|radius| radius * scale_mm),
            hole_radius_mm: self.hole_radius * scale_mm,
            half_size_mm: self.half_size.map(|half| half.map(|side| side * scale_mm)),
            ..SurfaceSpec::default()
        };
        made.push(match &self.glass {
            None | Some(Material::Mirror) => surface,
            Some(Material::Named(name)) => SurfaceSpec { medium: name.clone(), ..surface },
            Some(Material::Model([index, abbe_number])) => {
                let name = format!("{index}/{abbe_number}");
                let coefficients = vec![*index, *abbe_number];
                let medium = MediumSpec { formula: Formula::Abbe, coefficients, wavelengths_nm: MODEL_NM };
                media.insert(name.clone(), medium);
                SurfaceSpec { medium: name, ..surface }
            }
        });
        Ok(())
    }

    /// Its shape in mm.
    pub(super) fn shape(&self, scale_mm: f64) -> Result<Shape, SyntaxError> {
        let (curvature_per_mm, conic_constant) = (self.curvature / scale_mm, self.conic_constant);
        let radius_mm = (curvature_per_mm != 0.0).then(|| 1.0 / curvature_per_mm);
        match (self.kind.as_str(), radius_mm) {
            ("STANDARD", None) => Ok(Shape::Plane),
            ("STANDARD", Some(radius_mm)) if conic_constant == 0.0 => Ok(Shape::Sphere { radius_mm }),
            ("STANDARD", Some(radius_mm)) => Ok(Shape::Conic { radius_mm, conic_constant }),
            ("EVENASPH", _) => {
                Ok(Shape::EvenAsphere { radius_mm, conic_constant, coefficients: self.coefficients(scale_mm, 2) })
            }
            ("ODDASPHE", _) => {
                Ok(Shape::OddAsphere { radius_mm, conic_constant, coefficients: self.coefficients(scale_mm, 1) })
            }
            ("FRESNELS", Some(radius_mm)) => {
                Ok(Shape::Fresnel { radius_mm, conic_constant, coefficients: self.coefficients(scale_mm, 2) })
            }
            ("FRESNELS", None) => Err(self.error(self.kind_line, "a FRESNELS surface has no curvature".to_owned())),
            ("PARAXIAL", _) => Ok(Shape::ThinLens { focal_length_mm: self.parameter(1) * scale_mm }),
            ("TOROIDAL", _) if self.is_cylinder() => Ok(match radius_mm {
                Some(radius_mm) => Shape::Cylinder { radius_mm, curved: Across::Y },
                None => Shape::Plane,
            }),
            ("COORDBRK", _) => Ok(Shape::Break),
            (kind, _) => Err(self.error(self.kind_line, format!("surface type {kind} is unknown; legal: {LEGAL}"))),
        }
    }

    /// Whether a toroid is only curved along y, and round there.
    fn is_cylinder(&self) -> bool {
        let extra = self.extra.get(&1).copied().unwrap_or(0.0);
        self.conic_constant == 0.0 && extra == 0.0 && (1..=8).all(|k| self.parameter(k) == 0.0)
    }

    /// Parameters as coefficients of the powers `first`, 2 `first`, … of r, in mm.
    fn coefficients(&self, scale_mm: f64, first: i32) -> Vec<f64> {
        (1..=8).map(|k| self.parameter(k as usize) * scale_mm.powi(1 - first * k)).collect()
    }

    /// Shift and tilts; with a sixth parameter the tilts come first, about z, then y, then x.
    fn breaks(&self, scale_mm: f64, gap_mm: f64) -> Vec<SurfaceSpec> {
        let decentre_mm = [1, 2].map(|k| self.parameter(k) * scale_mm);
        let tilt_deg = [3, 4, 5].map(|k| self.parameter(k));
        let one = |decentre_mm, tilt_deg| SurfaceSpec {
            shape: Shape::Break,
            decentre_mm,
            tilt_deg,
            ..SurfaceSpec::default()
        };
        if self.parameter(6) == 0.0 {
            return vec![SurfaceSpec { gap_mm, ..one(decentre_mm, tilt_deg) }];
        }
        let about = |axis: usize| [0, 1, 2].map(|k| if k == axis { tilt_deg[axis] } else { 0.0 });
        let [z, y, x] = [2, 1, 0].map(|axis| one([0.0; 2], about(axis)));
        vec![z, y, x, SurfaceSpec { gap_mm, ..one(decentre_mm, [0.0; 3]) }]
    }

    fn parameter(&self, k: usize) -> f64 {
        self.parameters.get(&k).copied().unwrap_or(0.0)
    }

    fn error(&self, line: usize, message: String) -> SyntaxError {
        SyntaxError { line, message }
    }
}

/// Wavelengths at which a glass by its Abbe number is near a real one.
const MODEL_NM: [f64; 2] = [350.0, 1100.0];

/// A line GLAS: a name, 1 if it is a model, and then index and Abbe number.
fn material(line: &Line<'_>) -> Result<Material, SyntaxError> {
    let name = line.word(0)?;
    if name == "MIRROR" {
        return Ok(Material::Mirror);
    }
    if name == "___BLANK" || line.number_or_zero(1)? == 1.0 {
        return Ok(Material::Model([line.number(3)?, line.number(4)?]));
    }
    Ok(Material::Named(name.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(text: &str) -> Result<Entry, SyntaxError> {
        let mut entry = Entry::new(1);
        for (number, line) in (2..).zip(text.lines()) {
            entry.take(&Line::new(line, number))?;
        }
        Ok(entry)
    }

    #[test]
    fn surfaces_in_inches_become_surfaces_in_mm() {
        let shape = |text: &str| entry(text).and_then(|entry| entry.shape(25.4)).unwrap();
        assert_eq!(shape("TYPE STANDARD\nCURV 0.5"), Shape::Sphere { radius_mm: 50.8 });
        assert_eq!(shape("CURV 0"), Shape::Plane);
        let Shape::EvenAsphere { radius_mm: None, coefficients, .. } = shape("TYPE EVENASPH\nPARM 2 16387.064") else {
            panic!("an asphere")
        };
        assert!((coefficients[1] - 1.0).abs() < 1e-12);
        assert_eq!(shape("TYPE PARAXIAL\nPARM 1 2"), Shape::ThinLens { focal_length_mm: 50.8 });
        let cylinder = Shape::Cylinder { radius_mm: 50.8, curved: Across::Y };
        assert_eq!(shape("TYPE TOROIDAL\nCURV 0.5\nXDAT 1 0\nXDAT 2 100"), cylinder);
    }

    #[test]
    fn what_is_unknown_is_named_with_its_line() {
        let said = |text: &str| {
            let shape = entry(text).and_then(|entry| entry.shape(1.0));
            shape.unwrap_err().to_string()
        };
        assert!(
            said("CURV 0.1\nTYPE BINARY_2").starts_with("line 3: surface type BINARY_2 is unknown; legal: STANDARD")
        );
        assert!(said("TYPE TOROIDAL\nPARM 1 30").starts_with("line 2: surface type TOROIDAL is unknown"));
        assert_eq!(said("CURV x"), "line 2: value 1 of CURV is x; legal: a number");
        assert_eq!(said("GLAS"), "line 2: GLAS lacks its value 1");
        assert!(said("ELAP 1 2").starts_with("line 2: an aperture of kind ELAP is unknown"));
    }
}
