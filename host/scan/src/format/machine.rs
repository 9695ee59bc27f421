//! The machine file, from disk.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Item, Table, TableLike, Value, value};
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
    let mut file = document(text)?;
    let sensor = file
        .entry("sensor")
        .or_insert_with(|| Item::Table(Table::new()))
        .as_table_like_mut()
        .ok_or_else(|| wrong("sensor is no table"))?;
    let rows = |rows: &mut dyn Iterator<Item = Array>| value(rows.collect::<Array>());
    let rotation = mount.rows();
    put(
        sensor,
        "rotation",
        rows(&mut rotation.iter().map(|row| row.iter().copied().collect())),
    );
    put(sensor, "translation_mm", three(mount.translation_mm.into()));
    match covariance {
        Some(covariance) => {
            let rows = rows(&mut covariance.iter().map(|row| row.iter().copied().collect()));
            put(sensor, "covariance", rows);
        }
        None => {
            sensor.remove("covariance");
        }
    }
    checked(&file)
}

/// The text of a machine file with another line of one of its rotary axes; comments and all else stay as they are.
///
/// # Errors
/// `machine` where the text describes none, none comes of it, or the joint is no rotary one; `missing_axis` where it has no
/// such joint.
pub fn with_axis(
    text: &str,
    name: &str,
    direction: [f64; 3],
    point_mm: [f64; 3],
) -> Result<String, ScanError> {
    rotary(&AxisChain::parse(text).map_err(ScanError::from)?, name)?;
    let mut file = document(text)?;
    let is_it = |joint: &dyn TableLike| joint.get("name").and_then(Item::as_str) == Some(name);
    // [[joint]], or joint = [{ … }].
    let joint = match file.get_mut("joint") {
        Some(Item::ArrayOfTables(all)) => all
            .iter_mut()
            .map(|joint| joint as &mut dyn TableLike)
            .find(|joint| is_it(&**joint)),
        Some(Item::Value(Value::Array(all))) => all
            .iter_mut()
            .filter_map(Value::as_inline_table_mut)
            .map(|joint| joint as &mut dyn TableLike)
            .find(|joint| is_it(&**joint)),
        _ => None,
    };
    let joint = joint.ok_or_else(|| wrong(format_args!("joint {name} is no table")))?;
    put(joint, "direction", three(direction));
    put(joint, "point_mm", three(point_mm));
    checked(&file)
}

/// A rotary joint by its name.
///
/// # Errors
/// `missing_axis`; `machine` where it is a linear one.
pub fn rotary<'a>(machine: &'a AxisChain, name: &str) -> Result<&'a Joint, ScanError> {
    let joint = machine.joints.iter().find(|joint| joint.name == name);
    let Some(joint) = joint else {
        let rotary = (machine.joints.iter())
            .filter(|joint| joint.kind == JointKind::Rotary)
            .map(|joint| joint.name.as_str());
        let rotary: Vec<&str> = rotary.collect();
        let has = match rotary.len() {
            0 => "it has no rotary one".to_owned(),
            _ => format!("its rotary ones are {}", rotary.join(", ")),
        };
        return Err(ScanError::refused(
            "missing_axis",
            format_args!("the machine has no joint {name}: {has}"),
        ));
    };
    if joint.kind == JointKind::Linear {
        return Err(ScanError::refused(
            "machine",
            format_args!(
                "{name} is a linear axis: only a rotary one has a line that it turns about"
            ),
        ));
    }
    Ok(joint)
}

fn wrong(message: impl std::fmt::Display) -> ScanError {
    ScanError::unreadable("machine", message)
}

fn document(text: &str) -> Result<DocumentMut, ScanError> {
    text.parse()
        .map_err(|error: toml_edit::TomlError| wrong(error.to_string().trim()))
}

/// The text, if it is a machine file still.
fn checked(file: &DocumentMut) -> Result<String, ScanError> {
    let text = file.to_string();
    AxisChain::parse(&text).map_err(ScanError::from)?;
    Ok(text)
}

