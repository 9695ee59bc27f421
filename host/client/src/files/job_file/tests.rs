use super::*;

fn example() -> String {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/three-spheres.toml"
    );
    std::fs::read_to_string(path).unwrap()
}

/// The example with one text replaced, which must be there.
fn with(old: &str, new: &str) -> String {
    let text = example();
    assert!(text.contains(old), "{old}");
    text.replacen(old, new, 1)
}

fn fault(text: &str) -> JobFault {
    parse(text).unwrap_err()
}

/// The line of a fault, found by what stands there.
fn assert_at(fault: &JobFault, text: &str) {
    let place = fault
        .place
        .as_ref()
        .unwrap_or_else(|| panic!("no place: {}", fault.message));
    assert!(
        place.text.contains(text),
        "line {} is {:?}",
        place.line,
        place.text
    );
    let from: String = place.text.chars().skip(place.column - 1).collect();
    assert!(
        from.starts_with(text),
        "column {} is at {from:?}",
        place.column
    );
}

/// The example is a good job, and written as a file it is read as the same job.
#[test]
fn a_job_survives_being_written() {
    let job = parse(&example()).unwrap();
    assert_eq!(job.features.len(), 3);
    assert_eq!(parse(&write(&job).unwrap()).unwrap(), job);
}

/// Every dialect by its name, a further offset and a set, there and back; what the dialect
/// does not have is shown where it stands.
#[test]
fn every_dialect_in_a_job() {
    use umi_protocol::job::{Dialect, WorkOffset};
    let text = example();
    for dialect in Dialect::ALL {
        let text = text.replace("\"g10-g68\"", &format!("\"{}\"", dialect.name()));
        let job = parse(&text).unwrap();
        assert_eq!(job.correction.unwrap().dialect, dialect);
        assert_eq!(parse(&write(&job).unwrap()).unwrap(), job);
    }
    let further = "write_to = { extended = 7 }\nset = 3";
    let siemens = text.replace("\"g10-g68\"", "\"siemens\"");
    let variables = text
        .replace("\"g10-g68\"", "\"fanuc-g54.4\"")
        .replace("write_to = \"G55\"", further);
    let job = parse(&variables).unwrap();
    let spec = job.correction.unwrap();
    assert_eq!(
        (spec.write_to, spec.set),
        (WorkOffset::Extended(7), Some(3))
    );
    assert_eq!(parse(&write(&job).unwrap()).unwrap(), job);
    let no_set = fault(&siemens.replace("write_to = \"G55\"", further));
    assert_eq!(no_set.code, "bad_value");
    assert_at(&no_set, "set = 3");
    let no_place = fault(&siemens.replace("\"G55\"", "\"G58\""));
    assert_at(&no_place, "write_to = \"G58\"");
    assert!(no_place.message.contains("umi dialects"));
}

/// A misspelt field is shown where it stands, with the names that are allowed.
#[test]
fn an_unknown_field_is_shown_with_those_allowed() {
    let fault = fault(&with("rms_mm = 0.015", "rms = 0.015"));
    assert_eq!(fault.code, "job_syntax");
    assert_at(&fault, "rms = 0.015");
    for name in ["`rms`", "radius_error_mm", "registration_rms_mm"] {
        assert!(fault.message.contains(name), "{}", fault.message);
    }
}

/// An unknown word is shown with the words that are allowed.
#[test]
fn an_unknown_word_is_shown_with_those_allowed() {
    let fault = fault(&with("kind = \"sphere\"", "kind = \"ball\""));
    assert_at(&fault, "\"ball\"");
    for name in ["ball", "sphere", "cylinder", "cone"] {
        assert!(fault.message.contains(name), "{}", fault.message);
    }
}

/// One entry too many in a list with a fixed number of places is told with that number.
#[test]
fn one_entry_too_many_is_told_with_the_places() {
    let fixed = "[guards]\nfixed = [\"A\", \"B\", \"C\"]\n\n[limits]\n";
    let fault = fault(&with("[limits]\n", fixed));
    assert_eq!(fault.code, "job_syntax");
    assert_at(&fault, "[\"A\", \"B\", \"C\"]");
    assert!(
        fault.message.contains("at most 2 here"),
        "{}",
        fault.message
    );
}

/// Broken TOML is shown where it breaks.
#[test]
fn broken_toml_is_shown_where_it_breaks() {
    let fault = fault(&with("plate_timeout_s = 1800", "plate_timeout_s = 18 00"));
    assert_eq!(fault.code, "job_syntax");
    assert_eq!(
        fault.place.unwrap().text.split('=').next().unwrap().trim(),
        "plate_timeout_s"
    );
}

