//! The whole report: well formed, self-contained, complete, and safe with
//! hostile text and odd numbers.

use umi_protocol::reason::Reason;

use super::*;
use crate::draw::number;
use umi_client::session::{Session, Truth};

/// Tags that open and close like brackets, attributes in quotes, no stray
/// angle brackets or ampersands.
fn assert_well_formed(html: &str) {
    let mut open: Vec<&str> = Vec::new();
    let body = html.strip_prefix("<!DOCTYPE html>\n").unwrap();
    let mut rest = body;
    while let Some(at) = rest.find('<') {
        assert_text(&rest[..at], &open);
        let end = rest[at..].find('>').expect("tag without end") + at;
        let tag = &rest[at + 1..end];
        if let Some(name) = tag.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closes what is not open");
        } else {
            let name = tag.split([' ', '/']).next().unwrap();
            assert!(tag.matches('"').count().is_multiple_of(2), "{tag}");
            assert!(!tag.contains("NaN") && !tag.contains("inf"), "{tag}");
            if !tag.ends_with('/') {
                open.push(name);
            }
        }
        rest = &rest[end + 1..];
    }
    assert_text(rest, &open);
    assert!(open.is_empty(), "not closed: {open:?}");
}

fn assert_text(text: &str, open: &[&str]) {
    if open.last() == Some(&"style") {
        return;
    }
    assert!(!text.contains('>'), "stray bracket in {text}");
    for (at, _) in text.match_indices('&') {
        let known = ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"];
        assert!(known.iter().any(|k| text[at..].starts_with(k)), "{text}");
    }
}

/// The policy as it stands in an attribute.
fn policy_text() -> String {
    crate::pages::session::CONTENT_SECURITY_POLICY.replace('\'', "&#39;")
}

/// Every kind of page says in itself that nothing is to be loaded or run.
#[test]
fn every_page_has_a_policy() {
    let placed = crate::pages::scan::html(&crate::pages::scan::PlacedPage::default());
    assert_self_contained(&placed);
    let paths = crate::pages::paths::html(
        "paths",
        "result",
        &[],
        &[],
        &[],
        &umi_core::registration::RigidTransform::identity(),
        &umi_client::files::tool_path::diff::compare(
            &[],
            &[],
            &umi_core::registration::RigidTransform::identity(),
            umi_client::files::tool_path::diff::DiffLimits {
                near_mm: 1.0,
                within_mm: 1.0,
            },
        ),
    );
    assert_self_contained(&paths);
}

/// Nothing is fetched from anywhere, nothing runs.
fn assert_self_contained(html: &str) {
    let policy = format!("content=\"{}\"", policy_text());
    assert!(html.contains(&policy), "no policy in {}", &html[..400]);
    let html = html.replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    for forbidden in [
        "http:",
        "https:",
        "src=",
        "<script",
        "<link",
        "<iframe",
        "<object",
        "@import",
        "url(",
        "javascript:",
        " on",
    ] {
        let found = html.match_indices(forbidden).find(|(at, _)| {
            // " on" is an attribute only inside a tag and with a value.
            forbidden != " on" || {
                let tag = &html[*at..];
                let word = tag[1..].split([' ', '=', '>', '<']).next().unwrap_or("");
                tag[1 + word.len()..].starts_with("=\"")
            }
        });
        assert!(
            found.is_none(),
            "{forbidden}: {:?}",
            found.map(|(at, _)| &html[at..at + 60])
        );
    }
    for (_, target) in html
        .match_indices("href=\"")
        .map(|(at, m)| (at, &html[at + m.len()..]))
    {
        assert!(target.starts_with('#'), "a link leaves the file");
    }
}

fn check(session: &Session) -> String {
    let html = html(session);
    assert_well_formed(&html);
    assert_self_contained(&html);
    html
}

/// The clean session: every verdict, every correction program, every picture.
#[test]
fn the_clean_session_is_all_there() {
    let session = sample::good();
    let html = check(&session);
    assert_eq!(session.setups.len(), 5);
    for setup in &session.setups {
        assert!(setup.verdict.ok);
        assert!(html.contains(&setup.title));
        if let Some(correction) = &setup.verdict.correction {
            assert!(html.contains(&format!("{}</pre>", correction.text)));
        }
    }
    // Once in the tiles, once in the headings.
    assert_eq!(html.matches("<span class=\"badge ok\">").count(), 10);
    assert_eq!(html.matches("badge ng").count(), 0);
    // A sphere in two views each, three pictures a setup (the reference has one), a chart.
    assert_eq!(html.matches("<svg ").count(), 15 + 4 * 3 + 1 + 1);
    assert_eq!(
        html.matches("<svg ").count(),
        html.matches("<figcaption>").count()
    );
    assert_eq!(
        html.matches("aria-label=").count(),
        html.matches("<svg ").count() + 1 + 4
    );
}

