//! The work that instructions are counted for.

use core::hint::black_box;

use heapless::Vec;
use umi_core::brain::{Brain, Output};
use umi_core::dprnt::{Item, LineSplitter, ReceiverConfig};
use umi_core::fit::sphere;
use umi_core::journal::Journal;
use umi_core::registration::{RigidTransform, register};
use umi_core::rewrite::{Integers, RewriteSettings, Rewriter};
use umi_core::units::{Micros, Point};
use umi_protocol::job::Job;
use umi_protocol::pattern::{BlockPattern, LinePattern};

use crate::calibration::Readings;
use crate::half_sphere::half_sphere;
use crate::meter::{Ram, repeated};
use crate::readings::{CAPTURES, Capturing};
use crate::{CASES, Case, trust};

pub use crate::meter::{Failed, Meter, names};

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
    point_sensor(meter)?;
    trust::all(meter)
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
    let opened = Journal::open(Ram::new());
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
    })?;
    pairing(meter)
}

fn pairing(meter: &mut impl Meter) -> Result<(), Failed> {
    let failed = Failed(names::READING);
    let mut capturing = Capturing::begun().ok_or(failed)?;
    let mut place = None;
    meter.measure(names::READING, CAPTURES, &mut || place = capturing.place());
    place.ok_or(failed)
}
