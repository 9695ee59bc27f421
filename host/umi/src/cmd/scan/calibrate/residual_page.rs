//! What `umi scan calibrate sensor --report` shows: the residuals where they are, on the artefact.

use crate::show::terminal::Plain;
use umi_report::pages::deviation::{DeviationPage, DeviationPoint};
use umi_report::pages::scan::FigureTable;
use umi_scan::calibrate::observations::Observations;
use umi_scan::calibrate::sensor::{FeatureAnswer, SensorAnswer};
use umi_scan::rigid::Vec3;

use super::super::cloud::spread;

/// Unknowns of the mount, by their names, and their units.
const UNKNOWNS: [(&str, &str); 6] = [
    ("wx", "rad"),
    ("wy", "rad"),
    ("wz", "rad"),
    ("tx", "mm"),
    ("ty", "mm"),
    ("tz", "mm"),
];

/// The page.
pub fn page(found: &SensorAnswer, all: &Observations) -> DeviationPage {
    let mount = found.mount();
    let points = all.points.iter().zip(&found.residuals_mm);
    let points: Vec<DeviationPoint> = points
        // What was left out has none.
        .filter(|(_, residual)| residual.is_finite())
        .map(|(seen, &deviation_mm)| {
            let at = all.flanges[seen.flange].point(&mount.point(&seen.seen_mm));
            let outward = outward(&found.features[seen.feature], &at);
            DeviationPoint {
                at_mm: at.into(),
                deviation_mm,
                outward: [0, 1, 2].map(|i| outward[i] as f32),
            }
        })
        .collect();
    let sigma = found
        .sigma_mm
        .map_or_else(|| "unknown".into(), |sigma| format!("{sigma:.6} mm"));
    let mut tables = vec![mount_table(found), feature_table(found)];
    if !found.bars.is_empty() {
        tables.push(bar_table(found));
    }
    let most = found
        .residuals_mm
        .iter()
        .fold(0.0_f64, |most, r| most.max(r.abs()));
    DeviationPage {
        title: "The sensor's mount".into(),
        result: format!(
            "{} observations leave a standard deviation of {sigma}, {most:.6} mm at most",
            found.n
        ),
        ok: true,
        facts: vec![
            ("degrees of freedom", found.dof.to_string()),
            (
                "radius",
                found
                    .radius_mm
                    .map_or_else(|| "none: planes".into(), |mm| format!("{mm:.6} mm")),
            ),
            (
                "conditioning",
                format!("{:.2e}, a radian worth 100 mm", found.conditioning),
            ),
            (
                "poses",
                found.misfit.as_ref().map_or_else(
                    || "not held against one another: too little is left".into(),
                    |misfit| {
                        format!(
                            "F({}, {}) = {:.2}, {:.4} mm beyond the scatter of {:.4} mm within each",
                            misfit.dof_between,
                            misfit.dof_within,
                            misfit.f,
                            misfit.between_mm,
                            misfit.within_mm
                        )
                    },
                ),
            ),
            (
                "colours",
                "end about where 99 % of the residuals do".to_owned(),
            ),
        ],
        tables,
        remarks: found.warnings.clone(),
        bands: spread(points.iter().map(|p| p.deviation_mm).collect()),
        points,
        ..DeviationPage::default()
    }
}

/// Away from the artefact, as its residuals are counted.
fn outward(feature: &FeatureAnswer, at: &Vec3) -> Vec3 {
    let from = match (feature.normal, feature.center_mm) {
        (Some(normal), _) => Vec3::from(normal),
        (_, Some(centre)) => at - Vec3::from(centre),
        _ => Vec3::z(),
    };
    from.try_normalize(0.0).unwrap_or_else(Vec3::z)
}

fn mount_table(found: &SensorAnswer) -> FigureTable {
    let covariance = found.best_covariance();
    let rows = UNKNOWNS.iter().enumerate().map(|(i, (name, unit))| {
        let value = match i.checked_sub(3) {
            Some(axis) => format!("{:.6} mm", Plain(found.translation_mm[axis])),
            None => {
                let [x, y, z] = found.rotation[i].map(Plain);
                format!("row {}: {x:.9}, {y:.9}, {z:.9}", i + 1)
            }
        };
        let u = covariance.map_or_else(
            || "unknown".into(),
            |covariance| match covariance[i][i].sqrt() {
                0.0 => "held".into(),
                u => format!("{u:.2e} {unit}"),
            },
        );
        vec![(*name).to_owned(), value, u]
    });
    FigureTable {
        caption: "The mount: rotation and shift of [sensor], and their standard uncertainties"
            .into(),
        heads: vec!["unknown", "value", "standard uncertainty"],
        rows: rows.collect(),
    }
}

fn feature_table(found: &SensorAnswer) -> FigureTable {
    let rows = found.features.iter().map(|feature| {
        let three =
            |v: [f64; 3]| format!("{:.6}, {:.6}, {:.6}", Plain(v[0]), Plain(v[1]), Plain(v[2]));
        let place = match (feature.normal, feature.distance_mm, feature.center_mm) {
            (Some(normal), Some(mm), _) => format!("{} · p = {:.6} mm", three(normal), Plain(mm)),
            (_, _, Some(centre)) => three(centre),
            _ => String::new(),
        };
        vec![
            feature.feature.clone(),
            feature.n.to_string(),
            place,
            format!("{:.6}", feature.rms_mm),
            format!("{:+.6}", Plain(feature.max_mm)),
        ]
    });
    FigureTable {
        caption: "Residuals of each feature".into(),
        heads: vec![
            "feature",
            "points",
            "centre, or normal and distance",
            "rms, mm",
            "largest, mm",
        ],
        rows: rows.collect(),
    }
}

fn bar_table(found: &SensorAnswer) -> FigureTable {
    let rows = found.bars.iter().map(|bar| {
        vec![
            bar.balls.join(" to "),
            format!("{:.6}", bar.certified_mm),
            format!("{:.6}", bar.found_mm),
            format!("{:+.6}", Plain(bar.off_mm)),
            bar.u_mm
                .map_or_else(|| "unknown".into(), |u| format!("{u:.6}")),
        ]
    });
    FigureTable {
        caption: "Ball bars beside their certificates, in mm".into(),
        heads: vec!["balls", "certified", "found", "off", "standard uncertainty"],
        rows: rows.collect(),
    }
}
