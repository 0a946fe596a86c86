//! One dot as one band images it, in pixels of a plane's page.

use crate::likelihood::departure::Departure;
use crate::likelihood::laid::Bend;
use crate::likelihood::pencil::{Pencil, Vector2, Ways};
use crate::likelihood::smear::Smear;

/// A flat round dot in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dot {
    pub(crate) centre_mm: [f64; 3],
    pub(crate) diameter_mm: f64,
    /// Slopes dz/dx and dz/dy of its surface.
    pub(crate) slopes: Vector2,
}

/// The image of a dot: the unit disc, mapped by `p = centre + radius · shape e`, blurred by the pencil's disc.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Spot {
    /// Image of the dot's outline: its centre on the page, px.
    pub(crate) centre_px: Vector2,
    /// Radius along the longest axis, px.
    pub(crate) radius_px: f64,
    /// Radius of the image of a point, px; negative where the image is turned against the pupil.
    pub(crate) blur_px: f64,
    /// Growth of the blur from the centre to the end of the unit disc's first axis, px.
    pub(crate) blur_growth_px: f64,
    /// From the unit disc to the image, over the radius.
    pub(crate) shape: Matrix2,
    pub(crate) inverse: Matrix2,
    /// The ways through the masks, as [`Pencil::ways_at`] gives them.
    pub(crate) ways: Ways,
    /// Position on the page of the optical axis, px, and width of a pixel, mm, as they are seen from the spot.
    pub(crate) axis_px: Vector2,
    pub(crate) pitch_mm: f64,
    /// What the lens does to the images of its points, unless it is ideal.
    pub(crate) smear: Option<Smear>,
    /// How its page bends about its centre, if it does.
    pub(crate) bend: Option<Bend>,
}

/// Rows of a 2×2 matrix.
pub(crate) type Matrix2 = [[f64; 2]; 2];

/// Pixels across the axis, upright.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Raster {
    /// Position of the optical axis, px.
    pub(crate) axis_px: Vector2,
    pub(crate) pitch_mm: f64,
}

/// Change of a spot's centre, radius and blur with its dot's x, y, z and diameter.
pub(crate) type SpotJacobian = nalgebra::Matrix4<f64>;

/// Half-lit skirts reach this far beyond the blur's edge: half the diagonal of a pixel.
pub(crate) const PIXEL_REACH_PX: f64 = 0.71;

impl Spot {
    /// The image of `dot`; `departure` is what the lens adds to it.
    #[cfg(test)]
    pub(crate) fn of(dot: &Dot, pencil: &Pencil, raster: Raster, departure: Option<Departure>) -> Self {
        Self::with_jacobian(dot, pencil, raster, departure).0
    }

    /// The image of `dot`, and its changes with it; `departure` is what the lens adds to it.
    ///
    /// On a sloping surface the disc is foreshortened along the steepest way and its two halves are imaged by different
    /// magnifications. A central projection makes an ellipse of it, whose centre lies `m′ sinθ cosθ a²` beside the
    /// image of the dot's.
    pub(crate) fn with_jacobian(
        dot: &Dot,
        pencil: &Pencil,
        raster: Raster,
        departure: Option<Departure>,
    ) -> (Self, SpotJacobian) {
        let per_px = 1.0 / raster.pitch_mm;
        let (mut image, mut change) = (Imaging::at(dot.centre_mm, pencil), Imaging::change(dot.centre_mm, pencil));
        let radius_mm = 0.5 * dot.diameter_mm;
        let tilt = Tilt::of(dot.slopes);
        let magnification_slope = change.magnification / image.magnification;
        let upright = tilt.shape([change.x_mm, change.y_mm].map(|drift| drift / image.magnification));
        // What the lens does to the rim it does where that is.
        let stretch = departure.map(|departure| departure.applied(&mut image, &mut change));
        let shape = stretch.map_or(upright, |stretch| product(stretch, upright));
        let radius_px = (image.magnification * radius_mm).abs() * per_px;
        // In units of the radius along the first axis of the unit disc.
        let off_centre = magnification_slope * tilt.sin * radius_mm * radius_px;
        let centre_px = [
            raster.axis_px[0] + image.x_mm * per_px + off_centre * shape[0][0],
            raster.axis_px[1] + image.y_mm * per_px + off_centre * shape[1][0],
        ];
        let mut spot = Self {
            centre_px,
            radius_px,
            blur_px: image.blur_mm * per_px,
            blur_growth_px: change.blur_mm * tilt.sin * radius_mm * per_px,
            shape,
            inverse: inverse(shape),
            ways: Ways::new(),
            axis_px: raster.axis_px,
            pitch_mm: raster.pitch_mm,
            smear: departure.map(|departure| departure.smear(per_px, image.blur_mm)),
            bend: None,
        };
        let widened = spot.widen();
        spot.ways = pencil.ways_at(spot.image_mm(centre_px), spot.reach_px() * raster.pitch_mm);
        // What the lens adds changes too little across a step to count.
        let per_mm = image.magnification * per_px;
        let towards = image.magnification.signum();
        let jacobian = SpotJacobian::new(
            per_mm,
            0.0,
            change.x_mm * per_px,
            0.0,
            0.0,
            per_mm,
            change.y_mm * per_px,
            0.0,
            0.0,
            0.0,
            towards * change.magnification * radius_mm * per_px,
            0.5 * image.magnification.abs() * per_px,
            0.0,
            0.0,
            widened * change.blur_mm * per_px,
            0.0,
        );
        (spot, jacobian)
    }

