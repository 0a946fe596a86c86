//! Frames as the camera delivers them, and the planes that lie in them.

use thiserror::Error;

use crate::{Mosaic, Site};

/// Raw codes of one exposure: one page for a mosaic, three for RGB, one a band for a monochrome sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    width_px: usize,
    height_px: usize,
    code_max: u16,
    pages: Vec<Vec<u16>>,
}

/// Why pages of codes are not a frame, or a frame lacks a plane.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum FrameError {
    /// No pages or no pixels.
    #[error("the frame has no pixels")]
    Empty,
    /// A page with the wrong number of pixels.
    #[error("page {page} has {found} pixels where {width_px} × {height_px} were expected")]
    WrongLength {
        /// Index of the page.
        page: usize,
        /// Its number of pixels.
        found: usize,
        /// Expected columns.
        width_px: usize,
        /// Expected rows.
        height_px: usize,
    },
    /// A code above the largest one.
    #[error("a pixel reads {code}, above the sensor's largest code {code_max}")]
    AboveCodeMax {
        /// The code that was read.
        code: u16,
        /// The largest legal code.
        code_max: u16,
    },
    /// A plane that the frame does not carry.
    #[error("a {mosaic} frame of {pages} page(s) has no plane `{plane}`")]
    NoPlane {
        /// The plane that was asked for.
        plane: String,
        /// The mosaic by which it was asked.
        mosaic: &'static str,
        /// Pages of the frame.
        pages: usize,
    },
    /// A page that the frame does not have.
    #[error("page {page} is asked for, but the frame has {pages} page(s)")]
    NoPage {
        /// Index of the page.
        page: usize,
        /// Pages of the frame.
        pages: usize,
    },
    /// Too few columns or rows to hold the plane.
    #[error("a frame of {width_px} × {height_px} pixels is too small for a plane")]
    TooSmall {
        /// Columns.
        width_px: usize,
        /// Rows.
        height_px: usize,
    },
}

impl Frame {
    /// A frame of `pages`, each row by row; no code may exceed `code_max`.
    pub fn new(width_px: usize, height_px: usize, code_max: u16, pages: Vec<Vec<u16>>) -> Result<Self, FrameError> {
        let pixels = width_px.checked_mul(height_px).unwrap_or(0);
        if pixels == 0 || pages.is_empty() {
            return Err(FrameError::Empty);
        }
        for (page, codes) in pages.iter().enumerate() {
            if codes.len() != pixels {
                return Err(FrameError::WrongLength { page, found: codes.len(), width_px, height_px });
            }
            let code = codes.iter().copied().max().unwrap_or(0);
            if code > code_max {
                return Err(FrameError::AboveCodeMax { code, code_max });
            }
        }
        Ok(Self { width_px, height_px, code_max, pages })
    }

    /// Columns.
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Rows.
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// The largest code; a pixel that reads it is saturated.
    pub fn code_max(&self) -> u16 {
        self.code_max
    }

    /// The pages, each row by row.
    pub fn pages(&self) -> &[Vec<u16>] {
        &self.pages
    }

    /// The pixels of one plane, on their own sub-lattice and never interpolated.
    pub fn plane(&self, mosaic: Mosaic, plane: &str) -> Result<PlaneView<'_>, FrameError> {
        let missing =
            || FrameError::NoPlane { plane: plane.to_owned(), mosaic: mosaic.name(), pages: self.pages.len() };
        let site = mosaic.site(plane).filter(|site| site.page < self.pages.len()).ok_or_else(missing)?;
        self.view(site)
    }

    /// The pixels at a site, never interpolated.
    pub fn view(&self, site: Site) -> Result<PlaneView<'_>, FrameError> {
        FrameView::from(self).plane(site)
    }
}

/// Codes of one exposure that lie somewhere else.
#[derive(Debug, Clone, Copy)]
pub struct FrameView<'a> {
    width_px: usize,
    height_px: usize,
    code_max: u16,
    pages: Pages<'a>,
}

