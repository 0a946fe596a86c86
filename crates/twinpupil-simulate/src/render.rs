//! The light that every pixel receives in every band, integrated over the pupil and the pixel.

use rayon::prelude::*;
use twinpupil_instrument::{Band, ImagePoint, Instrument, PixelPoint, Projection, Registration, Sensor};
use twinpupil_optics::{BandOptics, Camera, Footprint, ObjectRays, RayLedger, RayMap, RayStarts};

use crate::bundle::{Bundle, Sight};
use crate::disc::Disc;
use crate::dot::Dot;
use crate::illumination::Illumination;
use crate::index::DotIndex;
use crate::light::{covered_light, sum};
use crate::patches::Patches;
use crate::plate::Pose;
use crate::progress::Progress;
use crate::ray::Ray;
use crate::sampling::{PUPIL_SAMPLES_MAX, SampleBank, SampleSet, pupil_cell};
use crate::scene::Scene;
use crate::surface::{Start, Surface};
use crate::texture::Texture;

/// Side of the squares of pixels that are first looked at as a whole, px.
pub(crate) const TILE_PX: usize = 16;

/// Smallest magnification at which a length on the sensor still makes sense in object space.
const MAGNIFICATION_MIN: f64 = 1e-6;

/// Between these widths, mm, a ray's shadow is kept where the first-order projection has a pole.
const SHADOW_MM_MIN: f64 = 1e-9;
const SHADOW_MM_MAX: f64 = 1e6;

/// Scene, optics and samples, ready to give the light in any pixel.
pub(crate) struct Renderer<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) sensor: &'a Sensor,
    /// Where the pixels lie on the reference frame.
    registration: Registration,
    pub(crate) bands: Vec<BandView<'a>>,
    index: DotIndex,
    bank: SampleBank,
    /// Samples for pencils that the masks cut.
    fine_bank: SampleBank,
}

/// How much finer the pupil is sampled where the masks cut the pencils: the cells of points along the masks' edges reach
/// beyond them, which widens the light at the edge of a dot as those at the pupil's rim would.
const FINENESS: usize = 4;

/// One band and the scene as it appears in it.
pub(crate) struct BandView<'a> {
    pub(crate) optics: &'a BandOptics,
    projection: Projection,
    surface: Surface,
    patches: Patches,
    /// Mean width of a pixel, mm, and the unit vector along the rows of pixels.
    pitch_mm: f64,
    along_rows: [f64; 2],
    pupil_samples: usize,
    /// In the order of the scene's dots.
    pub(crate) discs: Vec<Disc>,
    /// The same for the finer samples.
    fine_discs: Vec<Disc>,
    /// Width of the widest shadow of a ray on a dot.
    shadow_mm_max: f64,
}

/// What a bundle of rays meets.
#[derive(Default)]
struct Prospect {
    /// A dot fills it, and no picture stands in between.
    filled: Option<usize>,
    /// The picture may be in it.
    picture: bool,
    /// Dots that rays may or may not hit.
    dots: Vec<usize>,
}

/// Buffers that are used again from pixel to pixel.
#[derive(Default)]
pub(crate) struct Workspace {
    nearby: Vec<usize>,
    tile: Prospect,
    pixel: Prospect,
    image_x_mm: Vec<f64>,
    image_y_mm: Vec<f64>,
    pub(crate) rays: ObjectRays,
    coverage: Vec<f64>,
    ledger: RayLedger,
}

/// Corners of a rectangle, from its middle and in its width and height.
const CORNERS: [[f64; 2]; 4] = [[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]];

/// Centre and radius of the disc of the ideal image plane from which the rays of a rectangle of pixels start, given its
/// middle and its corners.
fn reach_of(surface: &Surface, middle: PixelPoint, corners: [PixelPoint; 4]) -> (ImagePoint, f64) {
    // Between the corners the map bends by far less.
    const MARGIN: f64 = 1.01;
    let centre = surface.start(middle).centre;
    let reach_mm = corners.map(|corner| {
        let start = surface.start(corner);
        (start.centre.x_mm - centre.x_mm).hypot(start.centre.y_mm - centre.y_mm) + start.reach_mm()
    });
    (centre, MARGIN * reach_mm.into_iter().fold(0.0, f64::max))
}

