//! The contrast of a plane, read where it is asked for: features are positive whatever their polarity.

use multiversion::multiversion;
use twinpupil_instrument::PlaneView;

use crate::background::Polarity;

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

/// Pixels that are looked at together.
pub(crate) const BLOCK: usize = 16;

/// What a block holds: pixels above a limit, pixels not above it, or both.
pub(crate) const ABOVE: u8 = 1;
pub(crate) const BELOW: u8 = 2;

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
        match self {
            Self::Codes { plane, level, polarity } => {
                plane.read_span(row, first, contrasts);
                match polarity {
                    Polarity::Bright => contrasts.iter_mut().for_each(|value| *value -= level),
                    Polarity::Dark => contrasts.iter_mut().for_each(|value| *value = level - *value),
                }
            }
            Self::Field { columns, contrasts: field } => {
                let start = row * columns + first;
                contrasts.copy_from_slice(&field[start..start + contrasts.len()]);
            }
        }
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

/// A row whose pixels are asked whether they are above a limit.
#[derive(Debug, Clone, Copy)]
pub(crate) enum RowAgainst<'a> {
    Codes { line: &'a [u16], step: usize, complement: u16, limit: u16 },
    Field { line: &'a [f32], limit: f32 },
}

impl RowAgainst<'_> {
    /// Marks the whole blocks of the row; what is left at its end has no mark.
    pub(crate) fn mark(&self, marks: &mut Vec<u8>) {
        marks.clear();
        match *self {
            Self::Codes { line, step: 1, complement, limit } => mark_all(line, complement, limit, marks),
            Self::Codes { line, step: 2, complement, limit } => mark_every_other(line, complement, limit, marks),
            Self::Codes { .. } => {}
            Self::Field { line, limit } => mark_field(line, limit, marks),
        }
    }

    /// One bit for each of up to 16 pixels from a column on, set where the pixel is above the limit.
    pub(crate) fn bits(&self, first: usize, count: usize) -> u32 {
        match *self {
            Self::Codes { line, step, complement, limit } => {
                let pixels = line[first * step..].iter().step_by(step).take(count);
                pixels.enumerate().fold(0, |bits, (k, &code)| bits | u32::from(code ^ complement > limit) << k)
            }
            Self::Field { line, limit } => {
                let pixels = line[first..first + count].iter().enumerate();
                pixels.fold(0, |bits, (k, &value)| bits | u32::from(value > limit) << k)
            }
        }
    }
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn mark_all(line: &[u16], complement: u16, limit: u16, marks: &mut Vec<u8>) {
    let blocks = line.as_chunks::<BLOCK>().0;
    marks.extend(blocks.iter().map(|block| mark(block.iter().map(|code| code ^ complement), limit)));
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn mark_every_other(line: &[u16], complement: u16, limit: u16, marks: &mut Vec<u8>) {
    let blocks = line.as_chunks::<{ 2 * BLOCK }>().0;
    marks.extend(blocks.iter().map(|block| {
        let pairs = block.as_chunks::<2>().0;
        mark(pairs.iter().map(|pair| pair[0] ^ complement), limit)
    }));
}

/// The mark of a block: differences that saturate at zero tell on which sides of the limit its codes lie.
#[inline(always)]
fn mark(codes: impl Iterator<Item = u16>, limit: u16) -> u8 {
    let (above, below) = codes.fold((0, 0), |(above, below), code| {
        (above | code.saturating_sub(limit), below | limit.saturating_add(1).saturating_sub(code))
    });
    u8::from(above != 0) * ABOVE + u8::from(below != 0) * BELOW
}

#[multiversion(targets("x86_64+avx2", "x86_64+avx"))]
fn mark_field(line: &[f32], limit: f32, marks: &mut Vec<u8>) {
    let blocks = line.as_chunks::<BLOCK>().0;
    marks.extend(blocks.iter().map(|block| {
        let above = block.iter().fold(0_u32, |count, value| count + u32::from(*value > limit));
        match above {
            0 => BELOW,
            16 => ABOVE,
            _ => ABOVE + BELOW,
        }
    }));
}
