//! What a cloud is compared with: a plane, cylinder, sphere, cone or torus from a TOML file, or a
//! mesh.

use std::path::Path;

use serde::Deserialize;

use crate::ScanError;
use crate::plan::mesh::read::read_obstacle;
use crate::rigid::Vec3;
use crate::surface::{CompositeSurface, Mesh, Near, outward, read_stl};

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
    /// One nappe without end; outside is away from the axis, and behind the apex.
    Cone {
        /// Its apex.
        apex_mm: Vec3,
        /// Unit vector from the apex into the cone.
        direction: Vec3,
        /// Half of its angle.
        half_angle_rad: f64,
    },
    /// Outside is away from the ring.
    Torus {
        /// Its centre.
        center_mm: Vec3,
        /// Unit vector along its axis.
        direction: Vec3,
        /// Of the ring.
        major_radius_mm: f64,
        /// Of the tube; less than that of the ring.
        minor_radius_mm: f64,
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
    Cone {
        apex_mm: [f64; 3],
        direction: [f64; 3],
        half_angle_deg: f64,
    },
    Torus {
        center_mm: [f64; 3],
        direction: [f64; 3],
        major_radius_mm: f64,
        minor_radius_mm: f64,
    },
}

impl Nominal {
    /// Reads a nominal: `.stl`, `.step`, `.stp` and `.obj` are meshes, all else TOML. STEP becomes
    /// triangles within 0.005 mm.
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
        let is = |name: &str| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case(name))
        };
        if ["step", "stp", "obj"].into_iter().any(is) {
            let mesh = outward(read_obstacle(path)?)?;
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
            NominalText::Cone {
                apex_mm,
                direction,
                half_angle_deg,
            } => {
                if !(half_angle_deg > 0.0 && half_angle_deg < 90.0) {
                    return Err(ScanError::refused(
                        "nominal",
                        "half_angle_deg must be above 0 and below 90",
                    ));
                }
                Self::Cone {
                    apex_mm: finite("apex_mm", apex_mm)?,
                    direction: unit("direction", direction)?,
                    half_angle_rad: half_angle_deg.to_radians(),
                }
            }
            NominalText::Torus {
                center_mm,
                direction,
                major_radius_mm,
                minor_radius_mm,
            } => {
                let (major_radius_mm, minor_radius_mm) =
                    (radius(major_radius_mm)?, radius(minor_radius_mm)?);
                if minor_radius_mm >= major_radius_mm {
                    return Err(ScanError::refused(
                        "nominal",
                        "minor_radius_mm must be below major_radius_mm",
                    ));
                }
                Self::Torus {
                    center_mm: finite("center_mm", center_mm)?,
                    direction: unit("direction", direction)?,
                    major_radius_mm,
                    minor_radius_mm,
                }
            }
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
            Self::Cone {
                apex_mm,
                direction,
                half_angle_rad,
            } => {
                let off = p - apex_mm;
                let height = direction.dot(&off);
                let radial = off - direction * height;
                let across = radial.norm();
                let (sin, cos) = half_angle_rad.sin_cos();
                // The foot on the generator beside the point; behind the apex the apex is nearest.
                if height * cos + across * sin <= 0.0 {
                    return Some(from(off, off.norm()));
                }
                let away = radial
                    .try_normalize(0.0)
                    .unwrap_or_else(|| beside(direction));
                from(away * cos - direction * sin, across * cos - height * sin)
            }
            Self::Torus {
                center_mm,
                direction,
                major_radius_mm,
                minor_radius_mm,
            } => {
                let off = p - center_mm;
                let height = direction.dot(&off);
                let radial = off - direction * height;
                let away = radial
                    .try_normalize(0.0)
                    .unwrap_or_else(|| beside(direction));
                let from_ring = off - away * *major_radius_mm;
                from(from_ring, from_ring.norm() - minor_radius_mm)
            }
            Self::Mesh(surface) => {
                let near = surface.near(p, *hint)?;
                *hint = near.face;
                near
            }
        })
    }

    /// What is odd about it beside these points, but no reason to refuse: what a mesh has for [flaws](crate::surface::Mesh::flaws), and sizes
    /// that look like another unit.
    #[must_use]
    pub fn warnings(&self, points: &[Vec3]) -> Vec<String> {
        let mut warnings = match self.mesh() {
            Some(mesh) => mesh.flaws(),
            None => Vec::new(),
        };
        warnings.extend(self.other_unit(points));
        warnings.extend(self.radians(points));
        warnings
    }

    fn mesh(&self) -> Option<&Mesh> {
        match self {
            Self::Mesh(surface) => surface.mesh.as_ref(),
            _ => None,
        }
    }

    /// A unit in which cloud and nominal would agree, where they do not in millimetres: the cloud lies on a nominal that
    /// is so much larger, or spans as much as such a mesh; or that it lies elsewhere.
    fn other_unit(&self, points: &[Vec3]) -> Option<String> {
        /// A cloud lies on a nominal that is as near as this share of its own size.
        const ON_IT: f64 = 0.01;
        let cloud_mm = span_mm(points);
        let mesh_mm = self.mesh().map(Mesh::diagonal_mm);
        let rms_mm = self.rms_mm(points, 1.0)?;
        let units = [
            (25.4, "the nominal looks like inches"),
            (1000.0, "the nominal looks like metres"),
            (1.0 / 25.4, "the cloud looks like inches"),
            (1e-3, "the cloud looks like metres"),
        ];
        // Where it would lie tells of any nominal. Nearer is not enough: whatever is made much larger comes near to a
        // cloud that lies beside it.
        let then = units.map(|(factor, unit)| Some((self.rms_mm(points, factor)?, factor, unit)));
        let (then_mm, factor, unit) =
            (then.into_iter().flatten()).min_by(|a, b| a.0.total_cmp(&b.0))?;
        let lies_on_it = then_mm < ON_IT * cloud_mm;
        if lies_on_it && 10.0 * then_mm < rms_mm && rms_mm > 0.005 * cloud_mm {
            return Some(format!(
                "unit: {unit}: the cloud is {rms_mm:.3} mm (rms) from the nominal, and {then_mm:.3} mm from one {factor:.4} \
                 times as large"
            ));
        }
        // Its place may be in millimetres all the same.
        let sized = [(25.4, "inches"), (1000.0, "metres")].map(|(factor, unit)| {
            let then_mm = self.with_sizes(factor)?.rms_mm(points, 1.0)?;
            Some((then_mm, unit))
        });
        if let Some((then_mm, unit)) = sized
            .into_iter()
            .flatten()
            .find(|(then_mm, _)| *then_mm < ON_IT * cloud_mm && 10.0 * then_mm < rms_mm)
        {
            return Some(format!(
                "unit: the nominal's radius looks like {unit}: the cloud is {rms_mm:.3} mm (rms) from the nominal, and \
                 {then_mm:.3} mm from one with such a radius"
            ));
        }
        // Sizes that agree tell of a mesh that lies elsewhere; a shape may have no end. A small cloud may be a part of it.
        if let Some(mesh_mm) = mesh_mm
            && rms_mm > 0.05 * cloud_mm.min(mesh_mm)
        {
            let alike = |factor: f64| (0.8..1.25).contains(&(cloud_mm / mesh_mm / factor));
            if let Some((factor, unit)) = units.iter().find(|(factor, _)| alike(*factor)) {
                let or = if *factor < 1.0 {
                    ", or it is a small part of the nominal and lies elsewhere"
                } else {
                    ""
                };
                return Some(format!(
                    "unit: {unit}: the cloud spans {cloud_mm:.1} mm, the nominal {mesh_mm:.1} mm{or}"
                ));
            }
        }
        elsewhere(points, rms_mm)
    }

    /// The same at its place with radii so many times as large; none where it has none.
    fn with_sizes(&self, factor: f64) -> Option<Self> {
        if self.mesh().is_some() {
            return None;
        }
        let mut other = self.clone();
        match &mut other {
            Self::Cylinder { radius_mm, .. } | Self::Sphere { radius_mm, .. } => {
                *radius_mm *= factor;
            }
            Self::Torus {
                major_radius_mm,
                minor_radius_mm,
                ..
            } => {
                *major_radius_mm *= factor;
                *minor_radius_mm *= factor;
            }
            Self::Plane { .. } | Self::Cone { .. } | Self::Mesh(_) => return None,
        }
        Some(other)
    }

    /// A cone that the cloud would lie on if its angle were in radians, where it does not as it stands.
    fn radians(&self, points: &[Vec3]) -> Option<String> {
        let mut other = self.clone();
        let Self::Cone { half_angle_rad, .. } = &mut other else {
            return None;
        };
        let written = half_angle_rad.to_degrees();
        *half_angle_rad = written;
        if written >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let (rms_mm, then_mm) = (self.rms_mm(points, 1.0)?, other.rms_mm(points, 1.0)?);
        (10.0 * then_mm < rms_mm).then(|| {
            format!(
                "angle_unit: half_angle_deg {written} looks like radians: the cloud is {rms_mm:.3} mm (rms) from the nominal, and \
                 {then_mm:.3} mm from one of {:.3} degrees",
                written.to_degrees()
            )
        })
    }

    /// The root mean square of the distances from the nominal made `factor` times as large about the origin, of some
    /// thousand points that are spread evenly over the cloud.
    fn rms_mm(&self, points: &[Vec3], factor: f64) -> Option<f64> {
        const ENOUGH: usize = 4000;
        let step = points.len() / ENOUGH + 1;
        let mut hint = 0;
        let (mut n, mut sum) = (0.0, 0.0);
        for point in points.iter().step_by(step) {
            let mm = factor * self.distance_mm(&(point / factor), &mut hint);
            n += 1.0;
            sum += mm * mm;
        }
        (n > 0.0 && f64::is_finite(sum)).then(|| (sum / n).sqrt())
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

/// That a cloud lies elsewhere, where it is so far from its nominal as no deviation is.
#[must_use]
pub fn elsewhere(points: &[Vec3], rms_mm: f64) -> Option<String> {
    /// Of the cloud's own size.
    const FAR: f64 = 0.5;
    const LEAST_MM: f64 = 1.0;
    let cloud_mm = span_mm(points);
    (rms_mm > LEAST_MM.max(FAR * cloud_mm)).then(|| {
        format!(
            "elsewhere: the cloud spans {cloud_mm:.1} mm and lies {rms_mm:.1} mm (rms) from the nominal: it is in another \
             frame, or of another part; umi scan localise places it"
        )
    })
}

/// From corner to corner of the box about some points.
fn span_mm(points: &[Vec3]) -> f64 {
    let (mut least, mut most) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(-f64::INFINITY));
    for point in points {
        (least, most) = (least.inf(point), most.sup(point));
    }
    (most - least).norm()
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

/// Any unit vector across another.
fn beside(direction: &Vec3) -> Vec3 {
    let axis = Vec3::ith(direction.iamin(), 1.0);
    direction.cross(&axis).normalize()
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
