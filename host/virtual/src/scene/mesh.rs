//! A solid of triangles, from a file.

use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;
use serde::Deserialize;
use umi_scan::surface::{Mesh, read_stl};

/// A closed surface of triangles.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneMesh {
    /// An STL file in mm; where its path is relative, from the scene's folder.
    file: String,
    /// Its triangles, once they are read.
    #[serde(skip)]
    surface: Option<Arc<Mesh>>,
}

/// Where a beam ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamEnd {
    /// Way along the beam, mm.
    pub way_mm: f64,
    /// The surface's outward normal there, unit.
    pub normal: Vector3<f64>,
}

impl SceneMesh {
    /// A solid of triangles, which must enclose it: a body has an inside.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn new(name: &str, surface: Mesh) -> Result<Self, String> {
        if !surface.is_closed() {
            return Err(format!(
                "the mesh {name} is not closed: some edges have a triangle on one side only, \
                 or their sides are not alike; export it as a solid"
            ));
        }
        Ok(Self {
            file: name.to_owned(),
            surface: Some(Arc::new(surface)),
        })
    }

    /// Reads the file of a mesh that came with a scene's text.
    pub(super) fn load(&mut self, folder: &Path) -> Result<(), String> {
        if self.surface.is_none() {
            let path = folder.join(&self.file);
            let surface = read_stl(&path).map_err(|error| error.message)?;
            *self = Self::new(&self.file, surface)?;
        }
        Ok(())
    }

    /// Distance of a point from the surface; negative inside.
    pub(super) fn distance_mm(&self, p: &Vector3<f64>) -> f64 {
        // Without triangles there is nothing to be near to.
        self.surface
            .as_ref()
            .map_or(f64::INFINITY, |mesh| mesh.near(p).distance_mm)
    }

    /// Outward normal of the triangle that is nearest to a point.
    pub(super) fn normal(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.surface
            .as_ref()
            .map_or_else(Vector3::z, |mesh| mesh.near(p).direction)
    }

    /// Where a beam first meets it within a way; `direction` is a unit vector.
    pub(super) fn beam(
        &self,
        from: &Vector3<f64>,
        direction: &Vector3<f64>,
        far_mm: f64,
    ) -> Option<BeamEnd> {
        let mesh = self.surface.as_ref()?;
        let hit = mesh.first_hit(from, direction, far_mm)?;
        Some(BeamEnd {
            way_mm: hit.at,
            normal: mesh.triangles().get(hit.face)?.normal,
        })
    }
}

impl PartialEq for SceneMesh {
    fn eq(&self, other: &Self) -> bool {
        match (&self.surface, &other.surface) {
            (Some(one), Some(two)) => Arc::ptr_eq(one, two),
            (None, None) => self.file == other.file,
            _ => false,
        }
    }
}
