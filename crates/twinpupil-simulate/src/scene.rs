//! What lies before the camera: `scene.toml`, checked once, and the dots that follow from it.

use std::ops::Deref;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;
use twinpupil_instrument::check::{self, SyntaxError, ValueError, positive, within};

use crate::dot::{Dot, DotSpec};
use crate::illumination::Illumination;
use crate::packing::PackingError;
use crate::plate::{Pattern, Plate, Pose};
use crate::texture::{Picture, Texture};

/// The most dots that a scene may have.
pub const DOT_COUNT_MAX: usize = 200_000;

/// The most electrons that a scene may put into a pixel.
const ELECTRONS_MAX: f64 = 1e9;

/// The largest distance, mm, in any direction.
pub(crate) const LENGTH_MM_MAX: f64 = 1e5;

/// A scene file that is not legal.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SceneError {
    /// Not the TOML that was expected.
    #[error(transparent)]
    Syntax(#[from] SyntaxError),
    /// A value outside its range.
    #[error(transparent)]
    Value(#[from] ValueError),
    /// More random dots than the plate holds.
    #[error(transparent)]
    Packing(#[from] PackingError),
}

/// `scene.toml` as it is written; [`Scene`] is the same, checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneSpec {
    /// Version of this format: 1.
    pub schema: u32,
    /// What the user calls the scene.
    pub name: String,
    /// Seed of everything random: where random dots lie, and the sensor's noise unless told otherwise.
    #[serde(default)]
    pub seed: u64,
    /// Electrons that the ground puts into a pixel which sees the whole pupil.
    #[serde(default)]
    pub background_e: f64,
    /// Electrons that a feature puts into a pixel which sees the whole pupil; below `background_e` for dark features.
    #[serde(default = "default_brightness_e")]
    pub brightness_e: f64,
    /// Uneven light, which falls on features and ground alike; the electrons above are those on the axis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub illumination: Option<Illumination>,
    /// Dots that face the camera.
    #[serde(default, rename = "dot", skip_serializing_if = "Vec::is_empty")]
    pub dots: Vec<DotSpec>,
    /// A flat plate with a pattern on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate: Option<Plate>,
}

fn default_brightness_e() -> f64 {
    20_000.0
}

/// A checked scene; reads like its [`SceneSpec`].
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    spec: SceneSpec,
    dots: Vec<Dot>,
    texture: Option<Texture>,
}

impl Deref for Scene {
    type Target = SceneSpec;

    fn deref(&self) -> &SceneSpec {
        &self.spec
    }
}

impl Scene {
    /// Checks every value of `spec` and lays out its dots.
    pub fn new(spec: SceneSpec) -> Result<Self, SceneError> {
        check::schema(spec.schema)?;
        // TOML integers are signed, so a larger seed could not be printed back.
        if spec.seed > i64::MAX as u64 {
            return Err(ValueError::new("seed", spec.seed, format!("0 to {}", i64::MAX)).into());
        }
        within("background_e", spec.background_e, 0.0, ELECTRONS_MAX)?;
        within("brightness_e", spec.brightness_e, 0.0, ELECTRONS_MAX)?;
        if let Some(illumination) = &spec.illumination {
            illumination.check()?;
        }
        let count = spec.dots.len().saturating_add(spec.plate.as_ref().map_or(0, Plate::dot_count));
        if count > DOT_COUNT_MAX {
            return Err(ValueError::new("number of dots", count, format!("0 to {DOT_COUNT_MAX}")).into());
        }
        let mut dots = Vec::with_capacity(count);
        for (i, dot) in spec.dots.iter().enumerate() {
            dot.check(i)?;
            dots.push(dot.facing_camera());
        }
        if let Some(plate) = &spec.plate {
            plate.check()?;
            dots.extend(plate.dots(spec.seed)?);
        }
        Ok(Self { spec, dots, texture: None })
    }

    /// Reads and checks a scene file. The picture of an image plate is handed over by [`Scene::with_picture`].
    pub fn from_toml(text: &str) -> Result<Self, SceneError> {
        Self::new(check::parse_toml(text)?)
    }

