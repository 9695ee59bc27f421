//! The part of the page on an experiment: the surface that was cut.

use umi_virtual::cutting::DeviationStatistics;

use crate::thesis::outcome::{ExperimentOutcome, ExperimentSummary, Surface, spread};
use crate::thesis::pages::map::{self, Map};
use crate::thesis::pages::thesis_tables;
use crate::thesis::printed as thesis;
use umi_client::session::Session;
use umi_report::draw::markup::{Element, el};
use umi_report::draw::number::{fixed, signed, typographic, um, um_signed};
use umi_report::figures::turn_and_tilt_deg;
use umi_report::pages::session::tables::{TableCell, num, num_or, table, word};

/// What the other rows of a table are compared with.
const THESIS: &str = "thesis";
const OURS: &str = "here";

/// Everything about an experiment, in the order of the thesis.
pub fn sections(outcome: &ExperimentOutcome, seeds: &[ExperimentSummary]) -> Vec<Element> {
    let session = &outcome.session;
    vec![
        el("section")
            .child(el("h2").text("The finished surface"))
            .child(surface_lead(outcome))
            .child(surfaces(outcome))
            .child(pictures(outcome))
            .children(over_seeds(seeds))
            .child(leftover(session)),
        thesis_tables::section(outcome),
    ]
}

fn surface_lead(outcome: &ExperimentOutcome) -> Element {
    let passes = &outcome.passes;
    let setting = &outcome.setting;
    let sources = if setting.ideal {
        "all error sources off"
    } else {
        "the error sources of table 5.5 and the control\u{2019}s delay on"
    };
    el("p").class("lead").text(format!(
        "Seed {}, {sources}. {} passes, {} mm apart on the surface, which leaves cusps of {} \u{b5}m \
         (the thesis: 0.541 mm and 9.6 \u{b5}m). Section 0 is cut in case 0, section 1 in case 1, \
         and so on. The second workpiece was cut in the same clampings by the same programs without \
         the corrections.",
        setting.seed,
        passes.count(),
        fixed(passes.stepover_mm(), 3),
        um(passes.cusp_mm()),
    ))
}

/// Table 5.1 (and 6.3), with ours and the uncorrected cut.
fn surfaces(outcome: &ExperimentOutcome) -> Element {
    let dash = || num_or(None);
    let mut rows: Vec<Vec<TableCell>> = thesis::SURFACES
        .iter()
        .map(|surface| {
            let mut row = vec![word(format!("{THESIS}, {}", surface.place)), dash()];
            row.push(num(signed(surface.above_mm, 4)));
            row.push(num(signed(surface.below_mm, 4)));
            row.push(num(fixed(surface.std_mm, 4)));
            row.extend((0..3).map(|_| dash()));
            row
        })
        .collect();
    for (name, surface) in [
        ("corrected", &outcome.corrected),
        ("not corrected", &outcome.uncorrected),
    ] {
        if let Some(figures) = &surface.against_first {
            rows.push(surface_row(
                &format!("{OURS}, {name}, cases 1 to 4 against case 0, as the thesis"),
                figures,
            ));
        }
        rows.push(surface_row(
            &format!("{OURS}, {name}, all against nominal"),
            &surface.whole,
        ));
        rows.extend(
            surface
                .sections
                .iter()
                .enumerate()
                .map(|(section, figures)| {
                    surface_row(&format!("{name}, section {section}"), figures)
                }),
        );
    }
    table(
        "Table 5.1. Deviation along the surface\u{2019}s normal; above is left, below is gone, of the nodes \
         that a tool has touched; the share that none has is stated beside. Averages are those of the \
         deviations above and below zero, as the thesis prints them. The thesis compares cases 1 to 4 with \
         the nominal arc as fitted to case 0; so does the row named after it: the nominal arc, its radius \
         kept, is laid on section 0 by least squares (shifts along normal and tangent, turns about \
         both). All other rows are against nominal where it was meant to be, which is harder. The \
         thesis\u{2019} were measured with laser scanners (accuracy 0.050 mm in table 5.1, resolution up to \
         0.014 mm in table 6.3) and hold the scanner\u{2019}s errors too, and all that a real machine and tool \
         add; ours are read from the virtual workpiece.",
        &[
            "<Surface",
            "Mean|mm",
            "Average above|mm",
            "Average below|mm",
            "Standard deviation|mm",
            "Smallest|mm",
            "Largest|mm",
            "Not cut|%",
        ],
        rows,
    )
}

