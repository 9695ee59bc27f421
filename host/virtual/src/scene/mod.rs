//! The scene: bodies on the machine's table, probe, tools and control.
//!
//! A scene is a TOML file: the machine with its errors, its control and probe, work
//! offsets and tools, and bodies that can be touched. Bodies may belong to a group,
//! which is placed as one: a fixture plate with all that is on it.
//!
//! ```
//! use nalgebra::Vector3;
//! use umi_virtual::scene::Scene;
//!
//! let scene = Scene::parse(
//!     r#"
//!     [[body]]
//!     name = "BALL"
//!     shape = { sphere = { radius_mm = 12.7 } }
//!     position_mm = [10.0, 0.0, 50.0]
//!     "#,
//! )?;
//! // A ball of 2.5 mm comes from above.
//! let contact = scene
//!     .first_contact(&Vector3::new(10.0, 0.0, 100.0), &Vector3::new(10.0, 0.0, 60.0), 2.5, |_| true)
//!     .expect("the ball is there");
//! assert!((contact.center_mm.z - (50.0 + 12.7 + 2.5)).abs() < 1e-9);
//! # Ok::<(), umi_virtual::scene::SceneError>(())
//! ```

mod area_scanner;
mod error;
mod file;
mod line_scanner;
mod mesh;
mod range;
mod rotary;
mod sensor;
mod shape;
mod trace;

#[cfg(test)]
mod tests;

use std::path::Path;

use nalgebra::{Matrix3, Vector3};
use umi_core::registration::RigidTransform;

use crate::nc::OffsetSystem;

pub use area_scanner::AreaScannerSpec;
pub use error::SceneError;
pub use file::{ControlSpec, MachineSpec, ProbeSpec, Stores, ToolSpec};
pub use line_scanner::{LineScannerSpec, SCANNER_PRESETS};
pub use mesh::{BeamEnd, SceneMesh};
pub use rotary::{AxisLoad, RotarySpec};
pub use sensor::PointSensorSpec;
pub use shape::SceneShape;
pub use trace::Collision;

/// A machine, its control and probe, and what stands on its table.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The machine.
    pub machine: MachineSpec,
    /// Its control.
    pub control: ControlSpec,
    /// Its probe.
    pub probe: ProbeSpec,
    /// Its distance sensor, if it has one.
    pub point_sensor: Option<PointSensorSpec>,
    /// Its area scanner, if it has one.
    pub scanner: Option<AreaScannerSpec>,
    /// Its line scanner, if it has one.
    pub line_scanner: Option<LineScannerSpec>,
    /// Work offsets of the control at the start, machine coordinates.
    pub offsets_mm: Vec<(OffsetSystem, [f64; 3])>,
    /// Workpiece setting errors of the control (`G54.4 P`) by number: along X, Y, Z in mm,
    /// about X, then Y, then Z in degrees.
    pub setting_errors: Vec<(u8, [f64; 6])>,
    /// Tools in the magazine.
    pub tools: Vec<(u32, ToolSpec)>,
    bodies: Vec<Body>,
    groups: Vec<Group>,
}

/// A solid at its place.
#[derive(Clone, Debug)]
pub struct Body {
    /// Its name, for messages.
    pub name: String,
    /// What it is.
    pub shape: SceneShape,
    /// A tool whose spindle turns passes through it: the
    /// [`Cutter`](crate::cutting::Cutter), not the machine, judges what it does there.
    pub cuttable: bool,
    /// Raw material above it, where it may be cut.
    pub stock_mm: f64,
    /// Body to its group, or to the machine.
    pose: RigidTransform,
    /// Its place in the list of groups.
    group: Option<usize>,
    /// Body to machine.
    placed: RigidTransform,
}

#[derive(Clone, Debug)]
struct Group {
    name: String,
    pose: RigidTransform,
}

/// The first contact of a ball that moves on a straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact<'a> {
    /// The body that is touched.
    pub body: &'a Body,
    /// Way of the ball's centre up to the contact, mm.
    pub way_mm: f64,
    /// Where the ball's centre is.
    pub center_mm: Vector3<f64>,
    /// Outward normal of the body at the contact, unit.
    pub normal: Vector3<f64>,
}

/// A gap below this is a contact, mm.
const TOUCH_MM: f64 = 1e-10;

impl Scene {
    /// Reads a scene.
    ///
    /// # Errors
    /// What is wrong, with line and column.
    pub fn parse(text: &str) -> Result<Self, SceneError> {
        Self::parse_in(text, Path::new(""))
    }

    /// Reads a scene whose text stands in this folder: from there the names of its files count.
    ///
    /// # Errors
    /// As [`Self::parse`], and a mesh that cannot be read or is not closed.
    pub fn parse_in(text: &str, folder: &Path) -> Result<Self, SceneError> {
        file::parse(text, folder)
    }

