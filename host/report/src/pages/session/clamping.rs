//! The part of the page on one clamping: verdict, figures, pictures, program.

use umi_protocol::feature::FeatureResult;
use umi_protocol::verdict::{SetupReason, Verdict};

use super::{registration, tables};
use crate::draw::markup::{Element, el};
use crate::draw::number::{fixed, signed, typographic};
use crate::draw::scale::Magnified;
use crate::figures::program::CorrectionMotion;
use crate::figures::{in_job_order, length, minus, motion, part_outline};
use crate::pictures::{part, residuals, setup, sphere};
use umi_client::session::{Session, Setup};

/// OK or NG: different in word, sign, shape and colour.
pub fn badge(ok: bool) -> Element {
    if ok {
        el("span").class("badge ok").text("\u{2713} OK")
    } else {
        el("span").class("badge ng").text("\u{2717} NG")
    }
}

/// One clamping.
pub fn section(session: &Session, place: usize, common: Magnified) -> Element {
    let Some(setup) = session.setups.get(place) else {
        return el("section");
    };
    let verdict = &setup.verdict;
    let mut out = el("section")
        .class(if verdict.ok {
            "clamping"
        } else {
            "clamping ng"
        })
        .attr("id", format!("setup-{place}"))
        .child(
            el("h2")
                .text(setup.heading())
                .text(" ")
                .child(badge(verdict.ok))
                .child(el("span").class("about").text(&setup.about)),
        )
        .child(says(session, setup));
    if let Some(table) = tables::spheres(session, setup) {
        out = out.child(table).child(few_freedoms(setup));
    }
    if let Some(table) = tables::other_features(session, setup) {
        out = out.child(table);
    }
    out = out.child(feature_pictures(session, setup, common));
    let tables = registration::tables(session, setup, place);
    let pictures = setup_pictures(session, place);
    if !(tables.is_empty() && pictures.is_empty()) {
        out = out.child(el("h3").text("Setup and registration"));
    }
    if !verdict.ok && tables.is_empty() {
        out = out.child(el("p").text(
            "Not compared and not registered: figures from refused or missing features would only mislead.",
        ));
    }
    out = out.children(tables);
    if !pictures.is_empty() {
        out = out.child(el("div").class("setup-row").children(pictures));
    }
    out.child(correction(session, setup))
}

/// The verdict in words.
fn says(session: &Session, setup: &Setup) -> Element {
    let verdict = &setup.verdict;
    let mut out = el("div").class("says");
    if verdict.ok {
        let text = if setup.is_taught() {
            "OK: every feature came, every limit holds. This clamping is the reference."
        } else if verdict.correction.is_some() {
            "OK: every feature came, every limit holds. The correction is cleared."
        } else if session.job.correction.is_some() {
            "OK: every feature came, every limit holds. No correction was made."
        } else {
            "OK: every feature came, every limit holds. The job asks for no correction."
        };
        out = out.child(el("p").text(text));
    } else {
        out = out
            .child(
                el("p")
                    .class("stop")
                    .text("NG: no correction leaves the board. Why:"),
            )
            .child(list("reasons", &verdict.reasons));
        out = out.children(dropped(verdict));
    }
    if !verdict.remarks.is_empty() {
        out = out
            .child(el("p").text("Remarks (they do not change the verdict):"))
            .child(list("remarks", &verdict.remarks));
    }
    out
}

fn dropped(verdict: &Verdict) -> Option<Element> {
    (verdict.reasons_dropped > 0).then(|| {
        el("p").text(format!(
            "{} more reasons found no room in the verdict.",
            verdict.reasons_dropped
        ))
    })
}

fn list(class: &str, reasons: &[SetupReason]) -> Element {
    el("ul").class(class).children(reasons.iter().map(|r| {
        el("li")
            .child(el("code").text(r.reason.code()))
            .text(" ")
            .text(typographic(&r.to_string()))
    }))
}

/// What a small number of degrees of freedom means.
fn few_freedoms(setup: &Setup) -> Element {
    let fits = setup.features.iter().filter_map(|f| f.fit.as_ref());
    if fits.into_iter().any(|fit| fit.dof == 1) {
        el("p").class("note").text(
            "With \u{3bd} = 1 degree of freedom s is hardly known itself: for 95 % confidence its \
             uncertainties are to be taken 12.7 times.",
        )
    } else {
        el("p").class("note")
    }
}

