//! An instrument made ready to trace.

use thiserror::Error;
use twinpupil_instrument::check::ValueError;
use twinpupil_instrument::{Band, GlassError, ImagePoint, Instrument, Lens, Projection};

use crate::fresnel::FresnelBand;
use crate::masks::Masks;
use crate::paraxial;
use crate::prescribed::{FEW_RAYS_PER_QUADRANT, PrescribedBand, RAYS_PER_QUADRANT};
use crate::stop::Stop;
use crate::thin::ThinBand;
use crate::{ObjectRays, Pencil, PointImage, RayLedger, RayMap, RayStarts};

/// Why an instrument cannot be traced.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum OpticsError {
    /// The band's pupil is in focus on the sensor, so that it limits the field and not the pencils.
    #[error(
        "`aperture[{aperture}].position_mm` is {position_mm}, where it is in focus in band `{band}`; \
         legal: a pupil that is out of focus"
    )]
    PupilInFocus {
        /// The band.
        band: String,
        /// Index of its pupil.
        aperture: usize,
        /// Where that stands, mm.
        position_mm: f64,
    },
    /// A lens or a mask that cannot be where the instrument says.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// A material without an index.
    #[error(transparent)]
    Glass(#[from] GlassError),
    /// A groove that would cut through the lens.
    #[error(
        "`lens.thickness_mm` is {thickness_mm}, but the groove {radius_mm} mm from the axis is deeper; \
         legal: a thicker or smaller lens, a longer focal length or a finer pitch"
    )]
    GrooveTooDeep {
        /// Outer radius of the groove, mm.
        radius_mm: f64,
        /// Thickness of the lens, mm.
        thickness_mm: f64,
    },
    /// More grooves than are sensible.
    #[error("`lens.groove_pitch_mm` is {groove_pitch_mm}, which makes {count} grooves; legal: at most 200000")]
    TooManyGrooves {
        /// The pitch, mm.
        groove_pitch_mm: f64,
        /// How many grooves it makes.
        count: f64,
    },
}

/// An instrument made ready to trace.
#[derive(Debug, Clone)]
pub struct Camera {
    bands: Vec<BandOptics>,
}

impl Camera {
    /// Prepares every band of `instrument`.
    pub fn new(instrument: &Instrument) -> Result<Self, OpticsError> {
        let bands = instrument.bands.iter().map(|band| BandOptics::new(instrument, band)).collect::<Result<_, _>>()?;
        Ok(Self { bands })
    }

    /// The same with grooves of Fresnel lenses that are infinitely fine: a smooth lens without the walls between facets, whose
    /// images move evenly with everything. Real grooves make images jump by what one of them holds of a pupil's light.
    pub fn smoothed(self) -> Self {
        Self { bands: self.bands.into_iter().map(BandOptics::smoothed).collect() }
    }

    /// The bands, in the order of the instrument's.
    pub fn bands(&self) -> &[BandOptics] {
        &self.bands
    }
}

/// One band of a [`Camera`]: its lens, its pupil and the other apertures as its light meets them.
#[derive(Debug, Clone)]
pub struct BandOptics {
    name: String,
    /// To first order, by the data sheet.
    projection: Projection,
    /// To first order, at the band's own wavelength.
    masks: Masks,
    model: Model,
}

#[derive(Debug, Clone)]
enum Model {
    Thin(ThinBand),
    Fresnel(Box<FresnelBand>),
    Prescribed(Box<PrescribedBand>),
}

impl BandOptics {
    fn new(instrument: &Instrument, band: &Band) -> Result<Self, OpticsError> {
        let projection = instrument.projection(band);
        let stops = instrument
            .ideal_apertures(band)
            .iter()
            .enumerate()
            .map(|(i, mask)| Stop::new(i, mask, &band.name))
            .collect();
        let masks = Masks {
            focal_length_mm: focal_length_mm(&instrument.lens, band, &projection)?,
            sensor_distance_mm: projection.sensor_distance_mm,
            stops,
            pupil: instrument.pupil_index(band),
            pupil_radius_mm: projection.pupil_radius_mm,
        };
        if masks.sensor_pencil(projection.pupil_position_mm).abs() < SMALLEST_PENCIL {
            return Err(OpticsError::PupilInFocus {
                band: band.name.clone(),
                aperture: masks.pupil,
                position_mm: projection.pupil_position_mm,
            });
        }
        let model = match &instrument.lens {
            Lens::Thin(_) => Model::Thin(ThinBand::new(&masks)),
            Lens::Fresnel(lens) => Model::Fresnel(Box::new(FresnelBand::new(lens, band.wavelength_nm, &masks)?)),
            Lens::Prescription(lens) => {
                Model::Prescribed(Box::new(PrescribedBand::new(instrument, lens, band, &masks)?))
            }
        };
        Ok(Self { name: band.name.clone(), projection, masks, model })
    }

    fn smoothed(self) -> Self {
        let model = match self.model {
            Model::Thin(band) => Model::Thin(band),
            Model::Fresnel(band) => Model::Fresnel(Box::new(band.smoothed())),
            Model::Prescribed(band) => Model::Prescribed(Box::new(band.smoothed())),
        };
        Self { model, ..self }
    }

    /// The band's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The band's first-order projection, as the instrument states it.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Focal length of the lens at the band's wavelength, mm.
    pub fn focal_length_mm(&self) -> f64 {
        self.masks.focal_length_mm
    }