    /// The scene as a file that [`Scene::from_toml`] reads back to the same.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.spec).expect("a checked scene is plain data")
    }

    /// JSON schema of the scene file.
    pub fn json_schema() -> schemars::Schema {
        schemars::schema_for!(SceneSpec)
    }

    /// What the user stated.
    pub fn spec(&self) -> &SceneSpec {
        &self.spec
    }

    /// The dots in the order of their ids: first those listed singly, then the plate's. Their centres are the truth.
    pub fn dots(&self) -> &[Dot] {
        &self.dots
    }

    /// Path of the picture that the plate carries, as the scene file states it.
    pub fn picture_path(&self) -> Option<&str> {
        match self.plate.as_ref().map(|plate| &plate.pattern) {
            Some(Pattern::Image(image)) => Some(&image.image),
            _ => None,
        }
    }

    /// The scene with the picture that its image plate carries; a scene without such a plate stays as it is.
    pub fn with_picture(mut self, picture: Picture) -> Result<Self, SceneError> {
        if let Some(Plate { pattern: Pattern::Image(image), .. }) = &self.spec.plate {
            let height_mm = image.width_mm * picture.height_px() as f64 / picture.width_px() as f64;
            positive("height of the plate's picture in mm", height_mm, LENGTH_MM_MAX)?;
            let pose = self.spec.plate.as_ref().map(Plate::pose).unwrap_or_default();
            let texture = Texture::new(picture, pose, [image.width_mm, height_mm]);
            positive("distance of the picture's nearest edge in mm", texture.nearest_mm(), LENGTH_MM_MAX)?;
            self.texture = Some(texture);
        }
        Ok(self)
    }

    /// The plane on which light falls where there is no dot: the plate's, or one that faces the camera in the middle of
    /// the dots' depths.
    pub(crate) fn ground(&self) -> Pose {
        let mean_mm = self.dots.iter().map(|dot| dot.centre_mm[2]).sum::<f64>() / self.dots.len().max(1) as f64;
        self.plate.as_ref().map_or(Pose { distance_mm: mean_mm, slope: [0.0; 2] }, Plate::pose)
    }

    /// The plate's picture, once it has been handed over.
    pub fn texture(&self) -> Option<&Texture> {
        self.texture.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANDOM: &str = "schema = 1\nname = \"a\"\nseed = 3\nbackground_e = 5.0\n\n[[dot]]\nx_mm = 1.0\ny_mm = -2.0\n\
        z_mm = 280.0\n\n[plate]\ndistance_mm = 300.0\ntilt_deg = 30.0\npattern = \"random-dots\"\ncount = 20\n\
        diameter_mm = 1.0\nr_min_mm = 2.0\nr_max_mm = 7.5\ngap_mm = 0.3\n";
    const GRID: &str = "schema = 1\nname = \"g\"\n[plate]\ndistance_mm = 250.0\ntilt_axis = \"x\"\npattern = \"grid\"\n\
        rows = 3\ncolumns = 4\npitch_mm = 2.0\ndiameter_mm = 1.0\n";
    const IMAGE: &str = "schema = 1\nname = \"i\"\n[plate]\ndistance_mm = 250.0\npattern = \"image\"\n\
        image = \"leaf.png\"\nwidth_mm = 12.0\n";

    fn message(text: &str, from: &str, to: &str) -> String {
        assert!(text.contains(from), "{from:?}");
        Scene::from_toml(&text.replacen(from, to, 1)).expect_err("must be refused").to_string()
    }

    #[test]
    fn printing_and_reading_is_the_identity() {
        for text in [RANDOM, GRID, IMAGE, "schema = 1\nname = \"nothing\"\n"] {
            let scene = Scene::from_toml(text).unwrap();
            let printed = scene.to_toml();
            assert_eq!(Scene::from_toml(&printed).expect("reads back"), scene, "{printed}");
        }
    }

    #[test]
    fn singly_listed_dots_come_first_and_face_the_camera() {
        let scene = Scene::from_toml(RANDOM).unwrap();
        assert_eq!(scene.dots().len(), 21);
        let first = Dot { centre_mm: [1.0, -2.0, 280.0], normal: [0.0, 0.0, -1.0], diameter_mm: 1.0 };
        assert_eq!(scene.dots()[0], first);
        assert_eq!(scene.brightness_e, 20_000.0);
    }

    #[test]
    fn bad_values_are_named_with_what_is_legal() {
        let cases = [
            (RANDOM, "schema = 1", "schema = 2", "`schema` is 2; legal: 1"),
            (RANDOM, "background_e = 5.0", "background_e = -1", "`background_e` is -1; legal: 0 to 1000000000"),
            (RANDOM, "background_e = 5.0", "background_e = nan", "`background_e` is NaN"),
            (RANDOM, "z_mm = 280.0", "z_mm = 0", "`dot[0].z_mm` is 0; legal: above 0"),
            (RANDOM, "x_mm = 1.0", "x_mm = inf", "`dot[0].x_mm` is inf"),
            (RANDOM, "tilt_deg = 30.0", "tilt_deg = 90", "`plate.tilt_deg` is 90; legal: -85 to 85"),
            (RANDOM, "r_max_mm = 7.5", "r_max_mm = 1.5", "`plate.r_max_mm` is 1.5; legal: 2 to"),
            (RANDOM, "gap_mm = 0.3", "gap_mm = -0.3", "`plate.gap_mm` is -0.3"),
            (
                RANDOM,
                "[plate]",
                "[illumination]\ngrowth_per_mm = [0, nan]\n[plate]",
                "`illumination.growth_per_mm[1]` is",
            ),
            (RANDOM, "diameter_mm = 1.0", "diameter_mm = 0", "`plate.diameter_mm` is 0"),
            (RANDOM, "count = 20", "count = 200000", "`number of dots` is 200001; legal: 0 to 200000"),
            (RANDOM, "r_max_mm = 7.5", "r_max_mm = 600", "must lie before the lens"),
            (GRID, "pitch_mm = 2.0", "pitch_mm = 0.5", "`plate.pitch_mm` is 0.5; legal: 1 to"),
            (GRID, "rows = 3", "rows = 0", "`plate.rows` is 0; legal: at least 1"),
            (GRID, "rows = 3", "rows = 4000000000", "`number of dots` is 16000000000"),
            (IMAGE, "width_mm = 12.0", "width_mm = -1", "`plate.width_mm` is -1"),
            (IMAGE, "leaf.png", "", "`plate.image` is empty"),
        ];
        for (text, from, to, expected) in cases {
            let message = message(text, from, to);
            assert!(message.contains(expected) && !message.contains('\n'), "{message:?} lacks {expected:?}");
        }
    }

    #[test]
    fn unknown_missing_and_ill_typed_keys_are_named() {
        let cases = [
            (RANDOM, "name = \"a\"\n", "", "missing field `name`"),
            (RANDOM, "name = \"a\"", "name = \"a\"\ncolour = 1", "unknown field `colour`"),
            (RANDOM, "z_mm = 280.0", "z_mm = 280.0\nr_mm = 1.0", "unknown field `r_mm`"),
            (RANDOM, "gap_mm = 0.3", "gap_mm = 0.3\nrows = 3", "unknown field `rows`"),
            (RANDOM, "gap_mm = 0.3\n", "", "missing field `gap_mm`"),
            (GRID, "pattern = \"grid\"", "pattern = \"hexagons\"", "unknown variant `hexagons`"),
            (GRID, "rows = 3", "rows = -3", "-3"),
            (IMAGE, "width_mm = 12.0", "width_mm = 12.0\ncount = 3", "unknown field `count`"),
            (IMAGE, "schema = 1", "schema =", "line 1"),
        ];
        for (text, from, to, expected) in cases {
            let message = message(text, from, to);
            assert!(message.contains(expected) && !message.contains('\n'), "{message:?} lacks {expected:?}");
        }
    }

    #[test]
    fn too_many_random_dots_say_how_many_fitted() {
        let message = message(RANDOM, "count = 20", "count = 150");
        assert!(message.starts_with("only ") && message.contains("of 150 random dots fitted"), "{message}");
    }

    #[test]
    fn the_published_schema_names_every_key() {
        let schema = Scene::json_schema().as_value().to_string();
        for key in ["brightness_e", "\"dot\"", "\"plate\"", "random-dots", "gap_mm", "tilt_axis", "pitch_mm", "image"] {
            assert!(schema.contains(key), "{key}");
        }
    }

    #[test]
    fn a_picture_belongs_to_an_image_plate() {
        let picture = || Picture::new(4, 2, vec![0.5; 8]).unwrap();
        let scene = Scene::from_toml(IMAGE).unwrap();
        assert_eq!(scene.picture_path(), Some("leaf.png"));
        assert!(scene.texture().is_none());
        assert_eq!(scene.with_picture(picture()).unwrap().texture().unwrap().size_mm(), [12.0, 6.0]);
        let grid = Scene::from_toml(GRID).unwrap().with_picture(picture()).unwrap();
        assert!(grid.texture().is_none() && grid.picture_path().is_none());
    }
}