fn three(xyz: [f64; 3]) -> Item {
    value(Array::from_iter(xyz))
}

/// Another value by the same key; what stands about the old one, as a comment behind it, stays.
fn put(table: &mut dyn TableLike, key: &str, mut item: Item) {
    let about = table.get(key).and_then(Item::as_value).map(Value::decor);
    if let (Some(about), Some(new)) = (about.cloned(), item.as_value_mut()) {
        *new.decor_mut() = about;
    }
    table.insert(key, item);
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
        let before = "# mine\n[chain] # none\nsensor = []\n\n# where it sits\n[sensor]\nrotation = [\n  [1, 0, 0], [0, 1, 0],\n  [0, 0, 1],\n] # turned\n# behind\n[workpiece]\ntranslation_mm = [1, 2, 3]\n";
        for text in [before, "[chain]\nsensor = []\n"] {
            let after = with_sensor(text, &mount, Some(&covariance)).unwrap();
            let machine = AxisChain::parse(&after).unwrap();
            assert_eq!(machine.sensor, mount);
            assert_eq!(machine.sensor_covariance, Some(covariance));
            for comment in text.lines().filter_map(|l| l.find('#').map(|at| &l[at..])) {
                assert!(after.contains(comment), "{comment} is not in\n{after}");
            }
            let again = with_sensor(&after, &mount, None).unwrap();
            assert_eq!(AxisChain::parse(&again).unwrap().sensor_covariance, None);
        }
        let error = with_sensor("sensor = 3", &mount, None).unwrap_err();
        assert_eq!(error.code, "machine");
    }

    /// Only the two lines of the joint differ, comments behind them stay, and what no such joint is is refused by name.
    #[test]
    fn a_new_axis_changes_its_two_lines_alone() {
        let blocks = "# mine\n[[joint]]\nname = \"X\"\nkind = \"linear\"\ndirection = [1, 0, 0] # along\n\n[[joint]]\nname = \"C\"\n\
                      kind = \"rotary\"\ndirection = [0, 0, 1]      # the axis\npoint_mm = [0, 0, 0]       # any point\nvalue = 3.5 # on it\n\n\
                      [chain]\nsensor = [\"X\"]\nworkpiece = [\"C\"]\n\n[sensor] # last\ntranslation_mm = [1, 2, 3]\n";
        let inline = "joint = [\n  { name = \"C\", kind = \"rotary\", direction = [0, 0, 1], point_mm = [0, 0, 0] }, # one\n]\n\
                      [chain]\nsensor = []\nworkpiece = [\"C\"]\n";
        let (direction, point) = ([1e-4, -3e-4, 1.0], [12.5, -1.0 / 3.0, 1e-9]);
        for (text, changed) in [(blocks, 2), (inline, 1)] {
            let after = with_axis(text, "C", direction, point).unwrap();
            let machine = AxisChain::parse(&after).unwrap();
            let joint = machine.joints.iter().find(|j| j.name == "C").unwrap();
            assert_eq!(joint.point_mm, Vector3::from(point));
            assert!((joint.direction - Vector3::from(direction).normalize()).norm() < 1e-15);
            assert_eq!(text.lines().count(), after.lines().count());
            let differ = text.lines().zip(after.lines()).filter(|(a, b)| a != b);
            let differ: Vec<_> = differ.collect();
            assert_eq!(differ.len(), changed, "{differ:?}");
            for (old, new) in differ {
                let comment = old.find('#').map_or("", |at| &old[at..]);
                assert!(new.ends_with(comment), "{new} lost {comment}");
            }
        }
        for (name, code) in [("X", "machine"), ("B", "missing_axis")] {
            let error = with_axis(blocks, name, direction, point).unwrap_err();
            assert_eq!(error.code, code);
            assert!(error.message.contains(name), "{error:?}");
        }
    }
}
