//! The contrast of a plane, read where it is asked for: features are positive whatever their polarity.

use std::ops::Range;

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::background::Polarity;
use crate::fetch::fetch;

/// Where contrasts come from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Light<'a> {
    /// Codes, less an even level.
    Codes {
        /// The plane.
        plane: PlaneView<'a>,
        /// Level of the ground, codes.
        level: f32,
        /// Which side of it features lie on.
        polarity: Polarity,
    },
    /// Contrasts that were computed for every pixel, row by row.
    Field {
        /// Columns of the plane.
        columns: usize,
        /// Its contrasts.
        contrasts: &'a [f32],
    },
}

/// Pixels that are looked at together: one for each bit of a mask.
pub(crate) const BLOCK: usize = 16;

impl Light<'_> {
    /// Columns of the plane.
    pub(crate) fn columns(&self) -> usize {
        match self {
            Self::Codes { plane, .. } => plane.columns,
            Self::Field { columns, .. } => *columns,
        }
    }

    /// Rows of the plane.
    pub(crate) fn rows(&self) -> usize {
        match self {
            Self::Codes { plane, .. } => plane.rows,
            Self::Field { columns, contrasts } => contrasts.len() / columns,
        }
    }

    /// Reads as many contrasts of a row as `contrasts` holds, from column `first` on.
    pub(crate) fn read(&self, row: usize, first: usize, contrasts: &mut [f32]) {
        read_alone(self, row, first, contrasts);
    }

    /// The same for one who reads many rows, and has been made for the processor.
    #[inline(always)]
    pub(crate) fn read_another(&self, row: usize, first: usize, contrasts: &mut [f32]) {
        match self {
            Self::Codes { plane, level, polarity } => {
                let sign = polarity.sign() as f32;
                let added = -sign * level;
                let line = &plane.line(row)[first * plane.step_px..];
                read_every(line, plane.step_px, |code| sign * f32::from(code) + added, contrasts);
            }
            Self::Field { columns, contrasts: field } => {
                let start = row * columns + first;
                contrasts.copy_from_slice(&field[start..start + contrasts.len()]);
            }
        }
    }

    /// Brings pixels near that will be read soon.
    pub(crate) fn fetch(&self, rows: Range<usize>, columns: Range<usize>) {
        if let Self::Codes { plane, .. } = self {
            fetch(plane, rows, columns);
        }
    }

    /// Reads contrasts between pixels, bilinear: as many as `contrasts` holds, of a row from a column on. All of them lie
    /// on the plane.
    pub(crate) fn sample(&self, first: f64, row: f64, contrasts: &mut [f32], rows: &mut [Vec<f32>; 2]) {
        let (column, upper) = (first as usize, row as usize);
        let (across, down) = ((first - column as f64) as f32, (row - upper as f64) as f32);
        // One more than asked for, where there is one.
        let count = (contrasts.len() + 1).min(self.columns() - column);
        for (line, row) in rows.iter_mut().zip([upper, (upper + 1).min(self.rows() - 1)]) {
            line.resize(count, 0.0);
            self.read(row, column, line);
            line.resize(contrasts.len() + 1, line[count - 1]);
        }
        blend([&rows[0], &rows[1]], across, down, contrasts);
    }

    /// The contrast of one pixel.
    pub(crate) fn at(&self, column: usize, row: usize) -> f32 {
        match self {
            Self::Codes { plane, level, polarity } => {
                let away = f32::from(plane.code(column, row)) - level;
                if *polarity == Polarity::Bright { away } else { -away }
            }
            Self::Field { columns, contrasts } => contrasts[row * columns + column],
        }
    }

    /// A row seen against a limit, codes of contrast.
    pub(crate) fn against(&self, row: usize, limit: f32) -> RowAgainst<'_> {
        match self {
            Self::Codes { plane, level, polarity } => {
                // Dark features are bright in the complement of the codes.
                let (complement, limit) = match polarity {
                    Polarity::Bright => (0, level + limit),
                    Polarity::Dark => (u16::MAX, f32::from(u16::MAX) - level + limit),
                };
                let step = plane.step_px;
                RowAgainst::Codes { line: plane.line(row), step, complement, limit: limit.floor() as u16 }
            }
            Self::Field { columns, contrasts } => {
                RowAgainst::Field { line: &contrasts[row * columns..(row + 1) * columns], limit }
            }
        }
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn read_alone(light: &Light<'_>, row: usize, first: usize, contrasts: &mut [f32]) {
    light.read_another(row, first, contrasts);
}

