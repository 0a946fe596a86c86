//! Lenses from `.zmx` files. The files here are written for these tests; numbers of lenses name their source.

use proptest::prelude::*;
use twinpupil_optics::{Beam, Fate, FieldPoint, Ray, Train, ZmxLens};

/// Optiland's Cooke triplet (see `tests/lenses/cooke-triplet.toml`), as OpticStudio would write it.
const COOKE: &str = "VERS 140124 258 36214
MODE SEQ
NAME Cooke triplet
UNIT MM X W X CM MR CPMM
ENPD 10
GCAT HIKARI SCHOTT
FTYP 0 0 3 3 0 0 0
XFLN 0 0 0 0 0 0 0 0 0 0 0 0
YFLN 0 14 20 0 0 0 0 0 0 0 0 0
WAVM 1 0.48 1
WAVM 2 0.55 1
WAVM 3 0.65 1
WAVM 4 0.99 1
PWAV 2
SURF 0
  TYPE STANDARD
  CURV 0.0 0 0 0 0 \"\"
  DISZ INFINITY
SURF 1
  TYPE STANDARD
  CURV 0.045426484276304 0 0 0 0 \"\"
  DISZ 3.25896
  GLAS SK16 0 0 1.5 40 0 0 0 0 0 0
  DIAM 9.5 1 0 0 1 \"\"
SURF 2
  CURV -0.002294838879821 0 0 0 0 \"\"
  DISZ 6.00755
SURF 3
  CURV -0.045018115289593 0 0 0 0 \"\"
  DISZ 0.99997
  GLAS F2 0 0 1.5 40 0 0 0 0 0 0
SURF 4
  STOP
  CURV 0.049280698918584 0 0 0 0 \"\"
  DISZ 4.75041
SURF 5
  CURV 0.012549633801686 0 0 0 0 \"\"
  DISZ 2.95208
  GLAS SK16 0 0 1.5 40 0 0 0 0 0 0
SURF 6
  CURV -0.054361623303306 0 0 0 0 \"\"
  DISZ 42.20778
SURF 7
  TYPE STANDARD
  CURV 0.0 0 0 0 0 \"\"
  DISZ 0
";

fn read(text: &str) -> ZmxLens {
    ZmxLens::read(text.as_bytes()).expect("a file")
}

fn train(lens: &ZmxLens) -> Train {
    Train::new(&lens.prescription, &[], lens.wavelengths_nm[0]).expect("glasses that ship")
}

#[test]
fn a_cooke_triplet_reads_in_every_encoding() {
    let lens = read(COOKE);
    assert_eq!((lens.prescription.name.as_str(), lens.prescription.stop()), ("Cooke triplet", Some(3)));
    for (found_nm, expected_nm) in lens.wavelengths_nm.iter().zip([550.0, 480.0, 650.0]) {
        assert!((found_nm - expected_nm).abs() < 1e-9);
    }
    assert_eq!(lens.wavelengths_nm.len(), 3);
    assert_eq!(lens.beam, Some(Beam::EntrancePupil { diameter_mm: 10.0 }));
    assert_eq!(lens.fields, [0.0, 14.0, 20.0].map(|deg| FieldPoint::Angle([0.0, deg])));
    assert_eq!(lens.catalogues, ["HIKARI", "SCHOTT"]);
    assert_eq!(lens.prescription.surfaces[0].semi_diameter_mm, Some(9.5));
    // As in `published.rs`; the curvatures here have 15 decimals.
    let focal_length_mm = train(&lens).first_order(Some(3)).focal_length_mm;
    assert!((focal_length_mm - 49.99978307143194).abs() < 1e-9, "{focal_length_mm}");
    let wide: Vec<u8> = "\u{feff}".chars().chain(COOKE.chars()).flat_map(|c| (c as u16).to_le_bytes()).collect();
    assert_eq!(ZmxLens::read(&wide).as_ref(), Ok(&lens));
    assert_eq!(ZmxLens::read(COOKE.replace('\n', "\r\n").as_bytes()).as_ref(), Ok(&lens));
}

