//! Points, directions and placements of a STEP file, in millimetres.

use nalgebra::Vector3;

use super::super::unreadable::unreadable;
use super::part21::{Entities, Value, Values};
use crate::ScanError;

/// The file's entities and its unit.
pub(super) struct Drawing {
    pub entities: Entities,
    pub mm_per_unit: f64,
}

/// A place with three directions.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub at: Vector3<f64>,
    pub x: Vector3<f64>,
    pub y: Vector3<f64>,
    pub z: Vector3<f64>,
}

impl Drawing {
    /// The values of an entity under a kind.
    pub fn get(&self, number: u64, kind: &str) -> Result<&[Value], ScanError> {
        let entity = self.entities.at(number)?;
        entity.get(kind).ok_or_else(|| {
            unreadable(format_args!(
                "#{number} is {} where {kind} is needed",
                entity.name()
            ))
        })
    }

    fn three(&self, number: u64, kind: &str) -> Result<Vector3<f64>, ScanError> {
        let list = self.get(number, kind)?.numbers(1)?;
        match list.as_slice() {
            [x, y, z] => Ok(Vector3::new(*x, *y, *z)),
            _ => Err(unreadable(format_args!(
                "#{number} has not three coordinates"
            ))),
        }
    }

    /// A point in mm.
    pub fn point(&self, number: u64) -> Result<Vector3<f64>, ScanError> {
        Ok(self.three(number, "CARTESIAN_POINT")? * self.mm_per_unit)
    }

    /// A unit vector.
    pub fn direction(&self, number: u64) -> Result<Vector3<f64>, ScanError> {
        self.three(number, "DIRECTION")?
            .try_normalize(1e-12)
            .ok_or_else(|| unreadable(format_args!("#{number} is a direction without length")))
    }

    /// A length in mm, above nothing.
    pub fn length(&self, values: &[Value], place: usize) -> Result<f64, ScanError> {
        let length = values.number(place)? * self.mm_per_unit;
        if length > 0.0 {
            return Ok(length);
        }
        Err(unreadable("a radius is not above 0"))
    }

    /// A placement; directions that are left out are z and x.
    pub fn frame(&self, number: u64) -> Result<Frame, ScanError> {
        let values = self.get(number, "AXIS2_PLACEMENT_3D")?;
        let at = self.point(values.entity(1)?)?;
        let given = |place: usize, else_this: Vector3<f64>| match values.value(place) {
            Some(Value::Entity(n)) => self.direction(*n),
            _ => Ok(else_this),
        };
        let z = given(2, Vector3::z())?;
        // Without a direction for x, any one across z: x of the file unless that is z.
        let free = if z.x.abs() < 0.9 {
            Vector3::x()
        } else {
            Vector3::z()
        };
        let towards = given(3, free)?;
        let x = (towards - z * z.dot(&towards))
            .try_normalize(1e-9)
            .ok_or_else(|| unreadable(format_args!("#{number}: both directions are the same")))?;
        Ok(Frame {
            at,
            x,
            y: z.cross(&x),
            z,
        })
    }
}
