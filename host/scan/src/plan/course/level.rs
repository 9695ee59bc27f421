//! Level lines of a height, as polylines over the triangles.

use std::collections::HashMap;

use nalgebra::Vector3;

use super::super::map::Chart;
use super::super::mesh::PartMesh;
use super::field::HeightField;

/// A point of a level line.
#[derive(Debug, Clone, Copy)]
pub struct LinePoint {
    /// Where it lies: on an edge of the surface.
    pub at: Vector3<f64>,
    /// Normal there, between those that the edge's vertices have on the chart.
    pub normal: Vector3<f64>,
    /// The edge's direction.
    pub edge: Vector3<f64>,
}

/// The lines at one level, each from border to border or round.
pub fn lines(
    part: &PartMesh,
    chart: &Chart,
    field: &HeightField,
    level: f64,
) -> Vec<Vec<LinePoint>> {
    // Each triangle that the level crosses joins two edges; the line walks from edge to edge.
    let mut points: Vec<LinePoint> = Vec::new();
    let mut numbers: HashMap<(u32, u32), u32> = HashMap::new();
    let mut links: Vec<[u32; 2]> = Vec::new();
    const NONE: u32 = u32::MAX;
    for f in &chart.map.faces {
        let above = f.map(|k| field.height[k as usize] >= level);
        if above[0] == above[1] && above[1] == above[2] {
            continue;
        }
        let mut ends = [NONE; 2];
        let mut found = 0;
        for k in 0..3 {
            let j = (k + 1) % 3;
            if above[k] == above[j] {
                continue;
            }
            let (a, b) = (f[k].min(f[j]), f[k].max(f[j]));
            let number = *numbers.entry((a, b)).or_insert_with(|| {
                let (ha, hb) = (field.height[a as usize], field.height[b as usize]);
                let w = ((level - ha) / (hb - ha)).clamp(0.0, 1.0);
                let (va, vb) = (
                    chart.map.vertices[a as usize] as usize,
                    chart.map.vertices[b as usize] as usize,
                );
                let (pa, pb) = (part.vertices[va], part.vertices[vb]);
                let (na, nb) = (chart.normals[a as usize], chart.normals[b as usize]);
                let normal = na * (1.0 - w) + nb * w;
                points.push(LinePoint {
                    at: pa + (pb - pa) * w,
                    normal: normal.try_normalize(1e-9).unwrap_or(na),
                    edge: (pb - pa).try_normalize(1e-12).unwrap_or_else(Vector3::x),
                });
                links.push([NONE; 2]);
                (points.len() - 1) as u32
            });
            if found < 2 {
                ends[found] = number;
                found += 1;
            }
        }
        let [a, b] = ends;
        if b == NONE {
            continue;
        }
        for (from, to) in [(a, b), (b, a)] {
            if let Some(slot) = links[from as usize].iter_mut().find(|s| **s == NONE) {
                *slot = to;
            }
        }
    }
    let mut taken = vec![false; points.len()];
    let mut lines = Vec::new();
    // Open lines begin at their ends; what is left then is round.
    let ends = (0..points.len()).filter(|&k| links[k][1] == NONE);
    let order: Vec<usize> = ends.chain(0..points.len()).collect();
    for start in order {
        if taken[start] {
            continue;
        }
        let mut line = Vec::new();
        let mut here = start;
        loop {
            taken[here] = true;
            line.push(points[here]);
            let next = links[here]
                .iter()
                .copied()
                .find(|&n| n != NONE && !taken[n as usize]);
            match next {
                Some(n) => here = n as usize,
                None => break,
            }
        }
        if line.len() > 2 && links[start][1] != NONE && links[here].contains(&(start as u32)) {
            line.push(points[start]);
        }
        if line.len() > 1 {
            lines.push(line);
        }
    }
    lines
}
