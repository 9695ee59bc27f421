//! Part, obstacles and specification in the machine's frame.
//!
//! What is found there does not depend on how the part lies in its file, as long as it stands on the machine the same way: only rounding
//! is left of a rigid motion of part and fixture together.

use umi_kinematics::Pose;

use super::super::machine::SensorPose;
use super::super::mesh::{PartMesh, RawMesh};
use super::super::spec::ScanSpec;
use super::samples::SamplePoint;
use crate::surface::Mesh;

/// The same scene, in the frame of the machine with its table at zero.
pub struct OnMachine {
    /// The part.
    pub part: PartMesh,
    /// What stands beside it.
    pub obstacles: Vec<Mesh>,
    /// The specification, of which the part's frame is the machine's.
    pub spec: ScanSpec,
    place: Pose,
}

impl OnMachine {
    /// None where the part's frame is the machine's already, or so far off that rounding leaves no surface there.
    pub fn new(part: &PartMesh, obstacles: &[Mesh], spec: &ScanSpec) -> Option<Self> {
        let place = spec.machine.chain.workpiece;
        if place == Pose::identity() {
            return None;
        }
        let raw = RawMesh {
            vertices: part.vertices.iter().map(|v| place.point(v)).collect(),
            faces: part.faces.iter().map(|f| f.map(|k| k as usize)).collect(),
        };
        let mut moved = PartMesh::weld(raw, true).ok()?;
        moved.dropped += part.dropped;
        moved.inset_mm = part.inset_mm;
        let mesh = |mesh: &Mesh| {
            let triangles = mesh.triangles().iter();
            let corners: Vec<_> = triangles
                .map(|t| t.corners.map(|c| place.point(&c)))
                .collect();
            Mesh::new(&corners).ok()
        };
        let obstacles = obstacles.iter().map(mesh).collect::<Option<_>>()?;
        let mut spec = spec.clone();
        spec.machine.chain.workpiece = Pose::identity();
        Some(OnMachine {
            part: moved,
            obstacles,
            spec,
            place,
        })
    }

    /// A pose on the part, in the machine's frame.
    pub fn pose(&self, on_part: &SensorPose) -> SensorPose {
        SensorPose {
            origin_mm: self.place.point(&on_part.origin_mm),
            beam: self.place.rotation * on_part.beam,
            line: self.place.rotation * on_part.line,
        }
    }

    /// A point of the surface, in the part's frame again. Its triangle is the placed part's.
    pub fn back(&self, point: &SamplePoint) -> SamplePoint {
        let rotation = &self.place.rotation;
        SamplePoint {
            at: rotation.tr_mul(&(point.at - self.place.translation_mm)),
            normal: rotation.tr_mul(&point.normal),
            face: point.face,
        }
    }
}
