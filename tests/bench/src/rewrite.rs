//! Rewriting a tool path: every motion carried by a transform.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow};
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{RewriteSettings, Rewriter};

use crate::data::{Data, laces};
use crate::{Contender, Work};

const TASK: &str = "tool path rewritten";

/// Everyone who rewrites tool paths.
pub fn contenders(data: &Data) -> [Contender; 2] {
    let contender = |by, work: fn(&str) -> Work| Contender {
        task: TASK,
        by,
        bytes: Some(data.path.len()),
        work: work(&data.path),
    };
    [contender("umi-core", by_umi), contender("gcode", by_gcode)]
}

/// Rotation by rows and translation: a setup turned by a degree and leaning by a hair
/// (Sawula 2013, table 4.2, case 1).
pub const ROTATION: [[f64; 3]; 3] = [
    [
        0.999_850_342_601_045_1,
        -0.017_299_183_339_861_236,
        -1.750_895_385_475_517_5e-4,
    ],
    [
        0.017_299_178_325_732_727,
        0.999_850_357_564_841_5,
        -3.011_167_662_389_097e-5,
    ],
    [
        1.755_842_451_372_200_2e-4,
        2.707_826_503_838_491e-5,
        0.999_999_984_218_470_1,
    ],
];
/// See [`ROTATION`].
pub const TRANSLATION_MM: [f64; 3] = [
    -0.870_024_925_116_4,
    -0.586_585_445_453_437,
    0.006_009_390_049_482,
];

/// The answer: how many motions, and the largest image on each axis, to the printed
/// micrometre.
fn by_umi(path: &str) -> Work {
    let path = path.to_owned();
    let settings = settings();
    Box::new(move |answer| {
        answer.clear();
        let mut out = Vec::with_capacity(2 * path.len());
        let mut sink = |bytes: &[u8]| out.extend_from_slice(bytes);
        let Ok(mut rewriter) = Rewriter::new(&settings) else {
            return;
        };
        if rewriter.push(path.as_bytes(), &mut sink).is_err() {
            return;
        }
        let Ok(summary) = rewriter.finish(&mut sink) else {
            return;
        };
        std::hint::black_box(&out);
        answer.push((summary.rapids + summary.feeds) as f64);
        answer.extend(
            summary
                .written_mm
                .map(|[_, high]| high)
                .into_iter()
                .flatten(),
        );
    })
}

/// A script on the parser crate `gcode`: reads every block, keeps G0 and G1 with X, Y, Z and
/// F, multiplies, prints. It knows no other word, no modes, no arcs, no refusals.
fn by_gcode(path: &str) -> Work {
    let path = path.to_owned();
    Box::new(move |answer| {
        use std::fmt::Write as _;
        answer.clear();
        let mut out = String::with_capacity(2 * path.len());
        let Ok(program) = gcode::parse(&path) else {
            return;
        };
        let mut at = [0.0_f64; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        let mut motions = 0_u32;
        for block in &program.blocks {
            for code in &block.codes {
                let gcode::Code::General(code) = code else {
                    continue;
                };
                if code.number.major() > 1 {
                    continue;
                }
                let mut feed = None;
                for argument in &code.args {
                    let gcode::Value::Literal(value) = argument.value else {
                        continue;
                    };
                    match argument.letter {
                        'X' => at[0] = f64::from(value),
                        'Y' => at[1] = f64::from(value),
                        'Z' => at[2] = f64::from(value),
                        'F' => feed = Some(value),
                        _ => {}
                    }
                }
                let image: [f64; 3] = std::array::from_fn(|axis| {
                    let sum: f64 = ROTATION[axis].iter().zip(at).map(|(r, p)| r * p).sum();
                    ((sum + TRANSLATION_MM[axis]) * 1000.0).round() / 1000.0
                });
                let [x, y, z] = image;
                // Writing to a String cannot fail.
                let _ = write!(out, "G{} X{x:.3} Y{y:.3} Z{z:.3}", code.number.major());
                if let Some(feed) = feed {
                    let _ = write!(out, " F{feed}");
                }
                out.push('\n');
                motions += 1;
                for (high, value) in high.iter_mut().zip(image) {
                    *high = high.max(value);
                }
            }
        }
        std::hint::black_box(&out);
        answer.push(f64::from(motions));
        answer.extend(high);
    })
}

fn settings() -> RewriteSettings {
    // The brain has a nalgebra of its own: both take plain numbers.
    let mut transform = RigidTransform::identity();
    for (row, values) in ROTATION.iter().enumerate() {
        for (column, value) in values.iter().enumerate() {
            transform.rotation[(row, column)] = *value;
        }
        transform.translation_mm[row] = TRANSLATION_MM[row];
    }
    RewriteSettings {
        loose_rapids: true,
        ..RewriteSettings::new(transform)
    }
}

/// Rewrites a path that is made on the way; time and memory as JSON. Only the time of the
/// rewriter counts.
pub fn stream(megabytes: u64) -> Result<serde_json::Value> {
    let mut rewriter = Rewriter::new(&settings()).map_err(|error| anyhow!("{error}"))?;
    let (mut read, mut written, mut time) = (0_u64, 0_u64, Duration::ZERO);
    let mut lace = 0;
    while read < megabytes * 1_000_000 {
        let piece = laces(lace, LACES);
        lace += LACES;
        let start = Instant::now();
        let done = rewriter.push(piece.as_bytes(), &mut |bytes| written += bytes.len() as u64);
        time += start.elapsed();
        done.map_err(|refusal| anyhow!("{refusal}"))?;
        read += piece.len() as u64;
    }
    Ok(serde_json::json!({
        "read_bytes": read,
        "written_bytes": written,
        "seconds": time.as_secs_f64(),
        "megabytes_a_second": read as f64 / 1e6 / time.as_secs_f64(),
        "state_bytes": size_of::<Rewriter>(),
        "peak_memory_kb": peak_kb()?,
    }))
}

/// Writes such a path as `path.nc`, and its transform as `moved.json`, for a command to be timed.
pub fn write(megabytes: u64, folder: &Path) -> Result<()> {
    let mut out = BufWriter::new(File::create(folder.join("path.nc"))?);
    let (mut written, mut lace) = (0, 0);
    while written < megabytes * 1_000_000 {
        let piece = laces(lace, LACES);
        lace += LACES;
        out.write_all(piece.as_bytes())?;
        written += piece.len() as u64;
    }
    out.flush()?;
    let moved = serde_json::json!({ "rotation": ROTATION, "translation_mm": TRANSLATION_MM });
    std::fs::write(folder.join("moved.json"), moved.to_string())?;
    Ok(())
}

/// Laces of a piece of the stream, about 90 KB.
const LACES: u32 = 500;

/// The most memory that this process ever had.
fn peak_kb() -> Result<u64> {
    let status = std::fs::read_to_string("/proc/self/status").context("no /proc here")?;
    status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next())
        .and_then(|kb| kb.parse().ok())
        .context("/proc does not say the memory")
}