/// Text that is too long for the board is refused, not cut.
#[test]
fn long_names_are_refused() {
    let fault = fault(&with(
        "name = \"SPHERE1\"",
        "name = \"SPHERE1-OF-A-LONG-PLATE\"",
    ));
    assert_at(&fault, "\"SPHERE1-OF-A-LONG-PLATE\"");
}

/// What the brain refuses is shown at the field in the file, with what is allowed.
#[test]
fn what_the_brain_refuses_is_shown_in_the_file() {
    for (old, new, code, at, allowed) in [
        (
            "rms_mm = 0.015",
            "rms_mm = -0.015",
            "bad_value",
            "rms_mm",
            "above 0",
        ),
        (
            "tilt_deg = 0.010",
            "tilt_deg = nan",
            "bad_value",
            "tilt_deg",
            "degrees above 0",
        ),
        (
            "plate_timeout_s = 1800",
            "plate_timeout_s = 0",
            "bad_value",
            "plate_timeout_s",
            "1 or more",
        ),
        (
            "program_number = 9010",
            "program_number = 0",
            "bad_value",
            "program_number",
            "1 to 9999",
        ),
        ("hits = 5", "hits = 3", "hit_count", "hits", "needs 5 to 64"),
        (
            "\"-z\", \"-x\", \"+x\"",
            "\"-z\", \"-x\"",
            "approach_count",
            "approach",
            "one for each",
        ),
        (
            "name = \"SPHERE2\"",
            "name = \"SPHERE1\"",
            "duplicate_feature",
            "name",
            "unique",
        ),
        (
            "name = \"THREE SPHERES\"",
            "name = \"(1)\"",
            "bad_name",
            "name",
            "A-Z",
        ),
        (
            "compensation = \"in_macro\"",
            "compensation = { on_board = { tip_radius_mm = 1.0, pretravel_mm = [0.0, 0.0, 2.0] } }",
            "bad_value",
            "pretravel_mm",
            "less than `tip_radius_mm`",
        ),
    ] {
        let fault = fault(&with(old, new));
        assert_eq!(fault.code, code, "{new}: {}", fault.message);
        assert_at(&fault, at);
        assert!(fault.message.contains(allowed), "{new}: {}", fault.message);
    }
}

/// What the receiver refuses is shown at its pattern or field, in the receiver's words.
#[test]
fn what_the_receiver_refuses_is_shown_in_the_file() {
    for (old, new, at, words) in [
        (
            "integer_digits = 4",
            "integer_digits = 40",
            "{ block",
            "pattern 1: format needs 1 to 15 digits",
        ),
        (
            "{ block = { headers = [\"SPHERE\"], format = { integer_digits = 4, decimals = 4 } } },",
            "\"grbl_probe\",\n    { template = { text = \"{x} {why}\" } },",
            "{ template",
            "pattern 2: an unknown field; there are {x} {y} {z}",
        ),
        (
            "idle_timeout_s = 300",
            "idle_timeout_s = 0",
            "idle_timeout_s",
            "longest silence",
        ),
        (
            "z = [0.0, 400.0]",
            "z = [400.0, 0.0]",
            "travel_mm",
            "travel_mm of z",
        ),
    ] {
        let fault = fault(&with(old, new));
        assert_eq!(fault.code, "bad_value", "{}", fault.message);
        assert!(fault.message.contains(words), "{}", fault.message);
        assert_at(&fault, at);
    }
}

/// A value that is missing is reported at the feature that needs it.
#[test]
fn a_missing_value_is_shown_at_its_feature() {
    let given = with("reference = \"taught\"", "reference = \"given\"");
    let place = given
        .lines()
        .find(|line| line.starts_with("position_mm"))
        .unwrap();
    let text = given.replacen(&format!("{place}\n"), "", 1);
    let fault = fault(&text);
    assert_eq!(fault.code, "missing");
    let place = fault.place.unwrap();
    let first = text
        .lines()
        .position(|line| line == "[[features]]")
        .unwrap()
        + 1;
    assert!(
        (first..first + 3).contains(&place.line),
        "line {}",
        place.line
    );
}

/// The mark stands under the column, also behind wider characters.
#[test]
fn the_mark_stands_under_the_column() {
    let source = "a = 1\nµ = 22\n";
    let place = TextPlace::of(source, &(source.find("22").unwrap()..source.len()));
    assert_eq!((place.line, place.column), (2, 5));
    assert_eq!(place.to_string(), "2 | µ = 22\n        ^");
}

