use super::*;

/// Discs (column, row, radius, height) with edges of three pixels on a field of 200 × 120.
fn field(discs: &[(f64, f64, f64, f64)]) -> Vec<f32> {
    (0..200 * 120)
        .map(|index| {
            let (column, row) = (f64::from(index % 200), f64::from(index / 200));
            let light = |(c, r, radius, height): &(f64, f64, f64, f64)| {
                height * (0.5 - ((column - c).hypot(row - r) - radius) / 6.0).clamp(0.0, 1.0)
            };
            discs.iter().map(light).sum::<f64>() as f32
        })
        .collect()
}

fn find(discs: &[(f64, f64, f64, f64)]) -> Vec<Blob> {
    find_on(1, discs)
}

fn find_on(step: usize, discs: &[(f64, f64, f64, f64)]) -> Vec<Blob> {
    let contrasts = field(discs);
    let mut blobs = Vec::new();
    Scout::default().find(&Light::Field { columns: 200, contrasts: &contrasts }, step, 7.5, &mut blobs);
    blobs.sort_by(|a, b| a.centre[0].total_cmp(&b.centre[0]));
    blobs
}

#[test]
fn a_disc_is_measured() {
    let blobs = find(&[(60.3, 50.8, 20.0, 100.0)]);
    let [blob] = blobs[..] else { panic!("{blobs:?}") };
    assert!((blob.centre[0] - 60.3).hypot(blob.centre[1] - 50.8) < 0.1, "{blob:?}");
    assert!((blob.pixels as f64 / 1256.6 - 1.0).abs() < 0.03, "{blob:?}");
    assert!((blob.area / 1256.6 - 1.0).abs() < 0.002, "{blob:?}");
    assert!((blob.height - 100.0).abs() < 1.0 && blob.alone && !blob.touches_edge, "{blob:?}");
    assert!((blob.edge - 3.0).abs() < 0.9, "{blob:?}");
}

#[test]
fn some_rows_tell_nearly_as_much() {
    for discs in [&[(60.3, 50.8, 20.0, 100.0)][..], &[(50.0, 50.0, 20.0, 100.0), (90.0, 52.0, 20.0, 100.0)]] {
        for step in [2, 3, 4] {
            for (all, some) in find_on(1, discs).iter().zip(&find_on(step, discs)) {
                let off = (all.centre[0] - some.centre[0]).hypot(all.centre[1] - some.centre[1]);
                assert!(off < 0.15 * step as f64, "{all:?} {some:?}");
                assert!((all.area / some.area - 1.0).abs() < 0.015, "{all:?} {some:?}");
                assert!((all.edge - some.edge).abs() < 0.6, "{all:?} {some:?}");
            }
            assert_eq!(find_on(step, discs).len(), discs.len());
        }
    }
}

#[test]
fn the_border_cuts_what_reaches_the_last_row_of_the_plane() {
    for step in 1..=6 {
        for (radius, is_cut) in [(21.0, false), (22.5, false), (23.9, false), (26.0, true)] {
            let blobs = find_on(step, &[(60.3, 94.8, radius, 100.0)]);
            let [blob] = blobs[..] else { panic!("{step}, {radius}: {blobs:?}") };
            assert_eq!(blob.touches_edge, is_cut, "{step}, {radius}: {blob:?}");
        }
    }
}

#[test]
fn discs_whose_skirts_meet_are_told_apart() {
    for gap in [-4.0, 0.0, 2.0, 5.0] {
        let blobs = find(&[(50.0, 50.0, 20.0, 100.0), (90.0 + gap, 52.0, 20.0, 100.0)]);
        let [a, b] = blobs[..] else { panic!("{gap}: {blobs:?}") };
        assert!((a.centre[0] - 50.0).abs() < 1.5 && (b.centre[0] - 90.0 - gap).abs() < 1.5, "{gap}: {blobs:?}");
    }
}

#[test]
fn a_faint_disc_beside_a_bright_one_is_found() {
    let blobs = find(&[(50.0, 50.0, 20.0, 100.0), (91.0, 50.0, 18.0, 35.0)]);
    let [_, faint] = blobs[..] else { panic!("{blobs:?}") };
    assert!((faint.centre[0] - 91.0).abs() < 1.5 && (faint.height - 35.0).abs() < 4.0, "{faint:?}");
}

#[test]
fn single_pixels_are_nothing() {
    let mut contrasts = field(&[(60.0, 50.0, 20.0, 100.0)]);
    contrasts[50 * 200 + 60] = 4000.0;
    contrasts[45 * 200 + 58] = -50.0;
    contrasts[20 * 200 + 150] = 4000.0;
    let mut blobs = Vec::new();
    Scout::default().find(&Light::Field { columns: 200, contrasts: &contrasts }, 1, 7.5, &mut blobs);
    let [blob] = blobs[..] else { panic!("{blobs:?}") };
    assert!((blob.height - 100.0).abs() < 1.0, "{blob:?}");
}

#[test]
fn edges_are_where_the_integral_says() {
    for share in [0.02, 0.1, 0.25, 0.35] {
        let t = blurred_edge(share);
        let light = 0.5 - (t * (1.0 - t * t).sqrt() + t.asin()) / std::f64::consts::PI;
        assert!((light - share).abs() < 2e-3, "{share}: {light}");
    }
}
