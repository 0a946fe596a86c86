//! Reads frames again and again on one thread, and in model mode on all, and prints times and errors as JSON, for `bench/run`,
//! which sets OpenCV beside them: `side_by_side [--repeats N] SCENE.toml FRAME.png …`, frames of the paper's camera.

use std::error::Error;
use std::hint::black_box;
use std::io::{self, Write};
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};
use std::{env, fs};

use cpu_time::ThreadTime;
use png::{BitDepth, ColorType};
use serde::Serialize;
use twinpupil_instrument::{Frame, Instrument, ResponseMatrix, paper};
use twinpupil_optics::response_table_for;
use twinpupil_reconstruct::{Mode, Options, Point, Reconstructor};
use twinpupil_simulate::{Dot, Scene, dot_bounds};

/// Rays for every pixel of the frames and of their bounds.
const PUPIL_SAMPLES: usize = 256;

/// Dots nearer to the axis than this do not count; from the second on the masks clip nothing at any depth, mm.
const COUNTED_MM: f64 = 2.0;
const UNCLIPPED_MM: f64 = 3.5;

/// A point farther in depth from every dot than this is false, mm.
const FALSE_DEPTH_MM: f64 = 5.0;

/// What is printed.
#[derive(Debug, Serialize)]
struct Bench {
    instrument: Numbers,
    rules: Rules,
    frames: Vec<FrameBench>,
}

/// What another program must know of the camera.
#[derive(Debug, Serialize)]
struct Numbers {
    focal_length_mm: f64,
    sensor_distance_mm: f64,
    pitch_mm: f64,
    axis_px: [f64; 2],
    code_max: u16,
    depth_range_mm: [f64; 2],
}

/// How points are scored.
#[derive(Debug, Serialize)]
struct Rules {
    counted_mm: f64,
    unclipped_mm: f64,
    false_depth_mm: f64,
}

#[derive(Debug, Serialize)]
struct FrameBench {
    name: String,
    frame: String,
    dots: Vec<TrueDot>,
    results: Vec<ModeBench>,
}

#[derive(Debug, Serialize)]
struct TrueDot {
    centre_mm: [f64; 3],
    diameter_mm: f64,
    /// Cramér–Rao bound of z; none for dots that are not wholly on the sensor.
    z_bound_mm: Option<f64>,
}

#[derive(Debug, Serialize)]
struct ModeBench {
    method: String,
    median_ms: f64,
    least_ms: f64,
    /// Dots that count, and how many of them were found.
    dots: usize,
    found: usize,
    /// Root mean square of the error of z over the dot's bound.
    error_over_bound: f64,
    /// The same where the masks clip nothing.
    unclipped_error_over_bound: f64,
    false_points: usize,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut words: Vec<String> = env::args().skip(1).collect();
    let repeats = match words.first().map(String::as_str) {
        Some("--repeats") if words.len() > 1 => words.drain(..2).nth(1).unwrap_or_default().parse()?,
        _ => 50,
    };
    let instrument = paper::instrument();
    let frames = words.chunks_exact(2).map(|pair| frame_bench(&instrument, &pair[0], &pair[1], repeats));
    let frames = frames.collect::<Result<Vec<_>, _>>()?;
    let bench = Bench { instrument: numbers(&instrument), rules: RULES, frames };
    writeln!(io::stdout(), "{}", serde_json::to_string_pretty(&bench)?)?;
    Ok(())
}

const RULES: Rules = Rules { counted_mm: COUNTED_MM, unclipped_mm: UNCLIPPED_MM, false_depth_mm: FALSE_DEPTH_MM };

fn numbers(instrument: &Instrument) -> Numbers {
    let (sensor, range) = (&instrument.sensor, instrument.depth_range());
    Numbers {
        focal_length_mm: instrument.lens.focal_length_mm(),
        sensor_distance_mm: sensor.distance_mm,
        pitch_mm: sensor.pitch_mm,
        axis_px: sensor.axis_px,
        code_max: sensor.code_max(),
        depth_range_mm: [range.near_mm, range.far_mm],
    }
}

fn frame_bench(instrument: &Instrument, scene: &str, path: &str, repeats: usize) -> Result<FrameBench, Box<dyn Error>> {
    let scene = Scene::from_toml(&fs::read_to_string(scene)?)?;
    let frame = read_frame(instrument, path)?;
    let bounds = dot_bounds(instrument, &scene, &ResponseMatrix::ideal(&instrument.bands), PUPIL_SAMPLES)?;
    let bounds = bounds.iter().map(|bound| bound.map(|bound| bound.std_mm()[2]));
    let dots: Vec<TrueDot> = scene.dots().iter().zip(bounds).map(|(dot, bound)| true_dot(dot, bound)).collect();
    let all = NonZeroUsize::new(rayon::current_num_threads()).unwrap_or(NonZeroUsize::MIN);
    let ways = [(Mode::Model, NonZeroUsize::MIN), (Mode::Model, all), (Mode::Centroid, NonZeroUsize::MIN)];
    let results = ways.map(|(mode, threads)| mode_bench(instrument, mode, threads, &frame, &dots, repeats));
    let results = results.into_iter().collect::<Result<Vec<_>, _>>()?;
    Ok(FrameBench { name: scene.name.clone(), frame: path.to_owned(), dots, results })
}