#[test]
fn rays_aimed_at_the_paraxial_stop_are_told_from_those_at_the_real_one() {
    let asked = |raim: &str| read(&COOKE.replace("UNIT MM", &format!("RAIM {raim}\nUNIT MM"))).has_paraxial_stop;
    assert_eq!(
        ["0 0 1 1 0 0 0 0 0 1", "0 1 1 1 0 0 0 0 0 1", "0 2 1 1 0 1 0 0 0", "0"].map(asked),
        [false, true, false, false]
    );
    assert!(!read(COOKE).has_paraxial_stop);
}

#[test]
fn a_lens_in_inches_is_as_long_in_mm() {
    let inches = read(&COOKE.replace("UNIT MM", "UNIT IN"));
    let (mm, inches) = (train(&read(COOKE)).first_order(Some(3)), train(&inches).first_order(Some(3)));
    assert!((inches.focal_length_mm - 25.4 * mm.focal_length_mm).abs() < 1e-9);
}

#[test]
fn beams_wavelengths_and_fields_that_mean_nothing_are_refused_with_the_line() {
    let said = |from: &str, to: &str| {
        assert!(COOKE.contains(from), "{from}");
        ZmxLens::read(COOKE.replace(from, to).as_bytes()).unwrap_err().to_string()
    };
    assert_eq!(said("ENPD 10", "ENPD 0"), "line 5: value 1 of ENPD is 0; legal: above 0");
    assert_eq!(said("ENPD 10", "FNUM -4"), "line 5: value 1 of FNUM is -4; legal: above 0");
    assert_eq!(said("ENPD 10", "OBNA 1 0"), "line 5: value 1 of OBNA is 1; legal: above 0 and below 1");
    assert_eq!(said("ENPD 10", "OBNA 90 1"), "line 5: value 1 of OBNA is 90; legal: above 0 and below 90, degrees");
    assert_eq!(
        said("YFLN 0 14 20", "YFLN 0 14 90"),
        "line 9: value 3 of YFLN is 90; legal: above -90 and below 90, degrees"
    );
    assert_eq!(
        said("XFLN 0 0", "XFLN 0 -95"),
        "line 8: value 2 of XFLN is -95; legal: above -90 and below 90, degrees"
    );
    assert_eq!(said("WAVM 2 0.55", "WAVM 2 0"), "line 11: wavelength 2 is 0 µm; legal: 0.001 to 1000");
    assert_eq!(
        said("WAVM 2 0.55", "WAVM 0 0.55"),
        "line 11: value 1 of WAVM is 0; legal: a whole number from 1 to 1000"
    );
    assert_eq!(said("PWAV 2", "PWAV 4"), "line 14: PWAV is 4; legal: the number of one of the 3 wavelengths");
    let infinite = said("FTYP 0", "FTYP 1");
    assert!(
        infinite.starts_with("line 7: value 1 of FTYP is 1, heights of the object, which is infinitely far"),
        "{infinite}"
    );
    assert_eq!(said("FTYP 0", "FTYP 4"), "line 7: value 1 of FTYP is 4; legal: a whole number up to 3");
    assert!(said("FTYP 0 0", "FTYP 0 1").starts_with("line 7: value 2 of FTYP"));
    // What does not count may be anything.
    read(&COOKE.replace("WAVM 4 0.99", "WAVM 4 0").replace("YFLN 0 14 20 0", "YFLN 0 14 20 95"));
    let near = COOKE.replace("FTYP 0", "FTYP 1").replace("DISZ INFINITY", "DISZ 100");
    assert_eq!(read(&near).fields[2], FieldPoint::Object([0.0, 20.0]));
}

#[test]
fn beams_are_read_by_their_kind() {
    let beam = |stated: &str| read(&COOKE.replace("ENPD 10", stated)).beam;
    assert_eq!(beam("FNUM 4 0"), Some(Beam::FNumber { f_number: 4.0 }));
    assert_eq!(beam("FNUM 4 1"), Some(Beam::WorkingFNumber { f_number: 4.0 }));
    assert_eq!(beam("OBNA 0.1 0"), Some(Beam::ObjectAperture { sine: 0.1 }));
    let Some(Beam::ObjectAperture { sine }) = beam("OBNA 30 1") else { panic!("a cone") };
    assert!((sine - 0.5).abs() < 1e-15);
}

