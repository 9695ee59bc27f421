//! The file of fiducials.

use std::path::{Path, PathBuf};

use nalgebra::Rotation3;
use serde::Deserialize;

use super::{Fiducial, FiducialShape};
use crate::ScanError;
use crate::rigid::{Vec3, pose_of_rows};
use crate::surface::read_stl;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    fiducial: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    shape: Shape,
    position_mm: [f64; 3],
    /// Rows.
    rotation: Option<[[f64; 3]; 3]>,
    /// About X, then Y, then Z of the machine.
    rotation_deg: Option<[f64; 3]>,
    #[serde(default)]
    u_position_mm: f64,
    #[serde(default)]
    u_rotation_rad: f64,
    #[serde(default)]
    carried: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Shape {
    Mesh(PathBuf),
    Sphere { radius_mm: f64 },
    Cone { half_angle_deg: f64, height_mm: f64 },
}

/// Reads fiducials; meshes are found beside the file.
///
/// # Errors
/// `bad_file` with what is wrong; as [`read_stl`] for the meshes.
pub fn read_fiducials(path: &Path) -> Result<Vec<Fiducial>, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    let bad = |what: &dyn std::fmt::Display| {
        ScanError::unreadable("bad_file", format_args!("{}: {what}", path.display()))
    };
    let file: File = toml::from_str(&text).map_err(|error| bad(&error))?;
    if file.fiducial.is_empty() {
        return Err(bad(&"no [[fiducial]] is in it"));
    }
    let mut all: Vec<Fiducial> = Vec::new();
    for entry in file.fiducial {
        let of = |what: &str| bad(&format_args!("fiducial {}: {what}", entry.name));
        if all.iter().any(|other| other.name == entry.name) {
            return Err(of("there are two of this name"));
        }
        let shape = shape(entry.shape, path.parent().unwrap_or(Path::new("")), &of)?;
        let rotation = match (entry.rotation, entry.rotation_deg) {
            (Some(_), Some(_)) => return Err(of("give rotation or rotation_deg, not both")),
            (Some(rows), None) => rows,
            (None, deg) => turned(deg.unwrap_or_default()),
        };
        let pose = pose_of_rows(&rotation, &entry.position_mm).ok_or_else(|| {
            of("rotation is three rows of a rotation that turns and does not mirror, position_mm three numbers")
        })?;
        // Above that it is no uncertainty of a place, and its square may be no number.
        if !(0.0..=1e3).contains(&entry.u_position_mm)
            || !(0.0..=1.0).contains(&entry.u_rotation_rad)
        {
            return Err(of(
                "u_position_mm is a number from 0 to 1000, u_rotation_rad one from 0 to 1",
            ));
        }
        all.push(Fiducial {
            name: entry.name,
            shape,
            pose,
            u_position_mm: entry.u_position_mm,
            u_rotation_rad: entry.u_rotation_rad,
            carried: entry.carried,
        });
    }
    Ok(all)
}

fn shape(
    shape: Shape,
    folder: &Path,
    bad: &impl Fn(&str) -> ScanError,
) -> Result<FiducialShape, ScanError> {
    let size = |x: f64| x.is_finite() && x > 0.0;
    match shape {
        Shape::Mesh(file) => Ok(FiducialShape::Mesh(read_stl(&folder.join(file))?)),
        Shape::Sphere { radius_mm } if size(radius_mm) => Ok(FiducialShape::Ball { radius_mm }),
        Shape::Cone {
            half_angle_deg,
            height_mm,
        } if size(height_mm) && size(half_angle_deg) && half_angle_deg < 85.0 => {
            Ok(FiducialShape::Cone {
                half_angle_rad: half_angle_deg.to_radians(),
                height_mm,
            })
        }
        _ => Err(bad(
            "sizes are positive, and a cone's half_angle_deg is below 85",
        )),
    }
}

/// The rows of a turn about X, then Y, then Z.
fn turned(deg: [f64; 3]) -> [[f64; 3]; 3] {
    let turn = |axis: Vec3, deg: f64| Rotation3::new(axis * deg.to_radians()).matrix().to_owned();
    let r = turn(Vec3::z(), deg[2]) * turn(Vec3::y(), deg[1]) * turn(Vec3::x(), deg[0]);
    std::array::from_fn(|i| std::array::from_fn(|k| r[(i, k)]))
}
