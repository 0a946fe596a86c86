//! Frames that are not what they should be: an empty result or an error, never a panic, a NaN or a hang.

use proptest::prelude::*;
use twinpupil_instrument::{Frame, Instrument, paper};
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, ReconstructError, Reconstruction, Reconstructor, RejectionReason};
use twinpupil_simulate::{DotSpec, Scene, SceneSpec};
use twinpupil_validation::rig::{Rig, dots};

/// The paper's camera with a small sensor.
fn small(width_px: usize, height_px: usize) -> Instrument {
    let text = paper::INSTRUMENT_TOML
        .replace("[1920, 1200]", &format!("[{width_px}, {height_px}]"))
        .replace("[959.5, 599.5]", &format!("[{}, {}]", 0.5 * width_px as f64, 0.5 * height_px as f64));
    Instrument::from_toml(&text).expect("legal")
}

fn read(instrument: &Instrument, codes: Vec<u16>, mode: Mode) -> Reconstruction {
    let [width_px, height_px] = instrument.sensor.size_px;
    let frame = Frame::new(width_px, height_px, instrument.sensor.code_max(), vec![codes]).expect("a frame");
    let table = response_table_for(instrument).expect("traceable");
    let options = Options { mode, ..Options::default() };
    Reconstructor::new(instrument.clone(), Some(table), options).reconstruct(&frame).expect("the right size")
}

#[test]
fn constant_frames_hold_nothing() {
    let instrument = small(320, 200);
    for code in [0, 1, 2048, 4095] {
        let result = read(&instrument, vec![code; 320 * 200], Mode::Centroid);
        // A real ground would be shaded about the axis, so an even one may look like features; never like points.
        assert!(result.points.is_empty(), "{code}: {result:?}");
    }
}

#[test]
fn a_frame_of_another_size_is_refused() {
    let reconstructor = Reconstructor::new(paper::instrument(), None, Options::default());
    let frame = Frame::new(4, 4, 4095, vec![vec![0; 16]]).expect("a frame");
    assert!(matches!(reconstructor.reconstruct(&frame), Err(ReconstructError::Size { found_px: [4, 4], .. })));
}

#[test]
fn saturated_dots_are_rejected_as_such() {
    let rig = Rig::new(paper::instrument(), Mode::Centroid);
    let scene = Scene::new(SceneSpec { brightness_e: 80_000.0, ..dots(&[[5.0, 1.0, 300.0]]).spec().clone() });
    let frame = rig.frame(&scene.expect("legal"), Some(1));
    let reconstructor = Reconstructor::new(paper::instrument(), None, Options::default());
    let result = reconstructor.reconstruct(&frame).expect("a frame of this camera");
    assert!(result.points.is_empty());
    assert_eq!(result.rejected.len(), 2);
    assert!(result.rejected.iter().all(|rejected| rejected.reason == RejectionReason::Saturated));
}

#[test]
fn twenty_thousand_dots_are_all_accounted_for() {
    let rig = Rig::new(paper::instrument(), Mode::Centroid);
    let place = |k: usize| ((k % 170) as f64 - 84.5, (k / 170) as f64 - 58.5);
    let dot = |k: usize| {
        let (i, j) = place(k);
        DotSpec { x_mm: 0.115 * i, y_mm: 0.115 * j, z_mm: 297.0, diameter_mm: 0.05 }
    };
    let spec = SceneSpec { dots: (0..20_000).map(dot).collect(), ..dots(&[]).spec().clone() };
    let frame = rig.frame(&Scene::new(spec).expect("legal"), Some(3));
    // On a lattice of every other pixel most of these are too small to be used, but none is lost.
    let result =
        Reconstructor::new(rig.instrument.clone(), None, Options::default()).reconstruct(&frame).expect("a frame");
    for band in ["red", "blue"] {
        let rejected = result.rejected.iter().filter(|rejected| rejected.band == band).count();
        let found = result.points.len() + rejected;
        assert!((19_500..=20_500).contains(&found), "{band}: {found}");
    }
    assert!(result.points.iter().all(|point| point.position_mm.iter().all(|c| c.is_finite())));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Noise, blocks and stripes of any size and level.
    #[test]
    fn any_codes_give_finite_points(
        width_px in 2_usize..90, height_px in 2_usize..90, seed in any::<u64>(), level in 0_u16..4096,
        block in 1_usize..40, paper_mode in any::<bool>(),
    ) {
        let instrument = small(width_px, height_px);
        let mut state = seed;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as u16
        };
        let blocks: Vec<u16> = (0..10_000).map(|_| random() % 4096).collect();
        let codes = (0..width_px * height_px)
            .map(|index| {
                let (column, row) = (index % width_px, index / width_px);
                match (column / block + row / block) % 3 {
                    0 => level,
                    1 => blocks[(column / block * 97 + row / block) % blocks.len()],
                    _ => random() % 4096,
                }
            })
            .collect();
        let mode = if paper_mode { Mode::Paper } else { Mode::Centroid };
        let result = read(&instrument, codes, mode);
        for point in &result.points {
            prop_assert!(point.position_mm.iter().chain(&point.std_mm).all(|value| value.is_finite()));
        }
    }
}
