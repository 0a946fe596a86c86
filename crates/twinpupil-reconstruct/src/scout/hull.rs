//! How much of its convex hull a piece fills.

use crate::scout::run::Run;

/// A hull; its buffers are used again from piece to piece.
#[derive(Debug, Clone, Default)]
pub(crate) struct Hull {
    left: Vec<[i32; 2]>,
    right: Vec<[i32; 2]>,
}

impl Hull {
    /// Share of the pixels within the convex hull of a piece's pixels that are the piece's.
    ///
    /// A polygon between pixel centres holds `area + rim/2 + 1` of them, with `rim` centres on its rim (Pick). Two discs
    /// that touch fill 88 % of their hull, two that overlap by a third of their diameter 96 %.
    pub(crate) fn filled_share(&mut self, runs: &[Run]) -> f64 {
        self.left.clear();
        self.right.clear();
        let mut pixels = 0;
        for row in runs.chunk_by(|a, b| a.row == b.row) {
            let [(Some(first), Some(last))] = [(row.first(), row.last())] else { continue };
            let v = first.row as i32;
            add(&mut self.left, [first.first as i32, v], 1);
            add(&mut self.right, [last.end as i32 - 1, v], -1);
            pixels += row.iter().map(Run::pixels).sum::<u32>();
        }
        let outline = self.left.iter().chain(self.right.iter().rev());
        let (mut twice_area, mut rim) = (0, 0);
        for (a, b) in outline.clone().zip(outline.clone().skip(1).chain(self.left.first())) {
            twice_area += i64::from(a[0]) * i64::from(b[1]) - i64::from(a[1]) * i64::from(b[0]);
            rim += common_divisor((b[0] - a[0]).unsigned_abs(), (b[1] - a[1]).unsigned_abs());
        }
        f64::from(pixels) / (0.5 * (twice_area.abs() as f64 + f64::from(rim)) + 1.0)
    }
}

/// Adds the next lower point to one side of a hull, which bulges to the left for `side` 1 and to the right for −1.
fn add(chain: &mut Vec<[i32; 2]>, point: [i32; 2], side: i32) {
    while let [.., a, b] = chain[..] {
        let turn = (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]);
        if side * turn < 0 {
            break;
        }
        chain.pop();
    }
    chain.push(point);
}

fn common_divisor(mut a: u32, mut b: u32) -> u32 {
    if a == 1 || b == 1 {
        return 1;
    }
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs of the pixels inside a shape, one a row and gap.
    fn runs(inside: impl Fn(f64, f64) -> bool) -> Vec<Run> {
        let mut runs = Vec::new();
        for row in 0..100 {
            let mut open = None;
            for column in 0..=120 {
                match (inside(f64::from(column), f64::from(row)) && column < 120, open) {
                    (true, None) => open = Some(column),
                    (false, Some(first)) => {
                        runs.push(Run { row, first, end: column, at: 0, peak: 1.0 });
                        open = None;
                    }
                    _ => {}
                }
            }
        }
        runs
    }

    fn share(inside: impl Fn(f64, f64) -> bool) -> f64 {
        Hull::default().filled_share(&runs(inside))
    }

    #[test]
    fn convex_shapes_fill_their_hull() {
        for radius in [0.5, 2.2, 7.9, 21.3] {
            assert_eq!(share(|u, v| (u - 40.3).hypot(v - 45.7) <= radius), 1.0, "{radius}");
        }
        assert_eq!(share(|u, v| ((u - 50.0) / 30.0).hypot((v - 40.0) / 11.0) <= 1.0), 1.0);
        assert_eq!(share(|u, v| v == 7.0 && u < 9.0), 1.0);
        assert_eq!(share(|u, v| (u - 40.0).hypot(v - 40.0) <= 15.0 && u + v > 71.5), 1.0);
    }

    #[test]
    fn discs_that_touch_or_overlap_do_not() {
        let pair = |distance: f64| {
            share(move |u, v| (u - 40.0).hypot(v - 40.0) <= 20.0 || (u - 40.0 - distance).hypot(v - 40.0) <= 20.0)
        };
        // Union over hull of two discs: (2 π a² − lens) / (π a² + 2 a d).
        let expected = |distance: f64| {
            let (a, d) = (20.0_f64, distance);
            let lens = 2.0 * a * a * (d / (2.0 * a)).acos() - 0.5 * d * (4.0 * a * a - d * d).sqrt();
            (2.0 * std::f64::consts::PI * a * a - lens) / (std::f64::consts::PI * a * a + 2.0 * a * d)
        };
        for distance in [27.0, 33.0, 40.0] {
            let (found, expected) = (pair(distance), expected(distance));
            assert!((found - expected).abs() < 0.015, "{distance}: {found} {expected}");
        }
    }
}