/// Which pixels of a 2×2 cell are wanted, by row and column.
pub(crate) type WantedCell = [[bool; 2]; 2];

impl<'a> Renderer<'a> {
    /// Renders pages whose pixels lie on the reference frame as `registration` says, with other rays for every `turn`.
    pub(crate) fn new(
        instrument: &'a Instrument,
        camera: &'a Camera,
        scene: &'a Scene,
        pupil_samples: usize,
        turn: usize,
        registration: Registration,
    ) -> Self {
        let sensor = &instrument.sensor;
        let [u, v] = sensor.size_px.map(|size| 0.5 * (size as f64 - 1.0));
        let middle = PixelPoint { u, v };
        let pitch_mm = sensor.pitch_mm * registration.area_px2(middle).sqrt();
        let [[x, _], [y, _]] = registration.jacobian(middle);
        let along_rows = [x / x.hypot(y), y / x.hypot(y)];
        let view = |(band, optics): (&Band, &'a BandOptics)| {
            let projection = instrument.projection(band);
            let surface = Surface::new(sensor, band, registration, &projection, optics.focal_length_mm());
            let patches = Patches::new(sensor.size_px);
            BandView::new(optics, projection, (surface, patches), (pitch_mm, along_rows), scene, pupil_samples)
        };
        Self {
            scene,
            sensor,
            registration,
            bands: instrument.bands.iter().zip(camera.bands()).map(view).collect(),
            index: DotIndex::new(scene.dots()),
            bank: SampleBank::new(pupil_samples, turn),
            fine_bank: SampleBank::new((FINENESS * pupil_samples).min(PUPIL_SAMPLES_MAX), turn),
        }
    }

    /// Electrons of unit response in every wanted pixel of a band, row by row, and what became of the rays.
    ///
    /// `progress` steps after every row of tiles.
    pub(crate) fn band_electrons(
        &self,
        band: usize,
        wanted: WantedCell,
        progress: &Progress<'_>,
    ) -> (Vec<f64>, RayLedger) {
        let [width_px, height_px] = self.sensor.size_px;
        let mut electrons = vec![0.0; width_px * height_px];
        let tile_rows = electrons.par_chunks_mut(width_px * TILE_PX).enumerate();
        let ledger = tile_rows
            .map_init(Workspace::default, |workspace, (tile_row, rows)| {
                for column in (0..width_px).step_by(TILE_PX) {
                    self.tile(band, [column, tile_row * TILE_PX], wanted, rows, workspace);
                }
                progress.step();
                std::mem::take(&mut workspace.ledger)
            })
            .reduce(RayLedger::default, |mut sum, ledger| {
                sum.merge(&ledger);
                sum
            });
        (electrons, ledger)
    }

    /// Fills one tile from `[column, row]` on; `rows` are the pixel rows of the tile's whole row of tiles.
    fn tile(&self, band: usize, first: [usize; 2], wanted: WantedCell, rows: &mut [f64], workspace: &mut Workspace) {
        let width_px = self.sensor.size_px[0];
        let [column_first, row_first] = first;
        let columns = column_first..width_px.min(column_first + TILE_PX);
        let (centre, radius_mm) = self.disc(band, first, [columns.len(), rows.len() / width_px]);
        let bundle = Bundle::new(self.bands[band].optics, centre, radius_mm);
        self.look_around(band, &bundle, workspace);
        let uniform_e = self.uniform_e(&workspace.tile);
        if uniform_e == Some(0.0) {
            return;
        }
        let unclipped_e = uniform_e.filter(|_| self.scene.illumination.is_none() && bundle.is_unclipped());
        for (row, pixels) in (row_first..).zip(rows.chunks_exact_mut(width_px)) {
            for column in columns.clone().filter(|column| wanted[row % 2][column % 2]) {
                pixels[column] = unclipped_e.unwrap_or_else(|| self.pixel(band, column, row, &bundle, workspace));
            }
        }
    }

