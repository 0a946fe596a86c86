# `just` lists what there is.
default:
    @just --list

# The whole check: format, lints, documentation, tests, and the real disks where their folder is there
ci:
    cargo fmt --all --check
    cargo clippy --workspace --all-targets -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps
    cargo test --workspace
    if [ -d ../shared/data/real-disks ]; then TWINPUPIL_REAL_DISKS="$PWD/../shared/data/real-disks" cargo test -p twinpupil-validation --test it real_disks; fi

# Tracing, simulating, detecting, matching: how long they take
bench:
    cargo bench --workspace

# twinpupil beside OpenCV on the same frames; Python with venv, and the network for the first run
side-by-side *OPTIONS:
    bench/run {{OPTIONS}}

# Print every accuracy that the README and the changelog speak of
targets:
    cargo run --release -p twinpupil-validation --bin targets

# Fuzz TARGET: instrument_toml, scene_toml, frame_file, envi_cube, lens_file or reconstruct; stable Rust, cargo-fuzz and a C++ compiler
fuzz TARGET SECONDS="60":
    mkdir -p fuzz/corpus/{{TARGET}}
    cargo fuzz run --sanitizer none {{TARGET}} fuzz/corpus/{{TARGET}} fuzz/seeds/{{TARGET}} -- -max_total_time={{SECONDS}} -timeout=20

# Simulate the paper's plate, reconstruct it and show what comes out
demo:
    cargo run --release -- demo

# Renew the golden files; say in CHANGELOG.md what moved and why.
bless:
    TWINPUPIL_BLESS=1 cargo test -p twinpupil --test it golden
