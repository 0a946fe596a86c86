//! What a coaxial two-aperture camera is: its file, its first-order projection, its frames and its tables.
//!
//! Everything the other crates share lives here as plain data: the optics and the simulation on one side and the
//! reconstruction on the other meet in [`Instrument`], [`Frame`] and [`ResponseTable`], and nowhere else.
//!
//! Lengths are in mm, wavelengths in nm, image positions in px or in mm from the axis; axes and signs are those of
//! CONVENTIONS.md.

mod aperture;
mod band;
pub mod builtin;
mod calibration;
mod catalogue;
pub mod check;
mod correction;
mod crosstalk;
mod cube;
mod dispersion;
mod distortion;
mod frame;
mod geometry;
mod glass;
mod homography;
mod ideal;
mod instrument;
mod lens;
mod medium;
mod mosaic;
mod page;
pub mod paper;
mod parameter;
mod paraxial;
mod prescribed;
mod prescription;
mod projection;
mod registration;
mod response;
mod sensor;
mod spectra;
pub mod text;
mod thick;
mod warp;

pub use aperture::{Annulus, Aperture, Zone};
pub use band::{Band, Role};
pub use calibration::{CalibrationFrame, CalibrationSpec};
pub use catalogue::Catalogue;
pub use correction::{Correction, Displacement};
pub use crosstalk::CrosstalkSpec;
pub use cube::CubePlane;
pub use distortion::Distortion;
pub use frame::{Frame, FrameError, FrameView, PlaneView};
pub use geometry::{ImagePoint, PixelPoint};
pub use glass::{Glass, GlassError};
pub use instrument::{DepthRange, Instrument, InstrumentError, InstrumentSpec};
pub use lens::{FresnelLens, GrooveSide, Lens, ThinLens};
pub use medium::{Formula, MediumSpec};
pub use mosaic::{Mosaic, Polarizers, Site};
pub use page::Page;
pub use parameter::{DistortionTerm, Parameter};
pub use paraxial::{CardinalPoints, ParaxialRay, ParaxialSurface, paraxial_rays};
pub use prescribed::{LensStand, MaskPlace, PrescriptionLens};
pub use prescription::{Across, Prescription, PrescriptionSpec, SURFACES_MAX, Shape, SurfaceSpec};
pub use projection::{Chief, Projection, position_from_radii_mm};
pub use registration::Registration;
pub use response::{BandResponse, Grid, LensTerms, PointResponse, PointSpread, ResponseTable};
pub use sensor::Sensor;
pub use spectra::{ResponseMatrix, SpectraError, SpectraSpec, SpectralTable};
pub use thick::MaskImage;
pub use warp::Warp;