fn surface_row(name: &str, figures: &DeviationStatistics) -> Vec<TableCell> {
    let cut = |text: String| num_or((figures.cut() > 0).then_some(text));
    vec![
        word(name),
        cut(signed(figures.mean_mm, 4)),
        cut(signed(figures.mean_above_mm, 4)),
        cut(signed(figures.mean_below_mm, 4)),
        cut(fixed(figures.std_mm, 4)),
        cut(signed(figures.min_mm, 4)),
        cut(signed(figures.max_mm, 4)),
        num(fixed(100.0 * figures.share_uncut(), 1)),
    ]
}

/// The result in one sentence.
pub fn result(outcome: &ExperimentOutcome) -> String {
    let range = |figures: &DeviationStatistics| {
        format!(
            "{} to {} \u{b5}m",
            signed(figures.min_mm * 1e3, 1),
            signed(figures.max_mm * 1e3, 1)
        )
    };
    let uncut =
        |figures: &DeviationStatistics| match fixed(100.0 * figures.share_uncut(), 0).as_str() {
            "0" => String::new(),
            share => format!(" where a tool was, and {share} % not cut at all"),
        };
    let [with, without] = [&outcome.corrected.whole, &outcome.uncorrected.whole];
    format!(
        "One surface, cut in {} clampings. With the corrections: {} from nominal{}. Without: {}{}.",
        outcome.session.setups.len(),
        range(with),
        uncut(with),
        range(without),
        uncut(without)
    )
}

/// Largest deviation from nominal.
fn largest(surface: &Surface) -> f64 {
    surface.whole.max_mm.max(-surface.whole.min_mm)
}

/// A map of a workpiece, bands of this width.
fn figure(
    outcome: &ExperimentOutcome,
    surface: &Surface,
    band_mm: f64,
    name: &str,
    caption: &str,
) -> Element {
    let stretches: Vec<(String, [f64; 2])> = (0..outcome.corrected.sections.len())
        .map(|section| {
            (
                format!("Case {section}"),
                outcome.passes.section_y_mm(section),
            )
        })
        .collect();
    let drawing = map::drawing(&Map {
        deviations: &surface.deviations,
        band_mm,
        stretches: &stretches,
        label: name,
    });
    el("figure").class("card").child(drawing).child(
        el("figcaption")
            .child(el("b").text(name))
            .text(typographic(caption)),
    )
}

/// Both workpieces, each in bands as fine as it is: where its own deviations lie.
pub fn first_pictures(outcome: &ExperimentOutcome) -> Element {
    let [corrected, uncorrected] = [&outcome.corrected, &outcome.uncorrected];
    let [fine, coarse] = [corrected, uncorrected].map(|surface| map::band_for(largest(surface)));
    let times = fixed(coarse / fine, 0);
    el("div").class("row2").children([
        figure(
            outcome,
            corrected,
            fine,
            "Corrected, in detail",
            &format!(": a band is {} \u{b5}m.", fixed(fine * 1e3, 1)),
        ),
        figure(
            outcome,
            uncorrected,
            coarse,
            "Not corrected",
            &format!(
                ": a band is {} \u{b5}m, {times} times as wide.",
                fixed(coarse * 1e3, 1)
            ),
        ),
    ])
}

/// Both workpieces in the range of both, and in that of the corrected one (as figures 5.1 to
/// 5.4).
fn pictures(outcome: &ExperimentOutcome) -> Element {
    let [corrected, uncorrected] = [&outcome.corrected, &outcome.uncorrected];
    el("div").class("row2").children([
        figure(
            outcome,
            corrected,
            map::band_for(largest(uncorrected)),
            "Corrected",
            ", in the range of both workpieces, as figures 5.1 and 5.3; the other one is above.",
        ),
        figure(
            outcome,
            uncorrected,
            map::band_for(largest(corrected)),
            "Not corrected, in detail",
            ", in the range of the corrected workpiece, which is above, as figures 5.2 and 5.4.",
        ),
    ])
}

