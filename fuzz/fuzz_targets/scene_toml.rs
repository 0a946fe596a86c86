//! A text is refused, or it is a scene of finite dots that prints and reads back to the same.

#![no_main]

use libfuzzer_sys::fuzz_target;
use twinpupil_simulate::Scene;

fuzz_target!(|text: &str| {
    let Ok(scene) = Scene::from_toml(text) else { return };
    for dot in scene.dots() {
        assert!(dot.centre_mm.iter().chain(&dot.normal).all(|value| value.is_finite()), "{dot:?}");
        assert!(dot.centre_mm[2] > 0.0, "{dot:?}");
    }
    let printed = scene.to_toml();
    assert_eq!(Scene::from_toml(&printed).expect("reads back"), scene, "{printed}");
});
