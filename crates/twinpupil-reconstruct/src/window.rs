//! The light of one feature: a round window about its centre, with what belongs to its neighbours taken out.

use std::ops::RangeInclusive;

use crate::contrast::Contrast;

/// Round windows about all features of a plane. Where windows overlap, each pixel's light is shared.
#[derive(Debug)]
pub(crate) struct Windows<'a> {
    contrast: &'a Contrast,
    /// Centres, pixels of the plane.
    pub(crate) centres: Vec<[f64; 2]>,
    /// Centres and extents of the features' outlines, which the windows' centres may not leave.
    pub(crate) outlines: Vec<([f64; 2], f64)>,
    radii: Vec<f64>,
    /// For every feature, those whose windows overlap its own.
    neighbours: Vec<Vec<u32>>,
}

/// One pixel of a window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WindowPixel {
    pub(crate) column: f64,
    pub(crate) row: f64,
    /// Contrast that belongs to the feature, codes.
    pub(crate) signal: f64,
    /// The feature's share of the pixel's contrast.
    pub(crate) share: f64,
    /// Contrast of the pixel as read, codes.
    pub(crate) contrast: f32,
}

impl<'a> Windows<'a> {
    /// Windows about features that each have a centre, an extent and a radius that holds all their light, pixels of the
    /// plane. `neighbours` are those that [`overlapping`] gives.
    pub(crate) fn new(contrast: &'a Contrast, discs: &[Disc], mut neighbours: Vec<Vec<u32>>) -> Self {
        let centres: Vec<[f64; 2]> = discs.iter().map(|disc| disc.centre).collect();
        let outlines = discs.iter().map(|disc| (disc.centre, disc.extent)).collect();
        let radii: Vec<f64> = discs.iter().map(|disc| disc.radius).collect();
        for (feature, near) in neighbours.iter_mut().enumerate() {
            keep_nearest(near, &centres, feature);
        }
        Self { contrast, centres, outlines, radii, neighbours }
    }

    /// Whether another feature's window overlaps this one's.
    pub(crate) fn overlaps(&self, feature: usize) -> bool {
        !self.neighbours[feature].is_empty()
    }

    /// Pixels of all windows that are shared, each as often as it has claimants.
    pub(crate) fn shared_pixels(&self) -> f64 {
        let area = |(near, radius): (&Vec<u32>, &f64)| near.len() as f64 * std::f64::consts::PI * radius * radius;
        self.neighbours.iter().zip(&self.radii).map(area).sum()
    }

    /// Visits the pixels of a feature's window, each with the feature's share of its light.
    pub(crate) fn for_each_pixel(&self, feature: usize, mut visit: impl FnMut(WindowPixel)) {
        self.for_each_row(feature, |row, first, line| {
            let claimed = self.claimed_columns(feature, row as f64);
            for (column, &value) in (first..).zip(line) {
                let (column, row) = (column as f64, row as f64);
                let share = if claimed.contains(&column) { self.share(feature, column, row, value) } else { 1.0 };
                visit(WindowPixel { column, row, signal: share * f64::from(value), share, contrast: value });
            }
        });
    }

