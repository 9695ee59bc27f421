//! Tables of figures: units in the headers, numbers to the right.

use umi_protocol::feature::{FeatureResult, Shape};
use umi_protocol::job::FeatureSpec;

use crate::draw::markup::{Element, el};
use crate::draw::number::{self, NONE, fixed, mm, typographic, um, um_signed};
use crate::figures::{half_sigma, in_job_order, radius_error, sphere_uncertainty};
use umi_client::session::{Session, Setup};

/// One cell.
pub struct TableCell {
    text: String,
    class: &'static str,
}

/// A number.
pub fn num(text: impl Into<String>) -> TableCell {
    TableCell {
        text: typographic(&text.into()),
        class: "n",
    }
}

/// A number, or a dash where there is none.
pub fn num_or(text: Option<String>) -> TableCell {
    num(text.unwrap_or_else(|| NONE.into()))
}

/// A number that breaks its limit: marked so that it is seen without colour.
pub fn judged(text: String, within: bool) -> TableCell {
    TableCell {
        text: typographic(&text),
        class: if within { "n" } else { "n over" },
    }
}

impl TableCell {
    /// What makes a row one that must look different.
    pub fn ng(text: &str) -> Self {
        Self {
            text: text.into(),
            class: "ng",
        }
    }
}

/// Words.
pub fn word(text: impl Into<String>) -> TableCell {
    TableCell {
        text: text.into(),
        class: "w",
    }
}

/// A table. A header is "name" or "name|unit"; one that begins with "<" stands
/// to the left, over words.
pub fn table(caption: &str, headers: &[&str], rows: Vec<Vec<TableCell>>) -> Element {
    let head = headers.iter().map(|header| {
        let (name, unit) = header.split_once('|').unwrap_or((header, ""));
        let th = el("th").attr("scope", "col");
        let th = match name.strip_prefix('<') {
            Some(name) => th.class("w").text(name),
            None => th.text(name),
        };
        if unit.is_empty() {
            th
        } else {
            th.child(el("span").class("unit").text(unit))
        }
    });
    let head = el("thead").child(el("tr").children(head));
    let body = rows.into_iter().map(|row| {
        let bad = row.iter().any(|c| c.class == "ng");
        let cells = row
            .into_iter()
            .map(|cell| el("td").class(cell.class).text(cell.text));
        let tr = el("tr").children(cells);
        if bad { tr.class("refused") } else { tr }
    });
    el("div").class("scroll").child(
        el("table")
            .child(el("caption").text(caption))
            .child(head)
            .child(el("tbody").children(body)),
    )
}

/// Whether a feature may be used, in a word.
fn status(feature: &FeatureResult) -> TableCell {
    if feature.is_ok() {
        word("\u{2713} ok")
    } else {
        TableCell::ng("\u{2717} refused")
    }
}

/// Every feature that arrived, and a line for each that did not.
fn arrived<'a>(
    session: &'a Session,
    setup: &'a Setup,
) -> impl Iterator<Item = (&'a FeatureSpec, Option<&'a FeatureResult>)> {
    in_job_order(session, setup).flat_map(|(spec, latest)| {
        let mut all: Vec<_> = setup
            .features
            .iter()
            .filter(move |f| f.name == spec.name)
            .map(|f| (spec, Some(f)))
            .collect();
        if latest.is_none() {
            all.push((spec, None));
        }
        all
    })
}

/// The sphere fits of one setup.
pub fn spheres(session: &Session, setup: &Setup) -> Option<Element> {
    use umi_protocol::job::FeatureKind::Sphere;
    let rows: Vec<Vec<TableCell>> = arrived(session, setup)
        .filter(|(spec, _)| spec.kind == Sphere)
        .map(|(spec, feature)| sphere_row(session, spec, feature))
        .collect();
    if rows.is_empty() {
        return None;
    }
    let limits = &session.job.limits;
    Some(table(
        &format!(
            "Spheres. Limits: radius error \u{b1}{} \u{b5}m, rms {} \u{b5}m.",
            um(limits.radius_error_mm),
            um(limits.rms_mm)
        ),
        &[
            "<Sphere",
            "Hits",
            "Centre X|mm",
            "Y|mm",
            "Z|mm",
            "Radius|mm",
            "Radius error|\u{b5}m",
            "rms|\u{b5}m",
            "s|\u{b5}m",
            "\u{3bd}",
            "u(x)|\u{b5}m",
            "u(y)|\u{b5}m",
            "u(z)|\u{b5}m",
            "u(r)|\u{b5}m",
            "thesis s/2|\u{b5}m",
            "<Status",
        ],
        rows,
    ))
}

