//! What the rewriter promises, on programs of a few lines. What programs of all kinds do on
//! a machine is in `tests/tests/send/rewrite`.

mod arcs;
mod called;
mod cycles;
mod heights;
mod plain;
mod refusals;
mod run;
mod stream;
mod text;
mod wrong_ways;

use std::string::String;
use std::vec::Vec;

use nalgebra::{Rotation3, Vector3};

use super::{Integers, RefusedLine, RewriteDialect, RewriteSettings, Rewriter, Summary, Unit};
use crate::registration::RigidTransform;

/// A turned part, and whose program it is.
pub(super) fn of(family: RewriteDialect, degrees: [f64; 3]) -> RewriteSettings {
    RewriteSettings {
        dialect: Some(family),
        ..settings(turned(degrees, [0.0; 3]))
    }
}

/// Turned about Z, then shifted.
pub(super) fn level(degrees: f64, shift_mm: [f64; 3]) -> RigidTransform {
    turned([0.0, 0.0, degrees], shift_mm)
}

/// Turned about X, Y, Z in this order, then shifted.
pub(super) fn turned(degrees: [f64; 3], shift_mm: [f64; 3]) -> RigidTransform {
    let [a, b, c] = degrees.map(f64::to_radians);
    let mut rotation = (Rotation3::from_axis_angle(&Vector3::z_axis(), c)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
        * Rotation3::from_axis_angle(&Vector3::x_axis(), a))
    .into_inner();
    if degrees.iter().all(|d| d % 90.0 == 0.0) {
        rotation = rotation.map(f64::round);
    }
    RigidTransform {
        rotation,
        translation_mm: Vector3::from(shift_mm),
    }
}

pub(super) fn settings(transform: RigidTransform) -> RewriteSettings {
    RewriteSettings {
        integers: Some(Integers::Units),
        unit: Some(Unit::Millimetre),
        loose_rapids: true,
        ..RewriteSettings::new(transform)
    }
}

/// The rewritten program without its header, and what was done.
pub(super) fn rewritten(
    settings: &RewriteSettings,
    program: &str,
) -> Result<(String, Summary), RefusedLine> {
    let mut text = Vec::new();
    let mut sink = |bytes: &[u8]| text.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(settings).unwrap();
    rewriter.push(program.as_bytes(), &mut sink)?;
    let summary = rewriter.finish(&mut sink)?;
    let text = String::from_utf8(text).unwrap();
    let is_header = |line: &&str| {
        line.starts_with("(UMI ")
            || line.starts_with("(R ")
            || line.starts_with("(T ")
            || line.starts_with("(STEP ")
    };
    let kept: Vec<&str> = text
        .split_inclusive('\n')
        .filter(|l| !is_header(l))
        .collect();
    Ok((kept.concat(), summary))
}

/// The same with plain settings.
pub(super) fn text(transform: RigidTransform, program: &str) -> String {
    match rewritten(&settings(transform), program) {
        Ok((text, _)) => text,
        Err(refusal) => panic!("{refusal}"),
    }
}