    /// Takes the blur of the even disc that is as wide as its smear; how that grows with the blur that it had.
    fn widen(&mut self) -> f64 {
        let Some(smear) = &self.smear else { return 1.0 };
        let blur_px = smear.even_blur_px().copysign(self.blur_px);
        let growth = if blur_px == 0.0 { 1.0 } else { self.blur_px / blur_px };
        self.blur_px = blur_px;
        growth
    }

    /// Adds a blur.
    pub(crate) fn soften(&mut self, blur_px: f64) {
        self.blur_px = self.blur_px.hypot(blur_px).copysign(self.blur_px);
    }

    /// Moves its light.
    pub(crate) fn shift(&mut self, [du_px, dv_px]: Vector2) {
        self.centre_px[0] += du_px;
        self.centre_px[1] += dv_px;
    }

    /// With the blur of every point a share of what it is.
    pub(crate) fn narrowed(&self, share: f64) -> Self {
        Self { blur_px: share * self.blur_px, blur_growth_px: share * self.blur_growth_px, ..self.clone() }
    }

    /// Largest blur on the dot, px.
    pub(crate) fn blur_px_max(&self) -> f64 {
        self.blur_px.abs() + self.blur_growth_px.abs()
    }

    /// How far the image of a point of the dot reaches at most, px.
    pub(crate) fn blur_reach_px(&self) -> f64 {
        self.blur_px_max() + self.smear.map_or(0.0, |smear| smear.reach_px())
    }

    /// Smallest blur on the dot, px.
    pub(crate) fn blur_px_min(&self) -> f64 {
        (self.blur_px.abs() - self.blur_growth_px.abs()).max(0.0)
    }

    /// Half the width of its edges, px.
    pub(crate) fn edge_px(&self) -> f64 {
        const PIXEL_PX: f64 = 0.5;
        self.blur_px.abs() + PIXEL_PX
    }

    /// Growth of the blur along u and v, px per px.
    pub(crate) fn blur_gradient(&self) -> Vector2 {
        self.inverse[0].map(|along| self.blur_growth_px * along / self.radius_px)
    }

    /// How much less light its pixels get than on the axis, by what the lens does to it.
    pub(crate) fn falloff(&self) -> f64 {
        self.smear.map_or(0.0, |smear| smear.falloff[0])
    }

    /// Growth of the light along u and v by what the lens does to it, relative, 1/px.
    pub(crate) fn falloff_slope(&self) -> Vector2 {
        let Some(smear) = &self.smear else { return [0.0; 2] };
        let rim_px = self.radius_px * smear.rim(self);
        smear.outwards.map(|along| -smear.falloff[1] / rim_px * along)
    }

    /// How far the light lies beside where kernels have it that take the blur where the edge is nearest, px.
    ///
    /// The point e of the dot is imaged at `P(e) + B(e) w` through the point w of the pupil, so the middle of the light
    /// lies `¼ B ∇B` beside that of the outline. Those kernels have it twice as far.
    pub(crate) fn skewed_px(&self) -> Vector2 {
        self.blur_gradient().map(|growth| -0.25 * self.blur_px * growth)
    }

    /// A position on the page in mm from the axis, along u and v.
    pub(crate) fn image_mm(&self, [u_px, v_px]: Vector2) -> Vector2 {
        [(u_px - self.axis_px[0]) * self.pitch_mm, (v_px - self.axis_px[1]) * self.pitch_mm]
    }

    /// Distance from the centre beyond which no light of the dot falls, px.
    pub(crate) fn reach_px(&self) -> f64 {
        self.radius_px + self.blur_reach_px() + PIXEL_REACH_PX
    }

    /// How much shorter it is than it is long, relative to its length.
    pub(crate) fn foreshortening(&self) -> f64 {
        let [[a, b], [c, d]] = self.shape;
        // Singular values s ≥ s′ of a 2×2 matrix: s² + s′² is the sum of its squares, s s′ its determinant.
        let (squares, product) = (a * a + b * b + c * c + d * d, (a * d - b * c).abs());
        let (sum, difference) = ((squares + 2.0 * product).sqrt(), (squares - 2.0 * product).max(0.0).sqrt());
        if sum > 0.0 { 2.0 * difference / (sum + difference) } else { 0.0 }
    }

    /// Whether the masks take some of its light.
    pub(crate) fn is_clipped(&self) -> bool {
        self.ways.len() != 1 || !self.ways[0].is_empty()
    }

    /// Whether the rim of a mask takes some of it.
    pub(crate) fn has_rims(&self) -> bool {
        self.ways.iter().flatten().any(|edge| edge.passes_inside)
    }
}

