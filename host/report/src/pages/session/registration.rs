//! Tables of the plate check and the registration, against limits and, where
//! it is known, against the true answer.

use umi_protocol::verdict::{RegistrationReport, Verdict};

use crate::draw::markup::{Element, el};
use crate::draw::number::{NONE, fixed, mm, signed, um, um_signed};
use crate::figures::{
    PoseError, point_errors, pose_error, rotation_uncertainty_rad, shift_mm, turn_and_tilt_deg,
};
use crate::pages::session::tables::{
    TableCell, judged, limit, num, num_or, table, vector_um, word,
};
use umi_client::session::{Session, Setup, Truth, datums};

/// Distances and registration of a setup, in rows that stay together on paper.
pub fn tables(session: &Session, setup: &Setup, place: usize) -> Vec<Element> {
    let row = || el("div").class("tables");
    let distances = distances(session, setup);
    let Some(registration) = &setup.verdict.registration else {
        return distances.map(|d| row().child(d)).into_iter().collect();
    };
    let against = setup
        .truth
        .map(|truth| (truth, pose_error(registration, &truth)));
    vec![
        row()
            .children(distances)
            .child(angles(session, registration, against.as_ref())),
        row()
            .child(lengths(session, place, registration, against.as_ref()))
            .child(scalars(session, &setup.verdict, registration)),
        row()
            .child(matrix(registration))
            .child(residual_table(session, registration)),
        row().children(points(session, setup)),
    ]
}

fn angles(
    session: &Session,
    registration: &RegistrationReport,
    against: Option<&(Truth, PoseError)>,
) -> Element {
    let limits = &session.job.limits;
    let (turn, tilt) = turn_and_tilt_deg(registration);
    let truly = against.map(|(truth, _)| {
        let as_report = RegistrationReport {
            rotation: truth.rotation,
            ..registration.clone()
        };
        turn_and_tilt_deg(&as_report)
    });
    let error = |found: f64, truly: Option<f64>| -> [TableCell; 2] {
        let deg = truly.map(|truly| found - truly);
        [
            num_or(deg.map(|d| signed(d.to_radians() * 1e6, 1))),
            num_or(deg.map(|d| signed(d * 1e6, 0))),
        ]
    };
    let u = rotation_uncertainty_rad(registration);
    let mut rows = Vec::new();
    let mut turn_row = vec![
        word("Turn about Z"),
        judged(signed(turn, 5), turn.abs() <= limits.rotation_deg),
        limit(limits.rotation_deg, 3),
        num_or(truly.map(|t| signed(t.0, 5))),
    ];
    turn_row.extend(error(turn, truly.map(|t| t.0)));
    turn_row.push(num_or(u.map(|u| fixed(u[2] * 1e6, 1))));
    rows.push(turn_row);
    let mut tilt_row = vec![
        word("Tilt of the Z axis"),
        judged(fixed(tilt, 5), tilt <= limits.tilt_deg),
        num(fixed(limits.tilt_deg, 3)),
        num_or(truly.map(|t| fixed(t.1, 5))),
    ];
    tilt_row.extend(error(tilt, truly.map(|t| t.1)));
    tilt_row.push(num(NONE));
    rows.push(tilt_row);
    if let Some((_, e)) = against {
        let mut push = |name: &str, rad: f64, digits: fn(f64, usize) -> String, u: Option<f64>| {
            let mut row = vec![word(name)];
            row.extend((0..3).map(|_| num(NONE)));
            row.push(num(digits(rad * 1e6, 1)));
            row.push(num(digits(rad.to_degrees() * 1e6, 0)));
            row.push(num_or(u.map(|u| fixed(u * 1e6, 1))));
            rows.push(row);
        };
        for (i, name) in ["True to found, about X", "about Y", "about Z"]
            .into_iter()
            .enumerate()
        {
            push(name, e.rotation_rad[i], signed, u.map(|u| u[i]));
        }
        push("angle of that rotation", e.angle_rad, fixed, None);
    }
    table(
        "Angles",
        &[
            "<Angle",
            "Measured|\u{b0}",
            "Limit|\u{b0}",
            "True|\u{b0}",
            "Error|\u{b5}rad",
            "Error|\u{b5}\u{b0}",
            "u|\u{b5}rad",
        ],
        rows,
    )
}

fn lengths(
    session: &Session,
    place: usize,
    registration: &RegistrationReport,
    against: Option<&(Truth, PoseError)>,
) -> Element {
    let limits = session.job.limits.shift_mm;
    let mut rows = Vec::new();
    let mut push = |name: &str, cells: Vec<TableCell>| {
        let mut row = vec![word(name)];
        row.extend(cells);
        rows.push(row);
    };
    if let Some(shift) = shift_mm(session, place) {
        let cells = (0..3).map(|i| judged(signed(shift[i], 4), shift[i].abs() <= limits[i]));
        push("Shift of the datum centroid", cells.collect());
        push("its limit", limits.iter().map(|l| limit(*l, 3)).collect());
    }
    let row = |v: [f64; 3]| v.iter().map(|c| num(signed(*c, 4))).collect();
    push(
        "Translation t, at the frame\u{2019}s origin",
        row(registration.translation_mm),
    );
    if let Some((truth, e)) = against {
        push("true t", row(truth.translation_mm));
        push("error of t", row(e.translation_mm));
    }
    table(
        "Displacements",
        &["<Displacement", "X|mm", "Y|mm", "Z|mm"],
        rows,
    )
}

