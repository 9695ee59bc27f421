//! Rewriting part programs on the host: files in, files out.

pub mod diff;
mod source;

use std::fs::File;
use std::io::{self, BufWriter, Read as _};
use std::path::{Path, PathBuf};

use nalgebra::{Rotation3, Vector3};
use umi_core::nc::rewrite::{BadSettings, Check, Identity, Refusal, Rewriter, Settings, Summary};
use umi_core::registration::RigidTransform;

use crate::failure::Failure;

pub use source::{Source, transform, verdict};

/// Bytes that are read at a time.
const PIECE: usize = 1 << 16;

/// Reasons that are listed, at most.
const MOST_LISTED: usize = 100;

/// A part as a program is tried with before there is a verdict.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    lean_deg: f64,
}

/// It lies askew by a degree.
pub const LEVEL: Trial = Trial { lean_deg: 0.0 };

/// It leans, too, as every measured one does: by hardly anything. What is refused does not
/// depend on how much up to a slope of 1 in 50, where no part is clamped.
pub const LEANING: Trial = Trial { lean_deg: 0.05 };

impl Trial {
    /// Nominal to measured.
    #[must_use]
    pub fn transform(self) -> RigidTransform {
        let turn = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, degrees.to_radians());
        let height = if self.lean_deg == 0.0 { 0.0 } else { 0.1 };
        RigidTransform {
            rotation: (turn(Vector3::x_axis(), self.lean_deg) * turn(Vector3::z_axis(), 1.0))
                .into_inner(),
            translation_mm: Vector3::new(1.0, 2.0, height),
        }
    }
}

/// What a program is, and what stands against rewriting it.
#[derive(Clone, Debug)]
pub struct Examined {
    /// Check value and length.
    pub identity: Identity,
    /// What would be done.
    pub summary: Summary,
    /// The first reasons against it.
    pub refusals: Vec<Refusal>,
    /// How many more there are.
    pub more: u64,
}

/// Looks at a program without writing anything.
///
/// # Errors
/// The file cannot be read, or the settings cannot be used.
pub fn examine(path: &Path, settings: &Settings) -> Result<Examined, Failure> {
    let mut rewriter = Rewriter::new(settings).map_err(|bad| bad_settings(&bad))?;
    let mut check = Check::default();
    let mut refusals = Vec::new();
    let mut more = 0;
    let mut note = |rewriter: &mut Rewriter, refusal: Refusal| {
        if refusals.len() < MOST_LISTED {
            refusals.push(refusal);
        } else {
            more += 1;
        }
        rewriter.go_on();
    };
    pieces(path, |bytes| {
        check.update(bytes);
        // Line by line, so that the next one is seen behind a refusal.
        for line in bytes.split_inclusive(|byte| matches!(byte, b'\n' | b'\r')) {
            if let Err(refusal) = rewriter.push(line, &mut |_| ()) {
                note(&mut rewriter, refusal);
            }
        }
        Ok(())
    })?;
    if let Err(refusal) = rewriter.finish(&mut |_| ()) {
        note(&mut rewriter, refusal);
    }
    Ok(Examined {
        identity: check.finish(),
        summary: rewriter.summary(),
        refusals,
        more,
    })
}

/// The first reason against rewriting a program that is in memory.
///
/// # Errors
/// The settings cannot be used.
pub fn refusal(program: &[u8], settings: &Settings) -> Result<Option<Refusal>, Failure> {
    let mut rewriter = Rewriter::new(settings).map_err(|bad| bad_settings(&bad))?;
    let done = rewriter
        .push(program, &mut |_| ())
        .and_then(|()| rewriter.finish(&mut |_| ()));
    Ok(done.err())
}

/// Rewrites a program that has been examined. The file appears whole or not at all; `-`
/// is standard output.
///
/// # Errors
/// A file cannot be read or written, or the program has changed since it was examined.
pub fn rewrite(from: &Path, to: &Path, settings: &Settings) -> Result<Summary, Failure> {
    let mut rewriter = Rewriter::new(settings).map_err(|bad| bad_settings(&bad))?;
    if to == Path::new("-") {
        let mut out = io::stdout().lock();
        return run(&mut rewriter, from, to, &mut out);
    }
    let part = PathBuf::from(format!("{}.part", to.display()));
    let file = File::create(&part).map_err(|error| Failure::file("write", &part, &error))?;
    let mut out = BufWriter::with_capacity(PIECE, file);
    let done = run(&mut rewriter, from, &part, &mut out).and_then(|summary| {
        std::fs::rename(&part, to).map_err(|error| Failure::file("write", to, &error))?;
        Ok(summary)
    });
    if done.is_err() {
        // What is half written is of no use to anybody.
        let _ = std::fs::remove_file(&part);
    }
    done
}

fn run(
    rewriter: &mut Rewriter,
    from: &Path,
    to: &Path,
    out: &mut impl io::Write,
) -> Result<Summary, Failure> {
    let mut written: io::Result<()> = Ok(());
    let mut sink = |bytes: &[u8]| {
        if written.is_ok() {
            written = out.write_all(bytes);
        }
    };
    let changed = |refusal: Refusal| Failure::refused("cannot_rewrite", refusal);
    pieces(from, |bytes| {
        rewriter.push(bytes, &mut sink).map_err(changed)
    })?;
    let summary = rewriter.finish(&mut sink).map_err(changed)?;
    written
        .and_then(|()| out.flush())
        .map_err(|error| Failure::file("write", to, &error))?;
    Ok(summary)
}

/// Reads a file piece by piece: the memory is that of one piece.
fn pieces(path: &Path, mut take: impl FnMut(&[u8]) -> Result<(), Failure>) -> Result<(), Failure> {
    let fail = |error: io::Error| Failure::file("read", path, &error);
    let mut file = File::open(path).map_err(fail)?;
    let mut buffer = vec![0; PIECE];
    loop {
        let length = file.read(&mut buffer).map_err(fail)?;
        if length == 0 {
            return Ok(());
        }
        take(buffer.get(..length).unwrap_or_default())?;
    }
}

fn bad_settings(bad: &BadSettings) -> Failure {
    Failure::trouble("settings", bad)
}