    /// The columns of a row between which a neighbour's window may hold pixels.
    fn claimed_columns(&self, feature: usize, row: f64) -> RangeInclusive<f64> {
        let chord = |&other: &u32| {
            let ([c, r], radius) = (self.centres[other as usize], self.radii[other as usize]);
            let half = (radius * radius - (row - r).powi(2)).sqrt();
            (half > 0.0).then_some((c - half, c + half))
        };
        let chords = self.neighbours[feature].iter().filter_map(chord);
        let (first, last) =
            chords.fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), (a, b)| (first.min(a), last.max(b)));
        first..=last
    }

    /// Visits the rows of a feature's window: row, first column, contrasts.
    ///
    /// A window that leaves the plane is trimmed on its far side too, so that it stays symmetric.
    pub(crate) fn for_each_row(&self, feature: usize, mut visit: impl FnMut(usize, usize, &[f32])) {
        let contrast = self.contrast;
        let ([column, row], radius) = (self.centres[feature], self.radii[feature]);
        let (last_column, last_row) = ((contrast.columns - 1) as f64, (contrast.rows - 1) as f64);
        // A half side that keeps both a pixel and its mirror image inside.
        let half = |centre: f64, last: f64| radius.min(centre).min(last - centre);
        let (half_width, half_height) = (half(column, last_column), half(row, last_row));
        if half_width < 0.0 || half_height < 0.0 {
            return;
        }
        for r in (row - half_height).ceil() as usize..=(row + half_height).floor() as usize {
            let dy = r as f64 - row;
            let chord = (radius * radius - dy * dy).max(0.0).sqrt().min(half_width);
            let line = &contrast.signal[r * contrast.columns..(r + 1) * contrast.columns];
            let (first, last) = ((column - chord).ceil() as usize, (column + chord).floor() as usize);
            visit(r, first, &line[first..last + 1]);
        }
    }

    /// The share of a pixel's light that belongs to a feature, from what each claimant shows on its far side.
    fn share(&self, feature: usize, column: f64, row: f64, value: f32) -> f64 {
        let others: f32 =
            self.claimants(feature, [column, row]).map(|other| self.own_light(other, [column, row], value)).sum();
        if others == 0.0 {
            return 1.0;
        }
        let own = self.own_light(feature, [column, row], value);
        f64::from(own / (own + others))
    }

    /// The neighbours of a feature whose windows hold a place.
    fn claimants(&self, feature: usize, place: [f64; 2]) -> impl Iterator<Item = usize> {
        self.neighbours[feature].iter().map(|&other| other as usize).filter(move |&other| {
            let [c, r] = self.centres[other];
            (place[0] - c).powi(2) + (place[1] - r).powi(2) < self.radii[other].powi(2)
        })
    }

    /// A feature's own light at a place: no more than what is there, and no more than what its far side shows once the
    /// feature's other neighbours are taken off there, since features are point symmetric and neighbours only add. At
    /// least the noise, so that shares stay defined.
    fn own_light(&self, feature: usize, place: [f64; 2], value: f32) -> f32 {
        let mirrored = self.mirrored(feature, place);
        let seen = self.contrast.at(mirrored[0], mirrored[1]);
        let others: f32 =
            self.claimants(feature, mirrored).map(|other| self.symmetric_light(other, mirrored, seen)).sum();
        value.min(seen - others).max(0.4 * self.contrast.pixel_noise)
    }

    /// The light that a feature shows both at a place and on its far side.
    fn symmetric_light(&self, feature: usize, place: [f64; 2], value: f32) -> f32 {
        let mirrored = self.mirrored(feature, place);
        value.min(self.contrast.at(mirrored[0], mirrored[1])).max(0.0)
    }

    /// The place on the far side of a feature's centre; where that lies outside the plane, the one beside it.
    fn mirrored(&self, feature: usize, [column, row]: [f64; 2]) -> [f64; 2] {
        let [c, r] = self.centres[feature];
        let (across, along) = (2.0 * c - column, 2.0 * r - row);
        let inside = |position: f64, count: usize| position >= 0.0 && position <= (count - 1) as f64;
        [
            if inside(across, self.contrast.columns) { across } else { column },
            if inside(along, self.contrast.rows) { along } else { row },
        ]
    }
}

/// Neighbours that share light with a feature, at most.
const NEIGHBOURS_MAX: usize = 6;

/// Leaves out all but the nearest neighbours of a feature.
fn keep_nearest(near: &mut Vec<u32>, centres: &[[f64; 2]], feature: usize) {
    let [c, r] = centres[feature];
    let distance2 = |other: &u32| {
        let [oc, or] = centres[*other as usize];
        (oc - c).powi(2) + (or - r).powi(2)
    };
    near.sort_by(|a, b| distance2(a).total_cmp(&distance2(b)).then(a.cmp(b)));
    near.truncate(NEIGHBOURS_MAX);
}

/// Where the light of a feature lies, pixels of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: [f64; 2],
    /// Distance from the centre to the farthest pixel of the outline.
    pub(crate) extent: f64,
    /// Radius of the window that holds all its light.
    pub(crate) radius: f64,
}

/// For every disc, the discs whose windows overlap its own.
pub(crate) fn overlapping(discs: &[Disc]) -> Vec<Vec<u32>> {
    let mut by_column: Vec<u32> = (0..discs.len() as u32).collect();
    by_column.sort_by(|&a, &b| discs[a as usize].centre[0].total_cmp(&discs[b as usize].centre[0]));
    let largest = discs.iter().map(|disc| disc.radius).fold(0.0, f64::max);
    let mut neighbours = vec![Vec::new(); discs.len()];
    for (k, &a) in by_column.iter().enumerate() {
        let own = &discs[a as usize];
        for &b in &by_column[k + 1..] {
            let other = &discs[b as usize];
            let (dx, dy) = (other.centre[0] - own.centre[0], other.centre[1] - own.centre[1]);
            if dx > own.radius + largest {
                break;
            }
            if dx.hypot(dy) < own.radius + other.radius {
                neighbours[a as usize].push(b);
                neighbours[b as usize].push(a);
            }
        }
    }
    neighbours
}