fn scalars(session: &Session, verdict: &Verdict, registration: &RegistrationReport) -> Element {
    let limits = &session.job.limits;
    let mut rows = vec![
        vec![
            word("rms of the residuals"),
            judged(
                um(registration.rms_mm),
                registration.rms_mm <= limits.registration_rms_mm,
            ),
            num(um(limits.registration_rms_mm)),
        ],
        vec![
            word(format!(
                "s of the residuals (\u{3bd} = {})",
                registration.dof
            )),
            num_or(registration.sigma_mm.map(um)),
            num(NONE),
        ],
    ];
    if let Some(expected) = registration.expected_error_mm {
        let most = limits.expected_error_mm;
        rows.push(vec![
            word("Expected error at the part\u{2019}s worst corner (1 s)"),
            judged(um(expected), most.is_none_or(|most| expected <= most)),
            num_or(most.map(um)),
        ]);
    }
    if let (Some(correction), Some(spec)) = (&verdict.correction, &session.job.correction) {
        rows.push(vec![
            word("Left by the correction at the part\u{2019}s corners"),
            judged(
                um(correction.leftover_mm),
                correction.leftover_mm <= spec.leftover_mm,
            ),
            num(um(spec.leftover_mm)),
        ]);
    }
    table(
        "Quality",
        &["<Figure", "Value|\u{b5}m", "Limit|\u{b5}m"],
        rows,
    )
}

fn matrix(registration: &RegistrationReport) -> Element {
    let rows = registration
        .rotation
        .iter()
        .zip(registration.translation_mm)
        .map(|(row, t)| {
            let mut cells: Vec<TableCell> = row.iter().map(|c| num(fixed(*c, 9))).collect();
            cells.push(num(mm(t)));
            cells
        })
        .collect();
    table("R and t: q = R p + t", &["R", "", "", "t|mm"], rows)
}

fn residual_table(session: &Session, registration: &RegistrationReport) -> Element {
    let rows = datums(&session.job)
        .zip(&registration.residuals_mm)
        .map(|(spec, residual)| {
            let mut row = vec![word(spec.name.as_str())];
            row.extend(vector_um(*residual));
            row
        })
        .collect();
    table(
        "Residuals R p + t \u{2212} q",
        &[
            "<Feature",
            "X|\u{b5}m",
            "Y|\u{b5}m",
            "Z|\u{b5}m",
            "length|\u{b5}m",
        ],
        rows,
    )
}

fn points(session: &Session, setup: &Setup) -> Option<Element> {
    let errors = point_errors(session, setup);
    let dashes = || (0..4).map(|_| num(NONE)).collect::<Vec<_>>();
    let rows: Vec<Vec<TableCell>> = (1..)
        .zip(&errors)
        .map(|(number, e)| {
            let mut row = vec![word(format!("P{number}"))];
            row.extend(e.point_mm.map(|c| num(fixed(c, 3))));
            row.extend(e.registration_mm.map_or_else(dashes, vector_um));
            row.extend(e.program_mm.map_or_else(dashes, vector_um));
            row
        })
        .collect();
    if errors
        .iter()
        .all(|e| e.registration_mm.is_none() && e.program_mm.is_none())
    {
        return None;
    }
    let caption = if setup.truth.is_some() {
        "Path errors against the true answer: of the registration, and of the correction program as a control executes it"
    } else {
        "What the correction program does at these points, less the registration"
    };
    Some(table(
        caption,
        &[
            "<Point",
            "X|mm",
            "Y|mm",
            "Z|mm",
            "Registration X|\u{b5}m",
            "Y|\u{b5}m",
            "Z|\u{b5}m",
            "length|\u{b5}m",
            "Program X|\u{b5}m",
            "Y|\u{b5}m",
            "Z|\u{b5}m",
            "length|\u{b5}m",
        ],
        rows,
    ))
}

/// Distances between datum positions.
fn distances(session: &Session, setup: &Setup) -> Option<Element> {
    if setup.verdict.distances.is_empty() {
        return None;
    }
    let limit = session.job.limits.distance_error_mm;
    let rows = setup
        .verdict
        .distances
        .iter()
        .map(|d| {
            let error = d.reference_mm.map(|r| d.measured_mm - r);
            vec![
                word(format!("{} to {}", d.a, d.b)),
                num(mm(d.measured_mm)),
                num_or(d.reference_mm.map(mm)),
                error.map_or_else(|| num(NONE), |e| judged(um_signed(e), e.abs() <= limit)),
            ]
        })
        .collect();
    Some(table(
        &format!("Distances in space. Limit \u{b1}{} \u{b5}m.", um(limit)),
        &["<Between", "Measured|mm", "Reference|mm", "Error|\u{b5}m"],
        rows,
    ))
}