fn true_dot(dot: &Dot, z_bound_mm: Option<f64>) -> TrueDot {
    TrueDot { centre_mm: dot.centre_mm, diameter_mm: dot.diameter_mm, z_bound_mm }
}

/// Reads a grey PNG of 16 bit.
fn read_frame(instrument: &Instrument, path: &str) -> Result<Frame, Box<dyn Error>> {
    let mut reader = png::Decoder::new(io::BufReader::new(fs::File::open(path)?)).read_info()?;
    let mut bytes = vec![0; reader.output_buffer_size().ok_or("the frame does not fit into memory")?];
    let info = reader.next_frame(&mut bytes)?;
    if (info.color_type, info.bit_depth) != (ColorType::Grayscale, BitDepth::Sixteen) {
        return Err(format!("{path}: not a grey image of 16 bit").into());
    }
    let codes = bytes.as_chunks().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
    Ok(Frame::new(info.width as usize, info.height as usize, instrument.sensor.code_max(), vec![codes])?)
}

fn mode_bench(
    instrument: &Instrument,
    mode: Mode,
    threads: NonZeroUsize,
    frame: &Frame,
    dots: &[TrueDot],
    repeats: usize,
) -> Result<ModeBench, Box<dyn Error>> {
    let table = response_table_for(instrument)?;
    let options = Options { mode, threads: Some(threads), ..Options::default() };
    let mut reader = Reconstructor::new(instrument.clone(), Some(table), options);
    let codes = &frame.pages()[0];
    // The first frame warms up.
    let points = reader.frame(codes)?.to_vec();
    let mut times: Vec<Duration> = Vec::with_capacity(repeats);
    for _ in 0..repeats.max(1) {
        // Processor time, so that what else the machine does costs neither program much; of several threads the time that
        // passes, which is what they are for.
        let (start, start_of_thread) = (Instant::now(), ThreadTime::now());
        black_box(reader.frame(black_box(codes))?);
        times.push(if threads.get() == 1 { start_of_thread.elapsed() } else { start.elapsed() });
    }
    times.sort();
    let ms = |time: Duration| 1000.0 * time.as_secs_f64();
    let errors = errors(&points, dots);
    let over_bound = |r_min_mm: f64| rms(errors.iter().filter(|error| error.r_mm >= r_min_mm).map(|e| e.over_bound));
    Ok(ModeBench {
        method: match threads.get() {
            1 => format!("twinpupil, {} mode", format!("{mode:?}").to_lowercase()),
            threads => format!("same, {threads} threads, elapsed"),
        },
        median_ms: ms(times[times.len() / 2]),
        least_ms: ms(times[0]),
        dots: counted(dots).count(),
        found: errors.len(),
        error_over_bound: over_bound(COUNTED_MM),
        unclipped_error_over_bound: over_bound(UNCLIPPED_MM),
        false_points: points.iter().filter(|point| !dots.iter().any(|dot| dot.is_at(point))).count(),
    })
}

/// A dot that was found.
struct Found {
    r_mm: f64,
    over_bound: f64,
}

fn counted(dots: &[TrueDot]) -> impl Iterator<Item = (&TrueDot, f64)> {
    dots.iter().filter(|dot| dot.r_mm() >= COUNTED_MM).filter_map(|dot| Some((dot, dot.z_bound_mm?)))
}

/// For every dot that counts its nearest point, if one lies on it.
fn errors(points: &[Point], dots: &[TrueDot]) -> Vec<Found> {
    let found = |(dot, bound_mm): (&TrueDot, f64)| {
        let on_dot = points.iter().filter(|point| dot.is_at(point));
        let nearest = on_dot.min_by(|a, b| dot.off_mm(a).total_cmp(&dot.off_mm(b)))?;
        let error_mm = nearest.position_mm[2] - dot.centre_mm[2];
        Some(Found { r_mm: dot.r_mm(), over_bound: error_mm / bound_mm })
    };
    counted(dots).filter_map(found).collect()
}

impl TrueDot {
    fn r_mm(&self) -> f64 {
        self.centre_mm[0].hypot(self.centre_mm[1])
    }

    /// How far a point lies from the centre, seen along the axis, mm.
    fn off_mm(&self, point: &Point) -> f64 {
        (point.position_mm[0] - self.centre_mm[0]).hypot(point.position_mm[1] - self.centre_mm[1])
    }

    fn is_at(&self, point: &Point) -> bool {
        self.off_mm(point) < 0.5 * self.diameter_mm && (point.position_mm[2] - self.centre_mm[2]).abs() < FALSE_DEPTH_MM
    }
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value * value, count + 1));
    if count == 0 { f64::NAN } else { (sum / f64::from(count)).sqrt() }
}