fn feature_pictures(session: &Session, setup: &Setup, common: Magnified) -> Element {
    let figures = setup
        .features
        .iter()
        .map(|feature| feature_picture(session, feature, common));
    let missing = in_job_order(session, setup)
        .filter(|(_, feature)| feature.is_none())
        .map(|(spec, _)| {
            let name = el("h4").text(&spec.name).text(" ");
            el("figure")
                .class("card ng")
                .child(name.child(el("span").class("badge ng").text("\u{2717} did not arrive")))
        });
    let row = el("div").class("row3").children(figures).children(missing);
    el("div").child(row).child(el("p").class("note").text(
        "Bars: residual of every hit along the surface normal, from the fitted sphere (thin circle) \
         to the hit; orange outside, blue inside, in \u{b5}m. Grey arrows: the probe\u{2019}s motion at \
         contact. Cross: fitted centre \u{b1} one standard uncertainty, magnified as the residuals. \
         Hits seen end-on are dots. Look for one bar that is longer than its neighbours (a bad hit), or \
         for pairs of opposite sign (X and Y are compensated differently).",
    ))
}

fn feature_picture(session: &Session, feature: &FeatureResult, common: Magnified) -> Element {
    use umi_protocol::job::FeatureKind::Sphere;
    let (svg, caption) = if feature.kind == Sphere {
        let limit = session.job.limits.approach_deg;
        sphere::drawing(session.spec(&feature.name), feature, common, limit)
    } else {
        residuals::drawing(feature)
    };
    let ok = feature.is_ok();
    let name = el("h4").text(&feature.name).text(" ");
    let name = if ok {
        name
    } else {
        name.child(el("span").class("badge ng").text("\u{2717} refused"))
    };
    let mut out = el("figure")
        .class(if ok { "card" } else { "card ng" })
        .child(name)
        .child(svg)
        .child(el("figcaption").text(typographic(&caption)));
    if !ok {
        let reasons = feature.reasons.iter().map(|reason| {
            el("li")
                .child(el("code").text(reason.code()))
                .text(" ")
                .text(typographic(&reason.to_string()))
        });
        out = out.child(el("ul").class("reasons").children(reasons));
    }
    out.child(
        el("details")
            .child(el("summary").text("Hits"))
            .child(tables::hits(feature)),
    )
}

fn setup_pictures(session: &Session, place: usize) -> Vec<Element> {
    let pictures = [
        setup::drawing(session, place),
        part::residuals(session, place),
        part::at_part(session, place),
    ];
    let card = |(svg, caption): (Element, String)| {
        el("figure")
            .class("card")
            .child(svg)
            .child(el("figcaption").text(typographic(&caption)))
    };
    pictures.into_iter().flatten().map(card).collect()
}

fn correction(session: &Session, setup: &Setup) -> Element {
    let out = el("div")
        .class("correction")
        .child(el("h3").text("Correction"));
    let Some(correction) = &setup.verdict.correction else {
        let why = if !setup.verdict.ok {
            "None: the verdict is NG."
        } else if setup.is_taught() {
            "None: this clamping is the reference."
        } else {
            "None was asked for."
        };
        return out.child(el("p").text(why));
    };
    let mut words = format!("Dialect {}.", correction.dialect.name());
    if let (Some(motion), Some(spec)) = (motion(session, setup), &session.job.correction) {
        let [x, y, z] = motion.offset_mm.map(|c| signed(c, 3));
        words = format!(
            "Dialect {}. Work offset {} = {} displaced by X {x}, Y {y}, Z {z} mm; rotation by {}\u{b0} \
             about X {}, Y {} mm. Largest displacement of a point of the part: {} mm.",
            correction.dialect.name(),
            spec.write_to,
            spec.probed_in,
            signed(motion.angle_deg, 3),
            fixed(motion.center_mm[0], 3),
            fixed(motion.center_mm[1], 3),
            fixed(largest_displacement(session, &motion), 3),
        );
    }
    out.child(el("p").text(typographic(&words))).child(
        el("pre")
            .attr("aria-label", "Correction program")
            .lines(&correction.text),
    )
}

fn largest_displacement(session: &Session, motion: &CorrectionMotion) -> f64 {
    part_outline(session)
        .iter()
        .flatten()
        .map(|p| length(minus(motion.apply(*p), *p)))
        .fold(0.0, f64::max)
}
