//! What `umi scan calibrate axis --report` shows: the residuals where the balls were, and a row for each centre.

use std::fmt::Write as _;

use crate::show::terminal::{Plain, Table};
use umi_report::pages::deviation::{DeviationPage, DeviationPoint};
use umi_report::pages::scan::FigureTable;
use umi_scan::calibrate::axis::{AxisAnswer, AxisMove, AxisResidual, TurnedCentres};

use super::super::cloud::spread;

/// Rows that a terminal shows at most; beyond that the largest only.
const SHOWN: usize = 40;

/// Directions of the residuals' columns.
const HEADS: [&str; 5] = [
    "angle, deg",
    "ball",
    "outward, µm",
    "onward, µm",
    "axial, µm",
];
/// What they mean.
pub(super) const MEANING: &str = "outward: away from the axis; onward: the way that the ball goes where the angle grows; axial: along the axis";

/// The page.
pub(super) fn page(
    found: &AxisAnswer,
    all: &TurnedCentres,
    moved: Option<&AxisMove>,
) -> DeviationPage {
    let parts: Vec<AxisResidual> = found.by_axis(&all.centres).collect();
    let points = (all.centres.iter().zip(&parts)).map(|(centre, part)| DeviationPoint {
        at_mm: centre.measured_mm.into(),
        deviation_mm: part.outward_mm,
        // A ball is seen from all sides, also along the axis.
        outward: [0.0; 3],
    });
    let points: Vec<DeviationPoint> = points.collect();
    let most = |of: fn(&AxisResidual) -> f64| {
        let most = parts
            .iter()
            .fold(0.0_f64, |most, part| most.max(of(part).abs()));
        format!("{most:.6} mm")
    };
    let mut facts = vec![
        ("degrees of freedom", found.dof.to_string()),
        ("largest outward", most(|part| part.outward_mm)),
        ("largest onward", most(|part| part.onward_mm)),
        ("largest axial", most(|part| part.axial_mm)),
        (
            "maps",
            "show the outward part; the table has all three".to_owned(),
        ),
    ];
    if let Some(moved) = moved {
        facts.push(("beside the machine file", said(moved)));
    }
    DeviationPage {
        title: "A rotary axis".into(),
        result: format!(
            "{} centres leave a standard deviation of {} a coordinate",
            found.n,
            sigma(found)
        ),
        ok: true,
        facts,
        tables: vec![
            axis_table(found),
            FigureTable {
                caption: format!("Residuals of each centre, measured less fitted ({MEANING})"),
                heads: HEADS.to_vec(),
                rows: rows(&parts, all),
            },
        ],
        remarks: found.warnings.clone(),
        bands: spread(parts.iter().map(|part| part.outward_mm).collect()),
        points,
        ..DeviationPage::default()
    }
}

/// How it lies beside the machine file's.
pub(super) fn said(moved: &AxisMove) -> String {
    format!(
        "{} was turned by {:.5} degrees and lay {:.6} mm beside",
        moved.joint, moved.turned_deg, moved.moved_mm
    )
}

/// The standard deviation, in words.
pub(super) fn sigma(found: &AxisAnswer) -> String {
    found
        .sigma_mm
        .map_or_else(|| "unknown".into(), |sigma| format!("{sigma:.6} mm"))
}

/// A row for each centre, in their order.
pub(super) fn csv(found: &AxisAnswer, all: &TurnedCentres) -> String {
    let mut text = String::from(
        "angle_deg,ball,x_mm,y_mm,z_mm,residual_x_mm,residual_y_mm,residual_z_mm,outward_mm,onward_mm,axial_mm\n",
    );
    let parts = found.by_axis(&all.centres);
    for ((centre, [rx, ry, rz]), part) in all.centres.iter().zip(&found.residuals_mm).zip(parts) {
        let ball = &all.balls[centre.ball];
        let [x, y, z]: [f64; 3] = centre.measured_mm.into();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{},{ball},{x},{y},{z},{rx},{ry},{rz},{},{},{}",
            centre.angle_deg, part.outward_mm, part.onward_mm, part.axial_mm
        );
    }
    text
}

/// The table for a terminal.
pub(super) fn table(found: &AxisAnswer, all: &TurnedCentres) -> String {
    let parts: Vec<AxisResidual> = found.by_axis(&all.centres).collect();
    let mut lengths: Vec<f64> = parts.iter().map(length).collect();
    let shown = if lengths.len() > SHOWN {
        lengths.sort_by(|a, b| b.total_cmp(a));
        Some(lengths[SHOWN / 2])
    } else {
        None
    };
    let mut table = Table::new("><>>>").titles(&HEADS);
    for (row, part) in rows(&parts, all).into_iter().zip(&parts) {
        if shown.is_none_or(|least| length(part) > least) {
            table.row(row);
        }
    }
    let which = match shown {
        Some(_) => format!(
            "The largest of {} residuals (--residuals writes all)",
            parts.len()
        ),
        None => "Residuals, measured less fitted".to_owned(),
    };
    format!("{which}; {MEANING}\n\n{table}\n")
}

fn length(part: &AxisResidual) -> f64 {
    part.outward_mm.hypot(part.onward_mm).hypot(part.axial_mm)
}

fn rows(parts: &[AxisResidual], all: &TurnedCentres) -> Vec<Vec<String>> {
    let um = |mm: f64| format!("{:+.3}", Plain(1e3 * mm));
    let row = |(centre, part): (&umi_scan::calibrate::axis::TurnedCentre, &AxisResidual)| {
        vec![
            format!("{:.4}", Plain(centre.angle_deg)),
            all.balls[centre.ball].clone(),
            um(part.outward_mm),
            um(part.onward_mm),
            um(part.axial_mm),
        ]
    };
    all.centres.iter().zip(parts).map(row).collect()
}

fn axis_table(found: &AxisAnswer) -> FigureTable {
    let u = |covariance: Option<[[f64; 3]; 3]>, i: usize, unit: &str| {
        covariance.map_or_else(
            || "unknown".into(),
            |c| format!("{:.2e}{unit}", c[i][i].max(0.0).sqrt()),
        )
    };
    let direction = found.cov_direction_poses.or(found.cov_direction);
    let point = found.cov_point_poses.or(found.cov_point);
    let of = |i: usize| {
        let axis = ["X", "Y", "Z"][i];
        [
            vec![
                format!("direction {axis}"),
                format!("{:+.9}", Plain(found.direction[i])),
                u(direction, i, ""),
            ],
            vec![
                format!("point {axis}"),
                format!("{:+.6} mm", Plain(found.point_mm[i])),
                u(point, i, " mm"),
            ],
        ]
    };
    let (directions, points): (Vec<_>, Vec<_>) = (0..3)
        .map(of)
        .map(|[direction, point]| (direction, point))
        .unzip();
    FigureTable {
        caption: "The axis: direction and the foot of the machine's origin on it, and their standard uncertainties".into(),
        heads: vec!["unknown", "value", "standard uncertainty"],
        rows: directions.into_iter().chain(points).collect(),
    }
}
