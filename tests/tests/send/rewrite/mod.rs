//! Rewritten programs against nominal ones: by the virtual machine's interpreter, by
//! LinuxCNC's, and the thesis' own path against an independent script.

mod back;
mod corpus;
mod differential;
mod follow;
mod grammar;
mod long;
mod public_programs;
mod random;
mod thesis;

use nalgebra::{Rotation3, Vector3};
use umi_core::registration::RigidTransform;
use umi_core::rewrite::{
    Integers, RefusedLine, RewriteDialect, RewriteSettings, Rewriter, Summary,
};
use umi_core::units::{Mm, Point, Rad};
use umi_tests::referee::RefereeRun;
use umi_virtual::nc::MotionPath;

/// Turned about X, Y, Z in this order, then shifted.
fn turned(degrees: [f64; 3], shift_mm: [f64; 3]) -> RigidTransform {
    let [a, b, c] = degrees.map(f64::to_radians);
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), c)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), a);
    RigidTransform {
        rotation: rotation.into_inner(),
        translation_mm: Vector3::from(shift_mm),
    }
}

/// The transform of a case of the thesis' table 4.2, with all its digits.
fn table_4_2(case: usize) -> RigidTransform {
    let path = format!(
        "{}/reference/fits/registration_thesis_table_4_2_case{case}.json",
        env!("CARGO_MANIFEST_DIR")
    );
    let fit: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let (r, t) = (&fit["result"]["R"], &fit["result"]["t"]);
    RigidTransform {
        rotation: nalgebra::Matrix3::from_fn(|row, column| number(&r[row][column])),
        translation_mm: Vector3::from_fn(|row, _| number(&t[row])),
    }
}

fn settings(transform: RigidTransform, clearance_mm: f64) -> RewriteSettings {
    RewriteSettings {
        // The way back is a second rewriting.
        again: true,
        loose_rapids: true,
        dialect: Some(RewriteDialect::Fanuc),
        integers: Some(Integers::Units),
        clearance: Mm(clearance_mm),
        ..RewriteSettings::new(transform)
    }
}

/// The program that comes out.
fn rewritten(settings: &RewriteSettings, program: &str) -> Result<(String, Summary), RefusedLine> {
    let mut text = Vec::new();
    let mut sink = |bytes: &[u8]| text.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(settings).unwrap();
    rewriter.push(program.as_bytes(), &mut sink)?;
    let summary = rewriter.finish(&mut sink)?;
    Ok((String::from_utf8(text).unwrap(), summary))
}

/// What the referee makes of a program, all cuts at one feed.
fn moves(run: &RefereeRun) -> Vec<follow::Move> {
    let mut from = Vector3::zeros();
    let mut all = Vec::new();
    for made in &run.moves {
        let to = Vector3::from(made.to_mm);
        let path = match made.arc {
            None => MotionPath::Line,
            Some((center, axis, sweep)) => MotionPath::Arc {
                center: Point::from_array_mm(center),
                axis: Vector3::from(axis),
                sweep: Rad(sweep),
            },
        };
        all.push(follow::Move {
            from,
            to,
            path,
            feed_mm_min: made.is_feed.then_some(100.0),
            by_machine: follow::by_machine(&to),
        });
        from = to;
    }
    all
}
