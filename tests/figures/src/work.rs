//! The work that instructions are counted for.

use core::convert::Infallible;
use core::hint::black_box;

use heapless::Vec;
use umi_core::brain::{Brain, Output};
use umi_core::dprnt::{Item, LineSplitter, ReceiverConfig};
use umi_core::fit::sphere;
use umi_core::journal::{ERASED, Flash, Geometry, Journal};
use umi_core::registration::{RigidTransform, register};
use umi_core::rewrite::{Integers, RewriteSettings, Rewriter};
use umi_core::units::{Micros, Point};
use umi_protocol::job::Job;
use umi_protocol::pattern::{BlockPattern, LinePattern};

use crate::calibration::Readings;
use crate::half_sphere::half_sphere;
use crate::{CASES, Case};

/// Lines of a finishing path, as CAM software writes them (Sawula 2013, appendix E).
const LACES: &[u8] = include_bytes!("../../reference/toolpath/appendix_e.nc");
/// Arcs in three planes: where the part leans, they become chords.
const ARCS: &[u8] = include_bytes!("../../nc/06-arcs-three-planes.nc");
/// Five clampings of the three-sphere plate, as a control prints them.
const SESSION: &[u8] = include_bytes!("../../reference/sessions/session_a.txt");
/// Lines of a clamping.
const LINES: usize = 27;
/// The job of that session.
const JOB: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/job.postcard"));

/// How often short work is done, so that the clock's steps do not show.
const TIMES: u32 = 20;

/// Points of a best fit of a scanned surface.
const MANY: usize = 500;

/// Work that did not come to its result: its count would mean nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Failed(pub &'static str);