#[derive(Debug, Clone, Copy)]
enum Pages<'a> {
    Apart(&'a [Vec<u16>]),
    InOne(&'a [u16]),
}

impl<'a> From<&'a Frame> for FrameView<'a> {
    fn from(frame: &'a Frame) -> Self {
        let Frame { width_px, height_px, code_max, pages } = frame;
        Self { width_px: *width_px, height_px: *height_px, code_max: *code_max, pages: Pages::Apart(pages) }
    }
}

impl<'a> FrameView<'a> {
    /// Codes as they lie in a camera's buffer: one page after the other, each row by row. Codes above `code_max` count as
    /// saturated.
    pub fn of_codes(width_px: usize, height_px: usize, code_max: u16, codes: &'a [u16]) -> Result<Self, FrameError> {
        let pixels = width_px.checked_mul(height_px).unwrap_or(0);
        if pixels == 0 || codes.is_empty() {
            return Err(FrameError::Empty);
        }
        let page = codes.len() / pixels;
        match codes.len() % pixels {
            0 => Ok(Self { width_px, height_px, code_max, pages: Pages::InOne(codes) }),
            found => Err(FrameError::WrongLength { page, found, width_px, height_px }),
        }
    }

    /// Columns.
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Rows.
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// The largest code; a pixel that reads it is saturated.
    pub fn code_max(&self) -> u16 {
        self.code_max
    }

    /// The pages, each row by row.
    pub fn pages(&self) -> impl Iterator<Item = &'a [u16]> + use<'a> {
        let Self { pages, .. } = *self;
        let pixels = self.width_px * self.height_px;
        (0..self.page_count()).filter_map(move |index| page(pages, index, pixels))
    }

    fn page_count(&self) -> usize {
        match self.pages {
            Pages::Apart(pages) => pages.len(),
            Pages::InOne(codes) => codes.len() / (self.width_px * self.height_px),
        }
    }

    /// The pixels at a site, never interpolated.
    pub fn plane(&self, site: Site) -> Result<PlaneView<'a>, FrameError> {
        let missing = || FrameError::NoPage { page: site.page, pages: self.page_count() };
        let codes = page(self.pages, site.page, self.width_px * self.height_px).ok_or_else(missing)?;
        let [column, row] = site.origin_px;
        if self.width_px <= column || self.height_px <= row {
            return Err(FrameError::TooSmall { width_px: self.width_px, height_px: self.height_px });
        }
        Ok(PlaneView {
            codes,
            frame_width_px: self.width_px,
            origin_px: site.origin_px,
            step_px: site.step_px,
            columns: (self.width_px - column).div_ceil(site.step_px),
            rows: (self.height_px - row).div_ceil(site.step_px),
            code_max: self.code_max,
        })
    }
}

fn page<'a>(pages: Pages<'a>, page: usize, pixels: usize) -> Option<&'a [u16]> {
    match pages {
        Pages::Apart(pages) => pages.get(page).map(Vec::as_slice),
        Pages::InOne(codes) => codes.chunks_exact(pixels).nth(page),
    }
}

/// One plane of a frame: every `step_px`-th pixel of a page from `origin_px` on.
#[derive(Debug, Clone, Copy)]
pub struct PlaneView<'a> {
    codes: &'a [u16],
    frame_width_px: usize,
    /// Frame column and row of the plane's first pixel.
    pub origin_px: [usize; 2],
    /// Frame pixels from one pixel of the plane to the next.
    pub step_px: usize,
    /// Columns of the plane.
    pub columns: usize,
    /// Rows of the plane.
    pub rows: usize,
    /// The largest code.
    pub code_max: u16,
}