/// A guard that lacks something elsewhere in the job says what, and a variable that cannot count
/// is refused by what it is.
#[test]
fn a_guard_says_what_it_lacks() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../examples/three-spheres-run.toml"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let (without, _) = text.split_once("[correction]").unwrap();
    let no_correction = fault(without);
    assert!(
        no_correction
            .message
            .starts_with("`guards.run_variable` needs a [correction]: its `dialect` says"),
        "{}",
        no_correction.message
    );
    assert_at(&no_correction, "run_variable = 531");
    let frame = without.replace("run_variable = 531", "#");
    let frame = fault(&frame);
    assert!(
        frame
            .message
            .starts_with("`guards.frame` needs a [correction]: it says in which"),
        "{}",
        frame.message
    );
    assert_at(&frame, "frame = true");
    let no_lines = fault(&text.replace("{ checked = {} },", ""));
    assert!(
        no_lines.message.contains("{ checked = {} }"),
        "{}",
        no_lines.message
    );
    let grbl = fault(&text.replace("\"g10-g68\"", "\"grbl\""));
    assert!(grbl.message.contains("grbl"), "{}", grbl.message);
    // Each of these counts elsewhere.
    for (dialect, variable, why) in [
        ("siemens", 1000, "no R parameter"),
        ("heidenhain", 531, "no QR parameter"),
        ("haas-e", 532, "none that O8830 compares"),
        ("variables", 33, "local variable"),
    ] {
        let with = |number: u32| {
            text.replace("\"g10-g68\"", &format!("\"{dialect}\""))
                .replace("run_variable = 531", &format!("run_variable = {number}"))
        };
        let refused = fault(&with(variable));
        assert!(
            refused.message.contains(why),
            "{dialect}: {}",
            refused.message
        );
        let good = if dialect == "heidenhain" { 31 } else { 531 };
        parse(&with(good)).unwrap();
    }
    for (number, why) in [
        ("0", "local"),
        ("31", "local variable"),
        ("50", "no common variable"),
        ("150", "cleared when the control is switched off"),
        ("5221", "system variable"),
        ("100000", "system variable"),
    ] {
        let refused =
            fault(&text.replace("run_variable = 531", &format!("run_variable = {number}")));
        assert_eq!(refused.code, "bad_value");
        assert!(
            refused.message.contains(why),
            "{number}: {}",
            refused.message
        );
        assert_at(&refused, "run_variable");
    }
    let typed = fault(&text.replace("run_variable = 531", "run_variable = true"));
    assert!(
        typed
            .message
            .ends_with("expected a whole number, 0 or more"),
        "{}",
        typed.message
    );
    let typed = fault(&text.replace("frame = true", "frame = 1"));
    assert!(
        typed.message.ends_with("expected true or false"),
        "{}",
        typed.message
    );
}

/// Nothing becomes the reference because it came first, unless the file says so; where a session
/// is over, nobody can be asked, and the first one is taken.
#[test]
fn a_job_that_does_not_say_teach_is_asked() {
    let says = example();
    assert_eq!(parse(&says).unwrap().teach, Teach::FirstOk);
    let mute: String = says
        .split_inclusive('\n')
        .filter(|l| !l.starts_with("teach"))
        .collect();
    assert_eq!(parse(&mute).unwrap().teach, Teach::Asked);
    let (measures, _) = mute.split_once("[correction]").unwrap();
    assert_eq!(
        parse(measures).unwrap().teach,
        Teach::Asked,
        "programs move by it"
    );
    // Nothing is registered and nothing moves.
    let two = measures.replace(
        "name = \"SPHERE3\"\n",
        "name = \"SPHERE3\"\ndatum = false\n",
    );
    assert_eq!(parse(&two).unwrap().teach, Teach::FirstOk);
    let given = mute.replace("reference = \"taught\"", "reference = \"given\"");
    assert_eq!(parse(&given).unwrap().teach, Teach::FirstOk);

    let file = std::env::temp_dir().join(format!("umi-mute-{}.toml", std::process::id()));
    std::fs::write(&file, &mute).unwrap();
    let session = load_for_session(&file).unwrap();
    assert!(session.teach_is_missing && session.job.teach == Teach::FirstOk);
    std::fs::write(
        &file,
        mute.replace("reference =", "teach = \"asked\"\nreference ="),
    )
    .unwrap();
    let session = load_for_session(&file).unwrap();
    assert!(!session.teach_is_missing && session.job.teach == Teach::Asked);
    std::fs::remove_file(&file).unwrap();
}
