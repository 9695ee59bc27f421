//! The page on a cloud beside its nominal.

use std::path::Path;

use umi_report::pages::deviation::{Bands, DeviationPage, DeviationPoint, LIMITS, Section};
use umi_report::pages::scan::FigureTable;
use umi_scan::compare::{Deviations, Nominal};
use umi_scan::rigid::Vec3;
use umi_scan::surface::Near;

use super::compare::figures;
use super::merged::MergeLosses;

/// A cloud, its nominal, and what one is to the other.
pub struct Compared<'a> {
    /// Whose name the cloud has.
    pub cloud: &'a Path,
    /// Whose name the nominal has.
    pub nominal: &'a Path,
    /// The nominal.
    pub surface: &'a Nominal,
    /// The cloud's points.
    pub points: &'a [Vec3],
    /// What the nominal is to each.
    pub near: &'a [Near],
    /// The figures of all.
    pub found: &'a Deviations,
    /// Between which deviations a point is good.
    pub limits: Option<Bands>,
    /// Across which axes, and where; none: three through the middle.
    pub sections: &'a [(usize, f64)],
    /// What was lost before.
    pub losses: Option<&'a MergeLosses>,
    /// What else must be known of the cloud, a line each.
    pub remarks: Vec<String>,
}

/// How many points lie below and above the limits.
pub fn beyond(near: &[Near], bands: Bands) -> (usize, usize) {
    let below = near.iter().filter(|n| n.distance_mm < bands.low_mm);
    let above = near.iter().filter(|n| n.distance_mm > bands.high_mm);
    (below.count(), above.count())
}

/// The page.
pub fn page(of: &Compared<'_>) -> DeviationPage {
    let found = of.found;
    let bands = of
        .limits
        .unwrap_or_else(|| spread(of.near.iter().map(|near| near.distance_mm).collect()));
    let (below, above) = beyond(of.near, bands);
    let name = |path: &Path| {
        path.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    let beyond = below + above;
    let share = 100.0 * beyond as f64 / found.n as f64;
    let (unit, _) = bands.unit();
    let range = format!(
        "{} to {} {unit}",
        bands.said(bands.low_mm),
        bands.said(bands.high_mm)
    );
    let result = match of.limits {
        Some(_) if beyond == 0 => format!("All {} points lie within {range}", found.n),
        Some(_) => format!(
            "{beyond} of {} points ({share:.2} %) lie outside of {range}: {below} below, {above} above",
            found.n
        ),
        None => format!(
            "{} points, rms {:.4} mm; no limits were given",
            found.n, found.rms_mm
        ),
    };
    let mut facts = vec![
        ("cloud", name(of.cloud)),
        ("nominal", name(of.nominal)),
        (
            "limits",
            match of.limits {
                Some(_) => range,
                None => format!(
                    "none given; the colours end at {range}, about where 99 % of the points do"
                ),
            },
        ),
        (
            "alignment",
            "none: the points are where the cloud has them".to_owned(),
        ),
    ];
    let (low, high) = span(of.points);
    facts.push((
        "the points span, mm",
        (0..3)
            .map(|i| format!("{} {:.3} to {:.3}", ["X", "Y", "Z"][i], low[i], high[i]))
            .collect::<Vec<_>>()
            .join(", "),
    ));
    let mut tables = vec![FigureTable {
        caption: "Deviations, positive outside of the nominal".into(),
        heads: vec!["figure", "mm"],
        rows: figures(found).split_off(1),
    }];
    let mut remarks = of.remarks.clone();
    if let Some(losses) = of.losses {
        tables.extend(losses.tables());
        remarks.extend(losses.remarks());
    }
    let cuts = if of.sections.is_empty() {
        (0..3)
            .map(|i| (i, f64::midpoint(low[i], high[i])))
            .collect()
    } else {
        of.sections.to_vec()
    };
    let sections = cuts
        .into_iter()
        .map(|(axis, at_mm)| Section {
            axis,
            at_mm,
            lines: of
                .surface
                .section(axis, at_mm)
                .into_iter()
                .map(|ends| ends.map(|p| [p.x, p.y, p.z]))
                .collect(),
        })
        .collect();
    let points = of.points.iter().zip(of.near);
    DeviationPage {
        title: format!("{} beside {}", name(of.cloud), name(of.nominal)),
        result,
        ok: of.limits.is_none() || beyond == 0,
        facts,
        tables,
        remarks,
        points: points
            .map(|(p, near)| DeviationPoint {
                at_mm: [p.x, p.y, p.z],
                deviation_mm: near.distance_mm,
                outward: [0, 1, 2].map(|i| near.direction[i] as f32),
            })
            .collect(),
        bands,
        ends: of.limits.map_or([None; 2], |_| LIMITS),
        sections,
        ..DeviationPage::default()
    }
}

/// A round number, up and down, that 99 % of the deviations lie within.
pub fn spread(mut deviations: Vec<f64>) -> Bands {
    for d in &mut deviations {
        *d = d.abs();
    }
    let at = (deviations.len() * 99 / 100).min(deviations.len() - 1);
    let (_, most, _) = deviations.select_nth_unstable_by(at, f64::total_cmp);
    // A tenth of a nanometre where there is no deviation at all.
    let most = most.max(1e-7);
    let decade = 10_f64.powi(most.log10().floor() as i32);
    let high_mm = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * decade)
        .find(|round| *round >= most)
        .unwrap_or(10.0 * decade);
    Bands {
        low_mm: -high_mm,
        high_mm,
    }
}

fn span(points: &[Vec3]) -> (Vec3, Vec3) {
    let first = points.first().copied().unwrap_or_else(Vec3::zeros);
    points
        .iter()
        .fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)))
}