/// The spoilt session: every reason of every feature and verdict stands there
/// in words and by its code, and no correction beside an NG.
#[test]
fn every_reason_is_there() {
    let session = sample::spoilt();
    let html = check(&session);
    let ng: Vec<_> = session.setups.iter().filter(|p| !p.verdict.ok).collect();
    assert_eq!(ng.len(), 4);
    let mut codes = Vec::new();
    for setup in &ng {
        for reason in &setup.verdict.reasons {
            let words = number::typographic(&reason.to_string());
            assert!(html.contains(&words), "{words}");
            assert!(html.contains(&format!("<code>{}</code>", reason.reason.code())));
            codes.push(reason.reason.code());
        }
    }
    for code in [
        "null_point",
        "lone_hit_offset",
        "suspect_sign",
        "missing_feature",
        "shift",
    ] {
        assert!(codes.contains(&code), "{codes:?}");
    }
    assert_eq!(html.matches("<section class=\"clamping ng\"").count(), 4);
    assert_eq!(html.matches("<pre").count(), 0);
    assert!(html.contains("None: the verdict is NG."));
    assert!(html.contains("did not arrive"));
    assert!(html.contains("all coordinates are zero"));
}

/// The figures of the page are those of the records: centre, radius, s, s/2
/// and u of the first sphere.
#[test]
fn figures_of_a_sphere_are_right() {
    let session = sample::good();
    let html = check(&session);
    let row = html
        .split("<tr>")
        .find(|row| row.starts_with("<td class=\"w\">SPHERE1</td>"))
        .unwrap();
    let minus = '\u{2212}';
    for (text, what) in [
        (format!("{minus}135.0200"), "x"),
        (format!("{minus}136.6200"), "y"),
        ("135.8960".into(), "z"),
        ("12.7130".into(), "radius"),
        ("+13.0".into(), "radius error"),
        ("12.0".into(), "s"),
        // s sqrt(1/2) for x and y; z has the radius' share too.
        ("8.5".into(), "u(x)"),
        ("6.0".into(), "s/2"),
    ] {
        assert!(row.contains(&format!(">{text}</td>")), "{what}: {row}");
    }
}

/// Table 4.1 of the thesis (Sawula 2013), with the uncertainty of the centre
/// that its figures give beside half of s, which is what it prints.
#[test]
fn thesis_table_4_1_is_reproduced() {
    let html = check(&sample::mixed());
    let row = html
        .split("<tr>")
        .find(|row| row.starts_with("<td class=\"w\">TABLE41</td>"))
        .unwrap();
    let minus = '\u{2212}';
    let figures: Vec<&str> = row
        .split("<td class=\"n\">")
        .skip(1)
        .map(|cell| cell.split('<').next().unwrap())
        .collect();
    let center_x = format!("{minus}136.7105");
    assert_eq!(
        figures,
        [
            "5/5", &center_x, "136.4120", "136.1212", "12.7118", "+11.8", "6.5", "14.5", "1",
            "10.3", "10.3", "16.2", "7.3", "7.2"
        ]
    );
}

/// Path errors against the true pose are those of the reference answers, and
/// the program, read back, is off by no more than its leftover besides.
#[test]
fn path_errors_are_those_of_the_reference() {
    let session = sample::good();
    let expected: serde_json::Value = serde_json::from_str(include_str!(
        "../../../tests/reference/sessions/session_a.json"
    ))
    .unwrap();
    for (setup, answer) in session.setups[1..]
        .iter()
        .zip(expected["registrations"].as_array().unwrap())
    {
        let errors = figures::point_errors(&session, setup);
        assert_eq!(errors.len(), 5);
        let leftover = setup.verdict.correction.as_ref().unwrap().leftover_mm;
        for (i, error) in errors.iter().enumerate() {
            let due = answer["path_error_vs_truth_mm"][i].as_f64().unwrap();
            let got = error.registration_mm.unwrap();
            assert!((figures::length(got) - due).abs() < 1e-8);
            // The first path point is above the part, the others on it.
            if i > 0 {
                let program = figures::minus(error.program_mm.unwrap(), got);
                assert!(figures::length(program) <= leftover + 1e-9);
            }
        }
    }
}

