//! The thesis' tables and its figure 3.5, with its figures beside ours.

use umi_protocol::feature::{FeatureResult, FitReport};

use crate::thesis::outcome::ExperimentOutcome;
use crate::thesis::pages::polar;
use crate::thesis::printed as thesis;
use umi_client::session::{Session, Setup, datums};
use umi_report::draw::markup::{Element, el};
use umi_report::draw::number::{fixed, mm, signed, typographic, um, um_signed};
use umi_report::figures::half_sigma;
use umi_report::pages::session::tables::{TableCell, num, num_or, table, word};

/// Whose figures a row holds, where both have rows.
const THESIS: &str = "thesis";
const OURS: &str = "here";

/// The tables in the thesis' order; table 5.1 stands with the surface.
pub fn section(outcome: &ExperimentOutcome) -> Element {
    let session = &outcome.session;
    el("section")
        .child(el("h2").text("Tables of the thesis"))
        .child(figure_3_5(outcome))
        .child(table_4_1(session))
        .child(table_4_2(session))
        .child(table_5_2(session))
        .child(table_5_3(session))
        .child(table_5_4(outcome))
        .child(table_5_5(outcome))
}

/// Figure 3.5: the probe in the ring gauge.
fn figure_3_5(outcome: &ExperimentOutcome) -> Element {
    let calibration = &outcome.calibration;
    let amounts = || calibration.pretravel.iter().map(|(_, mm)| *mm);
    el("div").class("row3").child(
        el("figure")
            .class("card")
            .child(polar::drawing(
                &calibration.pretravel,
                outcome.compensation_mm,
            ))
            .child(
                el("figcaption")
                    .child(el("b").text("Figure 3.5"))
                    .text(format!(
                        ", pretravel measured in a ring gauge in {} directions: {} \u{b5}m on average, {} to {}. \
                         Dashed: the {} \u{b5}m that the routine adds, the thesis\u{2019} average.",
                        calibration.pretravel.len(),
                        um(calibration.mean_mm),
                        um(amounts().fold(f64::INFINITY, f64::min)),
                        um(amounts().fold(f64::NEG_INFINITY, f64::max)),
                        um(outcome.compensation_mm),
                    )),
            ),
    )
}

/// The fit of a sphere in a clamping.
fn sphere<'a>(setup: &'a Setup, name: &str) -> Option<(&'a FeatureResult, &'a FitReport)> {
    let feature = setup.feature(name)?;
    Some((feature, feature.fit.as_ref()?))
}

fn names(session: &Session) -> Vec<String> {
    datums(&session.job)
        .map(|spec| spec.name.as_str().to_owned())
        .collect()
}

/// A row's name, in one line.
fn sphere_of(setup: &Setup, name: &str) -> String {
    format!("{}, {name}", setup.heading()).replace(' ', "\u{a0}")
}

fn table_4_1(session: &Session) -> Element {
    let found = session
        .setups
        .first()
        .zip(names(session).get(2))
        .and_then(|(setup, name)| sphere(setup, name));
    let ours = |row: usize| -> Vec<TableCell> {
        let point = found.and_then(|(feature, _)| feature.points_mm.get(row));
        (0..3)
            .map(|axis| num_or(point.map(|point| mm(point[axis]))))
            .collect()
    };
    let mut rows: Vec<Vec<TableCell>> = thesis::SPHERE_HITS_MM
        .iter()
        .zip(["top", "+X", "-X", "+Y", "-Y"])
        .enumerate()
        .map(|(row, (printed, side))| {
            let mut cells = vec![word(typographic(&format!("Point {}, {side}", row + 1)))];
            cells.extend(ours(row));
            cells.extend(printed.map(|c| num(mm(c))));
            cells
        })
        .collect();
    let center = found.and_then(|(_, fit)| fit.shape.position_mm());
    let mut cells = vec![word("Fitted centre")];
    cells.extend((0..3).map(|axis| num_or(center.map(|center| mm(center[axis])))));
    cells.extend(thesis::SPHERE_CENTER_MM.map(|c| num(mm(c))));
    rows.push(cells);
    let mut scalar = |name: &str, ours: Option<f64>, printed: f64| {
        let dash = || num_or(None);
        rows.push(vec![
            word(name),
            num_or(ours.map(mm)),
            dash(),
            dash(),
            num(mm(printed)),
            dash(),
            dash(),
        ]);
    };
    let fit = found.map(|(_, fit)| fit);
    let [radius_mm, std_mm, half_mm] = thesis::SPHERES_MM[0][2];
    scalar("Radius", fit.and_then(|f| f.shape.radius_mm()), radius_mm);
    scalar(
        "Standard deviation of residuals",
        fit.and_then(|f| f.sigma_mm),
        std_mm,
    );
    scalar(
        "\u{201c}Uncertainty of centre\u{201d} (half of it)",
        fit.and_then(half_sigma),
        half_mm,
    );
    table(
        "Table 4.1. Case 0, sphere 3: hits and fit.",
        &[
            "<",
            "X here|mm",
            "Y|mm",
            "Z|mm",
            "X thesis|mm",
            "Y|mm",
            "Z|mm",
        ],
        rows,
    )
}

