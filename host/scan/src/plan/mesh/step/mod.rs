//! STEP files (ISO 10303-21, shapes of AP 203, 214 and 242): the faces of their shells become triangles that leave the
//! surfaces by no more than [`CHORD_MM`].
//!
//! Read are planes, cylinders, cones, spheres, tori and B-splines (rational ones too), with borders of lines, circles,
//! ellipses and B-splines. All else is refused by its name: assemblies, other surfaces, a face that goes round without a
//! seam or reaches a pole, unless it lies on a ball.
//!
//! * [`part21`]: the text; [`frame`]: points and placements; [`spline`], [`surface`], [`curve`]: geometry.
//! * [`face`]: a face as triangles; [`ball`]: the same on a ball, with poles, or the whole of it.

mod ball;
mod curve;
mod face;
mod frame;
mod part21;
mod spline;
mod surface;
#[cfg(test)]
mod tests;

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};

use nalgebra::Vector3;

use super::RawMesh;
use super::unreadable::unreadable;
use crate::ScanError;
use frame::Drawing;
use part21::Values;

/// Triangles and edges leave the surface by no more than this.
const CHORD_MM: f64 = 0.005;

/// Edges that meet lie no farther apart.
const GAP_MM: f64 = 0.05;

/// Edges of triangles are no longer than this share of the part: long ones make a bad map.
const LONGEST_SHARE: f64 = 1.0 / 40.0;

/// What the reader does not know.
fn not_read(what: &str) -> ScanError {
    ScanError::refused(
        "mesh_format",
        format_args!(
            "In this STEP file {what} is not read. Export the part as STL, OBJ or PLY with a chord of 0.01 mm."
        ),
    )
}

/// Reads the shells of a file.
///
/// # Errors
/// `mesh_unreadable` for damage, `mesh_format` for what is not read, `mesh_empty` without faces.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, ScanError> {
    let entities = part21::parse(bytes)?;
    for (kind, what) in [
        ("NEXT_ASSEMBLY_USAGE_OCCURRENCE", "an assembly"),
        ("MAPPED_ITEM", "a shape that is placed several times"),
    ] {
        if !entities.having(kind).is_empty() {
            return Err(not_read(what));
        }
    }
    let mm_per_unit = unit(&entities)?;
    let drawing = Drawing {
        entities,
        mm_per_unit,
    };
    let mut shells = Vec::new();
    for kind in ["OPEN_SHELL", "CLOSED_SHELL"] {
        for shell in drawing.entities.having(kind) {
            shells.push(drawing.get(shell, kind)?.entities(1)?);
        }
    }
    let faces: Vec<u64> = shells.into_iter().flatten().collect();
    let faces: Vec<FaceText> = faces
        .into_iter()
        .map(|number| face_text(&drawing, number))
        .collect::<Result<_, _>>()?;
    let mut raw = RawMesh::default();
    if faces.is_empty() {
        return Ok(raw);
    }
    let longest_mm = LONGEST_SHARE * across(&drawing, &faces)?;
    let mut edges: HashMap<u64, Vec<Vector3<f64>>> = HashMap::new();
    for face in &faces {
        let number = face.number;
        let mut borders = Vec::new();
        let mut gone: Vec<Vec<ball::GoneEdge>> = Vec::new();
        for bound in &face.bounds {
            let mut edges_gone = Vec::new();
            let mut border: face::Border = Vec::new();
            for (edge, along) in bound {
                let points = match edges.entry(*edge) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(new) => new.insert(curve::edge(&drawing, *edge, longest_mm)?),
                };
                let way: Vec<_> = if *along {
                    points.clone()
                } else {
                    points.iter().rev().copied().collect()
                };
                // Each edge ends where the next begins.
                if let (Some(end), Some(begin)) = (border.pop(), way.first())
                    && (end - begin).norm() > GAP_MM
                {
                    return Err(unreadable(format_args!(
                        "the border of face #{number} has a gap of {:.3} mm",
                        (end - begin).norm()
                    )));
                }
                border.extend(&way);
                edges_gone.push((*edge, *along, way));
            }
            gone.push(edges_gone);
            if let (Some(end), Some(begin)) = (border.pop(), border.first())
                && (end - begin).norm() > GAP_MM
            {
                return Err(unreadable(format_args!(
                    "the border of face #{number} does not close"
                )));
            }
            borders.push(border);
        }
        let known = (raw.vertices.len(), raw.faces.len());
        let mut made = if borders.is_empty() {
            Err(not_read("a face without a border"))
        } else {
            face::triangles(&face.surface, &borders, face.turned, longest_mm, &mut raw)
        };
        if let (Err(_), surface::Surface::Sphere(frame, radius)) = (&made, &face.surface)
            && let Some(borders) = ball::without_seams(&gone)
        {
            raw.vertices.truncate(known.0);
            raw.faces.truncate(known.1);
            let turned = face.turned;
            made = ball::triangles(frame, *radius, &borders, turned, longest_mm, &mut raw);
        }
        made.map_err(|mut e| {
            e.message = format!("Face #{number}: {}", e.message);
            e
        })?;
    }
    Ok(raw)
}