/// The rotation error is the angle of the rotation between found and true.
#[test]
fn rotation_error_of_a_known_turn() {
    let session = sample::good();
    let registration = session.setups[1].verdict.registration.clone().unwrap();
    let turn = 5e-6f64;
    let (sin, cos) = turn.sin_cos();
    let about_z = [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]];
    // U = Rz(-5 µrad) R, so R = Rz(5 µrad) U.
    let rotation = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            (0..3)
                .map(|k| about_z[k][i] * registration.rotation[k][j])
                .sum()
        })
    });
    let truth = Truth {
        rotation,
        translation_mm: registration.translation_mm,
    };
    let error = figures::pose_error(&registration, &truth);
    assert!((error.angle_rad - turn).abs() < 1e-12, "{error:?}");
    assert!((error.rotation_rad[2] - turn).abs() < 1e-12, "{error:?}");
    assert_eq!(error.translation_mm, [0.0; 3]);
}

/// Names and texts from a control or a file cannot become markup.
#[test]
fn hostile_text_stays_text() {
    let mut session = sample::spoilt();
    let hostile = "<b>&\"'\u{1b}[31m";
    session.title = format!("{hostile}<script>alert(1)</script>");
    session.setups[0].title = "\" onload=\"x".into();
    session.faults[0].text = hostile.try_into().unwrap();
    for name in [&mut session.job.features[0].name, &mut session.job.name] {
        *name = hostile.try_into().unwrap();
    }
    session.setups[1].features[0].name = hostile.try_into().unwrap();
    session.setups[1].verdict.reasons[0].reason = Reason::MissingFeature {
        name: hostile.try_into().unwrap(),
    };
    let html = check(&session);
    assert!(!html.contains(hostile) && !html.contains("<script"));
    assert!(html.contains("&lt;b&gt;&amp;&quot;&#39;\u{241b}[31m"));
    let table = terminal::setup(&session, 1, false);
    assert!(!table.contains('\u{1b}'), "{table}");
}

/// NaN and infinity anywhere in the records do not reach the page as numbers
/// or into a picture.
#[test]
fn odd_numbers_do_not_break_the_page() {
    for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 0.0] {
        let mut session = sample::good();
        let setup = &mut session.setups[2];
        for feature in &mut setup.features {
            feature.points_mm[1][0] = odd;
            let fit = feature.fit.as_mut().unwrap();
            fit.rms_mm = odd;
            fit.sigma_mm = Some(odd);
            fit.residuals_mm[2] = odd;
            if let umi_protocol::feature::Shape::Sphere {
                center_mm,
                radius_mm,
                cov_unit,
            } = &mut fit.shape
            {
                center_mm[2] = odd;
                *radius_mm = odd;
                cov_unit[0][0] = odd;
            }
        }
        setup.verdict.distances[0].measured_mm = odd;
        let registration = setup.verdict.registration.as_mut().unwrap();
        registration.rotation[0][1] = odd;
        registration.translation_mm[1] = odd;
        registration.residuals_mm[0][0] = odd;
        registration.rms_mm = odd;
        session.path_points_mm[0][0] = odd;
        session.job.limits.rms_mm = odd;
        let html = check(&session);
        assert!(!html.contains("NaN") && !html.contains(">inf<"), "{odd}");
        let text = terminal::session(&session, false);
        assert!(!text.contains("NaN"), "{text}");
    }
}

/// A session without setups, truth, correction or board still makes a page.
#[test]
fn little_data_makes_a_page() {
    let mut session = sample::good();
    session.setups.clear();
    session.identity = None;
    check(&session);
    let mut session = sample::good();
    session.job.correction = None;
    session.path_points_mm.clear();
    for setup in &mut session.setups {
        setup.truth = None;
        setup.verdict.correction = None;
        setup.features.clear();
    }
    check(&session);
}

/// With `UMI_REPORT_DIR` set, writes the sample reports there to be looked at.
#[test]
fn samples_to_look_at() {
    let samples = [
        ("good", sample::good()),
        ("spoilt", sample::spoilt()),
        ("mixed", sample::mixed()),
    ];
    for (name, session) in samples {
        let html = check(&session);
        if let Some(dir) = std::env::var_os("UMI_REPORT_DIR") {
            let path = std::path::Path::new(&dir).join(format!("{name}.html"));
            std::fs::write(path, html).unwrap();
            print!("{}", terminal::session(&session, true));
        }
    }
}
