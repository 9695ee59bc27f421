//! What each face of the part demands.

use super::{FaceStock, span};
use crate::ScanError;
use crate::solve::Measured;
use crate::surface::Mesh;

/// What a face demands of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// At least this much stock, in mm.
    Stock(f64),
    /// As built: within half of this profile tolerance to either side, in mm.
    Profile(f64),
}

impl Rule {
    /// By how much a point with this stock keeps the rule, in mm.
    #[must_use]
    pub fn margin(self, stock_mm: f64) -> f64 {
        match self {
            Self::Stock(least) => stock_mm - least,
            Self::Profile(width) => width / 2.0 - stock_mm.abs(),
        }
    }

    /// Whether material is missing for the rule.
    pub(super) fn lacks(self, stock_mm: f64) -> bool {
        self.margin(stock_mm) < 0.0 && self.slope(stock_mm) > 0.0
    }

    /// How the margin grows with the stock: 1 or −1.
    pub(super) fn slope(self, stock_mm: f64) -> f64 {
        match self {
            Self::Profile(_) if stock_mm >= 0.0 => -1.0,
            _ => 1.0,
        }
    }
}

/// A face with its demand.
#[derive(Clone, Debug)]
pub struct Demand {
    /// Its name.
    pub name: String,
    /// Its triangles, a part of the model's surface.
    pub mesh: Mesh,
    /// What it demands.
    pub rule: Rule,
}

/// The model's triangles of a face have at least this share of the area of its mesh.
const OWNED: f64 = 0.5;
/// How far a face's mesh may lie from the model's triangle that belongs to it, in mm.
const SAME_MM: f64 = 0.02;

/// The face that each triangle of the model belongs to.
fn owners(model: &Mesh, demands: &[Demand]) -> Vec<Option<usize>> {
    model
        .triangles()
        .iter()
        .map(|t| {
            let centre = (t.corners[0] + t.corners[1] + t.corners[2]) / 3.0;
            demands
                .iter()
                .enumerate()
                .map(|(i, demand)| (i, demand.mesh.near(&centre)))
                .filter(|(i, near)| {
                    near.distance_mm.abs() < SAME_MM
                        && demands[*i].mesh.triangles()[near.face]
                            .normal
                            .dot(&t.normal)
                            > 0.7
                })
                .min_by(|a, b| a.1.distance_mm.abs().total_cmp(&b.1.distance_mm.abs()))
                .map(|(i, _)| i)
        })
        .collect()
}

/// Each face is a part of the model: else what it demands is asked of no point.
///
/// # Errors
/// `bad_file`, with the face and how far it lies off the model.
pub(super) fn check(model: &Mesh, demands: &[Demand]) -> Result<(), ScanError> {
    let owners = owners(model, demands);
    for (i, demand) in demands.iter().enumerate() {
        let triangles = model.triangles().iter().zip(&owners);
        let owned = triangles.filter(|(_, owner)| **owner == Some(i));
        let owned_mm2: f64 = owned.map(|(t, _)| t.area_mm2).sum();
        if owned_mm2 >= OWNED * demand.mesh.area_mm2() {
            continue;
        }
        let corners = demand.mesh.triangles().iter().flat_map(|t| t.corners);
        let off_mm = corners
            .map(|corner| model.near(&corner).distance_mm.abs())
            .fold(0.0, f64::max);
        let (name, what) = (
            &demand.name,
            "export it from the model, in mm and in its frame",
        );
        return Err(ScanError::unreadable(
            "bad_file",
            if off_mm > SAME_MM {
                format!(
                    "the face `{name}` is no part of the model, it lies up to {off_mm:.3} mm off: {what}"
                )
            } else {
                format!(
                    "the face `{name}` owns too few triangles of the model: another face has them, they look the other \
                     way, or they are not the model's; {what}"
                )
            },
        ));
    }
    Ok(())
}

/// The rule of each triangle; where no face demands anything, `require` or that there is stock at all.
pub(super) fn rules(model: &Mesh, demands: &[Demand], require: Option<f64>) -> Vec<Rule> {
    let other = Rule::Stock(require.unwrap_or(0.0));
    if demands.is_empty() {
        return vec![other; model.triangles().len()];
    }
    owners(model, demands)
        .into_iter()
        .map(|owner| owner.map_or(other, |i| demands[i].rule))
        .collect()
}

/// The stock of each face.
pub(super) fn by_face(
    model: &Mesh,
    demands: &[Demand],
    rules: &[Rule],
    measured: &[Measured],
) -> Vec<FaceStock> {
    if demands.is_empty() {
        return Vec::new();
    }
    let owners = owners(model, demands);
    demands
        .iter()
        .enumerate()
        .map(|(i, demand)| {
            let mine: Vec<usize> = (0..measured.len())
                .filter(|&k| owners[measured[k].face] == Some(i))
                .collect();
            let (min, max, sum, _) = span(measured, mine.iter().copied());
            let margin = mine
                .iter()
                .map(|&k| rules[measured[k].face].margin(measured[k].distance_mm))
                .fold(f64::INFINITY, f64::min);
            let some = |x: f64| (!mine.is_empty()).then_some(x);
            FaceStock {
                name: demand.name.clone(),
                min_mm: some(min),
                mean_mm: some(sum / mine.len().max(1) as f64),
                max_mm: some(max),
                margin_mm: some(margin),
                points: mine,
            }
        })
        .collect()
}