/// A face as the file has it.
struct FaceText {
    number: u64,
    surface: surface::Surface,
    /// The outer side is against the surface's normal.
    turned: bool,
    /// Edges of each border, with the sense that they are gone in.
    bounds: Vec<Vec<(u64, bool)>>,
}

fn face_text(drawing: &Drawing, number: u64) -> Result<FaceText, ScanError> {
    let entity = drawing.entities.at(number)?;
    let Some(values) = entity
        .get("ADVANCED_FACE")
        .or_else(|| entity.get("FACE_SURFACE"))
    else {
        return Err(not_read(&format!("the face #{number}, {}", entity.name())));
    };
    let surface = surface::read(drawing, values.entity(2)?)?;
    let turned = !values.flag(3)?;
    let mut bounds = Vec::new();
    for bound in values.entities(1)? {
        let entity = drawing.entities.at(bound)?;
        let Some(bound) = entity
            .get("FACE_OUTER_BOUND")
            .or_else(|| entity.get("FACE_BOUND"))
        else {
            return Err(unreadable(format_args!("#{bound} is no border of a face")));
        };
        let ring = bound.entity(1)?;
        // A whole ball has a point for its border.
        if matches!(surface, surface::Surface::Sphere(..))
            && drawing.entities.at(ring)?.get("VERTEX_LOOP").is_some()
        {
            continue;
        }
        let mut edges = curve::loop_edges(drawing, ring)?;
        if !bound.flag(2)? {
            // Gone along the other way: the face lies on the left, seen from its outer side.
            edges.reverse();
            for (_, along) in &mut edges {
                *along = !*along;
            }
        }
        bounds.push(edges);
    }
    Ok(FaceText {
        number,
        surface,
        turned,
        bounds,
    })
}

/// How large the part is, by the points of its edges: a whole torus has one vertex, and the ends of its edges say nothing.
fn across(drawing: &Drawing, faces: &[FaceText]) -> Result<f64, ScanError> {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    let mut known: HashSet<u64> = HashSet::new();
    for (edge, _) in faces.iter().flat_map(|f| &f.bounds).flatten() {
        if known.insert(*edge) {
            for at in curve::edge(drawing, *edge, f64::INFINITY)? {
                low = low.inf(&at);
                high = high.sup(&at);
            }
        }
    }
    for face in faces {
        // A ball reaches as far as a piece of it can.
        if let (surface::Surface::Sphere(frame, radius), []) = (&face.surface, &face.bounds[..]) {
            low = low.inf(&(frame.at - Vector3::repeat(*radius)));
            high = high.sup(&(frame.at + Vector3::repeat(*radius)));
        }
    }
    let across = (high - low).norm();
    if !across.is_finite() {
        return Err(not_read("a shape without borders"));
    }
    Ok(across.max(1e-3))
}

/// Millimetres of the file's unit of length.
fn unit(entities: &part21::Entities) -> Result<f64, ScanError> {
    let mut found: Option<f64> = None;
    for number in entities.having("LENGTH_UNIT") {
        let entity = entities.at(number)?;
        let here = if let Some(values) = entity.get("SI_UNIT") {
            match values.value(0) {
                Some(part21::Value::Word(prefix)) => match prefix.as_str() {
                    "MILLI" => 1.0,
                    "CENTI" => 10.0,
                    "DECI" => 100.0,
                    "MICRO" => 1e-3,
                    "KILO" => 1e6,
                    _ => return Err(not_read("a unit of length with an odd prefix")),
                },
                _ => 1000.0,
            }
        } else if let Some(values) = entity.get("CONVERSION_BASED_UNIT") {
            // So many of another unit: an inch is 25.4 mm, and mm is the file's other unit.
            let measure = entities.at(values.entity(1)?)?;
            let Some(measure) = measure
                .get("LENGTH_MEASURE_WITH_UNIT")
                .or_else(|| measure.get("MEASURE_WITH_UNIT"))
            else {
                return Err(not_read("a unit of length that no other one measures"));
            };
            let base = entities.at(measure.entity(1)?)?;
            let base = match base.get("SI_UNIT").and_then(|v| v.value(0)) {
                Some(part21::Value::Word(prefix)) if prefix == "MILLI" => 1.0,
                Some(part21::Value::Word(prefix)) if prefix == "CENTI" => 10.0,
                Some(part21::Value::Word(_)) | None => {
                    return Err(not_read("a unit of length with an odd base"));
                }
                Some(_) => 1000.0,
            };
            // What is made of others is the file's own; the one that measures it is not.
            return Ok(measure.number(0)? * base);
        } else {
            return Err(not_read(
                "a unit of length that is neither metric nor measured",
            ));
        };
        if found.is_some_and(|f| f != here) {
            return Err(not_read("a second unit of length"));
        }
        found = Some(here);
    }
    found.ok_or_else(|| not_read("a shape without a unit of length"))
}