    /// Electrons in one pixel, whose tile has been looked at and has the bundle `of_tile`.
    fn pixel(&self, band: usize, column: usize, row: usize, of_tile: &Bundle<'_>, workspace: &mut Workspace) -> f64 {
        let (centre, radius_mm) = self.disc(band, [column, row], [1, 1]);
        let bundle = of_tile.part(centre, radius_mm);
        let Workspace { tile, pixel, .. } = workspace;
        self.look_closer(band, &bundle, tile, pixel);
        match self.uniform_e(pixel) {
            Some(0.0) => 0.0,
            Some(electrons) if bundle.is_unclipped() => match &self.scene.illumination {
                None => electrons,
                Some(light) => electrons * self.light_on(&bundle, light, pixel.filled),
            },
            uniform_e => {
                let (bank, discs) = self.sampling(band, &bundle);
                let samples = bank.of_pixel(band, column, row);
                if let (None, Some(electrons)) = (&self.scene.illumination, uniform_e) {
                    self.weigh(band, [column, row], &bundle, samples, workspace);
                    return electrons * sum(&workspace.rays.weight) / samples.len() as f64;
                }
                self.trace(band, [column, row], &bundle, samples, workspace);
                match &self.scene.illumination {
                    Some(light) => self.unevenly_lit_e(band, light, samples, discs, workspace),
                    None => self.sampled_e(band, samples, discs, workspace),
                }
            }
        }
    }

    /// Samples for a bundle, and the dots as their rays meet them; finer ones where the masks cut it.
    pub(crate) fn sampling(&self, band: usize, bundle: &Bundle<'_>) -> (&SampleBank, &[Disc]) {
        let view = &self.bands[band];
        if bundle.is_unclipped() { (&self.bank, &view.discs) } else { (&self.fine_bank, &view.fine_discs) }
    }

    /// Centre and radius of the disc of the ideal image plane from which the rays of a rectangle of pixels start.
    pub(crate) fn disc(&self, band: usize, first: [usize; 2], size_px: [usize; 2]) -> (ImagePoint, f64) {
        let middle = |axis: usize| first[axis] as f64 + 0.5 * (size_px[axis] as f64 - 1.0);
        let own = PixelPoint { u: middle(0), v: middle(1) };
        let surface = &self.bands[band].surface;
        let [width, height] = size_px.map(|size| size as f64);
        let corner = |[a, b]: [f64; 2]| PixelPoint { u: own.u + a * width, v: own.v + b * height };
        if !surface.is_ideal() {
            return reach_of(surface, own, CORNERS.map(corner));
        }
        let centre = self.sensor.image_from_pixel(self.registration.map(own));
        if self.registration.is_identity() {
            return (centre, 0.5 * self.sensor.pitch_mm * width.hypot(height));
        }
        // The farthest corner, which a homography may move a little farther than the others.
        let reach_mm = CORNERS.map(|place| {
            let corner = self.sensor.image_from_pixel(self.registration.map(corner(place)));
            (corner.x_mm - centre.x_mm).hypot(corner.y_mm - centre.y_mm)
        });
        (centre, reach_mm.into_iter().fold(0.0, f64::max))
    }

    /// What the bundle of a tile meets among all there is.
    fn look_around(&self, band: usize, bundle: &Bundle<'_>, workspace: &mut Workspace) {
        let Workspace { nearby, tile, .. } = workspace;
        self.find_dots(band, bundle, nearby);
        let picture = self.scene.texture().is_some_and(|texture| may_meet(bundle, texture));
        self.look_at(band, bundle, nearby, picture, tile);
    }

    /// Replaces `nearby` by the dots that the bundle may meet.
    pub(crate) fn find_dots(&self, band: usize, bundle: &Bundle<'_>, nearby: &mut Vec<usize>) {
        nearby.clear();
        if !self.scene.dots().is_empty() {
            let [near_mm, far_mm] = self.index.z_mm;
            let (low_mm, high_mm) = bundle.rectangle_mm(near_mm, far_mm);
            let shadow_mm = self.bands[band].shadow_mm_max;
            self.index.find(low_mm.map(|c| c - shadow_mm), high_mm.map(|c| c + shadow_mm), nearby);
        }
    }

    /// What the bundle of a pixel meets among what its tile does.
    fn look_closer(&self, band: usize, bundle: &Bundle<'_>, tile: &Prospect, pixel: &mut Prospect) {
        let picture = tile.picture && self.scene.texture().is_some_and(|texture| may_meet(bundle, texture));
        self.look_at(band, bundle, &tile.dots, picture, pixel);
        pixel.filled = pixel.filled.or(tile.filled);
    }