impl<'a> PlaneView<'a> {
    /// The codes of one row of the plane, from left to right.
    pub fn row(&self, row: usize) -> impl ExactSizeIterator<Item = u16> + use<'a> {
        self.line(row).chunks(self.step_px).map(|pixels| pixels[0])
    }

    /// Reads the codes of one row of the plane into `codes`.
    pub fn read_row(&self, row: usize, codes: &mut [f32]) {
        self.read_span(row, 0, codes);
    }

    /// Reads as many codes of one row of the plane as `codes` holds, from column `first` on, in loops that vectorise.
    #[inline]
    pub fn read_span(&self, row: usize, first: usize, codes: &mut [f32]) {
        let line = &self.line(row)[first * self.step_px..];
        match self.step_px {
            1 => codes.iter_mut().zip(line).for_each(|(value, code)| *value = f32::from(*code)),
            2 => {
                let (pairs, rest) = line.as_chunks::<2>();
                // A row of odd length ends in a pixel without a partner.
                if let ([code], Some(last)) = (rest, codes.get_mut(pairs.len())) {
                    *last = f32::from(*code);
                }
                codes.iter_mut().zip(pairs).for_each(|(value, pair)| *value = f32::from(pair[0]));
            }
            step => codes.iter_mut().zip(line.iter().step_by(step)).for_each(|(value, code)| *value = f32::from(*code)),
        }
    }

    /// The codes of the page from the first pixel of one row of the plane to the end of that row of the page: every
    /// `step_px`-th is the plane's.
    #[inline]
    pub fn line(&self, row: usize) -> &'a [u16] {
        let start = (self.origin_px[1] + row * self.step_px) * self.frame_width_px;
        &self.codes[start + self.origin_px[0]..start + self.frame_width_px]
    }

    /// The code of one pixel of the plane, which must lie within it.
    #[inline]
    pub fn code(&self, column: usize, row: usize) -> u16 {
        let [u, v] = self.origin_px;
        self.codes[(v + row * self.step_px) * self.frame_width_px + u + column * self.step_px]
    }

    /// Frame column of a column of the plane, which may lie between pixels.
    #[inline]
    pub fn frame_u_px(&self, column: f64) -> f64 {
        self.origin_px[0] as f64 + column * self.step_px as f64
    }

    /// Frame row of a row of the plane, which may lie between pixels.
    #[inline]
    pub fn frame_v_px(&self, row: f64) -> f64 {
        self.origin_px[1] as f64 + row * self.step_px as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counting(width_px: usize, height_px: usize) -> Frame {
        let codes = (0..(width_px * height_px) as u16).collect();
        Frame::new(width_px, height_px, u16::MAX, vec![codes]).expect("a legal frame")
    }

    #[test]
    fn a_bayer_plane_is_every_other_pixel() {
        let frame = counting(5, 3);
        let blue = frame.plane(Mosaic::Rggb, "b").expect("rggb has b");
        assert_eq!((blue.columns, blue.rows), (2, 1));
        assert_eq!(blue.row(0).collect::<Vec<_>>(), [6, 8]);
        let red = frame.plane(Mosaic::Rggb, "r").expect("rggb has r");
        assert_eq!((red.columns, red.rows), (3, 2));
        assert_eq!(red.row(1).collect::<Vec<_>>(), [10, 12, 14]);
        let mut codes = [0.0; 3];
        red.read_row(1, &mut codes);
        assert_eq!(codes, [10.0, 12.0, 14.0]);
        blue.read_row(0, &mut codes[..2]);
        assert_eq!(codes, [6.0, 8.0, 14.0]);
        red.read_span(0, 1, &mut codes[..2]);
        assert_eq!(codes, [2.0, 4.0, 14.0]);
        assert_eq!(blue.line(0), [6, 7, 8, 9]);
        assert_eq!((red.frame_u_px(1.5), blue.frame_v_px(0.25)), (3.0, 1.5));
    }

    #[test]
    fn impossible_frames_are_errors() {
        assert_eq!(Frame::new(0, 3, 255, vec![vec![]]), Err(FrameError::Empty));
        assert_eq!(Frame::new(1, 1, 255, vec![]), Err(FrameError::Empty));
        assert!(matches!(Frame::new(2, 2, 255, vec![vec![0; 3]]), Err(FrameError::WrongLength { found: 3, .. })));
        let above = Frame::new(1, 1, 255, vec![vec![256]]);
        assert_eq!(above, Err(FrameError::AboveCodeMax { code: 256, code_max: 255 }));
        assert!(matches!(counting(2, 2).plane(Mosaic::Rgb, "b"), Err(FrameError::NoPlane { .. })));
        assert!(matches!(counting(1, 1).plane(Mosaic::Rggb, "b"), Err(FrameError::TooSmall { .. })));
    }
}
