//! The frame in which a machine is written down is free.

use toml::{Table, Value};
use umi_kinematics::Pose;
use umi_scan::rigid::{Vec3, rotation};

use crate::rig::run::{Folder, project, umi};

const CASE: &str = "tests/reference/scan/merge_5axis_latency";

fn vector(value: &Value) -> Vec3 {
    let mm = value.as_array().unwrap().iter();
    let mm: Vec<f64> = mm.map(|v| v.as_float().unwrap()).collect();
    Vec3::from_column_slice(&mm)
}

fn array(v: &Vec3) -> Value {
    Value::Array(v.iter().map(|x| Value::Float(*x)).collect())
}

fn pose(value: &Value) -> Pose {
    let mut pose = Pose::identity();
    for (i, row) in value["rotation"].as_array().unwrap().iter().enumerate() {
        pose.rotation.set_row(i, &vector(row).transpose());
    }
    pose.translation_mm = vector(&value["translation_mm"]);
    pose
}

/// Puts a motion behind a pose of the file.
fn move_pose(motion: &Pose, value: &mut Value) {
    let moved = motion.after(&pose(value));
    let rows = moved.rotation.row_iter().map(|row| array(&row.transpose()));
    value["rotation"] = Value::Array(rows.collect());
    value["translation_mm"] = array(&moved.translation_mm);
}

/// All axes, the sensor and the workpiece of a machine are moved together: the cloud, in the workpiece's frame, stays as it
/// is. All but the workpiece: the cloud moves by that motion, seen from there.
#[test]
fn a_motion_of_the_machines_frame_moves_the_cloud_by_that_motion() {
    let folder = Folder::new();
    let text = std::fs::read_to_string(project(&format!("{CASE}.toml"))).unwrap();
    let before: Table = text.parse().unwrap();
    let merged = |name: &str, machine: &Table| -> Vec<Vec3> {
        let machine = folder.file(&format!("{name}.toml"), machine.to_string());
        let out = folder.path(&format!("{name}.csv"));
        let [profiles, triggers] =
            ["profiles", "triggers"].map(|of| project(&format!("{CASE}.{of}.csv")));
        let args = ["scan", "merge", &profiles, &triggers, "--machine", &machine];
        umi(&[&args[..], &["--latency-us", "137", "-o", &out]].concat()).exits(0);
        let text = std::fs::read_to_string(&out).unwrap();
        let row = |line: &str| {
            let cells = line.split(',').skip(2).map(|cell| cell.parse().unwrap());
            Vec3::from_iterator(cells)
        };
        text.lines().skip(1).map(row).collect()
    };
    let cloud = merged("before", &before);
    assert!(cloud.len() > 100);
    let workpiece = pose(&before["workpiece"]);
    for (number, angles) in [[0.4, -1.1, 0.3], [-2.5, 0.2, 1.7]].into_iter().enumerate() {
        let motion = Pose {
            rotation: rotation(&Vec3::from(angles)),
            translation_mm: Vec3::new(300.0, -70.0, 1200.0),
        };
        let mut moved = before.clone();
        for joint in moved["joint"].as_array_mut().unwrap() {
            joint["direction"] = array(&(motion.rotation * vector(&joint["direction"])));
            if let Some(point) = joint.get("point_mm").map(vector) {
                joint["point_mm"] = array(&motion.point(&point));
            }
        }
        move_pose(&motion, &mut moved["sensor"]);
        let seen = workpiece.inverse().after(&motion).after(&workpiece);
        let far = |name: &str, machine: &Table, expected: &dyn Fn(&Vec3) -> Vec3| {
            let found = merged(&format!("{name}{number}"), machine);
            assert_eq!(found.len(), cloud.len());
            let off = cloud
                .iter()
                .zip(&found)
                .map(|(was, is)| (is - expected(was)).norm());
            off.fold(0.0, f64::max)
        };
        let off_mm = far("half", &moved, &|p| seen.point(p));
        assert!(off_mm < 1e-9, "{off_mm}");
        move_pose(&motion, &mut moved["workpiece"]);
        let off_mm = far("moved", &moved, &|p| *p);
        assert!(off_mm < 1e-9, "{off_mm}");
    }
}