    fn look_at(&self, band: usize, bundle: &Bundle<'_>, dots: &[usize], picture: bool, prospect: &mut Prospect) {
        prospect.dots.clear();
        prospect.filled = None;
        prospect.picture = picture;
        for &id in dots {
            match bundle.sight(&self.scene.dots()[id], self.bands[band].discs[id].shadow_mm) {
                Sight::Beside => {}
                // Only the rays can tell whether the picture hides the dot.
                Sight::Within if !picture => prospect.filled = Some(id),
                _ => prospect.dots.push(id),
            }
        }
    }

    /// The radiance that all rays bring back, if it is the same for all.
    fn uniform_e(&self, prospect: &Prospect) -> Option<f64> {
        match prospect {
            Prospect { filled: Some(_), .. } => Some(self.scene.brightness_e),
            Prospect { picture: false, dots, .. } if dots.is_empty() => Some(self.scene.background_e),
            _ => None,
        }
    }

    /// Traces the rays from the centre of a pixel.
    pub(crate) fn trace(
        &self,
        band: usize,
        [column, row]: [usize; 2],
        bundle: &Bundle<'_>,
        samples: &SampleSet,
        workspace: &mut Workspace,
    ) {
        let Workspace { image_x_mm, image_y_mm, rays, ledger, .. } = workspace;
        let BandView { surface, optics, .. } = &self.bands[band];
        if let Some(map) = self.ray_map(band, [column, row]) {
            return map.trace(bundle.centre, [&samples.pupil_x, &samples.pupil_y], rays, ledger);
        }
        if surface.is_ideal() {
            let ImagePoint { x_mm, y_mm } = bundle.centre;
            for (buffer, value) in [(&mut *image_x_mm, x_mm), (&mut *image_y_mm, y_mm)] {
                buffer.clear();
                buffer.resize(samples.len(), value);
            }
        } else {
            let start = surface.start(PixelPoint { u: column as f64, v: row as f64 });
            spread(&start, samples, image_x_mm, image_y_mm);
        }
        let starts = RayStarts { image_x_mm, image_y_mm, pupil_x: &samples.pupil_x, pupil_y: &samples.pupil_y };
        optics.trace(starts, rays, ledger);
    }

    /// [`Renderer::trace`] where it does not matter where the rays go.
    fn weigh(
        &self,
        band: usize,
        pixel: [usize; 2],
        bundle: &Bundle<'_>,
        samples: &SampleSet,
        workspace: &mut Workspace,
    ) {
        match self.ray_map(band, pixel) {
            Some(map) => {
                let Workspace { rays, ledger, .. } = workspace;
                map.weigh(bundle.centre, [&samples.pupil_x, &samples.pupil_y], rays, ledger);
            }
            None => self.trace(band, pixel, bundle, samples, workspace),
        }
    }

    /// The rays from about a pixel as polynomials, where all rays of a pixel start from one point of the ideal plane.
    fn ray_map(&self, band: usize, pixel: [usize; 2]) -> Option<&RayMap> {
        let BandView { surface, patches, optics, .. } = &self.bands[band];
        let make = |first: [usize; 2], size_px: [usize; 2]| {
            let (centre, radius_mm) = self.disc(band, first, size_px);
            optics.ray_map(centre, radius_mm)
        };
        if surface.is_ideal() { patches.around(pixel, make) } else { None }
    }

    /// Mean of what the traced rays bring back from the pixel's prospect.
    fn sampled_e(&self, band: usize, samples: &SampleSet, discs: &[Disc], workspace: &mut Workspace) -> f64 {
        let Workspace { pixel, rays, coverage, .. } = workspace;
        let view = &self.bands[band];
        let (ground_e, feature_e) = (self.scene.background_e, self.scene.brightness_e);
        let total_e = match self.scene.texture().filter(|_| pixel.picture) {
            None => {
                coverage.clear();
                coverage.resize(rays.len(), 0.0);
                pixel.dots.iter().for_each(|&id| discs[id].add_coverage(rays, coverage));
                let (light, covered) = covered_light(&rays.weight, coverage);
                ground_e * light + (feature_e - ground_e) * covered
            }
            Some(texture) => weighted_sum(rays, |index| {
                let ray = Ray::of(rays, index);
                let offset_px = [samples.offset_u_px[index], samples.offset_v_px[index]];
                let picture = view.picture_hit(texture, &ray, offset_px);
                // The picture hides what lies behind it.
                let dots = pixel.dots.iter().map(|&id| discs[id].coverage(&ray));
                let covered: f64 = dots.filter(|(_, z_mm)| *z_mm < picture.z_mm).map(|(coverage, _)| coverage).sum();
                let behind_e = ground_e + (feature_e - ground_e) * picture.value;
                behind_e + (feature_e - behind_e) * covered.min(1.0)
            }),
        };
        total_e / samples.len() as f64
    }
}

