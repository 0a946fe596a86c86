//! A printout as a PDF of one page of its size, which asks the printer not to scale it.

use anyhow::{Result, bail};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str, TextStr};

use super::{Bar, Disc, Printout, Text};

/// Points to a millimetre.
const POINTS: f64 = 72.0 / 25.4;

/// Longest side of a page  [ISO 32000-1, Annex C].
const SIDE_POINTS_MAX: f64 = 14_400.0;

/// Length of a Bézier curve's handles over the radius of the quarter of a circle that it draws, to 0.02 % of the radius.
const HANDLE: f64 = 0.551_915;

const FONT: Name<'static> = Name(b"F");

/// The file.
pub(super) fn encode(printout: &Printout) -> Result<Vec<u8>> {
    let size_points = printout.size_mm.map(|side_mm| side_mm * POINTS);
    if let Some(side) = size_points.iter().find(|side| **side > SIDE_POINTS_MAX) {
        let (side_mm, most_mm) = (side / POINTS, SIDE_POINTS_MAX / POINTS);
        bail!("a sheet of {side_mm:.0} mm is too long for a page of PDF; legal: up to {most_mm:.0} mm, or SVG");
    }
    let [catalog, pages, page_id, content, font, info] = [1, 2, 3, 4, 5, 6].map(Ref::new);
    let mut pdf = Pdf::new();
    let mut root = pdf.catalog(catalog);
    root.pages(pages);
    root.viewer_preferences().pair(Name(b"PrintScaling"), Name(b"None"));
    root.finish();
    pdf.document_info(info).title(TextStr(&printout.name)).creator(TextStr("twinpupil"));
    pdf.pages(pages).kids([page_id]).count(1);
    let mut page = pdf.page(page_id);
    let [width, height] = size_points.map(|side| side as f32);
    page.parent(pages).media_box(Rect::new(0.0, 0.0, width, height)).contents(content);
    page.resources().fonts().pair(FONT, font);
    page.finish();
    pdf.type1_font(font).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
    pdf.stream(content, &drawing(printout));
    Ok(pdf.finish())
}

/// Everything that is drawn, in mm from the upper left corner.
fn drawing(printout: &Printout) -> Vec<u8> {
    let [width_mm, height_mm] = printout.size_mm;
    let [ink, ground] = printout.ink.greys().map(f32::from);
    let mut content = Content::new();
    let points = POINTS as f32;
    content.transform([points, 0.0, 0.0, -points, 0.0, (height_mm * POINTS) as f32]);
    content.set_fill_gray(ground);
    content.rect(0.0, 0.0, width_mm as f32, height_mm as f32).fill_nonzero();
    content.set_fill_gray(ink);
    for disc in &printout.discs {
        circle(&mut content, disc);
    }
    for Bar { corner_mm, size_mm } in &printout.bars {
        let ([x, y], [width, height]) = (corner_mm.map(|mm| mm as f32), size_mm.map(|mm| mm as f32));
        content.rect(x, y, width, height).fill_nonzero();
    }
    for Text { start_mm: [x, y], size_mm, content: text } in &printout.texts {
        content.begin_text().set_font(FONT, *size_mm as f32);
        content.set_text_matrix([1.0, 0.0, 0.0, -1.0, *x as f32, *y as f32]);
        content.show(Str(&win_ansi(text))).end_text();
    }
    content.finish().into_vec()
}

/// A disc as four curves.
fn circle(content: &mut Content, Disc { centre_mm: [x, y], radius_mm }: &Disc) {
    let at = |across: f64, down: f64| [(x + radius_mm * across) as f32, (y + radius_mm * down) as f32];
    let [start_x, start_y] = at(1.0, 0.0);
    content.move_to(start_x, start_y);
    let mut along = [1.0, 0.0];
    for _ in 0..4 {
        let [a, b] = along;
        // A quarter of a turn further.
        let [c, d] = [-b, a];
        let [x1, y1] = at(a + HANDLE * c, b + HANDLE * d);
        let [x2, y2] = at(c + HANDLE * a, d + HANDLE * b);
        let [x3, y3] = at(c, d);
        content.cubic_to(x1, y1, x2, y2, x3, y3);
        along = [c, d];
    }
    content.close_path().fill_nonzero();
}