fn table_4_2(session: &Session) -> Element {
    let names = names(session);
    let (mut errors, mut motions) = (Vec::new(), Vec::new());
    // Case 0 is its own reference.
    let cases = session.setups.iter().skip(1).zip(&thesis::REGISTRATIONS);
    for (setup, printed) in cases {
        let found = setup.verdict.registration.as_ref();
        for (row, name) in names.iter().enumerate().take(3) {
            let mut cells = vec![word(sphere_of(setup, name))];
            let error = found.and_then(|r| r.residuals_mm.get(row));
            cells.extend((0..3).map(|i| num_or(error.map(|e| signed(e[i], 4)))));
            cells.extend(printed.errors_mm[row].map(|e| num(signed(e, 4))));
            errors.push(cells);

            let name = if row == 0 {
                setup.heading()
            } else {
                String::new()
            };
            let mut cells = vec![word(name)];
            cells.extend((0..3).map(|i| num_or(found.map(|r| fixed(r.rotation[row][i], 4)))));
            cells.push(num_or(found.map(|r| signed(r.translation_mm[row], 4))));
            cells.extend(printed.rotation[row].map(|r| num(fixed(r, 4))));
            cells.push(num(signed(printed.translation_mm[row], 4)));
            motions.push(cells);
        }
    }
    let errors = table(
        "Table 4.2. Registration error of the spheres: transformed less measured centre. The \
         thesis\u{2019} are 9.9 to 13.8 \u{b5}m rms over the three spheres; what is modelled here leaves about \
         1 \u{b5}m, as the largest source, the pretravel\u{2019}s lobes, acts alike in all cases and cancels. \
         So the thesis\u{2019} machine had more sources than its table 5.5 lists.",
        &[
            "<",
            "X here|mm",
            "Y|mm",
            "Z|mm",
            "X thesis|mm",
            "Y|mm",
            "Z|mm",
        ],
        errors,
    );
    let motions = table(
        "Table 4.2. R and T from case 0. The thesis\u{2019} plate stood as its registrations say, \
         not quite as its text says: +0.355 instead of +1 degree in case 3.",
        &[
            "<",
            "R here",
            "",
            "",
            "T here|mm",
            "R thesis",
            "",
            "",
            "T thesis|mm",
        ],
        motions,
    );
    el("div").class("tables").child(errors).child(motions)
}

fn table_5_2(session: &Session) -> Element {
    let names = names(session);
    let mut rows = Vec::new();
    let (mut sums, mut count) = ([0.0; 2], 0.0);
    for (setup, printed) in session.setups.iter().zip(&thesis::SPHERES_MM) {
        for (name, printed) in names.iter().zip(printed) {
            let fit = sphere(setup, name).map(|(_, fit)| fit);
            let radius = fit.and_then(|f| f.shape.radius_mm());
            // A fit that is exact to rounding states no sigma: it is nothing here.
            let sigma = fit.map(|f| f.sigma_mm.unwrap_or(0.0));
            if let (Some(radius), Some(sigma)) = (radius, sigma) {
                sums[0] += radius;
                sums[1] += sigma;
                count += 1.0;
            }
            let mut row = vec![
                word(sphere_of(setup, name)),
                num_or(radius.map(mm)),
                num_or(sigma.map(mm)),
                num_or(sigma.map(|s| mm(s / 2.0))),
            ];
            row.extend(printed.map(|value| num(mm(value))));
            rows.push(row);
        }
    }
    let mut average = vec![word("Average")];
    let mean = |sum: f64| num_or((count > 0.0).then(|| mm(sum / count)));
    average.extend([sums[0], sums[1], sums[1] / 2.0].map(mean));
    average.extend(thesis::SPHERES_AVERAGE_MM.map(|value| num(mm(value))));
    rows.push(average);
    table(
        "Table 5.2. Sphere fits: radius, standard deviation of the residuals, and half of it, which the \
         thesis calls the uncertainty of the centre. With these five hits the deviation is the difference \
         of the radii in X and Y and nothing else. The thesis\u{2019} probe had 13 \u{b5}m of it, and so has \
         this one; three lobes shift the centre and leave the radii equal. What the probe does alike in \
         every clamping cancels in the registration.",
        &[
            "<",
            "Radius here|mm",
            "Std. dev.|mm",
            "Half|mm",
            "Radius thesis|mm",
            "Std. dev.|mm",
            "Half|mm",
        ],
        rows,
    )
}

