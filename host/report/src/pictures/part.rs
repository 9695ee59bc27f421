//! The uncorrected error, magnified: residuals at the datum features, and errors at points
//! of the part.

use crate::draw::labels::Labels;
use crate::draw::markup::Element;
use crate::draw::number::um_signed;
use crate::draw::scale::{Magnified, PlanView, bar};
use crate::draw::svg::{arrow, circle, picture, polygon, text};
use crate::figures::{Vector, length, part_outline, point_errors};
use umi_client::session::{Session, datums};

const WIDTH: f64 = 300.0;
const HEIGHT: f64 = 420.0;
const CORNER: [f64; 2] = [6.0, 30.0];
const SIZE: [f64; 2] = [288.0, 346.0];
/// Room for the longest arrow.
const ROOM: f64 = 52.0;

/// An error at a place.
struct Error {
    at_mm: Vector,
    error_mm: Vector,
    name: String,
}

/// The registration's residuals at the datum features.
pub fn residuals(session: &Session, place: usize) -> Option<(Element, String)> {
    let setup = session.setups.get(place)?;
    let registration = setup.verdict.registration.as_ref()?;
    let reference = session.reference_mm(place)?;
    let errors: Vec<Error> = datums(&session.job)
        .zip(reference)
        .zip(&registration.residuals_mm)
        .map(|((spec, at_mm), error_mm)| Error {
            at_mm,
            error_mm: *error_mm,
            name: spec.name.to_string(),
        })
        .collect();
    let (svg, stated) = draw(
        "residuals of the registration",
        &format!(
            "{}: residuals of the registration at the datum features",
            setup.heading()
        ),
        &errors,
        &[],
    )?;
    let caption = format!(
        "Registered less measured position of every datum feature, {stated}; arrows X and Y, \
         number Z in \u{b5}m. Look for one arrow longer than the others: that feature has moved on the plate."
    );
    Some((svg, caption))
}

/// Errors at the path points (or the part's corners).
pub fn at_part(session: &Session, place: usize) -> Option<(Element, String)> {
    let setup = session.setups.get(place)?;
    let found = point_errors(session, setup);
    let corrected = setup.verdict.correction.is_some();
    let errors: Vec<Error> = (1..)
        .zip(found)
        .filter_map(|(number, e)| {
            Some(Error {
                at_mm: e.point_mm,
                error_mm: if corrected {
                    e.program_mm?
                } else {
                    e.registration_mm?
                },
                name: format!("P{number}"),
            })
        })
        .collect();
    let outline: Vec<[f64; 2]> = part_outline(session)
        .iter()
        .flatten()
        .map(|p| [p[0], p[1]])
        .collect();
    let title = if corrected {
        "error of the correction at the part"
    } else {
        "error of the registration at the part"
    };
    let label = format!("{}: {title}", setup.heading());
    let (svg, stated) = draw(title, &label, &errors, &outline)?;
    let against = if setup.truth.is_some() {
        "less the true position"
    } else {
        "less the registered position"
    };
    let what = if corrected {
        "Where the correction program puts these points"
    } else {
        "Where the registration puts these points (no correction was cleared)"
    };
    let caption = format!(
        "{what}, {against}, {stated}; arrows X and Y, number Z in \u{b5}m. Look for Z growing \
         from one side to the other: tilt, which a rotation about Z cannot correct."
    );
    Some((svg, caption))
}

/// Draws errors; gives the picture and its magnification in words.
fn draw(
    title: &str,
    label: &str,
    errors: &[Error],
    outline: &[[f64; 2]],
) -> Option<(Element, String)> {
    let finite: Vec<&Error> = errors
        .iter()
        .filter(|e| length(e.error_mm).is_finite() && length(e.at_mm).is_finite())
        .collect();
    if finite.is_empty() {
        return None;
    }
    let mut extent: Vec<[f64; 2]> = finite.iter().map(|e| [e.at_mm[0], e.at_mm[1]]).collect();
    extent.extend(outline);
    let plan = PlanView::fit(&extent, CORNER, SIZE, ROOM + 4.0);
    let largest = finite
        .iter()
        .map(|e| e.error_mm[0].hypot(e.error_mm[1]))
        .fold(0.0, f64::max);
    let errors_scale = Magnified::for_largest(largest, ROOM, plan.scale);
    let mut svg = picture(WIDTH, HEIGHT, label).child(text("t b", [6.0, 16.0], title));
    let far = [CORNER[0] + SIZE[0], CORNER[1] + SIZE[1]];
    let mut labels = Labels::new([2.0, 20.0], far);
    let (class, corners) = if outline.is_empty() {
        ("setup-line", &extent[..])
    } else {
        ("outline corrected", outline)
    };
    let corners: Vec<[f64; 2]> = corners.iter().map(|p| plan.at(p[0], p[1])).collect();
    svg = svg.child(polygon(class, &corners));
    for (i, from) in corners.iter().enumerate() {
        labels.keep_off_line(*from, corners[(i + 1) % corners.len()]);
    }
    let mut to_label = Vec::new();
    for error in finite {
        let at = plan.at(error.at_mm[0], error.at_mm[1]);
        let to = [
            at[0] + error.error_mm[0] * errors_scale.px_per_mm,
            at[1] - error.error_mm[1] * errors_scale.px_per_mm,
        ];
        svg = svg
            .child(circle("place", at, 3.0))
            .children(arrow("error", at, to));
        labels.keep_off(at, 5.0);
        labels.keep_off_line(at, to);
        to_label.push((
            at,
            format!("{} (Z {})", error.name, um_signed(error.error_mm[2])),
        ));
    }
    for (at, says) in to_label {
        svg = svg.child(labels.place("t", at, 8.0, &says));
    }
    let bar_mm = errors_scale.bar_mm(70.0);
    let svg = svg.children(bar(
        "bar",
        [14.0, HEIGHT - 26.0],
        bar_mm,
        errors_scale.px_per_mm,
    ));
    Some((svg, errors_scale.stated()))
}