fn sphere_row(
    session: &Session,
    spec: &FeatureSpec,
    feature: Option<&FeatureResult>,
) -> Vec<TableCell> {
    let limits = &session.job.limits;
    let name = word(spec.name.as_str());
    let Some(feature) = feature else {
        return missing_row(name, 14);
    };
    let hits = num(format!("{}/{}", feature.points_mm.len(), spec.hits));
    let Some(fit) = &feature.fit else {
        let mut row = vec![name, hits];
        row.extend((0..13).map(|_| num(NONE)));
        row.push(status(feature));
        return row;
    };
    let center = fit.shape.position_mm().unwrap_or([f64::NAN; 3]);
    let error = radius_error(Some(spec), fit);
    let u = sphere_uncertainty(fit);
    let mut row = vec![name, hits];
    row.extend(center.map(|c| num(mm(c))));
    row.push(num_or(fit.shape.radius_mm().map(mm)));
    row.push(error.map_or_else(
        || num(NONE),
        |e| judged(um_signed(e), e.abs() <= limits.radius_error_mm),
    ));
    row.push(judged(um(fit.rms_mm), fit.rms_mm <= limits.rms_mm));
    row.push(num_or(fit.sigma_mm.map(um)));
    row.push(num(fit.dof.to_string()));
    row.extend((0..4).map(|i| num_or(u.map(|u| um(u[i])))));
    row.push(num_or(half_sigma(fit).map(um)));
    row.push(status(feature));
    row
}

fn missing_row(name: TableCell, dashes: usize) -> Vec<TableCell> {
    let mut row = vec![name];
    row.extend((0..dashes).map(|_| num(NONE)));
    row.push(TableCell::ng("\u{2717} did not arrive"));
    row
}

/// The fits of all other kinds.
pub fn other_features(session: &Session, setup: &Setup) -> Option<Element> {
    use umi_protocol::job::FeatureKind::Sphere;
    let rows: Vec<Vec<TableCell>> = arrived(session, setup)
        .filter(|(spec, _)| spec.kind != Sphere)
        .map(|(spec, feature)| other_row(session, spec, feature))
        .collect();
    if rows.is_empty() {
        return None;
    }
    Some(table(
        "Other features: point on plane or line, centre, foot on the axis, or apex; normal, \
         direction or axis; radius, or half angle of a cone.",
        &[
            "<Feature",
            "<Kind",
            "Hits",
            "X|mm",
            "Y|mm",
            "Z|mm",
            "I",
            "J",
            "K",
            "Radius|mm",
            "Half angle|\u{b0}",
            "rms|\u{b5}m",
            "s|\u{b5}m",
            "\u{3bd}",
            "<Status",
        ],
        rows,
    ))
}

fn other_row(
    session: &Session,
    spec: &FeatureSpec,
    feature: Option<&FeatureResult>,
) -> Vec<TableCell> {
    let name = word(spec.name.as_str());
    let Some(feature) = feature else {
        return missing_row(name, 13);
    };
    let mut row = vec![
        name,
        word(format!("{:?}", feature.kind).to_lowercase()),
        num(format!("{}/{}", feature.points_mm.len(), spec.hits)),
    ];
    let Some(fit) = &feature.fit else {
        row.extend((0..11).map(|_| num(NONE)));
        row.push(status(feature));
        return row;
    };
    let (point, axis, angle) = match fit.shape {
        Shape::Sphere { center_mm, .. } => (center_mm, None, None),
        Shape::Plane {
            point_mm, normal, ..
        } => (point_mm, Some(normal), None),
        Shape::Line {
            point_mm,
            direction,
            ..
        }
        | Shape::Cylinder {
            point_mm,
            direction,
            ..
        } => (point_mm, Some(direction), None),
        Shape::Circle {
            center_mm, normal, ..
        } => (center_mm, Some(normal), None),
        Shape::Cone {
            apex_mm,
            direction,
            half_angle_rad,
            ..
        } => (apex_mm, Some(direction), Some(half_angle_rad)),
    };
    row.extend(point.map(|c| num(mm(c))));
    row.extend((0..3).map(|i| num_or(axis.map(|a| fixed(a[i], 7)))));
    row.push(num_or(fit.shape.radius_mm().map(mm)));
    row.push(num_or(angle.map(|a| fixed(a.to_degrees(), 5))));
    row.push(judged(
        um(fit.rms_mm),
        fit.rms_mm <= session.job.limits.rms_mm,
    ));
    row.push(num_or(fit.sigma_mm.map(um)));
    row.push(num(fit.dof.to_string()));
    row.push(status(feature));
    row
}

/// The hits of a feature and their residuals.
pub fn hits(feature: &FeatureResult) -> Element {
    let residual = |i: usize| {
        feature
            .fit
            .as_ref()
            .and_then(|f| f.residuals_mm.get(i).copied())
    };
    let rows = feature
        .points_mm
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let mut row = vec![num((i + 1).to_string())];
            row.extend(p.map(|c| num(mm(c))));
            row.push(num_or(residual(i).map(um_signed)));
            row
        })
        .collect();
    table(
        "Contact points as used in the fit",
        &["Hit", "X|mm", "Y|mm", "Z|mm", "Residual|\u{b5}m"],
        rows,
    )
}

/// Three components and a length, µm.
pub fn vector_um(v: [f64; 3]) -> Vec<TableCell> {
    let mut cells: Vec<TableCell> = v.iter().map(|c| num(um_signed(*c))).collect();
    cells.push(num(um(crate::figures::length(v))));
    cells
}

/// A limit on an absolute value.
pub fn limit(value: f64, decimals: usize) -> TableCell {
    num(format!("\u{b1}{}", number::fixed(value, decimals)))
}
