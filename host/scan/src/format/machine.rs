//! The machine file, from disk.

use std::path::Path;

use toml_edit::{Array, DocumentMut, Item, Table, value};
use umi_kinematics::{AxisChain, Pose};

use crate::ScanError;

/// Reads a machine file.
///
/// # Errors
/// The file cannot be read; code `machine` where it describes none.
pub fn read(path: &Path) -> Result<AxisChain, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    AxisChain::parse(&text).map_err(|error| {
        let mut error = ScanError::from(error);
        error.message = format!("{}: {}", path.display(), error.message);
        error
    })
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
