//! The machine file, from disk.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Item, Table, value};
use umi_kinematics::{AxisChain, Drive, Joint, JointKind, Pose};

use crate::ScanError;

/// Reads a machine file.
///
/// # Errors
/// The file cannot be read; code `machine` where it describes none.
pub fn read(path: &Path) -> Result<AxisChain, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    let machine = AxisChain::parse(&text).map_err(ScanError::from);
    let machine = machine.and_then(|machine| one_input_one_axis(&machine).map(|()| machine));
    machine.map_err(|mut error| {
        error.message = format!("{}: {}", path.display(), error.message);
        error
    })
}

/// Refuses two linear joints of a chain that have one input and other directions: one joint along the sum would move the
/// same, so that nobody writes two, and a wrong input looks just so. Linked axes exist (a gantry's or a telescope's two along
/// one direction, a screw, a parallelogram): they are told only ([`warnings`]).
fn one_input_one_axis(machine: &AxisChain) -> Result<(), ScanError> {
    const PARALLEL: f64 = 0.01;
    let input = |joint: &Joint| match joint.drive {
        Drive::Encoder { column, .. } if joint.kind == JointKind::Linear => Some(column),
        _ => None,
    };
    for chain in [&machine.sensor_chain, &machine.workpiece_chain] {
        let joints: Vec<&Joint> = chain.iter().map(|&place| &machine.joints[place]).collect();
        for (place, joint) in joints.iter().enumerate() {
            let Some(column) = input(joint) else {
                continue;
            };
            let across = |other: &&&Joint| {
                let sine = other.direction.cross(&joint.direction).norm();
                input(other) == Some(column)
                    && sine > PARALLEL * other.direction.norm() * joint.direction.norm()
            };
            if let Some(other) = joints[..place].iter().find(across) {
                return Err(ScanError::refused(
                    "machine",
                    format_args!(
                        "{} and {} run along different directions by one input, {column}: give each the input of its own encoder",
                        other.name, joint.name
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// What is no fault of a machine file, and may be a slip: every command that uses the machine tells it.
#[must_use]
pub fn warnings(machine: &AxisChain) -> Vec<String> {
    let mut all = Vec::new();
    for (place, joint) in machine.joints.iter().enumerate() {
        let name = &joint.name;
        if !machine.sensor_chain.contains(&place) && !machine.workpiece_chain.contains(&place) {
            all.push(format!("{name} is in neither chain: it moves nothing."));
        }
        if let Drive::Encoder { column, .. } = joint.drive {
            let same = machine.joints[..place].iter().find(
                |other| matches!(other.drive, Drive::Encoder { column: c, .. } if c == column),
            );
            if let Some(other) = same {
                all.push(format!(
                    "{} and {name} have the same input, {column}.",
                    other.name
                ));
            }
        }
        all.extend(radians(joint));
    }
    if machine.sensor == Pose::identity() {
        all.push("The sensor's mount is not known: umi scan calibrate sensor finds it.".into());
    }
    all
}

/// A rotary joint whose figures look like radians.
fn radians(joint: &Joint) -> Option<String> {
    use std::f64::consts::{PI, TAU};
    if joint.kind != JointKind::Rotary {
        return None;
    }
    let whole = |x: f64| (x - x.round()).abs();
    let name = &joint.name;
    match joint.drive {
        // 15 degrees and their multiples, as an indexing head has them, with four digits or more.
        Drive::Constant(at) if at != 0.0 && at.abs() < TAU + 1e-3 => {
            let steps = at / (PI / 12.0);
            (steps.round() != 0.0 && whole(steps) < 5e-4).then(|| {
                format!(
                    "{name} stands at {at}: that looks like radians, {:.0} degrees. `value` is in degrees.",
                    at.to_degrees()
                )
            })
        }
        // A turn has a whole number of counts, and mostly a round one; the figure may have few digits.
        Drive::Encoder {
            counts_per_unit, ..
        } => {
            let (by_degrees, by_radians) = (360.0 * counts_per_unit, TAU * counts_per_unit);
            let exact = whole(by_radians) < 1e-3 && whole(by_degrees) > 1e-3;
            let rounded = is_round(by_radians) && !is_round(by_degrees);
            (by_radians.abs() > 100.0 && (exact || rounded)).then(|| {
                format!(
                    "{name} has {counts_per_unit} counts a degree: that looks like counts a radian, of {by_radians:.0} a \
                     turn. `counts_per_deg` would be {}.",
                    by_radians.round() / 360.0
                )
            })
        }
        _ => None,
    }
}

/// Whether so many counts are what a turn of an encoder has: a number of two digits and zeros, rounded to five digits
/// when it was written; of three digits, or a power of two, rounded to six. Of numbers drawn at random three in a thousand are.
fn is_round(counts: f64) -> bool {
    let counts = counts.abs();
    let near = |x: f64, within: f64| (x - x.round()).abs() <= within * x;
    let digits = counts / 10_f64.powf(counts.log10().floor());
    let binary = counts / counts.log2().round().exp2();
    near(10.0 * digits, 2e-5) || near(100.0 * digits, 1e-6) || near(binary, 1e-6)
}

/// The text of a machine file with another mount, and how uncertain that is; comments and all else
/// stay as they are.
///
/// # Errors
/// `machine` where the text describes none, or none comes of it.
pub fn with_sensor(
    text: &str,
    mount: &Pose,
    covariance: Option<&[[f64; 6]; 6]>,
) -> Result<String, ScanError> {
    let wrong = |message: String| ScanError::unreadable("machine", message);
    let mut file: DocumentMut = text
        .parse()
        .map_err(|error: toml_edit::TomlError| wrong(error.to_string().trim().to_owned()))?;
    let sensor = file
        .entry("sensor")
        .or_insert_with(|| Item::Table(Table::new()))
        .as_table_like_mut()
        .ok_or_else(|| wrong("sensor is no table".into()))?;
    let rows = |rows: &mut dyn Iterator<Item = Array>| value(rows.collect::<Array>());
    let rotation = mount.rows();
    sensor.insert(
        "rotation",
        rows(&mut rotation.iter().map(|row| row.iter().copied().collect())),
    );
    let [x, y, z] = mount.translation_mm.into();
    sensor.insert("translation_mm", value(Array::from_iter([x, y, z])));
    match covariance {
        Some(covariance) => {
            let rows = rows(&mut covariance.iter().map(|row| row.iter().copied().collect()));
            sensor.insert("covariance", rows);
        }
        None => {
            sensor.remove("covariance");
        }
    }
    let text = file.to_string();
    AxisChain::parse(&text).map_err(ScanError::from)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn figures_that_look_like_radians_are_told() {
        let told = |kind: &str, drive: &str| {
            let text = format!(
                "[[joint]]\nname = \"B\"\nkind = \"{kind}\"\ndirection = [0, 1, 0]\npoint_mm = [0, 0, 0]\n{drive}\n\
                 [chain]\nsensor = [\"B\"]\nworkpiece = []\n[sensor]\ntranslation_mm = [0, 0, -9]\n"
            );
            warnings(&AxisChain::parse(&text).unwrap())
        };
        for drive in [
            "value = 1.5708",
            "value = -0.5236",
            "column = \"w\"\ncounts_per_deg = 572957.79513\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = -3183.0988618\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 572957.8\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 572958\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 3183.1\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 11459.2\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 1335088.1\norigin_counts = 0",
        ] {
            let all = told("rotary", drive);
            assert_eq!(all.len(), 1, "{drive}: {all:?}");
            assert!(
                all[0].starts_with("B ") && all[0].contains("radian"),
                "{all:?}"
            );
        }
        for drive in [
            "value = 90.0",
            "value = 0.0",
            "value = 1.6",
            "value = 7.5",
            "column = \"w\"\ncounts_per_deg = 10000\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 2777.7777777777777\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 2777.78\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 23301.689\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 728.1778\norigin_counts = 0",
            "column = \"w\"\ncounts_per_deg = 3183\norigin_counts = 0",
        ] {
            assert_eq!(told("rotary", drive), Vec::<String>::new(), "{drive}");
        }
    }

    #[test]
    fn a_new_mount_leaves_the_rest_of_the_file() {
        let mount = Pose {
            rotation: crate::rigid::rotation(&Vector3::new(0.1, 0.2, -0.3)),
            translation_mm: Vector3::new(1.0 / 3.0, -2.0, 1e-17),
        };
        let mut covariance = [[0.0; 6]; 6];
        (0..6).for_each(|i| covariance[i][i] = 1e-7 * (i + 1) as f64);
        let before = "# mine\n[chain] # none\nsensor = []\n\n# where it sits\n[sensor]\nrotation = [\n  [1, 0, 0], [0, 1, 0],\n  [0, 0, 1],\n]\n# behind\n[workpiece]\ntranslation_mm = [1, 2, 3]\n";
        for text in [before, "[chain]\nsensor = []\n"] {
            let after = with_sensor(text, &mount, Some(&covariance)).unwrap();
            let machine = AxisChain::parse(&after).unwrap();
            assert_eq!(machine.sensor, mount);
            assert_eq!(machine.sensor_covariance, Some(covariance));
            for line in text.lines().filter(|l| l.contains('#')) {
                assert!(after.contains(line), "{line} is not in\n{after}");
            }
            let again = with_sensor(&after, &mount, None).unwrap();
            assert_eq!(AxisChain::parse(&again).unwrap().sensor_covariance, None);
        }
        let error = with_sensor("sensor = 3", &mount, None).unwrap_err();
        assert_eq!(error.code, "machine");
    }
}
