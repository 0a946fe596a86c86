//! Lens files and catalogues that were damaged in every way that can be thought of, thousands of them, always the same.

use super::lens_file::{Taken, take};

const SEEDS: [&[u8]; 4] = [
    include_bytes!("../../../../docs/lenses/double-gauss.zmx"),
    include_bytes!("../../../../fuzz/seeds/lens_file/cooke-triplet.zmx"),
    include_bytes!("../../../../fuzz/seeds/lens_file/surfaces.zmx"),
    include_bytes!("../../../../fuzz/seeds/lens_file/glass.agf"),
];

const DAMAGES: usize = 20_000;

/// What stands where a number should.
const WORDS: [&str; 14] = [
    "nan",
    "-nan",
    "inf",
    "-INFINITY",
    "1e999",
    "-1e308",
    "1e-320",
    "0",
    "-0.0",
    "99999999999999999999",
    "1,5",
    "--",
    "\u{0}",
    "MIRROR",
];

/// Numbers drawn by chance, the same in every run [Steele, Lea and Flood 2014, SplitMix64].
struct Chance(u64);

impl Chance {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end.max(1) as u64) as usize
    }
}

/// The bytes with one more damage.
fn damaged(mut bytes: Vec<u8>, chance: &mut Chance) -> Vec<u8> {
    let at = chance.below(bytes.len());
    let to = (at + 1 + chance.below(60)).min(bytes.len());
    match chance.below(10) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at.min(to)..to)),
        2 => {
            let copied = bytes[at.min(to)..to].to_vec();
            let place = chance.below(bytes.len());
            drop(bytes.splice(place..place, copied));
        }
        3 => bytes.iter_mut().skip(at).take(1 + chance.below(8)).for_each(|byte| *byte = chance.below(256) as u8),
        4 | 5 => return with_word(&bytes, WORDS[chance.below(WORDS.len())], chance),
        6 => {
            let swap = |lines: &mut Vec<Vec<u8>>, chance: &mut Chance| {
                let [one, other] = [0, 1].map(|_| chance.below(lines.len()));
                lines.swap(one, other);
            };
            return with_lines(&bytes, swap, chance);
        }
        7 => {
            let double = |lines: &mut Vec<Vec<u8>>, chance: &mut Chance| {
                let n = chance.below(lines.len());
                let line = lines[n].clone();
                lines.extend(std::iter::repeat_n(line, 1 + chance.below(40)));
            };
            return with_lines(&bytes, double, chance);
        }
        8 => return wide(&bytes),
        _ => drop(bytes.splice(at..at, WORDS[chance.below(WORDS.len())].bytes())),
    }
    bytes
}

/// With another word in the place of one.
fn with_word(bytes: &[u8], word: &str, chance: &mut Chance) -> Vec<u8> {
    let replace = |lines: &mut Vec<Vec<u8>>, chance: &mut Chance| {
        let n = chance.below(lines.len());
        let mut words: Vec<&[u8]> = lines[n].split(|byte| *byte == b' ').collect();
        let k = chance.below(words.len());
        words[k] = word.as_bytes();
        lines[n] = words.join(&b' ');
    };
    with_lines(bytes, replace, chance)
}

fn with_lines(bytes: &[u8], change: impl Fn(&mut Vec<Vec<u8>>, &mut Chance), chance: &mut Chance) -> Vec<u8> {
    let mut lines: Vec<Vec<u8>> = bytes.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    change(&mut lines, chance);
    lines.join(&b'\n')
}

/// In UTF-16, as some programs write.
fn wide(bytes: &[u8]) -> Vec<u8> {
    [0xff, 0xfe].into_iter().chain(bytes.iter().flat_map(|byte| [*byte, 0])).collect()
}

#[test]
fn damage_is_refused_with_its_line_or_leaves_a_lens() {
    let mut chance = Chance(1);
    let mut counts = [0; 4];
    for k in 0..DAMAGES {
        let mut bytes = SEEDS[k % SEEDS.len()].to_vec();
        for _ in 0..1 + chance.below(4) {
            bytes = damaged(bytes, &mut chance);
        }
        counts[take(&bytes) as usize] += 1;
    }
    assert_eq!(counts.iter().sum::<usize>(), DAMAGES);
    // There are some of each: the damage is neither too great nor too small.
    assert!(counts.into_iter().all(|count| count > DAMAGES / 1000), "{counts:?}");
}

#[test]
fn whole_files_are_taken() {
    assert_eq!(SEEDS.map(take), [Taken::Lens, Taken::Lens, Taken::Lens, Taken::Catalogue]);
}

#[test]
fn what_is_far_too_long_is_refused_at_once() {
    let surfaces: String = (0..10_000).map(|k| format!("SURF {k}\nDISZ 1\n")).collect();
    assert_eq!(take(surfaces.as_bytes()), Taken::Refused);
    let glasses: String = (0..10_000).map(|k| format!("NM G{k} 2 0 1.5 60\nCD 1.0 0.01\nLD 0.3 2\n")).collect();
    assert_eq!(take(glasses.as_bytes()), Taken::Catalogue);
    // A glass that calls itself, or another that calls it, is a name like any other.
    let lens = "UNIT MM\nSURF 0\nDISZ INFINITY\nSURF 1\nGLAS A\nDISZ 1\nSURF 2\nGLAS B\nDISZ 1\nSURF 3\nDISZ 0\n";
    assert_eq!(take(lens.as_bytes()), Taken::LensWithoutGlass);
    assert_eq!(take("NM A 2\nNM A 2\nCD 1.0 nan\n".as_bytes()), Taken::Refused);
}
