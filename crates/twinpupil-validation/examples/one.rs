use twinpupil_validation::limit::{Camera, Score, model_rig};
use twinpupil_validation::scenes::discs;
use twinpupil_simulate::{Scene, SceneSpec};
fn main() {
    let scene = discs(&[[1.98, -0.84, 300.0, 1.0]]);
    let scene = Scene::new(SceneSpec { brightness_e: 1.5*32700.0, ..scene.spec().clone() }).unwrap();
    let rig = model_rig(Camera::Rgb);
    let s = Score::of(&rig, &scene, 3);
    println!("{:?}", s.found);
}