/// Who counts: given the name of the work, how many units of it are done in one go, and
/// what does it.
pub trait Meter {
    /// Does it, once, and counts.
    fn measure(&mut self, work: &'static str, units: u32, run: &mut dyn FnMut());
}

/// Does all work.
///
/// # Errors
/// Work that failed.
pub fn all(meter: &mut impl Meter) -> Result<(), Failed> {
    dprnt(meter)?;
    fits(meter)?;
    journal(meter)?;
    setup(meter)?;
    rewriting(meter)?;
    point_sensor(meter)
}

/// Does something a few times and counts it; `what` says whether it worked.
fn repeated(
    meter: &mut impl Meter,
    work: &'static str,
    times: u32,
    mut what: impl FnMut() -> bool,
) -> Result<(), Failed> {
    let mut all_worked = true;
    meter.measure(work, times, &mut || {
        for _ in 0..times {
            all_worked &= what();
        }
    });
    all_worked.then_some(()).ok_or(Failed(work))
}

/// The name and the work go together, and a test that holds the count names it.
pub mod names {
    /// A byte of DPRNT text.
    pub const BYTE: &str = "DPRNT text, a byte";
    /// A sphere of five hits.
    pub const SPHERE_5: &str = "sphere of 5 points with covariance";
    /// A best fit of a scan.
    pub const SPHERE_500: &str = "sphere of 500 points with covariance";
    /// Three datum features.
    pub const REGISTRATION_3: &str = "registration of 3 pairs with covariance";
    /// Five datum features.
    pub const REGISTRATION_5: &str = "registration of 5 pairs with covariance";
    /// A best fit of a scan to its nominal points.
    pub const REGISTRATION_500: &str = "registration of 500 pairs with covariance";
    /// A journal entry.
    pub const APPEND: &str = "journal entry of 64 bytes";
    /// From the last hit's line to the correction.
    pub const VERDICT: &str = "last hit of a setup: its sphere, registration, verdict, correction";
    /// A tool path on its way to a control: what it was.
    pub const LACES: &str = "tool path of lines rewritten, a byte read";
    /// A tool path on its way to a control: what it becomes.
    pub const CHORDS: &str = "tool path of arcs rewritten as chords, a byte written";
    /// A point sensor on a ball: the paper's spiral.
    pub const CALIBRATION_100: &str = "calibration of a point sensor by 100 readings";
    /// P = Q + t + γ g a.
    pub const PLACE: &str = "point of a reading of a point sensor";
    /// All of it.
    pub const SETUP: &str = "setup of 15 hits, from its first byte to its correction";
}

fn dprnt(meter: &mut impl Meter) -> Result<(), Failed> {
    let config = ReceiverConfig {
        patterns: [LinePattern::Block(BlockPattern::default())]
            .into_iter()
            .collect(),
        ..ReceiverConfig::default()
    };
    let mut receiver = LineSplitter::new(&config);
    let mut hits = 0;
    meter.measure(names::BYTE, SESSION.len() as u32, &mut || {
        receiver.receive(SESSION, Micros(0), &mut |item| {
            hits += u32::from(matches!(black_box(item), Item::Hit(_)));
        });
    });
    (hits == 75).then_some(()).ok_or(Failed(names::BYTE))
}

fn case(id: &'static str) -> Result<&'static Case, Failed> {
    CASES.iter().find(|case| case.id == id).ok_or(Failed(id))
}

fn fits(meter: &mut impl Meter) -> Result<(), Failed> {
    let five = case("sphere_thesis_table_4_1")?.points(0);
    repeated(meter, names::SPHERE_5, TIMES, || {
        black_box(sphere::fit(black_box(&five))).is_ok()
    })?;

    let setup = case("registration_thesis_table_4_2_case1")?;
    let (from, to) = (setup.points(0), setup.points(3));
    repeated(meter, names::REGISTRATION_3, TIMES, || {
        black_box(register(black_box(&from), black_box(&to))).is_ok()
    })?;
    let moved = register(&from, &to).map_err(|_| Failed(names::REGISTRATION_3))?;

    let eight = case("registration_half_turn_n8_15um")?;
    let (from, to) = (eight.points(0), eight.points(3));
    let (from, to) = (from.get(..5), to.get(..5));
    let (Some(from), Some(to)) = (from, to) else {
        return Err(Failed(names::REGISTRATION_5));
    };
    repeated(meter, names::REGISTRATION_5, TIMES, || {
        black_box(register(black_box(from), black_box(to))).is_ok()
    })?;

    let many: Vec<Point, MANY> = half_sphere(MANY as u32, 1).collect();
    repeated(meter, names::SPHERE_500, 1, || {
        black_box(sphere::fit(black_box(&many))).is_ok()
    })?;
    let measured: Vec<Point, MANY> = half_sphere(MANY as u32, 2)
        .map(|point| moved.apply(point))
        .collect();
    repeated(meter, names::REGISTRATION_500, 1, || {
        black_box(register(black_box(&many), black_box(&measured))).is_ok()
    })
}

fn journal(meter: &mut impl Meter) -> Result<(), Failed> {
    let opened = Journal::open(Ram([ERASED; RAM]));
    let (mut journal, _) = opened.map_err(|_| Failed(names::APPEND))?;
    repeated(meter, names::APPEND, TIMES, || {
        journal.append(1, Micros(1), black_box(&[0x55; 64])).is_ok()
    })
}

/// Feeds a brain; how many verdicts were OK.
fn feed(brain: &mut Brain, bytes: &[u8]) -> u32 {
    let mut ok = 0;
    brain.bytes(Micros(0), bytes, &mut |output| {
        if let Output::Verdict(verdict) = black_box(output) {
            ok += u32::from(verdict.ok);
        }
    });
    ok
}

fn setup(meter: &mut impl Meter) -> Result<(), Failed> {
    let failed = |_| Failed(names::SETUP);
    let job: Job = postcard::from_bytes(JOB).map_err(|_| Failed(names::SETUP))?;
    let mut brain = Brain::new(job).map_err(failed)?;
    let mut lines = SESSION.split_inclusive(|byte| *byte == b'\n');
    let mut taught = 0;
    for line in lines.by_ref().take(LINES) {
        taught += feed(&mut brain, line);
    }
    let mut ok = 0;
    meter.measure(names::SETUP, 1, &mut || {
        for line in lines.by_ref().take(LINES) {
            ok += feed(&mut brain, line);
        }
    });
    // The last hit's line, and the asterisks behind it.
    for line in lines.by_ref().take(LINES - 2) {
        feed(&mut brain, line);
    }
    let mut last = 0;
    meter.measure(names::VERDICT, 1, &mut || {
        for line in lines.by_ref().take(2) {
            last += feed(&mut brain, line);
        }
    });
    let all_ok = (taught, ok, last) == (1, 1, 1);
    all_ok.then_some(()).ok_or(Failed(names::SETUP))
}

/// A setup that was turned by a degree and leans by a hair (table 4.2, case 1), and one that
/// leans so much that no arc stays one.
fn rewriting(meter: &mut impl Meter) -> Result<(), Failed> {
    let setup = case("registration_thesis_table_4_2_case1")?;
    let moved = register(&setup.points(0), &setup.points(3)).map_err(|_| Failed(names::LACES))?;
    let hair = moved.transform;
    let [read, _] = rewritten(names::LACES, &hair, LACES)?;
    meter.measure(names::LACES, read, &mut || {
        let _ = black_box(rewritten(names::LACES, black_box(&hair), LACES));
    });
    let mut lean = RigidTransform::identity();
    let (sin, cos) = libm::sincos(0.05);
    (lean.rotation.m11, lean.rotation.m33) = (cos, cos);
    (lean.rotation.m13, lean.rotation.m31) = (sin, -sin);
    let [_, written] = rewritten(names::CHORDS, &lean, ARCS)?;
    meter.measure(names::CHORDS, written, &mut || {
        let _ = black_box(rewritten(names::CHORDS, black_box(&lean), ARCS));
    });
    Ok(())
}

/// Rewrites a program, from its first byte to its last; how many were read and written.
fn rewritten(
    work: &'static str,
    transform: &RigidTransform,
    program: &[u8],
) -> Result<[u32; 2], Failed> {
    let settings = RewriteSettings {
        integers: Some(Integers::Units),
        loose_rapids: true,
        ..RewriteSettings::new(*transform)
    };
    let mut written = 0;
    let mut sink = |bytes: &[u8]| written += black_box(bytes).len() as u32;
    let mut rewriter = Rewriter::new(&settings).map_err(|_| Failed(work))?;
    let done = rewriter
        .push(program, &mut sink)
        .and_then(|()| rewriter.finish(&mut sink));
    match done {
        Ok(summary) if summary.feeds + summary.chorded > 0 => Ok([program.len() as u32, written]),
        _ => Err(Failed(work)),
    }
}

fn point_sensor(meter: &mut impl Meter) -> Result<(), Failed> {
    let failed = Failed(names::CALIBRATION_100);
    let readings = Readings::of(case("paper_spiral_1um")?).ok_or(failed)?;
    repeated(meter, names::CALIBRATION_100, 1, || {
        black_box(black_box(&readings).calibrate()).is_ok()
    })?;
    let found = readings.calibrate().map_err(|_| failed)?;
    let (sensor, reading) = (found.sensor, readings.first().ok_or(failed)?);
    repeated(meter, names::PLACE, TIMES, || {
        let reading = black_box(&reading);
        let place = black_box(sensor.place(reading.axes, reading.gamma));
        place.mm.x.is_finite()
    })
}

const SECTOR: usize = 4096;
const SECTORS: usize = 4;
const RAM: usize = SECTORS * SECTOR;

/// Flash that takes no time: the journal's own work is counted.
struct Ram([u8; RAM]);

impl Flash for Ram {
    type Error = Infallible;

    fn geometry(&self) -> Geometry {
        Geometry {
            sectors: SECTORS as u16,
            sector_size: SECTOR as u32,
            write_size: 1,
            page_size: 256,
        }
    }

    fn read(&mut self, addr: u32, into: &mut [u8]) -> Result<(), Infallible> {
        if let Some(cells) = self.0.get(addr as usize..addr as usize + into.len()) {
            into.copy_from_slice(cells);
        }
        Ok(())
    }

    fn program(&mut self, addr: u32, bytes: &[u8]) -> Result<(), Infallible> {
        let cells = self.0.get_mut(addr as usize..addr as usize + bytes.len());
        if let Some(cells) = cells {
            cells.copy_from_slice(bytes);
        }
        Ok(())
    }

    fn erase(&mut self, sector: u32) -> Result<(), Infallible> {
        let at = sector as usize * SECTOR;
        if let Some(cells) = self.0.get_mut(at..at + SECTOR) {
            cells.fill(ERASED);
        }
        Ok(())
    }
}
