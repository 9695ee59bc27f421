//! Rewriting part programs on the host: files in, files out.

pub mod diff;
mod part_program;
mod source;

use std::fs::OpenOptions;
use std::io;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::mpsc::sync_channel;

use nalgebra::{Rotation3, Vector3};
use umi_core::correction::RunCheck;
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{
    MAX_AT_ONCE, ProgramIdentity, RefusedLine, RewriteDialect, RewriteSettings, Rewriter, Summary,
};

use umi_protocol::job::Dialect;

use crate::problem::Problem;

pub use part_program::PartProgram;
pub use source::{ProgramSource, transform, verdict};

use part_program::{PIECE, pieces};

/// Blocks of [`PIECE`] bytes that may wait to be written.
const BLOCKS_AHEAD: usize = 16;

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
    pub identity: ProgramIdentity,
    /// What would be done.
    pub summary: Summary,
    /// The first reasons against it.
    pub refusals: Vec<RefusedLine>,
    /// How many more there are.
    pub more: u64,
}

/// Looks at a program without writing anything.
///
/// # Errors
/// The file cannot be read, or the settings cannot be used.
pub fn examine(program: &PartProgram, settings: &RewriteSettings) -> Result<Examined, Problem> {
    let mut rewriter = rewriter(settings)?;
    let mut refusals = Vec::new();
    let mut more = 0;
    let mut note = |rewriter: &mut Rewriter, refusal: RefusedLine| {
        if refusals.len() < MOST_LISTED {
            refusals.push(refusal);
        } else {
            more += 1;
        }
        rewriter.go_on();
    };
    program.pieces(|bytes| {
        // Line by line, so that the next one is seen behind a refusal.
        for line in bytes.split_inclusive(|byte| matches!(byte, b'\n' | b'\r')) {
            if let Err(refusal) = rewriter.push(line, &mut |_| ()) {
                note(&mut rewriter, refusal);
            }
        }
        Ok(())
    })?;
    // Each program that is called and is not there is a reason of its own.
    while let Err(refusal) = rewriter.finish(&mut |_| ()) {
        note(&mut rewriter, refusal);
    }
    refusals.sort_by_key(|refusal| (refusal.line, refusal.column));
    Ok(Examined {
        identity: identity(program.path())?,
        summary: rewriter.summary(),
        refusals,
        more,
    })
}

/// Check value and length of a program, without a look at what it says.
///
/// # Errors
/// The file cannot be read.
pub fn identity(path: &Path) -> Result<ProgramIdentity, Problem> {
    /// With sixteen tables it takes a sixteenth of the steps; a board has no room for them.
    static CRC: crc::Crc<u32, crc::Table<16>> = crc::Crc::<u32, _>::new(&crc::CRC_32_ISO_HDLC);
    let mut digest = CRC.digest();
    let mut length = 0;
    pieces(path, |bytes| {
        digest.update(bytes);
        length += bytes.len() as u64;
        Ok(())
    })?;
    Ok(ProgramIdentity {
        crc32: digest.finalize(),
        bytes: length,
    })
}

/// The first reason against rewriting a program that is in memory.
///
/// # Errors
/// The settings cannot be used.
pub fn refusal(program: &[u8], settings: &RewriteSettings) -> Result<Option<RefusedLine>, Problem> {
    let mut rewriter = rewriter(settings)?;
    let done = rewriter
        .push(program, &mut |_| ())
        .and_then(|()| rewriter.finish(&mut |_| ()));
    Ok(done.err())
}

/// Rewrites a program. The file appears whole or not at all; what is no file, and `-`, which is
/// standard output, gets it as it comes, where what was written before a refusal cannot be taken
/// back: [`examine`] it first.
///
/// # Errors
/// A file cannot be read or written, or the program cannot be rewritten: the first reason.
pub fn rewrite(
    from: &PartProgram,
    to: &Path,
    settings: &RewriteSettings,
) -> Result<Summary, Problem> {
    let mut rewriter = rewriter(settings)?;
    if to == Path::new("-") {
        return run(&mut rewriter, from, to, io::stdout());
    }
    let fail = |error| Problem::file("write", to, &error);
    let is_device = to.metadata().is_ok_and(|found| !found.is_file());
    // Of this process alone: nobody's file has this name.
    let mut part = to.as_os_str().to_owned();
    part.push(format!(".{}.part", std::process::id()));
    let part = Path::new(&part);
    let mut options = OpenOptions::new();
    let file = if is_device {
        options.write(true).open(to)
    } else {
        options.write(true).create_new(true).open(part)
    };
    let done = run(&mut rewriter, from, to, file.map_err(fail)?);
    if is_device {
        return done;
    }
    let done = done.and_then(|summary| {
        std::fs::rename(part, to).map_err(fail)?;
        Ok(summary)
    });
    if done.is_err() {
        // What is half written is of no use to anybody.
        let _ = std::fs::remove_file(part);
    }
    done
}

/// Rewrites on this thread and writes on another, so that neither waits for the other.
fn run(
    rewriter: &mut Rewriter,
    from: &PartProgram,
    to: &Path,
    mut out: impl io::Write + Send,
) -> Result<Summary, Problem> {
    let refused = |refusal: RefusedLine| Problem::refused("cannot_rewrite", refusal);
    std::thread::scope(|scope| {
        let (blocks, written) = sync_channel::<Vec<u8>>(BLOCKS_AHEAD);
        let writing = scope.spawn(move || {
            for block in written {
                out.write_all(&block)?;
            }
            out.flush()
        });
        let room = || Vec::with_capacity(PIECE + MAX_AT_ONCE);
        let mut block = room();
        // Nobody takes a block behind an error of the other thread, which is told below.
        let mut sink = |bytes: &[u8]| {
            block.extend_from_slice(bytes);
            if block.len() >= PIECE {
                let _ = blocks.send(std::mem::replace(&mut block, room()));
            }
        };
        let done = from
            .pieces(|bytes| rewriter.push(bytes, &mut sink).map_err(refused))
            .and_then(|()| rewriter.finish(&mut sink).map_err(refused));
        let _ = blocks.send(block);
        drop(blocks);
        let written = writing.join().unwrap_or_else(|panic| resume_unwind(panic));
        let summary = done?;
        written.map_err(|error| Problem::file("write", to, &error))?;
        Ok(summary)
    })
}

/// One for these settings, whose comparison of the run is in the program's language.
fn rewriter(settings: &RewriteSettings) -> Result<Rewriter, Problem> {
    let is_other = settings
        .run
        .zip(settings.dialect)
        .is_some_and(|(run, dialect)| {
            let linuxcnc = RunCheck::of(Dialect::LinuxCnc, run.variable(), run.run());
            (linuxcnc == Some(run)) != (dialect == RewriteDialect::LinuxCnc)
        });
    if is_other {
        return Err(Problem::refused(
            "run_of_another",
            "the program is said to be one control's, and the job of the verdict is for another: \
             the comparison of the run would be an alarm there; say the dialect of the job's \
             control, or none",
        ));
    }
    Rewriter::new(settings).map_err(|bad| Problem::trouble("settings", bad))
}