/// Reads what is made of every `step`-th code, as many as there is place for.
#[inline(always)]
fn read_every(line: &[u16], step: usize, number: impl Fn(u16) -> f32, numbers: &mut [f32]) {
    match step {
        1 => numbers.iter_mut().zip(line).for_each(|(value, code)| *value = number(*code)),
        2 => {
            let (pairs, rest) = line.as_chunks::<2>();
            // A row of odd length ends in a pixel without a partner.
            if let ([code], Some(last)) = (rest, numbers.get_mut(pairs.len())) {
                *last = number(*code);
            }
            numbers.iter_mut().zip(pairs).for_each(|(value, pair)| *value = number(pair[0]));
        }
        _ => numbers.iter_mut().zip(line.iter().step_by(step)).for_each(|(value, code)| *value = number(*code)),
    }
}

/// Contrasts between those of two rows.
#[multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
fn blend([upper, lower]: [&[f32]; 2], across: f32, down: f32, contrasts: &mut [f32]) {
    let (next_upper, next_lower) = (&upper[1..], &lower[1..]);
    let corners = upper.iter().zip(next_upper).zip(lower.iter().zip(next_lower));
    for (value, ((a, b), (c, d))) in contrasts.iter_mut().zip(corners) {
        let (above, below) = (a + across * (b - a), c + across * (d - c));
        *value = above + down * (below - above);
    }
}

/// A row whose pixels are asked whether they are above a limit.
#[derive(Debug, Clone, Copy)]
pub(crate) enum RowAgainst<'a> {
    Codes { line: &'a [u16], step: usize, complement: u16, limit: u16 },
    Field { line: &'a [f32], limit: f32 },
}

impl RowAgainst<'_> {
    /// A mask for every block of the row, with a bit set for each pixel above the limit; beyond the row none is.
    pub(crate) fn masks(&self, masks: &mut Vec<u16>) {
        masks.clear();
        match *self {
            Self::Codes { line, step: 1, complement, limit } => masks_of_all(line, complement, limit, masks),
            Self::Codes { line, step: 2, complement, limit } => masks_of_every_other(line, complement, limit, masks),
            Self::Codes { line, step, complement, limit } => masks.extend(
                line.chunks(step * BLOCK)
                    .map(|block| mask(block.iter().step_by(step).map(|code| code ^ complement > limit))),
            ),
            Self::Field { line, limit } => masks_of_field(line, limit, masks),
        }
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn masks_of_all(line: &[u16], complement: u16, limit: u16, masks: &mut Vec<u16>) {
    let (blocks, rest) = line.as_chunks::<BLOCK>();
    masks.extend(blocks.iter().map(|block| mask(block.iter().map(|code| code ^ complement > limit))));
    masks.push(mask(rest.iter().map(|code| code ^ complement > limit)));
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn masks_of_every_other(line: &[u16], complement: u16, limit: u16, masks: &mut Vec<u16>) {
    let (blocks, rest) = line.as_chunks::<{ 2 * BLOCK }>();
    masks.extend(blocks.iter().map(|block| {
        let pairs = block.as_chunks::<2>().0;
        mask(pairs.iter().map(|pair| pair[0] ^ complement > limit))
    }));
    masks.push(mask(rest.iter().step_by(2).map(|code| code ^ complement > limit)));
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn masks_of_field(line: &[f32], limit: f32, masks: &mut Vec<u16>) {
    let (blocks, rest) = line.as_chunks::<BLOCK>();
    masks.extend(blocks.iter().map(|block| mask(block.iter().map(|value| *value > limit))));
    masks.push(mask(rest.iter().map(|value| *value > limit)));
}

/// One bit for each of up to 16 answers.
#[inline(always)]
fn mask(above: impl Iterator<Item = bool>) -> u16 {
    above.enumerate().fold(0, |mask, (k, above)| mask | if above { 1 << k } else { 0 })
}
