//! `design tolerance` in parts, interrupted, and put together: the same bytes whichever way.

use crate::program::Workplace;

/// Few sources, so that few rows are off by one number alone: 2 × 14 and 24 cameras, in three pieces.
const TOLERANCES: &str = "schema = 1\nname = \"few\"\n[sensor]\ndistance_mm = 0.1\ncentre_mm = 0.05\n[mask]\ncentre_mm = 0.03\n\
                          [lens]\nfocal_length_percent = 0.5\n[temperature]\nchange_k = 5.0\n\
                          mount_expansion_per_k = 23.6e-6\n[filter]\nleak = 0.002\ndot_diameter_mm = 1.0\n\
                          [calibration]\nnoise_px = 0.003\n";

const RUN: &str = "design tolerance paper --tolerances few.toml --cameras 24 --seed 5 -q";

const FILES: [&str; 6] =
    ["cameras.csv", "cameras.parquet", "contributors.csv", "places.csv", "report.html", "tolerances.toml"];

fn workplace() -> Workplace {
    let workplace = Workplace::new();
    workplace.write("few.toml", TOLERANCES);
    workplace
}

fn contents(workplace: &Workplace, folder: &str) -> Vec<Vec<u8>> {
    FILES.map(|file| std::fs::read(workplace.path(&format!("{folder}/{file}"))).unwrap()).into()
}

#[test]
fn one_run_is_two_shards_is_seven_is_one_that_was_interrupted() {
    let workplace = workplace();
    let whole = workplace.succeed(&format!("{RUN} -o whole"));
    let one = contents(&workplace, "whole");
    assert!(whole.contains("24 cameras, few tolerances, seed 5"), "{whole}");

    for count in [2, 7] {
        let folders: Vec<String> = (1..=count).map(|index| format!("shard{index}of{count}")).collect();
        for (index, folder) in (1..).zip(&folders) {
            // A shard without a piece makes no folder.
            assert_eq!(workplace.succeed(&format!("{RUN} --shard {index}/{count} -o {folder}")), "");
        }
        let filled: Vec<&str> =
            folders.iter().map(String::as_str).filter(|folder| workplace.path(folder).is_dir()).collect();
        let merged = workplace.succeed(&format!("design tolerance --merge {} -o merged{count} -q", filled.join(" ")));
        assert_eq!(merged, whole);
        assert!(contents(&workplace, &format!("merged{count}")) == one, "{count} shards");
    }

    // What was interrupted is a run some of whose pieces are there.
    let piece = workplace.path("whole/pieces/rows-000020-000039.parquet");
    std::fs::remove_file(&piece).unwrap();
    std::fs::remove_file(workplace.path("whole/report.html")).unwrap();
    let kept =
        std::fs::metadata(workplace.path("whole/pieces/rows-000000-000019.parquet")).unwrap().modified().unwrap();
    assert_eq!(workplace.succeed(&format!("{RUN} -o whole")), whole);
    assert!(contents(&workplace, "whole") == one);
    let now = std::fs::metadata(workplace.path("whole/pieces/rows-000000-000019.parquet")).unwrap().modified().unwrap();
    assert_eq!(now, kept);
}

#[test]
fn what_cannot_be_run_or_put_together_is_told() {
    let workplace = workplace();
    workplace.succeed(&format!("{RUN} --shard 1/2 -o part"));
    workplace.succeed(&format!("{RUN} --shard 2/2 -o rest"));
    let other = RUN.replace("--seed 5", "--seed 6");
    let said = workplace.fail(&format!("{other} -o part"));
    assert!(
        said.starts_with("part/pieces/rows-000000-000019.parquet: a piece of another run: its seed is 5, not 6"),
        "{said}"
    );
    let said = workplace.fail(&format!("{} -o part", RUN.replace("--cameras 24", "--cameras 25")));
    assert!(said.contains("a piece of another run: its cameras is 24, not 25"), "{said}");
    workplace.write("few.toml", TOLERANCES.replace("0.03", "0.04"));
    let said = workplace.fail(&format!("{RUN} -o part"));
    assert!(said.contains("a piece of another run: its tolerances is another"), "{said}");

    let said = workplace.fail("design tolerance --merge part -o all");
    assert_eq!(said, "the piece with rows 20 to 39 of 52 is missing");
    let said = workplace.fail("design tolerance --merge part rest part/pieces/rows-000000-000019.parquet -o all");
    assert!(said.contains("rows from 0 on are in "), "{said}");
    let said = workplace.fail("design tolerance --merge few.toml -o all");
    assert!(said.starts_with("few.toml: no Parquet file"), "{said}");
    let piece = std::fs::read(workplace.path("rest/pieces/rows-000020-000039.parquet")).unwrap();
    workplace.write("torn.parquet", &piece[..piece.len() - 100]);
    let said = workplace.fail("design tolerance --merge part torn.parquet -o all");
    assert!(said.starts_with("torn.parquet: the Parquet file cannot be read"), "{said}");

    workplace.write("bad.toml", "schema = 1\nname = \"bad\"\n[mask]\ncentre_mm = -1.0\n");
    let said = workplace.fail("design tolerance paper --tolerances bad.toml -o all");
    assert_eq!(said, "bad.toml: `mask.centre_mm` is -1; legal: 0 to 10");
    let said = workplace.fail("design tolerance paper --tolerances none.toml -o all");
    assert_eq!(said, "none.toml: there is no such file");
    for shard in ["0/7", "8/7", "x"] {
        let output = workplace.run(&format!("{RUN} --shard {shard} -o all"));
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{line}");
        assert!(line.contains(&format!("`{shard}` is no shard; legal: i/n")), "{line}");
    }
}

#[test]
fn an_example_is_a_file_of_tolerances() {
    let workplace = Workplace::new();
    for grade in ["commercial", "precision"] {
        let text = workplace.succeed(&format!("design tolerance --example {grade}"));
        assert!(text.contains(&format!("name = \"{grade}\"")) && text.contains("[temperature]"), "{text}");
    }
    assert_eq!(
        workplace.succeed("design tolerance --example"),
        workplace.succeed("design tolerance --example commercial")
    );
}