impl Renderer<'_> {
    /// Relative light where the middle of a bundle meets a dot, or the ground: where the light grows evenly, that is
    /// its mean over the bundle.
    pub(crate) fn light_on(&self, bundle: &Bundle<'_>, light: &Illumination, dot: Option<usize>) -> f64 {
        const ROUNDS: usize = 4;
        let (point_mm, slope) = self.surface(dot);
        let mut z_mm = point_mm[2];
        let mut place_mm = [0.0; 2];
        // On a plane that leans, the distance follows from the place.
        for _ in 0..ROUNDS {
            let Footprint { x_mm, y_mm, .. } = bundle.pencil.footprint(z_mm);
            place_mm = [x_mm, y_mm];
            z_mm = point_mm[2] + slope[0] * (x_mm - point_mm[0]) + slope[1] * (y_mm - point_mm[1]);
        }
        light.at(place_mm)
    }

    /// A point of the plane of a dot, or of the ground, and its slopes.
    fn surface(&self, dot: Option<usize>) -> ([f64; 3], [f64; 2]) {
        match dot.map(|id| &self.scene.dots()[id]) {
            Some(Dot { centre_mm, normal: [nx, ny, nz], .. }) => (*centre_mm, [-nx / nz, -ny / nz]),
            None => {
                let Pose { distance_mm, slope } = self.scene.ground();
                ([0.0, 0.0, distance_mm], slope)
            }
        }
    }

    /// [`Renderer::sampled_e`] where light falls unevenly: every ray brings what falls on the surface that it meets.
    fn unevenly_lit_e(
        &self,
        band: usize,
        light: &Illumination,
        samples: &SampleSet,
        discs: &[Disc],
        workspace: &mut Workspace,
    ) -> f64 {
        let Workspace { pixel, rays, .. } = workspace;
        let view = &self.bands[band];
        let (ground_e, feature_e) = (self.scene.background_e, self.scene.brightness_e);
        let (ground_mm, ground_slope) = self.surface(None);
        let filled = pixel.filled.map(|id| self.surface(Some(id)));
        let total_e = weighted_sum(rays, |index| {
            let ray = Ray::of(rays, index);
            if let Some((point_mm, slope)) = filled {
                return feature_e * light.at(ray.at(ray.meets_plane(point_mm, slope)));
            }
            let offset_px = [samples.offset_u_px[index], samples.offset_v_px[index]];
            let picture = self.scene.texture().filter(|_| pixel.picture);
            let hit = picture.map(|texture| view.picture_hit(texture, &ray, offset_px));
            let (value, picture_z_mm) = hit.map_or((0.0, f64::INFINITY), |hit| (hit.value, hit.z_mm));
            let behind_e = (ground_e + (feature_e - ground_e) * value)
                * light.at(ray.at(ray.meets_plane(ground_mm, ground_slope)));
            let (mut covered, mut lit) = (0.0, 0.0);
            for &id in &pixel.dots {
                let (coverage, z_mm) = discs[id].coverage(&ray);
                if z_mm < picture_z_mm {
                    covered += coverage;
                    lit += coverage * light.at(ray.at(z_mm));
                }
            }
            // Dots that overlap in the image cover no more than all.
            let share = 1.0 / f64::max(covered, 1.0);
            behind_e * (1.0 - covered * share) + feature_e * lit * share
        });
        total_e / samples.len() as f64
    }
}