#[test]
fn a_distance_beyond_all_is_infinite() {
    for far in ["1e10", "1.0E+010", "-1E18", "infinity"] {
        assert_eq!(read(&COOKE.replace("DISZ INFINITY", &format!("DISZ {far}"))), read(COOKE), "{far}");
    }
    assert_eq!(read(&COOKE.replace("DISZ INFINITY", "DISZ 9.9e6")).prescription.object_distance_mm, Some(9.9e6));
}

#[test]
fn what_a_file_says_beyond_the_lens_is_noted_with_the_line() {
    let notes = |more: &str| {
        let lens = read(&COOKE.replace("GCAT", &format!("{more}\nGCAT")));
        lens.notes.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert!(notes("MNUM 1 1\nENVD 20 1 1\nENVD 35 1 0\nVDXN 0 0 0\nRAIM 0 0 1").is_empty());
    let [said] = &notes("MNUM 3 2")[..] else { panic!("a note") };
    assert!(said.starts_with("line 6: MNUM is 3:") && said.ends_with("number 2"), "{said}");
    assert!(notes("ENVD 35 1 1")[0].starts_with("line 6: ENVD is 35 °C"));
    assert!(notes("VDXN 0 0\nVCYN 0 0.2")[0].starts_with("line 7: VCYN: vignetting factors"));
}

#[test]
fn media_know_their_lines() {
    assert_eq!(read(COOKE).medium_lines, [23, 25, 31, 32, 39, 40]);
}

#[test]
fn a_mirror_at_45_degrees_sends_light_up() {
    // Surfaces as in Optiland's `tests/zemax_files/one_mirror_up_45deg.zmx`.
    let lens = read(
        "UNIT MM\nWAVM 1 0.55 1\nSURF 0\nDISZ INFINITY\nSURF 1\nSTOP\nDISZ 30\nSURF 2\nTYPE COORDBRK\nPARM 3 45\nDISZ 0\n\
         SURF 3\nGLAS MIRROR 0 0 1.5 40\nDISZ 0\nSURF 4\nTYPE COORDBRK\nPARM 3 45\nDISZ -20\nSURF 5\nDISZ 0\n",
    );
    let (met, fate) = train(&lens).path(&Ray::new([1.0, 2.0, 0.0], [0.0, 0.0, 1.0]));
    assert_eq!(fate, Fate::Arrived);
    // Stop, mirror, image: 32 mm to where the mirror is 2 mm above the axis, then up to the image 20 mm above the axis.
    let image = met[2];
    assert!((image.path_mm - (32.0 + 18.0)).abs() < 1e-12, "{image:?}");
    assert!((image.position_mm[0] - 1.0).abs() < 1e-12 && (image.position_mm[1].abs() - 2.0).abs() < 1e-12);
    assert!((image.direction[2] + 1.0).abs() < 1e-12);
}

#[test]
fn a_break_with_its_tilts_first_undoes_one_with_its_shift_first() {
    let lens = read(
        "UNIT MM\nWAVM 1 0.55 1\nSURF 0\nDISZ INFINITY\nSURF 1\nDISZ 5\nSURF 2\nTYPE COORDBRK\nPARM 1 1\nPARM 2 -2\n\
         PARM 3 10\nPARM 4 20\nPARM 5 -30\nDISZ 0\nSURF 3\nTYPE COORDBRK\nPARM 1 -1\nPARM 2 2\nPARM 3 -10\nPARM 4 -20\n\
         PARM 5 30\nPARM 6 1\nDISZ 7\nSURF 4\nDISZ 0\n",
    );
    let (met, _) = train(&lens).path(&Ray::new([1.0, 2.0, 0.0], [0.1, 0.2, 1.0]));
    let image = met[met.len() - 1].position_mm;
    for (found, expected) in image.into_iter().zip([1.0 + 1.2, 2.0 + 2.4, 0.0]) {
        assert!((found - expected).abs() < 1e-12, "{image:?}");
    }
}

#[test]
fn an_asphere_of_a_model_glass_has_its_focal_length() {
    // Surfaces of Thorlabs' ACL3026U, which has f = 26.5 mm on its data sheet, with B270 by index and Abbe number.
    let lens = read(
        "UNIT MM\nENPD 27\nWAVM 1 0.587 1\nSURF 0\nDISZ INFINITY\nSURF 1\nSTOP\nTYPE EVENASPH\n\
         CURV 7.379474728988791300E-002 0 0 0 0\nPARM 1 0\nPARM 2 5.513E-6\nDISZ 1.19E+1\n\
         GLAS ___BLANK 1 0 1.5229 58.5 0 0 0\nCONI -6.301E-1\nSURF 2\nDISZ 1.809209481007E+1\nSURF 3\nDISZ 0\n",
    );
    let train = train(&lens);
    let focal_length_mm = train.first_order(Some(0)).focal_length_mm;
    assert!((focal_length_mm - 26.0).abs() < 0.6, "{focal_length_mm}");
    // Its asphere brings light from 12 mm off the axis to where its maker focuses it.
    let (met, _) = train.path(&Ray::new([0.0, 12.0, -1.0], [0.0, 0.0, 1.0]));
    assert!(met[2].position_mm[1].abs() < 0.2, "{:?}", met[2]);
}

#[test]
fn damaged_files_are_refused_with_the_line() {
    let said = |text: &str| ZmxLens::read(text.as_bytes()).unwrap_err().to_string();
    assert_eq!(said(""), "line 1: the file ends without a lens: it has no surface between object and image");
    assert!(said(&COOKE[..COOKE.find("SURF 1").unwrap()]).starts_with("line 18: the file ends without a lens"));
    // Wherever between lines it is cut, it is no lens with fewer surfaces.
    for (cut, _) in COOKE.match_indices('\n').take(COOKE.lines().count() - 1) {
        let (text, message) = (&COOKE[..=cut], said(&COOKE[..=cut]));
        let line = text.lines().count();
        assert!(message.starts_with(&format!("line {line}: the file ends with")), "{message}");
    }
    assert_eq!(said(&COOKE.replace("SURF 3", "SURF 2")), "line 28: SURF is 2; legal: 3, the next");
    assert_eq!(said(&COOKE.replace("MODE SEQ", "MODE NSC")), "line 2: MODE is NSC; legal: SEQ, a sequential lens");
    assert_eq!(said(&COOKE.replace("DISZ 6.00755", "DISZ nan")), "line 27: value 1 of DISZ is nan; legal: a number");
    let infinite = said(&COOKE.replace("DISZ 6.00755", "DISZ INFINITY"));
    assert!(infinite.starts_with("line 25: the distance behind a surface of the lens is infinite"), "{infinite}");
    let tilted = said(&COOKE.replacen("SURF 2\n", "SURF 2\n  SCBD 0 0 0 1.5 0\n", 1));
    assert!(tilted.starts_with("line 26: SCBD shifts or tilts"), "{tilted}");
    let unknown = said(&COOKE.replacen("SURF 2\n", "SURF 2\n  TYPE BINARY_2\n", 1));
    assert!(unknown.starts_with("line 26: surface type BINARY_2 is unknown"), "{unknown}");
    let strong = said(&COOKE.replace("CURV -0.002294838879821", "CURV 1e9"));
    assert!(strong.starts_with("line 25: `surface[1].shape.radius_mm` is"), "{strong}");
    let many: String = (0..10_000).map(|k| format!("SURF {k}\nDISZ 1\n")).collect();
    assert_eq!(said(&many), "line 4003: there are more than 2000 surfaces");
    let binary = ZmxLens::read(b"VERS\n\x00\x01\x02\x03").unwrap_err().to_string();
    assert_eq!(binary, "line 2: there is a control character, so this is not a text file");
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = ZmxLens::read(&bytes);
    }

    #[test]
    fn no_damage_makes_it_panic(at in 0..COOKE.len(), byte in any::<u8>(), cut in 0..COOKE.len()) {
        let mut bytes = COOKE.as_bytes().to_vec();
        bytes[at] = byte;
        bytes.truncate(cut.max(at));
        if let Ok(lens) = ZmxLens::read(&bytes)
            && let Ok(train) = Train::new(&lens.prescription, &[], 550.0)
        {
            let _ = train.first_order(lens.prescription.stop());
            let _ = train.path(&Ray::new([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]));
        }
    }
}