/// The same experiment with other random errors.
fn over_seeds(seeds: &[ExperimentSummary]) -> Option<Element> {
    if seeds.len() < 2 {
        return None;
    }
    let figures: [fn(&ExperimentSummary) -> f64; 6] = [
        |s| s.corrected.mean_mm,
        |s| s.corrected.mean_above_mm,
        |s| s.corrected.mean_below_mm,
        |s| s.corrected.std_mm,
        |s| s.corrected.min_mm,
        |s| s.corrected.max_mm,
    ];
    let mut rows: Vec<Vec<TableCell>> = seeds
        .iter()
        .map(|summary| {
            let mut row = vec![word(summary.seed.to_string())];
            row.extend(figures.map(|figure| num(um_signed(figure(summary)))));
            row.push(num(signed(summary.uncorrected.mean_mm, 3)));
            row.push(num(signed(summary.uncorrected.max_mm, 3)));
            row.extend(AS_THESIS.map(|figure| num_or(figure(summary).map(um_signed))));
            row
        })
        .collect();
    for (name, pick) in [("Mean", true), ("Standard deviation", false)] {
        let value = |figure: fn(&ExperimentSummary) -> f64| {
            let (mean, std) = spread(seeds, figure);
            if pick { mean } else { std }
        };
        let mut row = vec![word(name)];
        row.extend(figures.map(|figure| num(um_signed(value(figure)))));
        row.push(num(signed(value(|s| s.uncorrected.mean_mm), 3)));
        row.push(num(signed(value(|s| s.uncorrected.max_mm), 3)));
        row.extend(AS_THESIS.map(|figure| {
            let known = seeds.iter().all(|seed| figure(seed).is_some());
            let (mean, std) = spread(seeds, |s| figure(s).unwrap_or(0.0));
            num_or(known.then(|| um_signed(if pick { mean } else { std })))
        }));
        rows.push(row);
    }
    Some(table(
        "The whole surface with other seeds, and how far they spread; cut nodes only.",
        &[
            "<Seed",
            "Mean|\u{b5}m",
            "Average above|\u{b5}m",
            "Average below|\u{b5}m",
            "Std. dev.|\u{b5}m",
            "Smallest|\u{b5}m",
            "Largest|\u{b5}m",
            "Not corrected: mean|mm",
            "largest|mm",
            "As the thesis: above|\u{b5}m",
            "below|\u{b5}m",
            "std. dev.|\u{b5}m",
        ],
        rows,
    ))
}

/// What the thesis states of a surface: cases 1 to 4 against case 0.
const AS_THESIS: [fn(&ExperimentSummary) -> Option<f64>; 3] = [
    |s| Some(s.against_first?.mean_above_mm),
    |s| Some(s.against_first?.mean_below_mm),
    |s| Some(s.against_first?.std_mm),
];

/// What a rotation about Z cannot do.
fn leftover(session: &Session) -> Element {
    let rows = session
        .setups
        .iter()
        .filter_map(|setup| {
            let registration = setup.verdict.registration.as_ref()?;
            let correction = setup.verdict.correction.as_ref()?;
            let (_, found) = turn_and_tilt_deg(registration);
            let truly = setup.truth.map(|truth| {
                let rotation = truth.rotation;
                turn_and_tilt_deg(&umi_protocol::verdict::RegistrationReport {
                    rotation,
                    ..registration.clone()
                })
                .1
            });
            Some(vec![
                word(setup.heading()),
                num(fixed(found, 5)),
                num_or(truly.map(|tilt| fixed(tilt, 5))),
                num(um(correction.leftover_mm)),
            ])
        })
        .collect();
    el("div")
        .child(table(
            "What the corrections leave out.",
            &[
                "<Clamping",
                "Tilt found|\u{b0}",
                "True tilt|\u{b0}",
                "Left at the part\u{2019}s corners|\u{b5}m",
            ],
            rows,
        ))
        .child(el("p").class("note").text(
            "A work offset with a rotation about Z (G10 L2 with G68) cannot express a tilt. Each sphere\u{2019}s \
             height rests on one hit, so errors of the heights look like a tilt of the plate. The correction \
             leaves that tilt out, which does no harm where it is false and remains as a deviation where it is \
             true; the board refuses to correct where what is left out exceeds the job\u{2019}s limit.",
        ))
}