impl<'a> BandView<'a> {
    fn new(
        optics: &'a BandOptics,
        projection: Projection,
        (surface, patches): (Surface, Patches),
        (pitch_mm, along_rows): (f64, [f64; 2]),
        scene: &Scene,
        pupil_samples: usize,
    ) -> Self {
        let mut view = Self {
            optics,
            projection,
            surface,
            patches,
            pitch_mm,
            along_rows,
            pupil_samples,
            discs: Vec::new(),
            fine_discs: Vec::new(),
            shadow_mm_max: 0.0,
        };
        view.discs = scene.dots().iter().map(|dot| view.disc(dot, 1)).collect();
        view.fine_discs = scene.dots().iter().map(|dot| view.disc(dot, FINENESS)).collect();
        view.shadow_mm_max = view.discs.iter().map(|disc| disc.shadow_mm).fold(0.0, f64::max);
        view
    }

    /// A dot as the rays of this band meet it, of samples so many times finer.
    fn disc(&self, dot: &Dot, fineness: usize) -> Disc {
        let z_mm = dot.centre_mm[2];
        let blur_mm = object_length_mm(&self.projection, self.projection.blur_radius_mm(z_mm), z_mm);
        // `max` comes first: it also catches the NaN of a pupil that no pencil of rays fills.
        let shadow_mm = self
            .pixel_mm(z_mm)
            .hypot(blur_mm * pupil_cell((fineness * self.pupil_samples).min(PUPIL_SAMPLES_MAX)))
            .max(SHADOW_MM_MIN);
        Disc::new(dot, shadow_mm.min(SHADOW_MM_MAX)).turned(self.along_rows)
    }

    /// Width in object space at distance z of a pixel, seen from one pupil point, mm.
    fn pixel_mm(&self, z_mm: f64) -> f64 {
        object_length_mm(&self.projection, self.pitch_mm, z_mm)
    }

    /// What a ray sees of the picture at its own place in the pixel, which is moved there on the plate.
    fn picture_hit(&self, texture: &Texture, ray: &Ray, offset_px: [f64; 2]) -> PictureHit {
        let pose = texture.pose();
        let z_mm = ray.meets_plane([0.0, 0.0, pose.distance_mm], pose.slope);
        let [x_mm, y_mm] = ray.at(z_mm);
        let pixel_mm = self.pixel_mm(z_mm);
        match texture.at(x_mm + pixel_mm * offset_px[0], y_mm + pixel_mm * offset_px[1]) {
            Some(value) => PictureHit { value, z_mm },
            None => PictureHit { value: 0.0, z_mm: f64::INFINITY },
        }
    }
}

/// Where a ray meets the picture and what is there; infinitely far away and black beside it.
struct PictureHit {
    value: f64,
    z_mm: f64,
}

/// Length in object space at distance z of a length on the sensor, seen from one pupil point, mm.
fn object_length_mm(projection: &Projection, image_mm: f64, z_mm: f64) -> f64 {
    // `max` also catches the NaN of a pupil through which no single chief ray passes.
    image_mm / projection.magnification(z_mm).abs().max(MAGNIFICATION_MIN)
}

/// Whether some ray of the bundle may meet the picture.
fn may_meet(bundle: &Bundle<'_>, texture: &Texture) -> bool {
    let (low_mm, high_mm) = bundle.rectangle_mm(texture.nearest_mm(), texture.farthest_mm());
    let half_mm = texture.half_extent_mm();
    (0..2).all(|axis| low_mm[axis] <= half_mm[axis] && high_mm[axis] >= -half_mm[axis])
}

/// Where the rays of a pixel start on the ideal image plane, mm.
fn spread(start: &Start, samples: &SampleSet, image_x_mm: &mut Vec<f64>, image_y_mm: &mut Vec<f64>) {
    image_x_mm.clear();
    image_y_mm.clear();
    for (pupil_x, pupil_y) in samples.pupil_x.iter().zip(&samples.pupil_y) {
        let [x_mm, y_mm] = start.at(*pupil_x, *pupil_y);
        image_x_mm.push(x_mm);
        image_y_mm.push(y_mm);
    }
}

/// Sum over the rays that arrived of weight × value.
fn weighted_sum(rays: &ObjectRays, value: impl Fn(usize) -> f64) -> f64 {
    // Positions of lost rays mean nothing and may be NaN, so they are not multiplied by their weight of zero.
    rays.weight.iter().enumerate().map(|(ray, &weight)| if weight > 0.0 { weight * value(ray) } else { 0.0 }).sum()
}