    /// Traces rays from the sensor into object space and enters their fates in `ledger`.
    ///
    /// `rays` is overwritten with as many rays as `starts` has, in the same order. The pupil points should sample the
    /// unit disc uniformly; then the mean weight is the irradiance of the image point under a uniform object,
    /// relative to the axis and to an unclipped pupil. Positions and slopes of lost rays (weight 0) mean nothing.
    ///
    /// # Panics
    ///
    /// If the slices of `starts` differ in length.
    pub fn trace(&self, starts: RayStarts<'_>, rays: &mut ObjectRays, ledger: &mut RayLedger) {
        match &self.model {
            Model::Thin(band) => band.trace(starts, rays, ledger),
            Model::Fresnel(band) => band.trace(starts, rays, ledger),
            Model::Prescribed(band) => band.trace(starts, rays, ledger),
        }
    }

    /// All rays of the band from the image disc as polynomials, which follow traced ones to 1e-7 mm and are much faster to
    /// have: for a lens surface by surface that is smooth there and stops none of them but by its masks.
    ///
    /// Some 900 rays are traced to find it.
    pub fn ray_map(&self, centre: ImagePoint, radius_mm: f64) -> Option<RayMap> {
        match &self.model {
            Model::Thin(_) | Model::Fresnel(_) => None,
            Model::Prescribed(band) => band.ray_map(centre, radius_mm),
        }
    }

    /// All rays of the band from the image disc.
    ///
    /// Exact for a thin lens; for any other some 140 rays are traced to see how far the true rays are from the ideal
    /// ones, so parts of a pencil are much cheaper than pencils of their own.
    pub fn pencil(&self, centre: ImagePoint, radius_mm: f64) -> Pencil {
        match &self.model {
            Model::Thin(band) => band.pencil(centre, radius_mm),
            Model::Fresnel(band) => band.pencil(centre, radius_mm),
            Model::Prescribed(band) => band.pencil(centre, radius_mm),
        }
    }

    /// Whether it is certain that every ray from the image disc arrives with weight 1.
    ///
    /// True only for a thin lens: through a real one no two rays weigh the same.
    pub fn is_unclipped(&self, centre: ImagePoint, radius_mm: f64) -> bool {
        match &self.model {
            Model::Thin(band) => band.is_unclipped(centre, radius_mm),
            Model::Fresnel(_) | Model::Prescribed(_) => false,
        }
    }

    /// What becomes of the light of an object point (x, y, z) in mm, z > 0: exact for a thin lens, an average
    /// over some 160 rays for a Fresnel lens and over 128 for one surface by surface, clipped as behind an ideal lens.
    pub fn point_image(&self, object_mm: [f64; 3]) -> PointImage {
        match &self.model {
            Model::Thin(_) => self.masks.point_image(object_mm),
            Model::Fresnel(band) => band.point_image(object_mm),
            Model::Prescribed(band) => band.point_image(object_mm, RAYS_PER_QUADRANT),
        }
    }

    /// [`Self::point_image`] over 16 rays where it takes 128 otherwise: for many cameras, each of which is judged by itself.
    pub fn quick_point_image(&self, object_mm: [f64; 3]) -> PointImage {
        match &self.model {
            Model::Prescribed(band) => band.point_image(object_mm, FEW_RAYS_PER_QUADRANT),
            Model::Thin(_) | Model::Fresnel(_) => self.point_image(object_mm),
        }
    }

    /// [`Self::point_image`] as an ideal lens of the band's focal length would make it behind the same masks, exactly.
    pub fn ideal_point_image(&self, object_mm: [f64; 3]) -> PointImage {
        self.masks.point_image(object_mm)
    }

    /// Whether all masks stand on the axis.
    pub fn is_centred(&self) -> bool {
        self.masks.stops.iter().all(|stop| stop.centre_mm == [0.0; 2])
    }

    /// Image point whose rays through the middle of the pupil meet the middle of the mask that shades the ground about it,
    /// mm: that of the axis unless masks are off it. To first order.
    pub fn shade_centre_mm(&self) -> [f64; 2] {
        self.masks.shade_centre_mm()
    }

    /// Radius about the axis at distance `z_mm` inside which other masks clip the band's pupil, mm: 0 if it is clear
    /// on the axis, infinite if it is clear nowhere. To first order, along +x.
    pub fn clip_radius_mm(&self, z_mm: f64) -> f64 {
        self.masks.clip_radius_mm(z_mm)
    }

    /// Radius about the axis at distance `z_mm` inside which no light of the band passes, mm: 0 if some passes on the
    /// axis, infinite if none does anywhere. To first order, along +x.
    pub fn blind_radius_mm(&self, z_mm: f64) -> f64 {
        self.masks.blind_radius_mm(z_mm)
    }
}

/// Focal length of a lens in a band, mm.
fn focal_length_mm(lens: &Lens, band: &Band, projection: &Projection) -> Result<f64, OpticsError> {
    match lens {
        Lens::Thin(_) | Lens::Prescription(_) => Ok(projection.focal_length_mm),
        Lens::Fresnel(lens) => Ok(paraxial::cardinal_points(lens, band.wavelength_nm)?.focal_length_mm),
    }
}

/// Smallest width of a pencil at the pupil relative to the lens at which aiming through the pupil is still sensible.
const SMALLEST_PENCIL: f64 = 1e-6;