    /// The first body that a beam meets within a way, of those that count, and where;
    /// `direction` is a unit vector.
    pub fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
        counts: impl Fn(&Body) -> bool,
    ) -> Option<(&Body, BeamEnd)> {
        let mut first: Option<(&Body, BeamEnd)> = None;
        for body in self.bodies.iter().filter(|body| counts(body)) {
            let far_mm = first.map_or(far_mm, |(_, end)| end.way_mm);
            if let Some(end) = body.beam(from_mm, direction, far_mm) {
                first = Some((body, end));
            }
        }
        first
    }

    /// The bodies, placed.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The pose of a group (group to machine); none if there is no such group.
    #[must_use]
    pub fn pose(&self, group: &str) -> Option<RigidTransform> {
        let group = self.groups.iter().find(|g| g.name == group)?;
        Some(group.pose)
    }

    /// Places a group. False if there is none of this name.
    pub fn place(&mut self, group: &str, pose: RigidTransform) -> bool {
        let Some(number) = self.groups.iter().position(|g| g.name == group) else {
            return false;
        };
        if let Some(group) = self.groups.get_mut(number) {
            group.pose = pose;
        }
        for body in &mut self.bodies {
            if body.group == Some(number) {
                body.placed = joined(&pose, &body.pose);
            }
        }
        true
    }

    /// Distance of a ball's surface from the nearest body; negative in contact.
    pub fn clearance(
        &self,
        center_mm: &Vector3<f64>,
        radius_mm: f64,
        counts: impl Fn(&Body) -> bool,
    ) -> f64 {
        self.nearest(center_mm, &counts)
            .map_or(f64::INFINITY, |(_, distance)| distance - radius_mm)
    }

    /// The first contact of a ball on its way; none if there is none. A ball that
    /// starts in contact touches at once.
    pub fn first_contact(
        &self,
        from_mm: &Vector3<f64>,
        to_mm: &Vector3<f64>,
        radius_mm: f64,
        counts: impl Fn(&Body) -> bool,
    ) -> Option<Contact<'_>> {
        let way_mm = trace::first_closed(from_mm, to_mm, |p| {
            self.clearance(p, radius_mm, &counts) - TOUCH_MM
        })?;
        let direction = (to_mm - from_mm).try_normalize(0.0).unwrap_or_default();
        let center_mm = from_mm + direction * way_mm;
        let (body, _) = self.nearest(&center_mm, &counts)?;
        Some(body.contact(way_mm, center_mm))
    }

    fn nearest(&self, p: &Vector3<f64>, counts: &impl Fn(&Body) -> bool) -> Option<(&Body, f64)> {
        let mut nearest: Option<(&Body, f64)> = None;
        for body in self.bodies.iter().filter(|body| counts(body)) {
            let distance = body.distance_mm(p);
            if nearest.is_none_or(|(_, least)| distance < least) {
                nearest = Some((body, distance));
            }
        }
        nearest
    }
}

impl Body {
    /// Body to machine.
    #[must_use]
    pub fn placed(&self) -> &RigidTransform {
        &self.placed
    }

    /// Distance of a point from its surface, mm; negative inside.
    #[must_use]
    pub fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        self.shape.distance_mm(&self.local(p))
    }

    /// Outward normal of its surface nearest to a point, unit.
    #[must_use]
    pub fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.placed.rotation * self.shape.normal(&self.local(p))
    }

    /// Where a beam first meets it within a way; `direction` is a unit vector.
    #[must_use]
    pub fn beam(
        &self,
        from_mm: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        let own = self.placed.rotation.transpose() * direction;
        let end = self.shape.beam(&self.local(from_mm), &own, far_mm)?;
        Some(BeamEnd {
            normal: self.placed.rotation * end.normal,
            ..end
        })
    }

    fn local(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.placed.rotation.transpose() * (p - self.placed.translation_mm)
    }

    fn contact(&self, way_mm: f64, center_mm: Vector3<f64>) -> Contact<'_> {
        Contact {
            body: self,
            way_mm,
            center_mm,
            normal: self.normal(&center_mm),
        }
    }
}

impl PartialEq for Body {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

/// First `inner`, then `outer`.
fn joined(outer: &RigidTransform, inner: &RigidTransform) -> RigidTransform {
    RigidTransform {
        rotation: outer.rotation * inner.rotation,
        translation_mm: outer.rotate(&inner.translation_mm) + outer.translation_mm,
    }
}

/// The pose `p -> R (p - pivot) + pivot + translation`, R turning about X, then Y, then
/// Z of the fixed axes by these degrees.
#[must_use]
pub fn pose(
    translation_mm: [f64; 3],
    rotation_deg: [f64; 3],
    pivot_mm: [f64; 3],
) -> RigidTransform {
    let [x, y, z] = rotation_deg.map(f64::to_radians);
    let rotation = turn(2, z) * turn(1, y) * turn(0, x);
    let pivot = Vector3::from(pivot_mm);
    RigidTransform {
        rotation,
        translation_mm: pivot + Vector3::from(translation_mm) - rotation * pivot,
    }
}

fn turn(axis: usize, angle: f64) -> Matrix3<f64> {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    match axis {
        0 => Matrix3::new(1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c),
        1 => Matrix3::new(c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c),
        _ => Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
    }
}
