//! What `umi scan stock --report` shows.

use crate::show::terminal::Plain;
use std::path::Path;

use umi_report::pages::deviation::{
    Bands, DeviationPage, DeviationPoint, MarkedSpot, PointGroup, Section, html,
};
use umi_report::pages::scan::FigureTable;
use umi_scan::ScanError;
use umi_scan::compare::Nominal;
use umi_scan::rigid::Vec3;
use umi_scan::stock::StockFound;

/// The page on what was found with the scan's points that were used; `least_mm` of stock are needed.
///
/// # Errors
/// Of the model's file.
pub fn page(
    model: &Path,
    used: &[Vec3],
    found: &StockFound,
    least_mm: f64,
) -> Result<String, ScanError> {
    let nominal = Nominal::read(model)?;
    let ok = found.reasons.is_empty();
    let back = found.motion.inverse();
    let points: Vec<DeviationPoint> = used
        .iter()
        .zip(&found.measured)
        .map(|(q, m)| {
            let at = found.motion.undo(q);
            let outward = back.rotation * m.direction;
            DeviationPoint {
                at_mm: [at.x, at.y, at.z],
                deviation_mm: m.distance_mm,
                outward: [0, 1, 2].map(|i| outward[i] as f32),
            }
        })
        .collect();
    let name = model.file_name().unwrap_or_default().to_string_lossy();
    let (t, p) = (found.motion.translation_mm, found.least_at_mm);
    let three = |v: &Vec3| format!("{:.4}, {:.4}, {:.4}", Plain(v.x), Plain(v.y), Plain(v.z));
    let rotation: Vec<String> = found
        .motion
        .rotation
        .row_iter()
        .map(|row| {
            format!(
                "({:.9}, {:.9}, {:.9})",
                Plain(row[0]),
                Plain(row[1]),
                Plain(row[2])
            )
        })
        .collect();
    let middle: [f64; 3] = std::array::from_fn(|i| {
        let of = points.iter().map(|p| p.at_mm[i]);
        f64::midpoint(
            of.clone().fold(f64::INFINITY, f64::min),
            of.fold(f64::NEG_INFINITY, f64::max),
        )
    });
    let sections = middle
        .into_iter()
        .enumerate()
        .filter(|(_, at)| at.is_finite())
        .map(|(axis, at_mm)| Section {
            axis,
            at_mm,
            lines: nominal
                .section(axis, at_mm)
                .into_iter()
                .map(|ends| ends.map(|p| [p.x, p.y, p.z]))
                .collect(),
        })
        .collect();
    let (low_mm, high_mm, ends) = if found.max_mm > least_mm + 1e-3 {
        (least_mm, found.max_mm, ["needed", "most"])
    } else {
        // All of it is too little: the colours tell how little.
        let high_mm = least_mm.max(found.min_mm + 1e-3);
        (found.min_mm, high_mm, ["least", "needed"])
    };
    let groups = found
        .faces
        .iter()
        .filter(|face| !face.points.is_empty())
        .map(|face| PointGroup {
            name: face.name.clone(),
            points: face.points.clone(),
        })
        .collect();
    let least = points
        .iter()
        .min_by(|a, b| a.deviation_mm.total_cmp(&b.deviation_mm));
    let spot = least.map(|least| MarkedSpot {
        of: *least,
        says: format!("least {:.4} mm at {}", found.min_mm, three(&p)),
    });
    let number =
        |value: Option<f64>| value.map_or_else(String::new, |v| format!("{:.4}", Plain(v)));
    let faces = FigureTable {
        caption: "Stock of each face, and what is left of it beyond what the face needs".into(),
        heads: vec![
            "face",
            "points",
            "least, mm",
            "mean, mm",
            "most, mm",
            "margin, mm",
        ],
        rows: found
            .faces
            .iter()
            .map(|f| {
                vec![
                    f.name.clone(),
                    f.points.len().to_string(),
                    number(f.min_mm),
                    number(f.mean_mm),
                    number(f.max_mm),
                    number(f.margin_mm),
                ]
            })
            .collect(),
    };
    Ok(html(&DeviationPage {
        title: format!("Stock on {name}"),
        result: format!(
            "{}: least stock {:.4} mm",
            if ok { "OK" } else { "NG" },
            found.min_mm
        ),
        ok,
        facts: vec![
            ("least stock at, mm", format!("{} of the scan", three(&p))),
            ("which is on the part, mm", three(&found.motion.undo(&p))),
            ("mean stock", format!("{:.4} mm", found.mean_mm)),
            ("largest stock", format!("{:.4} mm", found.max_mm)),
            ("needed", format!("{least_mm} mm")),
            (
                "points",
                format!(
                    "{} used, {} left out as spikes, {} as other things",
                    found.n_used,
                    found.spikes.len(),
                    found.clutter.len()
                ),
            ),
            (
                "not scanned",
                format!("{:.1} % of the surface", found.unmeasured * 100.0),
            ),
            ("scan from part: translation, mm", three(&t)),
            ("rotation, rows", rotation.join(" ")),
        ],
        tables: if found.faces.is_empty() {
            Vec::new()
        } else {
            vec![faces]
        },
        remarks: found.reasons.iter().map(|r| r.message.clone()).collect(),
        points,
        bands: Bands { low_mm, high_mm },
        ends: ends.map(Some),
        groups,
        spots: spot.into_iter().collect(),
        sections,
    }))
}
