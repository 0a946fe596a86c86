//! The response table: what the optics make of object points, over radius and distance.

use rayon::prelude::*;
use twinpupil_instrument::{BandResponse, DepthRange, Grid, Instrument, Lens, PointResponse, ResponseTable};

use crate::{BandOptics, Camera, ObjectRays, OpticsError, RayLedger, RayStarts};

/// Finest table that is made by default, whatever the field of view.
const NODES_MAX: usize = 2000;

/// Share by which the default table reaches beyond the depth range and the corner of the sensor.
const MARGIN: f64 = 0.05;

/// Tabulates throughput and centroid displacement of every band at the nodes of `r_mm` and `z_mm` (all above zero), and
/// the light of an evenly bright ground at the nodes of `image_radius_mm`.
///
/// The displacement is that of the image's centroid from `Instrument::projection`, along the radius, zero where no
/// light arrives. Object points lie along +x: with apertures off the axis throughput and displacement hold for that azimuth
/// only, and what the lens itself adds is the mean of both sides of the axis.
pub fn response_table(camera: &Camera, r_mm: Grid, z_mm: Grid, image_radius_mm: Grid) -> ResponseTable {
    let node = |optics: &BandOptics, index: usize| {
        response(optics, r_mm.node(index % r_mm.count), z_mm.node(index / r_mm.count))
    };
    let bands = camera.bands().iter().map(|optics| BandResponse {
        band: optics.name().to_owned(),
        focal_length_mm: optics.focal_length_mm(),
        nodes: (0..r_mm.count * z_mm.count).into_par_iter().map(|index| node(optics, index)).collect(),
        ground: (0..image_radius_mm.count).into_par_iter().map(|i| ground(optics, image_radius_mm.node(i))).collect(),
        ground_centre_mm: optics.shade_centre_mm(),
    });
    ResponseTable { r_mm, z_mm, image_radius_mm, bands: bands.collect() }
}

/// The response table of an instrument over [`response_grids`].
pub fn response_table_for(instrument: &Instrument) -> Result<ResponseTable, OpticsError> {
    Ok(default_table(instrument, &Camera::new(instrument)?))
}

/// The same behind grooves of Fresnel lenses that are infinitely fine, whose walls take no light: what masks do to it alone.
pub fn smoothed_response_table_for(instrument: &Instrument) -> Result<ResponseTable, OpticsError> {
    Ok(default_table(instrument, &Camera::new(instrument)?.smoothed()))
}

fn default_table(instrument: &Instrument, camera: &Camera) -> ResponseTable {
    let (r_mm, z_mm) = response_grids(instrument);
    let image_radius_mm = Grid::spanning(0.0, instrument.corner_radius_mm(), GROUND_NODES);
    response_table(camera, r_mm, z_mm, image_radius_mm)
}

/// Radii at which the light of an even ground is tabulated by default.
const GROUND_NODES: usize = 257;

/// Mean weight of rays spread evenly over the pupil from a point of the sensor, along +x from the middle of the shade: the light of an evenly bright
/// ground, which does not depend on where the ground lies.
fn ground(optics: &BandOptics, image_radius_mm: f64) -> f64 {
    const RAYS: usize = 2048;
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let point = |k: usize| {
        let (sin, cos) = (golden_angle * k as f64).sin_cos();
        let radius = ((k as f64 + 0.5) / RAYS as f64).sqrt();
        (radius * cos, radius * sin)
    };
    let (pupil_x, pupil_y): (Vec<f64>, Vec<f64>) = (0..RAYS).map(point).unzip();
    let [x_mm, y_mm] = optics.shade_centre_mm();
    let (image_x_mm, image_y_mm) = (vec![x_mm + image_radius_mm; RAYS], vec![y_mm; RAYS]);
    let starts = RayStarts { image_x_mm: &image_x_mm, image_y_mm: &image_y_mm, pupil_x: &pupil_x, pupil_y: &pupil_y };
    let mut rays = ObjectRays::default();
    optics.trace(starts, &mut rays, &mut RayLedger::default());
    rays.weight.iter().sum::<f64>() / RAYS as f64
}

/// Radii up to the corner of the sensor and distances of the depth range, both with a margin of 5 %.
///
/// Thin lens: steps of 0.05 mm and at most 5 mm. Other lenses, which are smooth and cost more: twice that.
pub fn response_grids(instrument: &Instrument) -> (Grid, Grid) {
    let coarsening = match instrument.lens {
        Lens::Thin(_) => 1.0,
        Lens::Fresnel(_) | Lens::Prescription(_) => 2.0,
    };
    let DepthRange { near_mm, far_mm } = instrument.depth_range();
    let (near_mm, far_mm) = (near_mm * (1.0 - MARGIN), far_mm * (1.0 + MARGIN));
    let magnifications = instrument
        .projections()
        .into_iter()
        .flat_map(|projection| [near_mm, far_mm].map(|z_mm| projection.magnification(z_mm).abs()));
    let smallest = magnifications.fold(f64::INFINITY, f64::min);
    let r_max_mm = (1.0 + MARGIN) * instrument.corner_radius_mm() / smallest;
    let nodes = |span_mm: f64, step_mm: f64| ((span_mm / step_mm).ceil() as usize).clamp(1, NODES_MAX) + 1;
    let r_max_mm = r_max_mm.min(0.05 * coarsening * NODES_MAX as f64);
    let r_mm = Grid::spanning(0.0, r_max_mm, nodes(r_max_mm, 0.05 * coarsening));
    let z_mm = Grid::spanning(near_mm, far_mm, nodes(far_mm - near_mm, 5.0 * coarsening));
    (r_mm, z_mm)
}

fn response(optics: &BandOptics, r_mm: f64, z_mm: f64) -> PointResponse {
    let object_mm = [r_mm, 0.0, z_mm];
    let image = optics.point_image(object_mm);
    let first_order = optics.projection().image(object_mm);
    // Signed along +x, so that the table stays smooth where a centroid crosses the axis.
    let radial_deviation_mm = if image.throughput > 0.0 { image.centroid.x_mm - first_order.x_mm } else { 0.0 };
    let own = (image.aberration_mm[0], image.spread);
    let (aberration_mm, spread) = if optics.is_centred() {
        own
    } else {
        // What masks off the axis add to one side of it they take from the other.
        let other = optics.point_image([-r_mm, 0.0, z_mm]);
        (0.5 * (own.0 - other.aberration_mm[0]), (own.1 + other.spread) * 0.5)
    };
    PointResponse { throughput: image.throughput, radial_deviation_mm, aberration_mm, spread }
}
