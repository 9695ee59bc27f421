//! What a cloud is compared with: a plane, cylinder or sphere from a TOML file, or a mesh.

use std::path::Path;

use serde::Deserialize;

use crate::ScanError;
use crate::rigid::Vec3;
use crate::surface::{CompositeSurface, read_stl};

/// A surface with an outward side.
#[derive(Debug, Clone)]
pub enum Nominal {
    /// Outside is where the normal points.
    Plane {
        /// Any point of it.
        point_mm: Vec3,
        /// Unit vector.
        normal: Vec3,
    },
    /// Outside is away from the axis.
    Cylinder {
        /// Any point of the axis.
        point_mm: Vec3,
        /// Unit vector along the axis.
        direction: Vec3,
        /// Its radius.
        radius_mm: f64,
    },
    /// Outside is away from the centre.
    Sphere {
        /// Its centre.
        center_mm: Vec3,
        /// Its radius.
        radius_mm: f64,
    },
    /// Outside is where the faces look.
    Mesh(Box<CompositeSurface>),
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
enum NominalText {
    Plane {
        point_mm: [f64; 3],
        normal: [f64; 3],
    },
    Cylinder {
        point_mm: [f64; 3],
        direction: [f64; 3],
        radius_mm: f64,
    },
    Sphere {
        center_mm: [f64; 3],
        radius_mm: f64,
    },
}

impl Nominal {
    /// Reads a nominal: `.stl` is a mesh, all else TOML.
    ///
    /// # Errors
    /// `nominal` where the file describes none, or the mesh's own.
    pub fn read(path: &Path) -> Result<Self, ScanError> {
        if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("stl"))
        {
            let mesh = read_stl(path)?;
            return Ok(Self::Mesh(Box::new(CompositeSurface::from(mesh))));
        }
        let text =
            std::fs::read_to_string(path).map_err(|error| ScanError::file("read", path, &error))?;
        Self::parse(&text).map_err(|mut error| {
            error.message = format!("{}: {}", path.display(), error.message);
            error
        })
    }

    /// Reads a TOML description.
    ///
    /// # Errors
    /// `nominal`.
    pub fn parse(text: &str) -> Result<Self, ScanError> {
        let text: NominalText = toml::from_str(text)
            .map_err(|error| ScanError::unreadable("nominal", error.to_string().trim()))?;
        Ok(match text {
            NominalText::Plane { point_mm, normal } => Self::Plane {
                point_mm: finite("point_mm", point_mm)?,
                normal: unit("normal", normal)?,
            },
            NominalText::Cylinder {
                point_mm,
                direction,
                radius_mm,
            } => Self::Cylinder {
                point_mm: finite("point_mm", point_mm)?,
                direction: unit("direction", direction)?,
                radius_mm: radius(radius_mm)?,
            },
            NominalText::Sphere {
                center_mm,
                radius_mm,
            } => Self::Sphere {
                center_mm: finite("center_mm", center_mm)?,
                radius_mm: radius(radius_mm)?,
            },
        })
    }

    /// The signed distance of a point, positive outside. `hint`: the face that was nearest a
    /// moment ago.
    #[must_use]
    pub fn distance_mm(&self, p: &Vec3, hint: &mut usize) -> f64 {
        match self {
            Self::Plane { point_mm, normal } => normal.dot(&(p - point_mm)),
            Self::Cylinder {
                point_mm,
                direction,
                radius_mm,
            } => direction.cross(&(p - point_mm)).norm() - radius_mm,
            Self::Sphere {
                center_mm,
                radius_mm,
            } => (p - center_mm).norm() - radius_mm,
            Self::Mesh(surface) => surface.near(p, *hint).map_or(f64::NAN, |near| {
                *hint = near.face;
                near.distance_mm
            }),
        }
    }
}

fn finite(name: &str, values: [f64; 3]) -> Result<Vec3, ScanError> {
    if values.iter().all(|v| v.is_finite()) {
        return Ok(Vec3::from(values));
    }
    Err(ScanError::refused(
        "nominal",
        format_args!("{name} is not finite"),
    ))
}

fn unit(name: &str, values: [f64; 3]) -> Result<Vec3, ScanError> {
    let vector = finite(name, values)?;
    let largest = vector.amax();
    if largest == 0.0 {
        return Err(ScanError::refused(
            "nominal",
            format_args!("{name} has length 0"),
        ));
    }
    Ok((vector / largest).normalize())
}

fn radius(radius_mm: f64) -> Result<f64, ScanError> {
    if radius_mm.is_finite() && radius_mm > 0.0 {
        return Ok(radius_mm);
    }
    Err(ScanError::refused("nominal", "radius_mm must be above 0"))
}
