//! `design` in parts and put together: the same bytes whichever way.

use crate::program::Workplace;

/// One glass, quickly traced.
const LENS: &str = "[[surface]]\nshape = { kind = \"sphere\", radius_mm = 103.0 }\ngap_mm = 4.0\nmedium = \"N-BK7\"\n\
                    semi_diameter_mm = 12.0\nstop = true\n[[surface]]\n\
                    shape = { kind = \"sphere\", radius_mm = -103.0 }\ngap_mm = 90.0\nsemi_diameter_mm = 12.0\n";

const RUN: &str = "design lens.toml --like coarse.toml --distance-mm 300 -q";

const FILES: [&str; 3] = ["instrument.toml", "report.html", "sweep.csv"];

/// The paper's camera with few and large pixels.
fn workplace() -> Workplace {
    let workplace = Workplace::new();
    workplace.write("lens.toml", LENS);
    let line = |line: &str| match line.split_once(" = ") {
        Some(("size_px", _)) => "size_px = [400, 400]".to_owned(),
        Some(("axis_px", _)) => "axis_px = [199.5, 199.5]".to_owned(),
        Some(("pitch_mm", _)) => "pitch_mm = 0.02".to_owned(),
        _ => line.to_owned(),
    };
    let coarse = workplace.succeed("instrument paper").lines().map(line).collect::<Vec<_>>().join("\n");
    workplace.write("coarse.toml", coarse);
    workplace
}

fn contents(workplace: &Workplace, folder: &str) -> Vec<Vec<u8>> {
    FILES.map(|file| std::fs::read(workplace.path(&format!("{folder}/{file}"))).unwrap()).into()
}

#[test]
fn one_sweep_is_two_shards_is_seven_is_one_that_was_interrupted() {
    let workplace = workplace();
    let whole = workplace.succeed(&format!("{RUN} -o whole"));
    let one = contents(&workplace, "whole");
    assert!(whole.contains(" ←") && !workplace.path("whole/pieces").exists(), "{whole}");

    // The last shard in one folder finds all pieces there.
    assert_eq!(workplace.succeed(&format!("{RUN} --shard 1/2 -o both")), "");
    assert_eq!(workplace.succeed(&format!("{RUN} --shard 2/2 -o both")), whole);
    assert!(contents(&workplace, "both") == one);
    let modified = |piece: &str| std::fs::metadata(workplace.path(piece)).unwrap().modified().unwrap();
    let kept = modified("both/pieces/rows-000001-000001.parquet");
    std::fs::remove_file(workplace.path("both/pieces/rows-000003-000003.parquet")).unwrap();
    std::fs::remove_file(workplace.path("both/sweep.csv")).unwrap();
    assert_eq!(workplace.succeed(&format!("{RUN} --shard 2/2 -o both")), whole);
    assert!(contents(&workplace, "both") == one);
    assert_eq!(modified("both/pieces/rows-000001-000001.parquet"), kept);

    let folders: Vec<String> = (1..=7).map(|index| format!("part{index}")).collect();
    for (index, folder) in (1..).zip(&folders) {
        assert_eq!(workplace.succeed(&format!("{RUN} --shard {index}/7 -o {folder}")), "");
    }
    assert_eq!(workplace.succeed(&format!("design --merge {} -o merged -q", folders.join(" "))), whole);
    assert!(contents(&workplace, "merged") == one);

    what_does_not_belong_together(&workplace);
}

/// Of the seven parts.
fn what_does_not_belong_together(workplace: &Workplace) {
    let said = workplace.fail(&format!("{} --shard 1/7 -o part1", RUN.replace("300", "301")));
    assert!(
        said.starts_with(
            "part1/pieces/rows-000000-000000.parquet: a piece of another run: its distance_mm is 300, not 301"
        ),
        "{said}"
    );
    let said = workplace.fail(&format!("{RUN} --shard 1/7 --radii-mm 0.3 0.6 -o part1"));
    assert!(said.contains("a piece of another run: its radii_mm is another"), "{said}");
    workplace.write("lens.toml", LENS.replace("4.0", "4.5"));
    let said = workplace.fail(&format!("{RUN} --shard 1/7 -o part1"));
    assert!(said.contains("a piece of another run: its lens is another"), "{said}");

    assert_eq!(workplace.fail("design --merge part1 part2 -o all"), "the piece with rows 2 to 6 of 25 is missing");
    let said = workplace.fail("design tolerance --merge part1 -o all");
    assert!(said.contains("a piece of a run of another kind"), "{said}");
    for wrong in
        ["design", "design lens.toml", "design lens.toml --distance-mm 300 --merge part1", "design --shard 1/2"]
    {
        assert_eq!(workplace.run(wrong).status.code(), Some(2), "{wrong}");
    }
}