/// Where a point is imaged and how; or how that changes with its distance, per mm.
struct Imaging {
    x_mm: f64,
    y_mm: f64,
    magnification: f64,
    /// Radius of the image, signed.
    blur_mm: f64,
}

impl Imaging {
    fn at(point_mm: [f64; 3], pencil: &Pencil) -> Self {
        let (image, magnification) = pencil.projection.image_and_magnification(point_mm);
        let blur_mm = pencil.signed_blur_mm(point_mm[2], magnification);
        Self { x_mm: image.x_mm, y_mm: image.y_mm, magnification, blur_mm }
    }

    fn change([x_mm, y_mm, z_mm]: [f64; 3], pencil: &Pencil) -> Self {
        const STEP_MM: f64 = 0.01;
        let (far, near) =
            (Self::at([x_mm, y_mm, z_mm + STEP_MM], pencil), Self::at([x_mm, y_mm, z_mm - STEP_MM], pencil));
        let per_mm = 0.5 / STEP_MM;
        Self {
            x_mm: (far.x_mm - near.x_mm) * per_mm,
            y_mm: (far.y_mm - near.y_mm) * per_mm,
            magnification: (far.magnification - near.magnification) * per_mm,
            blur_mm: (far.blur_mm - near.blur_mm) * per_mm,
        }
    }
}

impl Departure {
    /// `blur_mm` is the signed radius of the image of its middle.
    fn smear(&self, per_px: f64, blur_mm: f64) -> Smear {
        let (sign, parts) = (blur_mm.signum(), [self.spread, self.outer]);
        Smear {
            outwards: self.outwards,
            blur_px: [blur_mm, self.outer.growth_mm].map(|mm| sign * mm * per_px),
            stretch_px: parts.map(|part| sign * part.stretch_mm * per_px),
            coma_px: parts.map(|part| part.coma_mm.map(|mm| mm * per_px)),
            spherical_px: sign * self.spread.spherical_mm * per_px,
            falloff: parts.map(|part| part.falloff),
            // What passes the pupil at w arrives at −B w.
            light_px: -self.spread.light_growth * blur_mm * per_px,
            left_px: self.spread.left_mm * per_px,
            away: self.away,
        }
    }

    /// Adds it to an image and its changes; what is left is how the image is stretched, by as much in one direction as it is
    /// shrunk in the other.
    fn applied(&self, image: &mut Imaging, change: &mut Imaging) -> Matrix2 {
        let [[a, b], [c, d]] = self.growth;
        let mean = 0.5 * (a + d);
        image.x_mm += self.shift_mm[0];
        image.y_mm += self.shift_mm[1];
        image.magnification += mean;
        image.blur_mm += self.spread.growth_mm;
        change.x_mm += self.shift_per_mm[0];
        change.y_mm += self.shift_per_mm[1];
        let inverse = 1.0 / image.magnification;
        [[1.0 + (a - mean) * inverse, b * inverse], [c * inverse, 1.0 + (d - mean) * inverse]]
    }
}

/// How a surface is tilted.
pub(crate) struct Tilt {
    /// Unit vector along the steepest slope.
    steepest: Vector2,
    pub(crate) sin: f64,
    cos: f64,
}

impl Tilt {
    pub(crate) fn of([sx, sy]: Vector2) -> Self {
        let slope = (sx * sx + sy * sy).sqrt();
        let cos = 1.0 / (1.0 + slope * slope).sqrt();
        let steepest = if slope > 0.0 { [sx / slope, sy / slope] } else { [1.0, 0.0] };
        Self { steepest, sin: slope * cos, cos }
    }

    /// `R diag(cosθ, 1) + (p′/m) ⊗ (sinθ, 0)`: foreshortening along the first axis, and what the drift p′ of the image
    /// with depth adds to it, over the magnification.
    pub(crate) fn shape(&self, drift: Vector2) -> Matrix2 {
        let [ux, uy] = self.steepest;
        [[ux * self.cos + drift[0] * self.sin, -uy], [uy * self.cos + drift[1] * self.sin, ux]]
    }
}

/// A vector under a matrix.
pub(crate) fn times(matrix: Matrix2, [x, y]: Vector2) -> Vector2 {
    matrix.map(|[a, b]| a * x + b * y)
}

/// The product of two matrices.
pub(crate) fn product([[a, b], [c, d]]: Matrix2, [[e, f], [g, h]]: Matrix2) -> Matrix2 {
    [[a * e + b * g, a * f + b * h], [c * e + d * g, c * f + d * h]]
}

/// Inverse of a matrix; a surface seen edge on counts as nearly so.
pub(crate) fn inverse([[a, b], [c, d]]: Matrix2) -> Matrix2 {
    const FLATTEST: f64 = 1e-3;
    let determinant = a * d - b * c;
    let determinant = if determinant.abs() < FLATTEST { FLATTEST.copysign(determinant) } else { determinant };
    [[d / determinant, -b / determinant], [-c / determinant, a / determinant]]
}
