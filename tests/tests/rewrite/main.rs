//! Rewritten programs against nominal ones: by the virtual machine's interpreter, by
//! LinuxCNC's, and the thesis' own path against an independent script.

mod back;
mod corpus;
mod follow;
mod long;
mod random;
mod thesis;

use nalgebra::{Rotation3, Vector3};
use umi_core::nc::rewrite::{Integers, Refusal, Rewriter, Settings, Summary};
use umi_core::registration::RigidTransform;
use umi_core::units::Mm;

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

fn settings(transform: RigidTransform, clearance_mm: f64) -> Settings {
    Settings {
        integers: Some(Integers::Units),
        clearance: Mm(clearance_mm),
        ..Settings::new(transform)
    }
}

/// The program that comes out.
fn rewritten(settings: &Settings, program: &str) -> Result<(String, Summary), Refusal> {
    let mut text = Vec::new();
    let mut sink = |bytes: &[u8]| text.extend_from_slice(bytes);
    let mut rewriter = Rewriter::new(settings).unwrap();
    rewriter.push(program.as_bytes(), &mut sink)?;
    let summary = rewriter.finish(&mut sink)?;
    Ok((String::from_utf8(text).unwrap(), summary))
}