/// Text in the encoding of the font; what that does not have is written with what it has, or as a question mark.
fn win_ansi(text: &str) -> Vec<u8> {
    text.chars().flat_map(encoded).collect()
}

fn encoded(letter: char) -> Vec<u8> {
    let has = |code: &u8| matches!(code, 0x20..=0x7e | 0xa0..);
    match letter {
        '≥' => b">=".into(),
        '≤' => b"<=".into(),
        '≈' => b"~".into(),
        '−' | '‐' => b"-".into(),
        'μ' => vec![0xb5],
        '€' => vec![0x80],
        '…' => vec![0x85],
        '‘' => vec![0x91],
        '’' | '′' => vec![0x92],
        '“' => vec![0x93],
        '”' | '″' => vec![0x94],
        '–' => vec![0x96],
        '—' => vec![0x97],
        _ => vec![u8::try_from(letter).ok().filter(has).unwrap_or(b'?')],
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::target;
    use super::super::{Format, Ink};
    use super::*;

    #[test]
    fn a_page_is_as_large_as_its_sheet_and_is_not_scaled() {
        let mut printout = Printout::new(&target("a"), Ink::DarkOnLight, Some(3.0));
        printout.size_mm = [25.4, 50.8];
        let pdf = String::from_utf8_lossy(&printout.encode(Format::Pdf).unwrap()).into_owned();
        assert!(pdf.starts_with("%PDF-1.") && pdf.contains("/MediaBox [0 0 72 144]"), "{pdf}");
        assert!(pdf.contains("/PrintScaling /None") && pdf.contains("(a)"), "{pdf}");
        printout.size_mm = [6000.0, 1.0];
        let error = printout.encode(Format::Pdf).unwrap_err().to_string();
        assert!(error.contains("6000 mm") && error.contains("up to 5080 mm"), "{error}");
    }

    #[test]
    fn circles_are_round() {
        let mut drawn = Content::new();
        circle(&mut drawn, &Disc { centre_mm: [10.0, 20.0], radius_mm: 2.0 });
        let text = String::from_utf8(drawn.finish().into_vec()).unwrap();
        let numbers = |line: &str| line.split(' ').filter_map(|word| word.parse().ok()).collect::<Vec<f64>>();
        let mut from = [12.0, 20.0];
        for curve in text.lines().filter(|line| line.ends_with(" c")) {
            let values = numbers(curve);
            let ends = [from, [values[0], values[1]], [values[2], values[3]], [values[4], values[5]]];
            for step in 0..=16 {
                let (t, s) = (f64::from(step) / 16.0, 1.0 - f64::from(step) / 16.0);
                let weights = [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t];
                let at = [0, 1].map(|axis| (0..4).map(|k| weights[k] * ends[k][axis]).sum::<f64>());
                let radius = (at[0] - 10.0).hypot(at[1] - 20.0);
                assert!((radius / 2.0 - 1.0).abs() < 2.0e-4, "{radius}");
            }
            from = ends[3];
        }
        assert!((from[0] - 12.0).hypot(from[1] - 20.0) < 1e-5 && text.matches(" c\n").count() == 4, "{text}");
    }

    #[test]
    fn what_the_font_lacks_is_written_otherwise_or_a_question_mark() {
        assert_eq!(win_ansi("4 × 3 ½ ∞ é"), b"4 \xd7 3 \xbd ? \xe9");
        assert_eq!(win_ansi("r ≥ −2 µm – “a”"), b"r >= -2 \xb5m \x96 \x93a\x94");
        let printout = Printout::new(&target("(a)"), Ink::LightOnDark, None);
        let text = String::from_utf8_lossy(&drawing(&printout)).into_owned();
        assert!(text.contains("\\(a\\)") || text.contains("((a))"), "{text}");
    }
}
