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

const MOST_STEPS: usize = 2000;

/// Heights that rise along the laser line, one for each branch of the axes.
pub fn line_fields(part: &PartMesh, chart: &Chart, driver: &Driver<'_>) -> Vec<HeightField> {
    let lines: Vec<Vec<Vector3<f64>>> = chart
        .faces
        .iter()
        .map(|&f| driver.lines_for(&part.normal(f as usize)))
        .collect();
    let branches = lines.iter().map(Vec::len).max().unwrap_or(0);
    (0..branches)
        .map(|branch| {
            let chosen: Vec<Option<Vector3<f64>>> = lines
                .iter()
                .map(|l| l.get(branch).or_else(|| l.last()).copied())
                .collect();
            let slopes = one_sense(part, chart, &chosen);
            let height = rise(part, chart, &slopes);
            HeightField::new(part, chart, height, format!("line, branch {branch}"))
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

/// The height whose slope is nearest to the wanted one, by conjugate gradients.
fn rise(part: &PartMesh, chart: &Chart, slopes: &[Vector3<f64>]) -> Vec<f64> {
    let n = chart.map.vertices.len();
    let mut rows: Vec<Vec<(u32, f64)>> = vec![Vec::with_capacity(7); n];
    let mut diagonal = vec![1e-9; n];
    let mut rest = vec![0.0; n];
    for (k, f) in chart.map.faces.iter().enumerate() {
        let face = chart.faces[k] as usize;
        let (t, normal) = (part.corners(face), part.normal(face));
        for c in 0..3 {
            let (i, j, o) = (f[c], f[(c + 1) % 3], f[(c + 2) % 3]);
            let (a, b) = (t[c] - t[(c + 2) % 3], t[(c + 1) % 3] - t[(c + 2) % 3]);
            let cot = (a.dot(&b) / a.cross(&b).norm().max(1e-300)).clamp(-1e4, 1e4) / 2.0;
            for (p, q) in [(i, j), (j, i)] {
                match rows[p as usize].iter_mut().find(|(v, _)| *v == q) {
                    Some((_, w)) => *w += cot,
                    None => rows[p as usize].push((q, cot)),
                }
                diagonal[p as usize] += cot;
            }
            // The slope of the corner's hat function, times the area.
            let hat = normal.cross(&(t[c] - t[(c + 1) % 3])) / 2.0;
            rest[o as usize] += hat.dot(&slopes[k]);
        }
    }
    for d in &mut diagonal {
        *d = d.max(1e-9);
    }
    let mut x = vec![0.0; n];
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut step: Vec<f64> = rest.iter().zip(&diagonal).map(|(r, d)| r / d).collect();
    let mut size = dot(&rest, &step);
    let goal = size * 1e-10;
    let mut product = vec![0.0; n];
    for _ in 0..MOST_STEPS {
        if size.is_nan() || size <= goal || size < 1e-300 {
            break;
        }
        for (i, row) in rows.iter().enumerate() {
            product[i] = row
                .iter()
                .map(|(j, w)| w * (step[i] - step[*j as usize]))
                .sum();
        }
        let curvature = dot(&step, &product);
        if curvature.is_nan() || curvature <= 0.0 {
            break;
        }
        let length = size / curvature;
        for k in 0..n {
            x[k] += step[k] * length;
            rest[k] -= product[k] * length;
        }
        let next: f64 = rest.iter().zip(&diagonal).map(|(r, d)| r * r / d).sum();
        for k in 0..n {
            step[k] = rest[k] / diagonal[k] + step[k] * (next / size);
        }
        size = next;
    }
    x
}
