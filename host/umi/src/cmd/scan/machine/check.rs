//! `umi scan machine check`

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};
use umi_kinematics::{AxisChain, Drive, Joint, JointKind, Pose};
use umi_scan::ScanError;
use umi_scan::format::machine;

use super::super::super::Format;
use super::super::answer::answer;
use crate::failure::Failure;

/// What a machine file says: its chains as a picture, and what to look at
#[derive(Args)]
#[command(after_help = HELP)]
pub(crate) struct Check {
    /// The machine file
    #[arg(value_name = "MACHINE.toml")]
    machine: PathBuf,
    #[command(flatten)]
    pub format: Format,
}

const HELP: &str = "\
Examples:
  umi scan machine check mill.toml
  umi scan machine check mill.toml --json

Refused (status 2): machine (unknown or repeated names, an axis without direction, a mount
that mirrors).";

impl Check {
    pub fn run(&self) -> Result<(), Failure> {
        let machine = machine::read(&self.machine);
        // The picture is of the machine, the answer of the file: both from one reading.
        let shown = machine.as_ref().map(picture).unwrap_or_default();
        let found: Result<Value, ScanError> = machine.map(|m| object(&m));
        answer(found, self.format.json, |_| shown)
    }
}

fn three(v: &[f64; 3]) -> String {
    format!("({}, {}, {})", short(v[0]), short(v[1]), short(v[2]))
}

/// Up to four digits behind the point, without zeros at their end.
fn short(x: f64) -> String {
    let text = format!("{x:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

fn unit(joint: &Joint) -> &'static str {
    match joint.kind {
        JointKind::Linear => "mm",
        JointKind::Rotary => "degree",
    }
}

/// An axis in a line.
fn line(joint: &Joint) -> String {
    let mut text = format!("{:<4}", joint.name);
    let direction = three(&joint.direction.into());
    match joint.kind {
        JointKind::Linear => text += &format!("along {direction}"),
        JointKind::Rotary => {
            text += &format!(
                "about {direction} through {} mm",
                three(&joint.point_mm.into())
            );
        }
    }
    text += &match &joint.drive {
        Drive::Encoder {
            column,
            counts_per_unit,
            origin_counts,
        } => format!(
            "; input {column}, {} counts a {}, 0 at {}",
            short(*counts_per_unit),
            unit(joint),
            short(*origin_counts)
        ),
        Drive::Constant(value) => format!("; stands at {} {}", short(*value), unit(joint)),
        Drive::Named => "; no encoder".to_owned(),
    };
    text
}

/// Both chains, from the base outwards.
fn picture(machine: &AxisChain) -> String {
    let mut text = String::from("base\n");
    let chains = [
        (
            "├─",
            "│  ",
            &machine.sensor_chain,
            "sensor",
            &machine.sensor,
        ),
        (
            "└─",
            "   ",
            &machine.workpiece_chain,
            "workpiece",
            &machine.workpiece,
        ),
    ];
    for (begin, beside, chain, end, frame) in chains {
        let mut depth = 0;
        for &place in chain {
            let lead = if depth == 0 {
                begin.to_owned()
            } else {
                format!("{beside}{}└─", "   ".repeat(depth - 1))
            };
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{lead} {}", line(&machine.joints[place]));
            depth += 1;
        }
        let lead = if depth == 0 {
            begin.to_owned()
        } else {
            format!("{beside}{}└─", "   ".repeat(depth - 1))
        };
        let _ = writeln!(
            text,
            "{lead} {end} at {} mm",
            three(&frame.translation_mm.into())
        );
    }
    for warning in warnings(machine) {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// What every command that uses the machine tells, and what the counts of a scan want besides.
fn warnings(machine: &AxisChain) -> Vec<String> {
    let mut all = machine::warnings(machine);
    let named = machine.joints.iter().filter(|j| j.drive == Drive::Named);
    all.extend(named.map(|joint| {
        format!(
            "{} has no encoder: umi scan merge needs counts of it.",
            joint.name
        )
    }));
    all
}

fn object(machine: &AxisChain) -> Value {
    let names = |chain: &[usize]| -> Vec<&str> {
        chain
            .iter()
            .map(|&k| machine.joints[k].name.as_str())
            .collect()
    };
    let frame = |pose: &Pose| {
        let rows: Vec<[f64; 3]> = pose
            .rotation
            .row_iter()
            .map(|r| [r[0], r[1], r[2]])
            .collect();
        json!({"rotation": rows, "translation_mm": pose.translation_mm.as_slice()})
    };
    let joints: Vec<Value> = machine
        .joints
        .iter()
        .map(|joint| {
            let mut value = json!({
                "name": joint.name,
                "kind": match joint.kind { JointKind::Linear => "linear", JointKind::Rotary => "rotary" },
                "direction": joint.direction.as_slice(),
            });
            if joint.kind == JointKind::Rotary {
                value["point_mm"] = json!(joint.point_mm.as_slice());
            }
            match &joint.drive {
                Drive::Encoder { column, counts_per_unit, origin_counts } => {
                    value["column"] = json!(column);
                    let name = match joint.kind {
                        JointKind::Linear => "counts_per_mm",
                        JointKind::Rotary => "counts_per_deg",
                    };
                    value[name] = json!(counts_per_unit);
                    value["origin_counts"] = json!(origin_counts);
                }
                Drive::Constant(at) => value["value"] = json!(at),
                Drive::Named => {}
            }
            value
        })
        .collect();
    json!({
        "kind": "machine",
        "joints": joints,
        "chain": {"sensor": names(&machine.sensor_chain), "workpiece": names(&machine.workpiece_chain)},
        "sensor": frame(&machine.sensor),
        "workpiece": frame(&machine.workpiece),
        "warnings": warnings(machine),
    })
}

#[cfg(test)]
mod tests {
    use super::super::new::Preset;
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn every_preset_is_a_machine_that_waits_for_its_mount() {
        for preset in Preset::value_variants() {
            let machine = AxisChain::parse(preset.text()).unwrap();
            let warnings = warnings(&machine);
            assert_eq!(warnings.len(), 1, "{warnings:?}");
            assert!(warnings[0].contains("calibrate sensor"));
            let picture = picture(&machine);
            for joint in &machine.joints {
                assert!(picture.contains(&joint.name));
            }
        }
        let table = AxisChain::parse(Preset::C800u.text()).unwrap();
        assert_eq!(
            picture(&table).lines().nth(5).unwrap(),
            "└─ A   about (1, 0, 0) through (0, 0, 0) mm; input w, 10000 counts a degree, 0 at 0"
        );
    }
}
