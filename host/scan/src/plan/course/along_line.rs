//! Courses for a machine whose spindle cannot turn: the laser line follows from the beam, so the courses run across it.
//!
//! On every triangle the exact pose gives a line. The height whose slope follows these lines best (least squares over the
//! area, a Poisson problem) has level lines that the laser line comes out across.

use std::collections::VecDeque;

use nalgebra::Vector3;

use super::super::drive::axes::Driver;
use super::super::map::Chart;
use super::super::mesh::{PartMesh, weld::BORDER};
use super::field::HeightField;
use umi_sparse::SparseSystem;

/// A triangle's area counts as no less than this share of its longest edge's square: a sliver does not own the system.
const LEAST_AREA: f64 = 1e-5;

/// Heights that rise along the laser line, one for each branch of the axes.
pub fn line_fields(part: &PartMesh, chart: &Chart, driver: &Driver<'_>) -> Vec<HeightField> {
    let lines: Vec<Vec<Vector3<f64>>> = chart
        .faces
        .iter()
        .map(|&f| driver.lines_for(&part.normal(f as usize)))
        .collect();
    let branches = lines.iter().map(Vec::len).max().unwrap_or(0);
    (0..branches)
        .filter_map(|branch| {
            let chosen: Vec<Option<Vector3<f64>>> = lines
                .iter()
                .map(|l| l.get(branch).or_else(|| l.last()).copied())
                .collect();
            let slopes = one_sense(part, chart, &chosen);
            let height = rise(part, chart, &slopes)?;
            let name = format!("line, branch {branch}");
            Some(HeightField::new(part, chart, height, name))
        })
        .collect()
}

/// A line has no sense; neighbours are given the same one. Zero where there is no line.
fn one_sense(part: &PartMesh, chart: &Chart, lines: &[Option<Vector3<f64>>]) -> Vec<Vector3<f64>> {
    let mut place = vec![usize::MAX; part.faces.len()];
    for (k, &f) in chart.faces.iter().enumerate() {
        place[f as usize] = k;
    }
    let mut slopes = vec![Vector3::zeros(); lines.len()];
    let mut seen = vec![false; lines.len()];
    for start in 0..lines.len() {
        let (false, Some(line)) = (seen[start], lines[start]) else {
            continue;
        };
        seen[start] = true;
        slopes[start] = line;
        let mut open = VecDeque::from([start]);
        while let Some(k) = open.pop_front() {
            for &g in &part.neighbours[chart.faces[k] as usize] {
                let Some(&j) = (g != BORDER).then(|| &place[g as usize]) else {
                    continue;
                };
                if j == usize::MAX || seen[j] {
                    continue;
                }
                if let Some(line) = lines[j] {
                    seen[j] = true;
                    slopes[j] = if line.dot(&slopes[k]) < 0.0 {
                        -line
                    } else {
                        line
                    };
                    open.push_back(j);
                }
            }
        }
    }
    slopes
}

/// The height whose slope is nearest to the wanted one. None where the system cannot be solved.
fn rise(part: &PartMesh, chart: &Chart, slopes: &[Vector3<f64>]) -> Option<Vec<f64>> {
    // The first vertex stands at zero: heights are told but for a constant.
    let unknown = |v: u32| v.checked_sub(1);
    let count = chart.map.vertices.len().saturating_sub(1) as u32;
    let mut system = SparseSystem::new(count, 6 * chart.faces.len());
    let mut right = vec![0.0; count as usize];
    for ((f, &face), slope) in chart.map.faces.iter().zip(&chart.faces).zip(slopes) {
        let (t, normal) = (part.corners(face as usize), part.normal(face as usize));
        let edge = |k: usize| t[(k + 2) % 3] - t[(k + 1) % 3];
        // The slope of each corner's hat function, times the area.
        let hats = [0, 1, 2].map(|k| normal.cross(&edge(k)) / 2.0);
        let longest = hats
            .iter()
            .map(|h| 4.0 * h.norm_squared())
            .fold(0.0, f64::max);
        let area = part.area_mm2(face as usize).max(LEAST_AREA * longest);
        for i in 0..3 {
            let Some(row) = unknown(f[i]) else { continue };
            right[row as usize] += hats[i].dot(slope);
            for j in 0..3 {
                if let Some(column) = unknown(f[j]) {
                    system.add(row, column, hats[i].dot(&hats[j]) / area);
                }
            }
        }
    }
    let solved = system.solve(&right)?;
    Some(std::iter::once(0.0).chain(solved).collect())
}
