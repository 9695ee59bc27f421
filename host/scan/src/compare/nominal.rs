//! What a cloud is compared with: a plane, cylinder or sphere from a TOML file, or a mesh.

use std::path::Path;

use serde::Deserialize;

use crate::ScanError;
use crate::rigid::Vec3;
use crate::surface::{CompositeSurface, Near, read_stl};

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
        self.near(p, hint).map_or(f64::NAN, |near| near.distance_mm)
    }

    /// The same with the direction in which the distance grows; none for a mesh without a face.
    #[must_use]
    pub fn near(&self, p: &Vec3, hint: &mut usize) -> Option<Near> {
        let from = |off: Vec3, distance_mm: f64| Near {
            distance_mm,
            direction: off.try_normalize(0.0).unwrap_or_else(Vec3::z),
            face: 0,
        };
        Some(match self {
            Self::Plane { point_mm, normal } => from(*normal, normal.dot(&(p - point_mm))),
            Self::Cylinder {
                point_mm,
                direction,
                radius_mm,
            } => {
                let off = p - point_mm;
                from(
                    off - direction * direction.dot(&off),
                    direction.cross(&off).norm() - radius_mm,
                )
            }
            Self::Sphere {
                center_mm,
                radius_mm,
            } => from(p - center_mm, (p - center_mm).norm() - radius_mm),
            Self::Mesh(surface) => {
                let near = surface.near(p, *hint)?;
                *hint = near.face;
                near
            }
        })
    }

    /// Where the plane across an axis (0 X, 1 Y, 2 Z) cuts a mesh; nothing for other nominals.
    #[must_use]
    pub fn section(&self, axis: usize, at_mm: f64) -> Vec<[Vec3; 2]> {
        let Self::Mesh(surface) = self else {
            return Vec::new();
        };
        let triangles = surface.mesh.iter().flat_map(|mesh| mesh.triangles());
        triangles
            .filter_map(|triangle| cut(&triangle.corners, axis, at_mm))
            .collect()
    }
}

/// Where a plane cuts a triangle. A corner on the plane counts as above it.
fn cut(corners: &[Vec3; 3], axis: usize, at_mm: f64) -> Option<[Vec3; 2]> {
    let mut ends = (0..3).filter_map(|k| {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let (u, v) = (a[axis] - at_mm, b[axis] - at_mm);
        ((u >= 0.0) != (v >= 0.0)).then(|| a + (b - a) * (u / (u - v)))
    });
    Some([ends.next()?, ends.next()?])
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