fn table_5_3(session: &Session) -> Element {
    let names = names(session);
    let pairs = [(0, 1), (0, 2), (1, 2)];
    let plan = |setup: &Setup, (a, b): (usize, usize)| -> Option<f64> {
        let a = setup.position_mm(names.get(a)?)?;
        let b = setup.position_mm(names.get(b)?)?;
        Some((b[0] - a[0]).hypot(b[1] - a[1]))
    };
    let first: Vec<Option<f64>> = pairs
        .iter()
        .map(|pair| session.setups.first().and_then(|setup| plan(setup, *pair)))
        .collect();
    let rows = session
        .setups
        .iter()
        .zip(
            thesis::DISTANCES_MM
                .iter()
                .zip(&thesis::DISTANCE_CHANGES_MM),
        )
        .map(|(setup, (printed, changes))| {
            let mut row = vec![word(setup.heading())];
            for (place, pair) in pairs.iter().enumerate() {
                let here = plan(setup, *pair);
                let change = here.zip(first[place]).map(|(here, first)| here - first);
                row.push(num_or(here.map(mm)));
                row.push(num_or(change.map(um_signed)));
                row.push(num(mm(printed[place])));
                row.push(num(um_signed(changes[place])));
            }
            row
        })
        .collect();
    table(
        "Table 5.3. Distances of the centres in plan (the thesis\u{2019} agree with its table 4.2 only so), \
         and their change from case 0. The board itself judges distances in space.",
        &[
            "<",
            "1\u{2013}2 here|mm",
            "change|\u{b5}m",
            "thesis|mm",
            "change|\u{b5}m",
            "1\u{2013}3 here|mm",
            "change|\u{b5}m",
            "thesis|mm",
            "change|\u{b5}m",
            "2\u{2013}3 here|mm",
            "change|\u{b5}m",
            "thesis|mm",
            "change|\u{b5}m",
        ],
        rows,
    )
}

fn table_5_4(outcome: &ExperimentOutcome) -> Element {
    let mut rows = Vec::new();
    for (place, (plane, printed)) in outcome.planes.iter().zip(&thesis::PLANES).enumerate() {
        let mut push = |who: &str, centroid: [f64; 3], normal: [f64; 3], std_mm: f64| {
            let mut row = vec![word(format!("Case {place}, {who}"))];
            row.extend(centroid.map(|c| num(mm(c))));
            row.extend(normal.map(|c| num(fixed(c, if who == OURS { 6 } else { 4 }))));
            row.push(num(mm(std_mm)));
            rows.push(row);
        };
        push(OURS, plane.centroid_mm, plane.normal, plane.std_mm);
        push(THESIS, printed.centroid_mm, printed.normal, printed.std_mm);
    }
    let points = outcome.planes.first().map_or(0, |plane| plane.points);
    table(
        &format!(
            "Table 5.4. The setup\u{2019}s surface, plane through {points} hits. Our setup is flat: the \
             thesis\u{2019} 0.016 to 0.019 mm are mostly its setup\u{2019}s form. Hits are not compensated along Z, \
             as in the thesis."
        ),
        &[
            "<",
            "Centroid X|mm",
            "Y|mm",
            "Z|mm",
            "Normal X",
            "Y",
            "Z",
            "Std. dev.|mm",
        ],
        rows,
    )
}

fn table_5_5(outcome: &ExperimentOutcome) -> Element {
    let rows = outcome
        .sources
        .iter()
        .map(|(name, amount)| vec![word(name.as_str()), word(amount.as_str())])
        .collect();
    table(
        "Table 5.5. Error sources in force here: the thesis\u{2019} list (position of the machine while \
         probing and while cutting 1.0 \u{b5}m (2\u{3c3}) each, repeatability of the probe 1.0 \u{b5}m (2\u{3c3}), \
         pretravel by direction up to 10 \u{b5}m) and the control\u{2019}s delay of 0 to 4 ms (section 3.5.1), and \
         nothing else: no scanner, no tool wear, no bending, no warmth. The pretravel\u{2019}s mean is not the \
         62.0 \u{b5}m of section 3.5.2 that the routine adds, but what the radii of table 5.2 say of balls of \
         25.400 mm: 55.1 \u{b5}m in X and 41.7 \u{b5}m in Y, 48.4 \u{b5}m on average. The ring gauge (figure 3.5) \
         shows somewhat more, as the control\u{2019}s delay at 20 mm/min adds 0.7 \u{b5}m on average.",
        &["<Source", "<Amount"],
        rows,
    )
}
