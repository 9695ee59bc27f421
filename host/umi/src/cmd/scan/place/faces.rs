//! The file that says what each face of a part demands.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use umi_scan::ScanError;
use umi_scan::stock::{Demand, Rule};
use umi_scan::surface::read_stl;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    face: Vec<Face>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Face {
    name: String,
    mesh: PathBuf,
    stock_mm: Option<f64>,
    profile_mm: Option<f64>,
}

/// Reads the faces; the meshes are found beside the file.
pub fn read(path: &Path) -> Result<Vec<Demand>, ScanError> {
    let text =
        std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
    let bad = |what: &dyn std::fmt::Display| {
        ScanError::unreadable("bad_file", format_args!("{}: {what}", path.display()))
    };
    let file: File = toml::from_str(&text).map_err(|error| bad(&error))?;
    let mut demands = Vec::new();
    for face in file.face {
        let rule = match (face.stock_mm, face.profile_mm) {
            (Some(stock), None) if stock.is_finite() => Rule::Stock(stock),
            (None, Some(width)) if width.is_finite() && width > 0.0 => Rule::Profile(width),
            _ => {
                return Err(bad(&format_args!(
                    "the face `{}` needs either stock_mm or profile_mm, in mm",
                    face.name
                )));
            }
        };
        let beside = path.parent().unwrap_or(Path::new("")).join(&face.mesh);
        demands.push(Demand {
            mesh: read_stl(&beside)?,
            name: face.name,
            rule,
        });
    }
    Ok(demands)
}
